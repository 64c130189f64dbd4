use super::*;
use camrig_base::{Cfa, RawFrame};
use camrig_formats::DngInfo;
use camrig_sensor_core::config::FrameSettings;
use std::io::{Read, Write};
use std::sync::Mutex;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// A desk that remembers what it was asked.
#[derive(Clone, Default)]
struct Notebook(Arc<Mutex<Vec<String>>>);

impl Desk for Notebook {
    fn order(&self, order: Order) -> Result<()> {
        self.0.lock().unwrap().push(format!("{order:?}"));
        Ok(())
    }

    fn save(&self, frame: &Frame) -> Result<String> {
        self.0.lock().unwrap().push(format!("save {}", frame.number));
        Ok("x.dng".into())
    }
}

struct Served {
    address: SocketAddr,
    token: String,
    shared: Arc<Shared>,
    desk: Notebook,
}

fn serve() -> Served {
    let page = View::listen("127.0.0.1:0").unwrap();
    let (address, token) = (page.address, page.guard.secret().to_string());
    let (shared, desk) = (Arc::new(Shared::default()), Notebook::default());
    page.serve(shared.clone(), desk.clone());
    Served { address, token, shared, desk }
}

fn frame(number: u64, dn: [u16; 4]) -> Frame {
    let header = serde_json::json!({
        "width": 2, "height": 2, "first_band_nm": 400.0, "band_step_nm": 10.0, "bands": 1,
        "made_of": "nothing",
    });
    Frame {
        number,
        raw: RawFrame {
            width: 2,
            height: 2,
            bits: 10,
            cfa: Cfa::parse("RGGB").unwrap(),
            black_level_dn: 42.0,
            white_level_dn: 1023,
            data: dn.to_vec(),
        },
        settings: FrameSettings::new(0.01).with_temperature(20.0),
        counter: 1,
        injected: None,
        light: Arc::new(Light {
            illuminant: None,
            header: serde_json::from_value(header).unwrap(),
            info: DngInfo::default(),
        }),
    }
}

impl Served {
    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream
    }

    fn answer(&self, request: &str) -> String {
        let mut stream = self.connect();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        answer
    }

    fn page(&self) -> String {
        self.answer(&format!("GET / HTTP/1.1\r\nHost: {}\r\n\r\n", self.address))
    }

    fn open(&self) -> WebSocket<TcpStream> {
        let mut request = format!("ws://{}/socket", self.address).into_client_request().unwrap();
        let protocols = format!("camrig, {}", self.token).parse().unwrap();
        request.headers_mut().insert("Sec-WebSocket-Protocol", protocols);
        tungstenite::client(request, self.connect()).unwrap().0
    }

    fn push(&self, frame: Frame) {
        let (number, period_ms) = (frame.number, 40.0);
        let timing = Timing { frame: number, at_s: number as f64, period_ms, late: false };
        self.shared.change(|state| {
            state.count(timing);
            state.newest = Some(Arc::new(frame));
        });
    }
}

/// The text and the samples of a message.
fn parts(message: &Message) -> (serde_json::Value, Vec<u16>) {
    let Message::Binary(bytes) = message else { panic!("{message:?}") };
    let (length, rest) = bytes.split_first_chunk().unwrap();
    let (text, samples) = rest.split_at(u32::from_le_bytes(*length) as usize);
    let samples = samples.as_chunks().0.iter().map(|dn| u16::from_le_bytes(*dn)).collect();
    (serde_json::from_slice(text).unwrap(), samples)
}

fn ask(socket: &mut WebSocket<TcpStream>, text: &str) -> (serde_json::Value, Vec<u16>) {
    socket.send(Message::text(text)).unwrap();
    parts(&socket.read().unwrap())
}

#[test]
fn a_page_is_sent_frames_as_it_asks_and_its_orders_are_passed_on() {
    let served = serve();
    let mut socket = served.open();
    served.push(frame(1, [100, 200, 300, 1023]));
    let (told, samples) = ask(&mut socket, r#"{"next":{"seen":0,"event":0,"pixels":true}}"#);
    assert_eq!(samples, [100, 200, 300, 1023]);
    assert_eq!((told["frames"].as_u64(), told["frame"]["bits"].as_u64()), (Some(1), Some(10)));
    assert_eq!(told["frame"]["black_dn"][3], 42.0);
    assert_eq!(told["frame"]["cfa"]["letters"], "RGGB");
    assert_eq!(told["times"].as_array().unwrap().len(), 1);
    // A frozen page gets figures, and what it shows is what is saved.
    served.push(frame(2, [0; 4]));
    let (told, samples) = ask(&mut socket, r#"{"next":{"seen":1,"event":0,"pixels":false}}"#);
    assert!(samples.is_empty() && told["frame"].is_null() && told["frames"] == 2, "{told}");
    socket.send(Message::text("\"save\"")).unwrap();
    socket.send(Message::text(r#"{"set":{"exposure_s":0.02}}"#)).unwrap();
    socket.send(Message::text(r#"{"set":{"exposure_s":-1}}"#)).unwrap();
    let events = |told: &serde_json::Value| {
        let events = told["events"].as_array().unwrap().clone();
        events.iter().map(|e| e["text"].as_str().unwrap().to_string()).collect::<Vec<_>>()
    };
    let mut told = told;
    for _ in 0..20 {
        told = ask(&mut socket, r#"{"next":{"seen":2,"event":0,"pixels":true}}"#).0;
        if events(&told).len() == 2 {
            break;
        }
    }
    let said = events(&told);
    assert!(said[0].contains("frame 1 saved: x.dng") && said[1].contains("above 0"), "{said:?}");
    assert_eq!(*served.desk.0.lock().unwrap(), ["save 1", "ExposureS(0.02)"]);
}

#[test]
fn who_breaks_the_rules_of_the_socket_is_put_out() {
    let served = serve();
    for message in [
        Message::text("x"),
        Message::text("x".repeat(10_000)),
        Message::binary(vec![1]),
        Message::text("{\"set\":{\"fault\":1}}"),
    ] {
        let mut socket = served.open();
        socket.send(message).unwrap();
        let end = (0..5).find_map(|_| socket.read().err());
        assert!(end.is_some(), "it goes on");
    }
    assert!(served.desk.0.lock().unwrap().is_empty());
}

#[test]
fn requests_that_never_end_do_not_hold_up_others_and_are_bounded() {
    let served = serve();
    let halves: Vec<TcpStream> = (0..MAX_CONNECTIONS - 2)
        .map(|_| {
            let mut stream = served.connect();
            stream.write_all(b"GET / HTTP/1.1\r\nHost: ").unwrap();
            stream
        })
        .collect();
    assert!(served.page().starts_with("HTTP/1.1 200"), "there is room left");
    let more: Vec<TcpStream> = (0..4).map(|_| served.connect()).collect();
    let until = Instant::now() + Duration::from_secs(20);
    while served.page().starts_with("HTTP/1.1 200") {
        assert!(Instant::now() < until, "connections have no bound");
    }
    drop((halves, more));
    while !served.page().starts_with("HTTP/1.1 200") {
        assert!(Instant::now() < until, "there is no room again");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn heads_that_are_none_or_too_long_are_refused() {
    let served = serve();
    let host = served.address;
    let long = format!("GET / HTTP/1.1\r\nHost: {host}\r\nX: {}\r\n\r\n", "x".repeat(20_000));
    let many = format!("GET / HTTP/1.1\r\nHost: {host}\r\n{}\r\n", "X: y\r\n".repeat(100));
    for (request, status) in
        [("\u{1}\u{2}\r\n\r\n", "400"), (many.as_str(), "431"), ("GET / HTTP/1.1\r\n\r\n", "403")]
    {
        let answer = served.answer(request);
        assert_eq!(answer.split(' ').nth(1), Some(status), "{request:.40}: {answer}");
    }
    // The connection may be reset while the rest of it is still coming.
    let answer = served.answer(&long);
    assert!(answer.is_empty() || answer.contains("431"), "{answer}");
}

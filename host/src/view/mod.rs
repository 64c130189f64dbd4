//! A live page of a rig: a small HTTP server on this machine.
//!
//! # Who may use it
//! Other pages in the same browser, and other programs' pages on this machine, must not drive the
//! rig:
//! - it listens on the loopback interface unless told otherwise;
//! - every request must name this server in `Host` (a name rebound to 127.0.0.1 does not pass),
//!   and its `Origin`, where a browser sends one, must be this page's;
//! - everything but the page itself needs the token, in a header that other origins cannot send
//!   without a permission that is never given. The token comes with the address that is printed,
//!   in its fragment, which browsers do not send on.

mod state;

pub use state::{State, Told};

use camrig_base::{Error, Result};
use camrig_rig::Token;
use serde::Deserialize;
use std::io::Read;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, mpsc};
use tiny_http::{Header, Method, Request, Response, Server};

/// What the page asks of the rig.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Control {
    /// Exposure to write, s.
    pub exposure_s: Option<f64>,
    /// Gain to write.
    pub analog_gain: Option<f64>,
}

impl Control {
    fn is_in_range(&self) -> bool {
        let ok = |v: Option<f64>, most: f64| v.is_none_or(|v| v > 0.0 && v <= most);
        ok(self.exposure_s, LONGEST_EXPOSURE_S) && ok(self.analog_gain, LARGEST_GAIN)
    }
}

/// Longest exposure that the page may ask for, s. A trade: long enough for any bench, and a slip
/// of the hand does not stop the stream for hours.
const LONGEST_EXPOSURE_S: f64 = 60.0;
/// Largest gain that the page may ask for: the whole numbers of the rig's gain code, which has 16
/// bits in steps of 1/256.
const LARGEST_GAIN: f64 = 255.0;
/// Longest request body, bytes: far more than a [`Control`] has.
const LONGEST_BODY: u64 = 4096;
/// The token's header.
const TOKEN: &str = "X-Camrig-Token";

/// The server of the page.
pub struct View {
    server: Arc<Server>,
    address: SocketAddr,
    token: Token,
}

impl View {
    /// Listens on an address.
    ///
    /// # Errors
    /// An address at which this machine cannot listen.
    pub fn listen(address: &str) -> Result<Self> {
        let failed = |why: String| {
            Error::device(format!("cannot listen: {why}"))
                .at(address)
                .help("give an address of this machine and a free port, for instance 127.0.0.1:0")
        };
        let server = Server::http(address).map_err(|e| failed(e.to_string()))?;
        let ip = server.server_addr().to_ip().ok_or_else(|| failed("no address".into()))?;
        Ok(Self { server: Arc::new(server), address: ip, token: Token::random()? })
    }

    /// Where the page is, its token included.
    pub fn url(&self) -> String {
        format!("http://{}/#{}", self.address, self.token.secret())
    }

    /// Answers requests until the process ends. What the page asks of the rig goes to `controls`.
    ///
    /// Each request has a thread of its own, as its connection has in the server: an answer waits
    /// for the request's body, which may never come, and for a client that may never read.
    pub fn serve(self, state: Arc<Mutex<State>>, controls: mpsc::Sender<Control>) {
        let page = Arc::new(self);
        std::thread::spawn(move || {
            for request in page.server.incoming_requests() {
                let (page, state, controls) = (page.clone(), state.clone(), controls.clone());
                // Where there is no thread left, the connection is closed.
                let _ = std::thread::Builder::new()
                    .spawn(move || page.answer(request, &state, &controls));
            }
        });
    }

    fn answer(
        &self,
        mut request: Request,
        state: &Mutex<State>,
        controls: &mpsc::Sender<Control>,
    ) {
        let response = match self.refusal(&request) {
            Some((status, why)) => text(status, why),
            None => self.page(&mut request, state, controls),
        };
        // A browser that has gone does not want the answer.
        let _ = request.respond(response);
    }

    /// Why a request is not answered.
    fn refusal(&self, request: &Request) -> Option<(u16, &'static str)> {
        let mut hosts = request.headers().iter().filter(|h| h.field.equiv("Host"));
        let host = hosts.next().map(|h| h.value.as_str().to_string()).unwrap_or_default();
        if hosts.next().is_some() || !self.is_own(&host) {
            return Some((403, "this is not the address of this page"));
        }
        let foreign =
            |h: &&Header| h.field.equiv("Origin") && h.value.as_str() != format!("http://{host}");
        if request.headers().iter().any(|h| foreign(&h)) {
            return Some((403, "another page may not ask this"));
        }
        let api = request.url().starts_with("/api/");
        let token = request.headers().iter().find(|h| h.field.equiv(TOKEN));
        if api && !token.is_some_and(|t| self.token.is(t.value.as_str().as_bytes())) {
            return Some((
                403,
                "the token is missing or wrong: open the address that camrig printed",
            ));
        }
        None
    }

    /// Whether a Host header names this server.
    fn is_own(&self, host: &str) -> bool {
        let port = self.address.port();
        host == self.address.to_string()
            || self.address.ip().is_loopback()
                && ["localhost", "127.0.0.1", "[::1]"]
                    .iter()
                    .any(|n| host == format!("{n}:{port}"))
    }

    fn page(
        &self,
        request: &mut Request,
        state: &Mutex<State>,
        controls: &mpsc::Sender<Control>,
    ) -> Answer {
        let url = request.url().to_string();
        let (path, query) = url.split_once('?').unwrap_or((&url, ""));
        let number = |key: &str| {
            query.split('&').find_map(|p| p.strip_prefix(key)?.strip_prefix('=')?.parse().ok())
        };
        // A thread that panicked has left the figures as they were.
        let state = || state.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        match (request.method(), path) {
            (Method::Get, "/") => data("text/html; charset=utf-8", include_bytes!("page.html")),
            (Method::Get, "/view.js") => data("text/javascript", include_bytes!("view.js")),
            (Method::Get, "/view.css") => data("text/css", include_bytes!("view.css")),
            (Method::Get, "/api/state") => {
                let json = state().json(number("row"), number("column")).to_string();
                data("application/json", json.as_bytes())
            }
            (Method::Get, "/api/frame.png") => picture(state().picture()),
            (Method::Get, "/api/noise.png") => picture(state().noise_picture()),
            (Method::Post, "/api/control") => {
                let mut body = Vec::new();
                let read = request.as_reader().take(LONGEST_BODY + 1).read_to_end(&mut body);
                if read.is_err() || body.len() as u64 > LONGEST_BODY {
                    return text(413, "too long");
                }
                match serde_json::from_slice::<Control>(&body) {
                    Ok(control) if control.is_in_range() => match controls.send(control) {
                        Ok(()) => data("application/json", b"{}"),
                        Err(_) => text(409, "the stream has ended"),
                    },
                    _ => text(
                        400,
                        "use {\"exposure_s\": 0.01, \"analog_gain\": 2.0}: above zero, at most 60 \
                         s and a gain of 255",
                    ),
                }
            }
            (_, "/" | "/view.js" | "/view.css" | "/api/state" | "/api/frame.png") => {
                text(405, "only GET")
            }
            (_, "/api/control") => text(405, "only POST"),
            _ => text(404, "nothing is here"),
        }
    }
}

type Answer = Response<std::io::Cursor<Vec<u8>>>;

fn data(kind: &str, bytes: &[u8]) -> Answer {
    let headers = [
        ("Content-Type", kind),
        ("Cache-Control", "no-store"),
        ("X-Content-Type-Options", "nosniff"),
        ("X-Frame-Options", "DENY"),
        ("Referrer-Policy", "no-referrer"),
        ("Cross-Origin-Resource-Policy", "same-origin"),
        (
            "Content-Security-Policy",
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
             connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        ),
    ];
    let mut response = Response::from_data(bytes);
    for (name, value) in headers {
        if let Ok(header) = Header::from_bytes(name, value) {
            response.add_header(header);
        }
    }
    response
}

fn text(status: u16, why: &str) -> Answer {
    data("text/plain; charset=utf-8", why.as_bytes()).with_status_code(status)
}

fn picture(picture: Result<Option<Vec<u8>>>) -> Answer {
    match picture {
        Ok(Some(png)) => data("image/png", &png),
        Ok(None) => text(404, "not yet"),
        Err(error) => text(500, &error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_formats::DngInfo;
    use std::io::Write;
    use std::net::TcpStream;
    use std::time::Duration;

    #[test]
    fn a_request_whose_body_never_comes_does_not_hold_up_others() {
        let page = View::listen("127.0.0.1:0").unwrap();
        let (address, token) = (page.address, page.token.secret().to_string());
        let (sender, _controls) = mpsc::channel();
        page.serve(Arc::new(Mutex::new(State::new(DngInfo::default()))), sender);
        let connect = |request: String| {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
            stream.write_all(request.as_bytes()).unwrap();
            stream
        };
        let post = |headers: &str, body: &str| {
            connect(format!(
                "POST /api/control HTTP/1.1\r\nHost: {address}\r\n{headers}\
                 Content-Length: 300000\r\n\r\n{body}"
            ))
        };
        let _stuck = [post("", ""), post("", "{"), post(&format!("{TOKEN}: {token}\r\n"), "{")];
        let mut answer = String::new();
        let headers = format!("Host: {address}\r\n{TOKEN}: {token}\r\nConnection: close");
        connect(format!("GET /api/state HTTP/1.1\r\n{headers}\r\n\r\n"))
            .read_to_string(&mut answer)
            .unwrap();
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    }
}

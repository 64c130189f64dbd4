//! Frames of 640 x 480 pixels of three floats through a socket (`camrig-frames/1`), beside the bare
//! socket and copying the same bytes in the same run.
//!
//! `cargo bench -p camrig-benches --bench frames`. A thread writes the messages as fast as they are
//! taken; all is counted from the first frame to the last, in frames per second. "Taken" is a frame
//! whose bytes are in memory, checked; "a picture" one whose samples have been read as a scene.

use camrig::scene_files::sequence::{self, Reading};
use camrig_benches::scene_frames::{Kind, header};
use std::hint::black_box;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::time::{Duration, Instant};

const SIZE: [u32; 2] = [640, 480];
const FRAMES: u64 = 200;
const PAYLOAD: usize = 4 * 3 * 640 * 480;

fn main() {
    let folder = std::env::temp_dir().join(format!("camrig-frames-{}", std::process::id()));
    std::fs::create_dir(&folder).expect("a folder");
    println!("copying: {:.0} frames/s", best(copied));
    for (name, socket) in SOCKETS {
        let bare = best(|| bare(socket(&folder.join("bare"))));
        let taken = best(|| received(socket(&folder.join("taken")), false));
        let opened = best(|| received(socket(&folder.join("opened")), true));
        println!("{name}: bare {bare:.0}, taken {taken:.0}, a picture {opened:.0} frames/s");
    }
    std::fs::remove_dir_all(&folder).expect("the folder goes");
}

/// The highest of a few rates.
fn best(mut rate: impl FnMut() -> f64) -> f64 {
    (0..3).map(|_| rate()).fold(0.0, f64::max)
}

fn rate(begin: Instant, frames: u64) -> f64 {
    frames as f64 / begin.elapsed().as_secs_f64()
}

/// Copies payloads in memory.
fn copied() -> f64 {
    let (from, mut to) = (vec![1u8; PAYLOAD], vec![0u8; PAYLOAD]);
    let begin = Instant::now();
    for _ in 0..FRAMES {
        to.copy_from_slice(black_box(&from));
        black_box(&to);
    }
    rate(begin, FRAMES)
}

/// Writes all messages.
fn write(mut to: impl Write) {
    let payload = 0.5f32.to_le_bytes().repeat(PAYLOAD / 4);
    for number in 0..=FRAMES {
        to.write_all(&header(number, Some((SIZE, Kind::Floats)))).expect("a reader");
        to.write_all(&payload).expect("a reader");
    }
    let _ = to.write_all(&header(FRAMES + 1, None));
}

/// A socket of one kind: how camrig names it, who listens, and who connects.
struct Socket {
    spec: String,
    accept: Box<dyn FnOnce() -> Box<dyn Read>>,
    connect: Box<dyn Fn() -> std::io::Result<Box<dyn Write>> + Send>,
}

/// Makes a socket, at a path where it needs one.
type Opener = fn(&Path) -> Socket;

/// The kinds of sockets that this system has.
const SOCKETS: &[(&str, Opener)] = &[
    ("TCP", tcp),
    #[cfg(unix)]
    ("Unix socket", unix),
];

fn tcp(_: &Path) -> Socket {
    let free = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr();
    let place = free.expect("an address");
    Socket {
        spec: format!("tcp://{place}"),
        accept: Box::new(move || {
            Box::new(TcpListener::bind(place).expect("a port").accept().expect("a writer").0)
        }),
        connect: Box::new(move || Ok(Box::new(TcpStream::connect(place)?))),
    }
}

#[cfg(unix)]
fn unix(path: &Path) -> Socket {
    use std::os::unix::net::{UnixListener, UnixStream};
    let _ = std::fs::remove_file(path);
    let (here, there) = (path.to_owned(), path.to_owned());
    Socket {
        spec: format!("unix:{}", path.display()),
        accept: Box::new(move || {
            Box::new(UnixListener::bind(here).expect("a socket").accept().expect("a writer").0)
        }),
        connect: Box::new(move || Ok(Box::new(UnixStream::connect(&there)?))),
    }
}

/// Connects as soon as somebody listens, and writes.
fn write_to(connect: Box<dyn Fn() -> std::io::Result<Box<dyn Write>> + Send>) {
    std::thread::spawn(move || {
        loop {
            match connect() {
                Ok(to) => return write(to),
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        }
    });
}

/// Reads the messages' bytes into one buffer.
fn bare(socket: Socket) -> f64 {
    write_to(socket.connect);
    let mut from = (socket.accept)();
    let mut message = vec![0; 256 + PAYLOAD];
    from.read_exact(&mut message).expect("a frame");
    let begin = Instant::now();
    for _ in 0..FRAMES {
        from.read_exact(&mut message).expect("a frame");
        black_box(&message);
    }
    rate(begin, FRAMES)
}

/// Takes the frames as camrig does.
fn received(socket: Socket, open: bool) -> f64 {
    write_to(socket.connect);
    let opened = sequence::open(&socket.spec, &Reading::default()).expect("a stream");
    let mut frames = opened.expect("a sequence");
    frames.next_frame().expect("a frame");
    let begin = Instant::now();
    for _ in 0..FRAMES {
        let frame = frames.next_frame().expect("a frame").expect("not the end");
        if open {
            black_box(frame.open().expect("a picture").size());
        } else {
            black_box(frame.number);
        }
    }
    rate(begin, FRAMES)
}

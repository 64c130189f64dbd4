//! The console: a live page of a rig.
//!
//! # Frames
//! The streaming thread puts its newest frame and figures into [`Shared`] and never waits. A
//! browser asks for the next frame over a WebSocket once it has drawn the last one, so a slow one
//! sees fewer frames. Raw samples are sent; the page develops, measures and plots them itself,
//! even while it is frozen.
//!
//! # Access
//! Other pages in the same browser, and other programs' pages on this machine, must not control the
//! rig:
//! - it listens on the loopback interface by default;
//! - every request must name this server in `Host` (a name rebound to 127.0.0.1 does not pass),
//!   and its `Origin`, if a browser sends one, must be this page's;
//! - the WebSocket needs the token. It is in the fragment of the printed address, which browsers do
//!   not transmit.
//!
//! # Resources
//! Each connection has a thread, and there are at most [`MAX_CONNECTIONS`]. Request heads and
//! messages are short, and clients that neither read nor write are dropped.

mod assets;
mod guard;
mod http;
mod message;
mod order;
mod socket;
mod state;

pub use order::Order;
pub use state::{
    Frame, Light, Progress, Recording, Register, Settings, Shared, Source, State, Status, Timing,
};

use camrig_base::{Error, Result};
use guard::Guard;
use http::{Head, Refusal};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Maximum number of connections. A browser tab has one for frames and up to six while it loads.
pub const MAX_CONNECTIONS: usize = 32;
/// Time limit for a request's head. A trade-off: enough for slow networks, and a stuck client soon
/// makes room.
const HEAD_PATIENCE: Duration = Duration::from_secs(10);
/// Time limit for a client to read bytes sent to it.
const WRITE_PATIENCE: Duration = Duration::from_secs(10);
/// Pause after a failed `accept`.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Carries out the page's requests.
pub trait Desk: Send + Sync {
    /// Passes an order, whose values are in range, to the stream.
    ///
    /// # Errors
    /// An order that is not accepted.
    fn order(&self, order: Order) -> Result<()>;

    /// Saves a frame; returns its place.
    ///
    /// # Errors
    /// A file that cannot be written.
    fn save(&self, frame: &Frame) -> Result<String>;
}

/// The server of the page.
pub struct View {
    listener: TcpListener,
    address: SocketAddr,
    guard: Guard,
}

/// State shared by all connections.
struct Console {
    guard: Guard,
    shared: Arc<Shared>,
    desk: Box<dyn Desk>,
    connections: AtomicUsize,
}

/// A connection that is counted until it ends.
struct Counted(Arc<Console>);

impl View {
    /// Listens on an address.
    ///
    /// # Errors
    /// An address at which this machine cannot listen.
    pub fn listen(address: &str) -> Result<Self> {
        let failed = |why: std::io::Error| {
            Error::device(format!("cannot listen: {why}"))
                .at(address)
                .help("give an address of this machine and a free port, for instance 127.0.0.1:0")
        };
        let listener = TcpListener::bind(address).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        Ok(Self { listener, address, guard: Guard::new(address)? })
    }

    /// Address of the page, with its token.
    pub fn url(&self) -> String {
        format!("http://{}/#{}", self.address, self.guard.secret())
    }

    /// Answers requests until the process ends.
    pub fn serve(self, shared: Arc<Shared>, desk: impl Desk + 'static) {
        let console = Console {
            guard: self.guard,
            shared,
            desk: Box::new(desk),
            connections: AtomicUsize::new(0),
        };
        let console = Arc::new(console);
        std::thread::spawn(move || {
            for stream in self.listener.incoming() {
                match stream {
                    Ok(stream) => console.clone().accept(stream),
                    Err(_) => std::thread::sleep(ACCEPT_PAUSE),
                }
            }
        });
    }
}

impl Console {
    /// Answers a connection on a thread of its own. If there are too many, or no thread can be
    /// started, it is closed.
    fn accept(self: Arc<Self>, stream: TcpStream) {
        let taken = self.connections.fetch_add(1, Ordering::Relaxed);
        let counted = Counted(self);
        if taken < MAX_CONNECTIONS {
            let _ = std::thread::Builder::new().spawn(move || counted.0.answer(stream));
        }
    }

    fn answer(&self, mut stream: TcpStream) {
        // What fails here fails with the first byte.
        let _ = stream.set_nodelay(true);
        let _ = stream.set_write_timeout(Some(WRITE_PATIENCE));
        let head = Head::read(&mut stream, Instant::now() + HEAD_PATIENCE);
        let sent = match head.and_then(|head| self.guard.check(&head).map(|()| head)) {
            Ok(head) if head.path == "/socket" => return socket::serve(stream, head, self),
            Ok(head) if head.method != "GET" => {
                Refusal(405, "only GET is allowed").send(&mut stream)
            }
            Ok(head) => match assets::find(&head.path) {
                Some(asset) => asset.send(&mut stream, head.only("Host").unwrap_or_default()),
                None => Refusal(404, "not found").send(&mut stream),
            },
            Err(refusal) => refusal.send(&mut stream),
        };
        // A browser that has gone does not want the answer.
        let _ = sent;
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.connections.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests;

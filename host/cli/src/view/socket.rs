//! A browser's WebSocket: it asks, the server answers. See [`super`].

use super::Console;
use super::http::{Head, Refusal};
use super::message;
use super::order::{Ask, Next};
use super::state::Frame;
use camrig_base::{Error, Result};
use std::io::Write;
use std::net::TcpStream;
use std::sync::Arc;
use std::time::Duration;
use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Message, WebSocket};

/// Longest message of a page, bytes: far more than an order needs.
const LONGEST_MESSAGE: usize = 4096;
/// Time after which a silent page is dropped. A page asks several times per second; tabs in the
/// background are slowed down to once a minute.
const READ_PATIENCE: Duration = Duration::from_secs(150);
/// Longest wait for something new. A trade-off: a page soon sees that the server is there, and a
/// stalled rig costs little.
const NEWS_PATIENCE: Duration = Duration::from_millis(250);
/// The WebSocket protocol; the token is another one that the page names.
const PROTOCOL: &str = "camrig";

/// Serves a page until it disconnects.
pub fn serve(mut stream: TcpStream, head: Head, console: &Console) {
    let key = match console.guard.check_token(&head).and_then(|()| key(&head)) {
        Ok(key) => derive_accept_key(key.as_bytes()),
        Err(refusal) => {
            let _ = refusal.send(&mut stream);
            return;
        }
    };
    let accepted = format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Accept: {key}\r\nSec-WebSocket-Protocol: {PROTOCOL}\r\n\r\n"
    );
    let ready = stream.write_all(accepted.as_bytes());
    if ready.and_then(|()| stream.set_read_timeout(Some(READ_PATIENCE))).is_err() {
        return;
    }
    let config = WebSocketConfig::default()
        .max_message_size(Some(LONGEST_MESSAGE))
        .max_frame_size(Some(LONGEST_MESSAGE))
        .write_buffer_size(0);
    let socket = WebSocket::from_partially_read(stream, head.rest, Role::Server, Some(config));
    Page { socket, console, shown: None }.serve();
}

/// The key of a WebSocket's handshake (RFC 6455).
fn key(head: &Head) -> std::result::Result<&str, Refusal> {
    let says = |name, word| head.words(name).any(|w: &str| w.eq_ignore_ascii_case(word));
    let asked = head.method == "GET"
        && says("Upgrade", "websocket")
        && says("Connection", "upgrade")
        && head.only("Sec-WebSocket-Version") == Some("13")
        && says("Sec-WebSocket-Protocol", PROTOCOL);
    let refusal = Refusal(400, "this is the address of a WebSocket (RFC 6455), protocol camrig");
    head.only("Sec-WebSocket-Key").filter(|_| asked).ok_or(refusal)
}

/// A page being served.
struct Page<'a> {
    socket: WebSocket<TcpStream>,
    console: &'a Console,
    /// The frame whose samples were sent last, which the page shows.
    shown: Option<Arc<Frame>>,
}

impl Page<'_> {
    /// Answers until the page disconnects, breaks the protocol or is silent too long.
    fn serve(&mut self) {
        while let Ok(message) = self.socket.read() {
            let told = match message {
                Message::Text(text) => match serde_json::from_str::<Ask>(&text) {
                    Ok(ask) => self.obey(ask),
                    Err(_) => break,
                },
                Message::Binary(_) | Message::Close(_) => break,
                _ => Ok(()),
            };
            if told.is_err() {
                return;
            }
        }
        let _ = self.socket.close(None).and_then(|()| self.socket.flush());
    }

    fn obey(&mut self, ask: Ask) -> tungstenite::Result<()> {
        let said = match ask {
            Ask::Next(next) => return self.next(next),
            Ask::Save => self.save(),
            Ask::Set(order) => order.check().and_then(|()| self.console.desk.order(order)),
        };
        if let Err(error) = said {
            self.console.shared.change(|state| state.fault("page", &error));
        }
        Ok(())
    }

    fn save(&self) -> Result<()> {
        let none = || Error::input("no frame to save yet").help("wait for the first one");
        let frame = self.shown.as_ref().ok_or_else(none)?;
        let place = self.console.desk.save(frame)?;
        let number = frame.number;
        let note = format!("frame {number} saved: {place}");
        self.console.shared.change(|state| state.note("page", note));
        Ok(())
    }

    fn next(&mut self, next: Next) -> tungstenite::Result<()> {
        let (text, frame) = {
            let state = self.console.shared.news(next.seen, next.event, NEWS_PATIENCE);
            let frame = state.newest.clone().filter(|f| next.pixels && f.number > next.seen);
            (message::text(&state, &next, frame.as_deref()), frame)
        };
        let bytes = message::bytes(&text, frame.as_deref());
        self.shown = frame.or(self.shown.take());
        self.socket.send(Message::binary(bytes))
    }
}

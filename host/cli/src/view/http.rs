//! Requests without bodies and their responses, one per connection.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Longest head of a request, bytes: browsers send less than one KiB.
const LONGEST_HEAD: usize = 16 << 10;
/// Maximum number of headers of a request; browsers send some fifteen.
const MAX_HEADERS: usize = 64;

/// A request without its body.
#[derive(Debug)]
pub struct Head {
    /// `GET`, for instance.
    pub method: String,
    /// The path without the query.
    pub path: String,
    headers: Vec<(String, String)>,
    /// Bytes received after it.
    pub rest: Vec<u8>,
}

/// Why a request is refused: status and message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refusal(pub u16, pub &'static str);

impl Head {
    /// Reads a request's head, until a deadline.
    ///
    /// # Errors
    /// A malformed head, or one that is too long or too late.
    pub fn read(stream: &mut TcpStream, until: Instant) -> Result<Self, Refusal> {
        let mut bytes = Vec::new();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let late = Refusal(408, "the request came too late");
            // No time at all would mean for ever.
            stream.set_read_timeout(Some(left.max(Duration::from_millis(1)))).map_err(|_| late)?;
            let mut piece = [0; 4096];
            let count = match stream.read(&mut piece) {
                Ok(0) => return Err(Refusal(400, "the request is incomplete")),
                Ok(count) => count,
                Err(_) => return Err(late),
            };
            bytes.extend_from_slice(&piece[..count]);
            if bytes.len() > LONGEST_HEAD {
                return Err(Refusal(431, "the request's head is too long"));
            }
            if let Some(head) = Self::parse(&bytes)? {
                return Ok(head);
            }
            if left.is_zero() {
                return Err(late);
            }
        }
    }

    /// A head, or `None` if its end is missing.
    fn parse(bytes: &[u8]) -> Result<Option<Self>, Refusal> {
        let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
        let mut request = httparse::Request::new(&mut headers);
        let end = match request.parse(bytes) {
            Ok(httparse::Status::Complete(end)) => end,
            Ok(httparse::Status::Partial) => return Ok(None),
            Err(httparse::Error::TooManyHeaders) => return Err(Refusal(431, "too many headers")),
            Err(_) => return Err(Refusal(400, "not an HTTP request")),
        };
        let target = request.path.unwrap_or_default();
        let path = target.split_once('?').map_or(target, |(path, _)| path).to_owned();
        let text = |h: &httparse::Header<'_>| {
            (h.name.to_owned(), String::from_utf8_lossy(h.value).into_owned())
        };
        Ok(Some(Self {
            method: request.method.unwrap_or_default().to_owned(),
            path,
            headers: request.headers.iter().map(text).collect(),
            rest: bytes[end..].to_vec(),
        }))
    }

    /// Values of all headers of a name.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a str> {
        let named = self.headers.iter().filter(move |(n, _)| n.eq_ignore_ascii_case(name));
        named.map(|(_, value)| value.as_str())
    }

    /// The value of a header that must occur once.
    pub fn only<'a>(&'a self, name: &'a str) -> Option<&'a str> {
        let mut values = self.all(name);
        values.next().filter(|_| values.next().is_none())
    }

    /// The comma-separated words of all headers of a name.
    pub fn words<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a str> {
        self.all(name).flat_map(|value| value.split(',')).map(str::trim)
    }
}

impl Refusal {
    /// Sends it.
    ///
    /// # Errors
    /// A client that has gone.
    pub fn send(self, stream: &mut TcpStream) -> std::io::Result<()> {
        send(stream, self.0, "text/plain; charset=utf-8", "'self'", self.1.as_bytes())
    }
}

/// Sends a response, with the content security policy of the page.
///
/// # Errors
/// A client that has gone.
pub fn send(
    stream: &mut TcpStream,
    status: u16,
    kind: &str,
    connect: &str,
    body: &[u8],
) -> std::io::Result<()> {
    let length = body.len();
    let head = format!(
        "HTTP/1.1 {status} {}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n\
         Connection: close\r\nCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n\
         X-Frame-Options: DENY\r\nReferrer-Policy: no-referrer\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\nContent-Security-Policy: default-src 'none'; \
         script-src 'self'; style-src 'self'; img-src data:; connect-src {connect}; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\r\n",
        if status == 200 { "OK" } else { "Refused" }
    );
    stream.write_all(&[head.as_bytes(), body].concat())
}

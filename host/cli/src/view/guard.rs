//! Access control of the page: see [`super`].

use super::http::{Head, Refusal};
use camrig_base::Result;
use camrig_rig::Token;
use std::net::SocketAddr;

/// The server's address and token.
pub struct Guard {
    address: SocketAddr,
    token: Token,
}

impl Guard {
    /// A guard with a random token.
    ///
    /// # Errors
    /// An operating system without random numbers.
    pub fn new(address: SocketAddr) -> Result<Self> {
        Ok(Self { address, token: Token::random()? })
    }

    /// The token's text.
    pub fn secret(&self) -> &str {
        self.token.secret()
    }

    /// Accepts requests that name this server and do not come from another page.
    ///
    /// # Errors
    /// Any other request, with the reason.
    pub fn check(&self, head: &Head) -> Result<(), Refusal> {
        let host = head.only("Host").filter(|host| self.is_own(host));
        let host = host.ok_or(Refusal(403, "this is not the address of this page"))?;
        match head.all("Origin").all(|origin| origin == format!("http://{host}")) {
            true => Ok(()),
            false => Err(Refusal(403, "other pages have no access")),
        }
    }

    /// Accepts requests with the token. A script cannot add headers to a WebSocket request, only
    /// names of protocols: the token is one of them.
    ///
    /// # Errors
    /// Any other request, with the reason.
    pub fn check_token(&self, head: &Head) -> Result<(), Refusal> {
        let mut words = head.words("Sec-WebSocket-Protocol");
        match words.any(|word| self.token.is(word.as_bytes())) {
            true => Ok(()),
            false => Err(Refusal(
                403,
                "the token is missing or wrong: open the address that camrig printed",
            )),
        }
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
}

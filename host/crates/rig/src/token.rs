//! A secret that a client must know, for a rig on TCP and for the console.
//!
//! On TCP it is the first packet, before Hello: the word `camrig-token`, a space and the token, in
//! a packet of the link's framing without header and CRC. It keeps out other programs and other
//! people's scripts; it crosses the network unencrypted.

use camrig_base::{Error, Result};
use std::fmt;
use std::io::Read;

/// What the first packet begins with.
const GREETING: &[u8] = b"camrig-token ";
/// Bytes of the length before a packet on TCP.
const LENGTH_HEAD: usize = size_of::<u32>();
/// Longest token, characters.
const LONGEST: usize = 64;

/// A secret of letters, digits, `-` and `_`.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl fmt::Debug for Token {
    /// Without the secret, which would land in logs.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(..)")
    }
}

impl Token {
    /// 128 bits from the operating system, in hexadecimal.
    ///
    /// # Errors
    /// An operating system that gives no random numbers.
    pub fn random() -> Result<Self> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes)
            .map_err(|e| Error::device(format!("no random numbers for the token: {e}")))?;
        Ok(Self(bytes.iter().map(|b| format!("{b:02x}")).collect()))
    }

    /// A token of somebody's choice.
    ///
    /// # Errors
    /// An empty or long text, or other characters than letters, digits, `-` and `_`.
    pub fn parse(text: &str) -> Result<Self> {
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        match (1..=LONGEST).contains(&text.len()) && text.chars().all(plain) {
            true => Ok(Self(text.into())),
            false => Err(Error::input("not a token")
                .help(format!("a token has 1 to {LONGEST} letters, digits, - and _"))),
        }
    }

    /// The secret.
    pub fn secret(&self) -> &str {
        &self.0
    }

    /// Whether a text is this token. It takes a time that does not depend on where the difference
    /// is, so that the token cannot be guessed byte by byte.
    pub fn is(&self, text: &[u8]) -> bool {
        let own = self.0.as_bytes();
        own.len() == text.len() && own.iter().zip(text).fold(0, |d, (x, y)| d | (x ^ y)) == 0
    }

    /// What a host sends first.
    pub(crate) fn greeting(&self) -> Vec<u8> {
        let packet = [GREETING, self.0.as_bytes()].concat();
        [&(packet.len() as u32).to_le_bytes()[..], &packet].concat()
    }

    /// Whether what comes first from a host is this token. Reads no byte more.
    pub(crate) fn is_greeted(&self, mut host: impl Read) -> bool {
        let mut head = [0; LENGTH_HEAD];
        if host.read_exact(&mut head).is_err() {
            return false;
        }
        let length = u32::from_le_bytes(head) as usize;
        let mut packet = vec![0; length.min(GREETING.len() + LONGEST)];
        packet.len() == length
            && host.read_exact(&mut packet).is_ok()
            && packet.strip_prefix(GREETING).is_some_and(|text| self.is(text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_token_itself_opens() {
        let token = Token::parse("Ab-3_").unwrap();
        assert!(token.is_greeted(&token.greeting()[..]));
        let mut longer = token.greeting();
        longer.extend(b"next packet");
        let mut rest = &longer[..];
        assert!(token.is_greeted(&mut rest));
        assert_eq!(rest, b"next packet");
        for other in ["Ab-3", "Ab-3_x", "ab-3_", "x"] {
            assert!(!token.is_greeted(&Token::parse(other).unwrap().greeting()[..]), "{other}");
        }
        for bytes in [&b""[..], b"GET / HTTP/1.1\r\n\r\n", &[0; 20], &[255; 80]] {
            assert!(!token.is_greeted(bytes));
        }
        let cut = token.greeting();
        assert!(!token.is_greeted(&cut[..cut.len() - 1]));
    }

    #[test]
    fn random_ones_differ_and_texts_are_checked() {
        assert_ne!(Token::random().unwrap(), Token::random().unwrap());
        assert_eq!(Token::random().unwrap().secret().len(), 32);
        let long = "x".repeat(65);
        for text in ["", "a b", "ä", "a?b", &long] {
            assert!(Token::parse(text).is_err(), "{text}");
        }
        assert!(!format!("{:?}", Token::parse("secret").unwrap()).contains("secret"));
    }
}

//! Addresses of rigs.

use super::Token;
use camrig_base::{Error, ErrorCode, Result};
use std::fmt;

/// Bits per second of a serial line unless the URL says: the highest rate
/// of common USB serial converters (FT232R).
const DEFAULT_BAUD: u32 = 3_000_000;

/// Address of a rig.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Url {
    /// An emulator in this process.
    Emulator,
    /// An emulator, or a rig behind a network.
    Tcp {
        /// Host and port.
        address: String,
        /// What a rig that asks for it is to be told.
        token: Option<Token>,
    },
    /// A serial port, or a USB device of the class CDC-ACM.
    Serial {
        /// Device file or port name.
        path: String,
        /// Bits per second.
        baud: u32,
    },
    /// A USB device of the class HID.
    Hid {
        /// USB vendor number.
        vid: u16,
        /// USB product number.
        pid: u16,
        /// Serial number, where several are connected.
        serial: Option<String>,
    },
}

impl Url {
    /// Reads `emulator:`, `tcp://HOST:PORT[?token=TEXT]`, `serial:///dev/ttyACM0?baud=N` or
    /// `hid://VID:PID[/SERIAL]` (VID and PID in hexadecimal).
    pub fn parse(text: &str) -> Result<Self> {
        let wrong = || {
            Error::input(format!("{text:?} is not an address of a rig"))
                .help(
                    "use emulator:, tcp://HOST:PORT[?token=TEXT], \
                     serial:///dev/ttyACM0?baud=3000000 or hid://VID:PID[/SERIAL] (hexadecimal)",
                )
                .with_code(ErrorCode::RigNotFound)
        };
        if text == "emulator:" {
            return Ok(Url::Emulator);
        }
        let (scheme, rest) = text.split_once("://").ok_or_else(wrong)?;
        match scheme {
            "tcp" => {
                let (address, query) = rest.split_once('?').unwrap_or((rest, ""));
                let token = match query.strip_prefix("token=") {
                    Some(text) => Some(Token::parse(text)?),
                    None if query.is_empty() => None,
                    None => return Err(wrong()),
                };
                let sound = address
                    .rsplit_once(':')
                    .is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
                sound.then(|| Url::Tcp { address: address.into(), token }).ok_or_else(wrong)
            }
            "serial" => {
                let (path, query) = rest.split_once('?').unwrap_or((rest, ""));
                let baud = match query.strip_prefix("baud=") {
                    Some(number) => number.parse().ok().filter(|&b| b > 0).ok_or_else(wrong)?,
                    None if query.is_empty() => DEFAULT_BAUD,
                    None => return Err(wrong()),
                };
                (!path.is_empty())
                    .then(|| Url::Serial { path: path.into(), baud })
                    .ok_or_else(wrong)
            }
            "hid" => {
                let (ids, serial) = match rest.split_once('/') {
                    Some((ids, serial)) => (ids, Some(serial.to_string())),
                    None => (rest, None),
                };
                let (vid, pid) = ids.split_once(':').ok_or_else(wrong)?;
                let number = |t: &str| u16::from_str_radix(t, 16).map_err(|_| wrong());
                Ok(Url::Hid { vid: number(vid)?, pid: number(pid)?, serial })
            }
            _ => Err(wrong()),
        }
    }
}

impl fmt::Display for Url {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Url::Emulator => f.write_str("emulator:"),
            // Without the token: it is for the rig, not for logs.
            Url::Tcp { address, .. } => write!(f, "tcp://{address}"),
            Url::Serial { path, baud } => write!(f, "serial://{path}?baud={baud}"),
            Url::Hid { vid, pid, serial: None } => write!(f, "hid://{vid:04x}:{pid:04x}"),
            Url::Hid { vid, pid, serial: Some(s) } => write!(f, "hid://{vid:04x}:{pid:04x}/{s}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_come_back_as_they_were() {
        for text in [
            "emulator:",
            "tcp://localhost:7420",
            "tcp://[::1]:7420",
            "serial:///dev/ttyACM0?baud=115200",
            "hid://1209:0001",
            "hid://1209:0001/RIG-0001",
        ] {
            assert_eq!(Url::parse(text).unwrap().to_string(), text);
        }
        let secret = Url::parse("tcp://localhost:7420?token=s3").unwrap();
        assert_eq!(secret.to_string(), "tcp://localhost:7420");
        assert!(matches!(secret, Url::Tcp { token: Some(t), .. } if t.secret() == "s3"));
        let serial = Url::parse("serial://COM3").unwrap();
        assert_eq!(serial, Url::Serial { path: "COM3".into(), baud: DEFAULT_BAUD });
    }

    #[test]
    fn what_is_no_address_is_refused_with_help() {
        for text in [
            "",
            "tcp://host",
            "tcp://:1",
            "tcp://host:99999",
            "tcp://host:1?token=",
            "tcp://host:1?key=a",
            "serial://",
            "serial:///dev/x?speed=1",
            "serial:///dev/x?baud=0",
            "hid://12:zz",
            "hid://1209",
            "usb://1",
        ] {
            assert!(Url::parse(text).unwrap_err().to_string().contains("help"), "{text}");
        }
    }
}

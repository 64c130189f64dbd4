//! The device's memory: bootstrap registers at the addresses of GigE Vision, features from 0xF000,
//! the XML that describes them from 0x10000. Registers have 4 bytes, big endian; floating-point
//! features 8.

use crate::gvcp::Status;

/// Addresses of the bootstrap registers.
pub mod bootstrap {
    pub const VERSION: u32 = 0x0000;
    pub const DEVICE_MODE: u32 = 0x0004;
    pub const MAC_HIGH: u32 = 0x0008;
    pub const MAC_LOW: u32 = 0x000C;
    pub const IP_SUPPORTED: u32 = 0x0010;
    pub const IP_CURRENT: u32 = 0x0014;
    pub const IP_ADDRESS: u32 = 0x0024;
    pub const IP_MASK: u32 = 0x0034;
    pub const VENDOR: u32 = 0x0048;
    pub const MODEL: u32 = 0x0068;
    pub const DEVICE_VERSION: u32 = 0x0088;
    pub const INFORMATION: u32 = 0x00A8;
    pub const SERIAL: u32 = 0x00D8;
    pub const USER_NAME: u32 = 0x00E8;
    pub const DISCOVERY_BYTES: usize = 0xF8;
    pub const XML_URL: u32 = 0x0200;
    pub const INTERFACES: u32 = 0x0600;
    pub const STREAM_CHANNELS: u32 = 0x0904;
    pub const GVSP_CAPABILITY: u32 = 0x092C;
    pub const GVCP_CAPABILITY: u32 = 0x0934;
    pub const HEARTBEAT_MS: u32 = 0x0938;
    pub const TICKS_PER_S: u32 = 0x0940;
    pub const GVSP_CONFIGURATION: u32 = 0x0960;
    pub const CONTROL: u32 = 0x0A00;
    pub const HOST_PORT: u32 = 0x0D00;
    pub const PACKET_SIZE: u32 = 0x0D04;
    pub const PACKET_DELAY: u32 = 0x0D08;
    pub const DESTINATION: u32 = 0x0D18;
    pub const SOURCE_PORT: u32 = 0x0D1C;
}

/// Addresses of the features.
pub mod feature {
    pub const WIDTH: u32 = 0xF000;
    pub const HEIGHT: u32 = 0xF004;
    pub const OFFSET_X: u32 = 0xF008;
    pub const OFFSET_Y: u32 = 0xF00C;
    pub const PIXEL_FORMAT: u32 = 0xF010;
    pub const PAYLOAD_BYTES: u32 = 0xF014;
    pub const TEST_PATTERN: u32 = 0xF028;
    pub const TEST_VALUE: u32 = 0xF02C;
    pub const ACQUISITION: u32 = 0xF040;
    pub const ACQUISITION_MODE: u32 = 0xF044;
    pub const ACQUISITION_FRAMES: u32 = 0xF048;
    pub const TRIGGER_SELECTOR: u32 = 0xF04C;
    pub const TRIGGER_MODE: u32 = 0xF050;
    pub const TRIGGER_SOURCE: u32 = 0xF054;
    pub const TRIGGER_SOFTWARE: u32 = 0xF058;
    pub const LOCKED: u32 = 0xF05C;
    pub const FAULT: u32 = 0xF060;
    pub const FAULT_ARGUMENT: u32 = 0xF064;
    pub const FRAME_NUMBER: u32 = 0xF068;
    pub const FRAME_COUNTER: u32 = 0xF06C;
    pub const EXPOSURE_US: u32 = 0xF080;
    pub const GAIN_DB: u32 = 0xF088;
    pub const FRAME_RATE: u32 = 0xF090;
    pub const PACKET_LOSS: u32 = 0xF098;
    /// The XML begins here.
    pub const XML: u32 = 0x1_0000;
}

/// The bytes.
#[derive(Clone, Debug)]
pub struct Memory {
    bytes: Vec<u8>,
}

impl Memory {
    /// Memory of zeros with the XML in it, and its place in the register for it.
    pub fn new(xml: &str) -> Self {
        let mut bytes = vec![0; feature::XML as usize];
        bytes.extend(xml.as_bytes());
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        let mut memory = Self { bytes };
        let url = format!("Local:camrig.xml;{:X};{:X}", feature::XML, xml.len());
        memory.set_text(bootstrap::XML_URL, 512, &url);
        memory
    }

    /// So many bytes at an address.
    ///
    /// # Errors
    /// Beyond the memory, or not in words.
    pub fn read(&self, address: u32, count: usize) -> Result<&[u8], Status> {
        if !address.is_multiple_of(4) || !count.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        let start = address as usize;
        self.bytes.get(start..start.saturating_add(count)).ok_or(Status::InvalidAddress)
    }

    /// A register.
    pub fn word(&self, address: u32) -> u32 {
        u32::from_be_bytes(self.array(address))
    }

    /// A register that a bench's number of 16 bits was written to.
    pub fn short(&self, address: u32) -> u16 {
        self.word(address) as u16
    }

    /// A floating-point feature.
    pub fn float(&self, address: u32) -> f64 {
        f64::from_be_bytes(self.array(address))
    }

    fn array<const N: usize>(&self, address: u32) -> [u8; N] {
        self.bytes[address as usize..].first_chunk().copied().unwrap_or([0; N])
    }

    /// Sets a register.
    pub fn set(&mut self, address: u32, value: u32) {
        self.put(address, &value.to_be_bytes());
    }

    /// Sets a floating-point feature.
    pub fn set_float(&mut self, address: u32, value: f64) {
        self.put(address, &value.to_be_bytes());
    }

    /// Sets a text of at most `length` bytes, the zero at its end included.
    pub fn set_text(&mut self, address: u32, length: usize, text: &str) {
        let mut field = vec![0; length];
        let bytes = &text.as_bytes()[..text.len().min(length - 1)];
        field[..bytes.len()].copy_from_slice(bytes);
        self.put(address, &field);
    }

    /// Sets bytes within the registers.
    pub fn put(&mut self, address: u32, bytes: &[u8]) {
        let start = address as usize;
        if let Some(place) = self.bytes.get_mut(start..start + bytes.len()) {
            place.copy_from_slice(bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_read_in_words_and_says_where_the_xml_is() {
        let mut memory = Memory::new("<xml/>");
        let url = memory.read(bootstrap::XML_URL, 512).unwrap();
        assert!(url.starts_with(b"Local:camrig.xml;10000;6\0"));
        assert_eq!(memory.read(feature::XML, 8).unwrap(), b"<xml/>\0\0");
        assert_eq!(memory.read(feature::XML + 8, 4), Err(Status::InvalidAddress));
        assert_eq!(memory.read(2, 4), Err(Status::BadAlignment));
        assert_eq!(memory.read(0, 6), Err(Status::BadAlignment));
        memory.set_float(feature::GAIN_DB, 6.0);
        assert_eq!(memory.read(feature::GAIN_DB, 8).unwrap(), 6f64.to_be_bytes());
        memory.set_text(bootstrap::SERIAL, 16, "0123456789abcdefgh");
        assert_eq!(memory.read(bootstrap::SERIAL, 16).unwrap(), b"0123456789abcde\0");
    }
}

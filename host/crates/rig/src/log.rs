//! The log of a firmware, decoded: `defmt` sends numbers, the firmware's ELF file holds the text.

use camrig_base::{Error, Result};
use defmt_decoder::{DecodeError, Locations, Table};
use std::path::Path;

/// Turns log bytes into lines.
pub struct LogDecoder {
    table: Table,
    locations: Option<Locations>,
}

impl LogDecoder {
    /// A decoder for the firmware in this ELF file.
    ///
    /// # Errors
    /// A file that cannot be read, or is no firmware with `defmt` messages.
    pub fn open(elf: &Path) -> Result<Self> {
        let bytes = std::fs::read(elf).map_err(|e| Error::io("read", elf, e))?;
        let wrong = |what: String| {
            Error::input(what)
                .at(elf.display())
                .help("give the ELF file of the firmware that runs")
        };
        let table = Table::parse(&bytes)
            .map_err(|e| wrong(format!("not a firmware with defmt messages: {e}")))?
            .ok_or_else(|| wrong("a firmware without defmt messages".into()))?;
        // Places in the source need debug information for every message.
        let locations = table
            .get_locations(&bytes)
            .ok()
            .filter(|l| table.indices().all(|i| l.contains_key(&(i as u64))));
        Ok(Self { table, locations })
    }

    /// Calls `line` with each message in some bytes, and with a remark where bytes are not a
    /// message.
    pub fn decode(&self, bytes: &[u8], mut line: impl FnMut(String)) {
        let mut decoder = self.table.new_stream_decoder();
        decoder.received(bytes);
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("print", |l| l.as_str());
                    let place = self.locations.as_ref().and_then(|l| l.get(&frame.index()));
                    let place = place.map_or_else(String::new, |l| {
                        let file = l.file.file_name().unwrap_or(l.file.as_os_str());
                        format!(" ({}:{})", file.to_string_lossy(), l.line)
                    });
                    line(format!("{level:5} {}{place}", frame.display_message()));
                }
                Err(DecodeError::UnexpectedEof) => return,
                Err(DecodeError::Malformed) => {
                    line("?     bytes that are not a message of this firmware".into());
                    if !self.table.encoding().can_recover() {
                        return;
                    }
                }
            }
        }
    }
}

//! Faults by schedule: which frames of a stream are lost, late or wrong, and how, for tests of the
//! receiver.
//!
//! ```text
//! # frames are counted from the first of the stream, which is 0
//! 17: drop
//! 100-130: freeze
//! 140: row 300 corrupt; 141: rows 10-19 lost
//! every 50 from 200: late 4 ms
//! 250-260: stuck counter
//! ```
//! Faults act on frames as they come from a rig, in the order of the schedule, so that every
//! output shows them; those of packets show where a frame is written as packets of CSI-2. Random
//! bits are drawn by the number of the frame: the same in every run.

use super::RigFrame;
use camrig_base::{Error, Result};
use camrig_formats::csi2::Damage;
use camrig_rig_link::packing::{WrongSize, pack_row, unpack_row};
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use std::ops::RangeInclusive;
use std::path::Path;
use std::time::Duration;

/// What a schedule may say, for messages.
const FRAMES: &str = "17, 100-130 or every 50 from 200";
const KNOWN: &str = "drop; freeze; repeat; black; white; row N corrupt; row N lost; rows A-B lost; \
                     bit errors RATE; stuck counter; stuck registers; late N ms; and of CSI-2: \
                     row N ecc 1; row N ecc 2; row N crc; row N no packet; row N short; \
                     row N word count; row N channel; row N data type; no frame start; \
                     no frame end";

/// The frames of an entry.
#[derive(Clone, Debug, PartialEq)]
enum When {
    Frames(RangeInclusive<u32>),
    Every { step: u32, first: u32 },
}

impl When {
    fn has(&self, frame: u32) -> bool {
        match self {
            Self::Frames(frames) => frames.contains(&frame),
            Self::Every { step, first } => {
                frame.checked_sub(*first).is_some_and(|since| since.is_multiple_of(*step))
            }
        }
    }
}

/// What happens to a frame.
#[derive(Clone, Debug, PartialEq)]
enum What {
    /// It is lost.
    Drop,
    /// Its samples are those of the frame before; its counter goes on.
    Freeze,
    /// It is the frame before, counter included.
    Repeat,
    /// All samples are 0, or the highest code.
    Filled { high: bool },
    /// The bits of a row are inverted.
    CorruptRow(u32),
    /// Rows are 0.
    LostRows(RangeInclusive<u32>),
    /// So many of the bits, as a fraction, are inverted at random places.
    BitErrors(f64),
    /// Its counter is that of the frame before.
    StuckCounter,
    /// What is written before it to the registers of exposure and gain is lost.
    StuckRegisters,
    /// It is delivered later.
    Late(Duration),
    /// One of its packets is damaged.
    Packet(Damage),
}

/// An entry of a schedule.
#[derive(Clone, Debug, PartialEq)]
struct Entry {
    when: When,
    what: What,
    text: String,
}

/// A schedule, and what it needs of the frame before.
#[derive(Clone, Debug)]
pub struct Faults {
    entries: Vec<Entry>,
    previous: Option<Previous>,
}

/// What was delivered last.
#[derive(Clone, Debug)]
struct Previous {
    packed: Vec<u8>,
    counter: u16,
}

impl Faults {
    /// Reads a schedule for frames of so many rows.
    ///
    /// # Errors
    /// A file that cannot be read, entries that are none, rows beyond the frame.
    pub fn load(path: &Path, rows: u32) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?;
        Self::parse(&text, rows).map_err(|e| e.at(path.display()))
    }

    fn parse(text: &str, rows: u32) -> Result<Self> {
        let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default());
        let entries = lines.flat_map(|line| line.split(';')).map(str::trim);
        let entries = entries.filter(|entry| !entry.is_empty()).map(|entry| {
            let (when_text, what_text) = entry.split_once(':').unwrap_or((entry, ""));
            let found = when(when_text).zip(what(what_text));
            let (when, what) = found.ok_or_else(|| {
                Error::input(format!("{entry:?} is no entry of a schedule of faults"))
                    .help(format!("write FRAMES: FAULT; FRAMES are {FRAMES}; FAULT is {KNOWN}"))
            })?;
            let last_row = match &what {
                What::CorruptRow(row) => *row,
                What::LostRows(rows) => *rows.end(),
                What::Packet(damage) => damage.row().unwrap_or(0),
                _ => 0,
            };
            if last_row >= rows {
                return Err(Error::input(format!("{entry:?} of frames of {rows} rows"))
                    .help(format!("rows are counted from 0 to {}", rows - 1)));
            }
            Ok(Entry { when, what, text: what_text.trim().to_string() })
        });
        Ok(Self { entries: entries.collect::<Result<_>>()?, previous: None })
    }

    /// The first fault that shows in packets of CSI-2 alone, in words.
    pub fn of_packets(&self) -> Option<&str> {
        let of_packets = |entry: &&Entry| matches!(entry.what, What::Packet(_));
        self.entries.iter().find(of_packets).map(|entry| &*entry.text)
    }

    /// Whether what is written before a frame is lost; who writes asks.
    pub fn has_stuck_registers(&self, frame: u32) -> bool {
        let mut entries = self.entries.iter();
        entries.any(|entry| entry.what == What::StuckRegisters && entry.when.has(frame))
    }

    /// How much later a frame is delivered; who delivers it waits.
    pub fn delay(&self, frame: u32) -> Duration {
        let late = self.entries.iter().filter(|entry| entry.when.has(frame));
        late.map(|entry| if let What::Late(delay) = entry.what { delay } else { Duration::ZERO })
            .fold(Duration::ZERO, Duration::saturating_add)
    }

    /// Does to a frame of so many columns and bits what the schedule says, and returns it in words.
    ///
    /// # Errors
    /// A frame whose rows do not have the columns.
    pub fn apply(
        &mut self,
        frame: u32,
        taken: &mut RigFrame,
        (columns, bits): (usize, u32),
    ) -> Result<Vec<String>> {
        let mut done = Vec::new();
        for entry in self.entries.iter().filter(|entry| entry.when.has(frame)) {
            // A frame that is not there has no samples to change, but what was written is lost.
            if taken.dropped && entry.what != What::StuckRegisters {
                continue;
            }
            let rows = Rows { columns, bits, frame };
            if act(&entry.what, self.previous.as_ref(), taken, &rows)
                .map_err(|e| Error::internal(format!("a raw row of {} bytes", e.found)))?
            {
                done.push(entry.text.clone());
            }
        }
        if !taken.dropped {
            let (packed, counter) = (taken.packed.clone(), taken.start.counter);
            self.previous = Some(Previous { packed, counter });
        }
        Ok(done)
    }
}

/// Does one thing to a frame; false if there is no frame before that it needs.
fn act(
    what: &What,
    previous: Option<&Previous>,
    taken: &mut RigFrame,
    rows: &Rows,
) -> Result<bool, WrongSize> {
    let needs = matches!(what, What::Freeze | What::Repeat | What::StuckCounter);
    let Previous { packed, counter } = match previous {
        Some(previous) => previous,
        None if needs => return Ok(false),
        None => &Previous { packed: Vec::new(), counter: 0 },
    };
    if matches!(what, What::Freeze | What::Repeat) {
        taken.packed.clone_from(packed);
    }
    if matches!(what, What::Repeat | What::StuckCounter) {
        taken.start.counter = *counter;
    }
    let highest = ((1u32 << rows.bits) - 1) as u16; // of 16 bits at most
    match what {
        // Who delivers the frame waits.
        What::Late(_) => {}
        What::Packet(damage) => taken.damage.push(*damage),
        What::Freeze | What::Repeat | What::StuckCounter | What::StuckRegisters => {}
        What::Drop => (taken.dropped, taken.packed) = (true, Vec::new()),
        What::Filled { high } => {
            let code = if *high { highest } else { 0 };
            rows.change(taken, 0..=u32::MAX, |_, row| row.fill(code))?;
        }
        What::CorruptRow(row) => {
            let invert = |_, samples: &mut [u16]| samples.iter_mut().for_each(|s| *s ^= highest);
            rows.change(taken, *row..=*row, invert)?;
        }
        What::LostRows(lost) => rows.change(taken, lost.clone(), |_, row| row.fill(0))?,
        What::BitErrors(rate) => {
            let seed = u64::from(rows.frame) << 32 | 0xfa17;
            let mut draws = SplitMix64::from_seed(seed.to_le_bytes());
            rows.change(taken, 0..=u32::MAX, |_, row| {
                let all = row.len() as u64 * u64::from(rows.bits);
                for _ in 0..(all as f64 * rate + fraction(&mut draws)) as u64 {
                    let bit = draws.next_u64() % all;
                    row[(bit / u64::from(rows.bits)) as usize] ^=
                        1 << (bit % u64::from(rows.bits));
                }
            })?;
        }
    }
    Ok(true)
}

/// The samples of a frame.
struct Rows {
    columns: usize,
    bits: u32,
    frame: u32,
}

impl Rows {
    /// Changes the samples of some rows.
    fn change(
        &self,
        taken: &mut RigFrame,
        which: RangeInclusive<u32>,
        mut change: impl FnMut(u32, &mut [u16]),
    ) -> Result<(), WrongSize> {
        let packing = taken.raw_row.packing;
        let mut samples = vec![0; self.columns];
        for (row, packed) in (0..).zip(taken.packed.chunks_mut(packing.row_bytes(self.columns))) {
            if which.contains(&row) {
                unpack_row(packing, packed, &mut samples)?;
                change(row, &mut samples);
                pack_row(packing, &samples, packed)?;
            }
        }
        Ok(())
    }
}

/// A random number from 0 to 1.
fn fraction(draws: &mut SplitMix64) -> f64 {
    (draws.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Two numbers with `-` between, the first not above the second.
fn range(text: &str) -> Option<RangeInclusive<u32>> {
    let (first, last) = text.split_once('-')?;
    let range = first.trim().parse().ok()?..=last.trim().parse().ok()?;
    (!range.is_empty()).then_some(range)
}

fn when(text: &str) -> Option<When> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let number = |text: &str| text.parse::<u32>().ok();
    Some(match *words.as_slice() {
        ["every", step, "from", first] => {
            When::Every { step: number(step).filter(|step| *step > 0)?, first: number(first)? }
        }
        [frames] | ["frame" | "frames", frames] => match number(frames) {
            Some(frame) => When::Frames(frame..=frame),
            None => When::Frames(range(frames)?),
        },
        _ => return None,
    })
}

fn what(text: &str) -> Option<What> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let number = |text: &str| text.parse::<u32>().ok();
    Some(match *words.as_slice() {
        ["drop"] => What::Drop,
        ["freeze"] => What::Freeze,
        ["repeat"] => What::Repeat,
        ["black"] => What::Filled { high: false },
        ["white"] => What::Filled { high: true },
        ["row", row, "corrupt"] => What::CorruptRow(number(row)?),
        ["row", row, "lost"] => number(row).map(|row| What::LostRows(row..=row))?,
        ["rows", rows, "lost"] => What::LostRows(range(rows)?),
        ["bit", "errors", rate] => {
            What::BitErrors(rate.parse().ok().filter(|rate| (0.0..=1.0).contains(rate))?)
        }
        ["stuck", "counter"] => What::StuckCounter,
        ["stuck", "registers"] => What::StuckRegisters,
        ["row", row, ref rest @ ..] => What::Packet(of_row(rest)?(number(row)?)),
        ["no", "frame", "start"] => What::Packet(Damage::NoFrameStart),
        ["no", "frame", "end"] => What::Packet(Damage::NoFrameEnd),
        ["late", ms, "ms"] => What::Late(Duration::from_millis(number(ms)?.into())),
        _ => return None,
    })
}

/// What happens to the packet of a row.
fn of_row(words: &[&str]) -> Option<fn(u32) -> Damage> {
    Some(match words {
        ["ecc", "1"] => Damage::HeaderBit,
        ["ecc", "2"] => Damage::HeaderBits,
        ["crc"] => Damage::Checksum,
        ["no", "packet"] => Damage::NoPacket,
        ["short"] => Damage::Short,
        ["word", "count"] => Damage::WordCount,
        ["channel"] => Damage::VirtualChannel,
        ["data", "type"] => Damage::DataType,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_firmware_sim::raw_row::RawRow;
    use camrig_rig_link::message::{Exposure, Fault, FrameShape, FrameStart};
    use camrig_rig_link::packing::Packing;

    const COLUMNS: usize = 8;
    const BITS: u32 = 10;

    /// A frame of four rows whose samples and counter are its number.
    fn frame(number: u16) -> RigFrame {
        let packing = Packing::Raw10;
        let mut packed = vec![0; 4 * packing.row_bytes(COLUMNS)];
        for row in packed.chunks_mut(packing.row_bytes(COLUMNS)) {
            pack_row(packing, &[number; COLUMNS], row).unwrap();
        }
        let shape = FrameShape { rows: 4, units: 1, unit_bytes: 33, raw_bytes: 10, halo: 0 };
        let start = FrameStart {
            transfer: 0,
            shape,
            exposure: Exposure { exposure_s: 0.01, analog_gain: 1.0 },
            counter: number,
            frame: number.into(),
            seed: 0,
            test_pattern: 0,
            fault: Fault::None,
        };
        let (dropped, receipts, lines, restored, damage) = (false, None, None, None, Vec::new());
        let raw_row = RawRow { packing, rows: 1, halves: false };
        RigFrame { start, packed, receipts, raw_row, dropped, damage, lines, restored }
    }

    /// Samples of the first column, counter and faults in words; no samples of a dropped frame.
    fn taken(faults: &mut Faults, number: u16) -> (Vec<u16>, u16, String) {
        let mut frame = frame(number);
        let said = faults.apply(number.into(), &mut frame, (COLUMNS, BITS)).unwrap();
        assert_eq!(frame.dropped, frame.packed.is_empty());
        let mut samples = [0; COLUMNS];
        let rows = frame.packed.chunks(Packing::Raw10.row_bytes(COLUMNS));
        let first = rows.map(|row| {
            unpack_row(Packing::Raw10, row, &mut samples).unwrap();
            samples[0]
        });
        (first.collect(), frame.start.counter, said.join(", "))
    }

    #[test]
    fn every_fault_does_to_its_frames_what_it_says() {
        let text = "# a table\n0: freeze\nframe 2: drop\n4-5: freeze; 6: repeat\n7: black\n\
                    8: white\n9: row 1 corrupt; 9: rows 2-3 lost\n\
                    every 10 from 20: stuck counter\n40: late 1 ms; 40-41: late 70 ms\n\
                    41: stuck registers";
        let mut faults = Faults::parse(text, 4).unwrap();
        assert!(!faults.has_stuck_registers(40) && faults.has_stuck_registers(41));
        let mut at = |number| taken(&mut faults, number);
        let whole =
            |samples: u16, counter: u16, said: &str| (vec![samples; 4], counter, said.to_string());
        assert_eq!(at(0), whole(0, 0, ""), "nothing was before it");
        assert_eq!(at(1), whole(1, 1, ""));
        assert_eq!(at(2), (Vec::new(), 2, "drop".into()));
        assert_eq!(at(3), whole(3, 3, ""));
        assert_eq!(at(4), whole(3, 4, "freeze"));
        assert_eq!(at(5), whole(3, 5, "freeze"));
        assert_eq!(at(6), whole(3, 5, "repeat"));
        assert_eq!(at(7), whole(0, 7, "black"));
        assert_eq!(at(8), whole(1023, 8, "white"));
        let both = (vec![9, 1023 - 9, 0, 0], 9, "row 1 corrupt, rows 2-3 lost".to_string());
        assert_eq!(at(9), both);
        assert_eq!(at(19), whole(19, 19, ""));
        assert_eq!(at(20), whole(20, 19, "stuck counter"));
        assert_eq!(at(21), whole(21, 21, ""));
        assert_eq!(at(30), whole(30, 21, "stuck counter"));
        assert_eq!(at(40), whole(40, 21, "stuck counter, late 1 ms, late 70 ms"));
        assert_eq!(at(41), whole(41, 41, "late 70 ms, stuck registers"));
        let delays = [39, 40, 41].map(|frame| faults.delay(frame).as_millis());
        assert_eq!(delays, [0, 71, 70]);
    }

    #[test]
    fn faults_of_packets_are_for_who_writes_them() {
        let text = "1: row 2 ecc 1; 1: row 0 crc; 1: no frame end; 2: row 1 no packet";
        let mut faults = Faults::parse(text, 4).unwrap();
        assert_eq!(faults.of_packets(), Some("row 2 ecc 1"));
        assert_eq!(Faults::parse("1: row 2 lost", 4).unwrap().of_packets(), None);
        let mut damage = |number: u16| {
            let mut frame = frame(number);
            faults.apply(number.into(), &mut frame, (COLUMNS, BITS)).unwrap();
            frame.damage
        };
        let all = [Damage::HeaderBit(2), Damage::Checksum(0), Damage::NoFrameEnd];
        assert_eq!([damage(1), damage(2)], [all.to_vec(), vec![Damage::NoPacket(1)]]);
        let said = Faults::parse("1: row 4 ecc 2", 4).unwrap_err().to_string();
        assert!(said.contains("4 rows"), "{said}");
    }

    /// 4 rows of 80 bits at a rate of 0.1 are 32 bits; some bit may be inverted twice.
    #[test]
    fn bit_errors_are_as_many_as_asked_for_and_the_same_in_every_run() {
        let wrong = |number: u16| {
            let mut faults = Faults::parse("0-9: bit errors 0.1", 4).unwrap();
            let mut frame = frame(0);
            faults.apply(number.into(), &mut frame, (COLUMNS, BITS)).unwrap();
            let ones = frame.packed.iter().map(|byte| byte.count_ones()).sum::<u32>();
            (frame.packed, ones)
        };
        assert_eq!(wrong(1), wrong(1));
        assert_ne!(wrong(1), wrong(2));
        assert!((20..=32).contains(&wrong(1).1), "{}", wrong(1).1);
    }

    #[test]
    fn what_is_no_schedule_is_refused() {
        for text in [
            "17 drop",
            "17: vanish",
            "x: drop",
            "9-3: drop",
            "every 0 from 1: drop",
            "1: bit errors 2",
            "1: late 4 s",
            "1: row x lost",
        ] {
            let said = Faults::parse(text, 4).unwrap_err().to_string();
            assert!(said.contains(text), "{said}");
        }
        let said = Faults::parse("1: rows 2-4 lost", 4).unwrap_err().to_string();
        assert!(said.contains("4 rows"), "{said}");
    }
}

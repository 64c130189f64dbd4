//! Every target with its seeds and a fixed number of changes of each: what a fuzzer has found
//! stays mended, and a reader that lets any short file through to a panic is noticed without one.

use camrig_fuzz::files::Reader;
use camrig_fuzz::memory::Bounded;
use camrig_fuzz::{device, frames, gige, host, profiles, usbip, video};
use std::path::{Path, PathBuf};

#[global_allocator]
static MEMORY: Bounded = Bounded;

/// Changes of each seed, and conversations on the link.
const CHANGES: u64 = 40;
const CONVERSATIONS: u64 = 500;

/// SplitMix64.
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    fn bytes(&mut self, most: usize) -> Vec<u8> {
        (0..self.below(most)).map(|_| self.next() as u8).collect()
    }

    /// `seed` with some bytes replaced, a piece removed or repeated.
    fn changed(&mut self, seed: &[u8]) -> Vec<u8> {
        let mut bytes = seed.to_vec();
        for _ in 0..=self.below(4) {
            let (from, length) = (self.below(bytes.len()), self.below(40));
            let piece = from..bytes.len().min(from + length);
            match self.below(4) {
                0 => drop(bytes.drain(piece)),
                1 => drop(bytes.splice(from..from, bytes[piece].to_vec())),
                _ => bytes[piece.start..].iter_mut().take(1).for_each(|b| *b = self.next() as u8),
            }
        }
        bytes
    }
}

fn files_of(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn readers_take_or_refuse_every_seed_and_its_changes() {
    let seeds = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/seeds"));
    for folder in files_of(seeds) {
        let reader = Reader::new(&folder.file_name().unwrap().to_string_lossy());
        for file in files_of(&folder) {
            println!("{}", file.display());
            let seed = std::fs::read(&file).unwrap();
            reader.read(&seed);
            let mut draws = Draws(1);
            for _ in 0..CHANGES {
                reader.read(&draws.changed(&seed));
            }
        }
    }
}

#[test]
fn both_ends_of_the_link_survive_bytes_that_nobody_meant() {
    for seed in 0..CONVERSATIONS {
        let bytes = Draws(seed).bytes(2000);
        device::converse(&bytes);
        host::converse(&bytes);
    }
}

#[test]
fn a_camera_on_the_network_survives_datagrams_that_nobody_meant() {
    // Writes of its features, a resend request and a read, and changes of these.
    let mut meant = Vec::new();
    for address in (0xF000u16..0xF0A0).step_by(4) {
        meant.extend([0x82, 16, 0x42, 1, 0, 0x82, 0, 8, 0, 1, 0, 0]);
        meant.extend(address.to_be_bytes());
        meant.extend([0, 0, 0, 4]);
    }
    meant.extend([0x40, 12, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0xff, 0xff, 0xff]);
    meant.extend([0x04, 8, 0, 1, 0, 0, 0, 0, 2, 0]);
    gige::converse(&meant);
    let mut draws = Draws(1);
    for _ in 0..CONVERSATIONS {
        gige::converse(&draws.changed(&meant));
        gige::converse(&draws.bytes(2000));
    }
}

#[test]
fn streams_of_scenes_end_or_are_refused() {
    let mut y4m = b"YUV4MPEG2 W6 H4 F25:1 Ip C420jpeg\n".to_vec();
    for _ in 0..2 {
        y4m.extend(b"FRAME\n");
        y4m.extend([128; 36]);
    }
    video::watch(&y4m);
    let mut draws = Draws(1);
    for _ in 0..CHANGES {
        video::watch(&draws.changed(&y4m));
        frames::watch(&draws.bytes(2000));
    }
}

#[test]
fn sensors_take_any_transactions_and_maps_are_read_or_refused() {
    let map = include_str!("../../host/crates/profiles/profiles/ov7670.toml").as_bytes();
    let mut draws = Draws(1);
    for name in camrig_profiles::Profile::names() {
        for _ in 0..CHANGES {
            profiles::drive(&[name.as_bytes(), b"\x0c", &draws.bytes(2000)].concat());
        }
    }
    for _ in 0..CONVERSATIONS {
        profiles::drive(&[&draws.changed(map), &b"\x0c"[..], &draws.bytes(200)].concat());
    }
}

#[test]
fn the_usb_camera_answers_or_refuses_whatever_a_host_asks() {
    let mut meant = Vec::new();
    // Set-up, a format, a stream with two transfers, controls; the interface is the index.
    let probe = [&[0, 0, 1, 1][..], &[0; 22]].concat();
    for (setup, out) in [
        ([0x80, 6, 0, 2, 0, 0, 255, 255], &[][..]),
        ([0x21, 1, 0, 1, 1, 0, 26, 0], &probe),
        ([0x21, 1, 0, 2, 1, 0, 26, 0], &probe),
        ([0x21, 1, 0, 4, 0, 1, 4, 0], &[50, 0, 0, 0]),
        ([0x21, 1, 0, 4, 0, 2, 2, 0], &[0, 2]),
        ([0xA1, 0x81, 0, 4, 0, 2, 2, 0], &[]),
    ] {
        meant.extend([1, 1, u8::from(out.is_empty()), 0, out.len().max(1) as u8]);
        meant.extend(setup);
        meant.extend(out);
    }
    for seq in [2, 3] {
        meant.extend([1, seq, 1, 1, 200]);
        meant.extend([0; 8]);
    }
    meant.extend([2, 4, 0, 3, 0]);
    meant.extend([0; 8]);
    usbip::attach(&meant);
    let mut draws = Draws(1);
    for _ in 0..CONVERSATIONS {
        usbip::attach(&draws.changed(&meant));
        usbip::attach(&draws.bytes(2000));
    }
}

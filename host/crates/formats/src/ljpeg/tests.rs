//! Against an encoder written down straight from T.81.

use super::*;

/// Sizes of differences, 0 to 16, all of five bits: code and size are the same number.
const CODE_BITS: u32 = 5;

#[derive(Default)]
struct Writer {
    bytes: Vec<u8>,
    pool: u32,
    filled: u32,
}

impl Writer {
    fn put(&mut self, value: u32, count: u32) {
        for i in (0..count).rev() {
            self.pool = self.pool << 1 | (value >> i & 1);
            self.filled += 1;
            if self.filled == 8 {
                self.bytes.push(self.pool as u8);
                if self.pool as u8 == 0xFF {
                    self.bytes.push(0);
                }
                (self.pool, self.filled) = (0, 0);
            }
        }
    }

    fn flush(&mut self) {
        while self.filled > 0 {
            self.put(1, 1);
        }
    }
}

/// A stream of `columns` x `rows` pixels of `n` components.
pub(crate) fn encode(
    data: &[u16],
    (columns, rows, n): (usize, usize, usize),
    (bits, predictor): (u32, u8),
    restart_rows: usize,
) -> Vec<u8> {
    let mut out = vec![0xFF, 0xD8, 0xFF, 0xFE, 0, 4, 1, 2]; // SOI, a comment
    out.extend([0xFF, 0xC3, 0, 8 + 3 * n as u8, bits as u8]);
    out.extend((rows as u16).to_be_bytes());
    out.extend((columns as u16).to_be_bytes());
    out.push(n as u8);
    (0..n as u8).for_each(|c| out.extend([c, 0x11, 0]));
    let mut counts = [0u8; 16];
    counts[CODE_BITS as usize - 1] = 17;
    out.extend([0xFF, 0xC4, 0, 19 + 17, 0]);
    out.extend(counts);
    out.extend(0..17u8);
    if restart_rows > 0 {
        out.extend([0xFF, 0xDD, 0, 4]);
        out.extend(((columns * restart_rows) as u16).to_be_bytes());
    }
    out.extend([0xFF, 0xDA, 0, 6 + 2 * n as u8, n as u8]);
    (0..n as u8).for_each(|c| out.extend([c, 0]));
    out.extend([predictor, 0, 0]);
    let mut w = Writer::default();
    let width = columns * n;
    let header = Header { predictor, ..Header::default() };
    for y in 0..rows {
        let fresh = y == 0 || (restart_rows > 0 && y % restart_rows == 0);
        if fresh && y > 0 {
            w.flush();
            w.bytes.extend([0xFF, 0xD0 + ((y / restart_rows - 1) % 8) as u8]);
        }
        for x in 0..width {
            let at = |dx: usize, dy: usize| i32::from(data[(y - dy) * width + x - dx * n]);
            let predicted = match (fresh, x < n) {
                (true, true) => 1 << (bits - 1),
                (true, false) => at(1, 0),
                (false, true) => at(0, 1),
                (false, false) => header.predict(at(1, 0), at(0, 1), at(1, 1)),
            };
            let difference = (at(0, 0) - predicted) as i16 as i32;
            let size = match difference {
                -32768 => 16,
                other => 32 - other.abs().leading_zeros(),
            };
            w.put(size, CODE_BITS);
            if size < 16 {
                let low = if difference < 0 { difference - 1 } else { difference };
                w.put(low as u32 & ((1 << size) - 1), size);
            }
        }
    }
    w.flush();
    out.extend(w.bytes);
    out.extend([0xFF, 0xD9]);
    out
}

fn noise(count: usize, bits: u32) -> Vec<u16> {
    let top = ((1u32 << bits) - 1) as u16;
    (0..count).map(|i| (i.wrapping_mul(2_654_435_761) >> 9) as u16 & top).collect()
}

#[test]
fn every_predictor_and_number_of_components_comes_back() {
    for predictor in 1..=7 {
        for n in 1..=4 {
            for (bits, restart_rows) in [(8, 0), (12, 3), (16, 0), (16, 2)] {
                let data = noise(6 * 7 * n, bits);
                let stream = encode(&data, (6, 7, n), (bits, predictor), restart_rows);
                let image = decode(&stream, data.len()).unwrap();
                assert_eq!(image.0, data, "{predictor} {n} {bits}");
            }
        }
    }
}

#[test]
fn lying_sizes_and_truncations_are_refused() {
    let data = noise(6 * 7 * 2, 14);
    let stream = encode(&data, (6, 7, 2), (14, 1), 0);
    assert!(decode(&stream, 83).unwrap_err().to_string().contains("83 samples"));
    for length in 0..stream.len() - 3 {
        assert!(decode(&stream[..length], 84).is_err(), "{length}");
    }
    // A size of 65535 x 65535 costs no memory.
    let mut forged = stream.clone();
    forged[13..17].fill(0xFF);
    assert!(decode(&forged, usize::MAX).is_err());
    // Baseline JPEG has no raw samples.
    let mut lossy = stream;
    lossy[9] = 0xC0;
    assert!(decode(&lossy, 84).unwrap_err().to_string().contains("not lossless"));
}

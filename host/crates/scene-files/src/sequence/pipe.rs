//! A stream that is read by a thread of its own, so that its writer can work ahead while frames are
//! computed, and that a writer which falls silent is noticed.

use camrig_base::Error;
use std::io::{self, Read};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

/// Bytes that are read at a time, and pieces that may wait: 4 MiB in all, a frame of full HD. A
/// trade between memory and how far a writer works ahead.
const PIECE: usize = 1 << 18;
const PIECES: usize = 16;
/// How long the first byte may take: a renderer has its scene to load.
const FIRST: Duration = Duration::from_secs(60);

/// The bytes of a stream.
pub(super) struct Pipe {
    pieces: Receiver<io::Result<Vec<u8>>>,
    piece: Vec<u8>,
    at: usize,
    /// Longest silence from now on.
    patience: Duration,
    stall: Duration,
}

impl Pipe {
    /// Reads `stream` from now on. Silence for longer than `stall` is an error of kind
    /// [`io::ErrorKind::TimedOut`]; before the first byte it may last a minute, or `stall` where
    /// that is longer.
    pub fn new(mut stream: impl Read + Send + 'static, stall: Duration) -> Self {
        let (sender, pieces) = sync_channel(PIECES);
        // It ends with the stream, or with the first piece that nobody takes.
        std::thread::spawn(move || {
            loop {
                let mut piece = vec![0; PIECE];
                let read = match stream.read(&mut piece) {
                    Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                    read => read,
                };
                let ended = !matches!(read, Ok(1..));
                let piece = read.map(|n| {
                    piece.truncate(n);
                    piece
                });
                if sender.send(piece).is_err() || ended {
                    return;
                }
            }
        });
        Self { pieces, piece: Vec::new(), at: 0, patience: stall.max(FIRST), stall }
    }
}

impl Read for Pipe {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        while self.at == self.piece.len() {
            match self.pieces.recv_timeout(self.patience) {
                Ok(piece) => self.piece = piece?,
                Err(RecvTimeoutError::Timeout) => {
                    let seconds = self.patience.as_secs_f64();
                    let what = format!("nothing came for {seconds} s");
                    return Err(io::Error::new(io::ErrorKind::TimedOut, what));
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(0),
            }
            self.at = 0;
            self.patience = self.stall;
            if self.piece.is_empty() {
                return Ok(0);
            }
        }
        let n = out.len().min(self.piece.len() - self.at);
        out[..n].copy_from_slice(&self.piece[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }
}

/// What went wrong with a stream.
pub(super) fn broken(error: &io::Error) -> Error {
    match error.kind() {
        io::ErrorKind::TimedOut => Error::limit(error.to_string()).help(
            "its writer has stalled or is slower than that: look at what it says, or allow longer \
             silence",
        ),
        _ => Error::device(format!("the stream broke: {error}")),
    }
}

/// Reads `count` bytes; fewer where the stream ends before. Memory grows with what comes, so that a
/// size that is a lie takes none.
pub(super) fn read_up_to(stream: &mut dyn Read, count: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    stream.take(count).read_to_end(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    /// Gives a byte, then nothing for a while.
    struct Silent(bool);

    impl Read for Silent {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            if std::mem::replace(&mut self.0, true) {
                std::thread::sleep(Duration::from_secs(30));
            }
            out[0] = 7;
            Ok(1)
        }
    }

    #[test]
    fn silence_is_noticed_and_the_end_is_the_end() {
        let began = Instant::now();
        let mut pipe = Pipe::new(Silent(false), Duration::from_millis(50));
        let error = read_up_to(&mut pipe, 2).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        assert!(broken(&error).to_string().contains("nothing came for 0.05 s"));
        assert!(began.elapsed() < Duration::from_secs(20));
        let bytes: Vec<u8> = (0..3 * PIECE).map(|i| (i % 251) as u8).collect();
        let mut pipe = Pipe::new(io::Cursor::new(bytes.clone()), Duration::from_secs(9));
        assert!(read_up_to(&mut pipe, u64::MAX).unwrap() == bytes);
        assert_eq!(pipe.read(&mut [0]).unwrap(), 0);
    }
}

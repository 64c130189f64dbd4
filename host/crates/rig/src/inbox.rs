//! Bytes on their way from whoever reads a link to whoever waits for packets: a queue with an end
//! to its patience and to its memory.

use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// What [`Outlet::take`] found.
#[derive(Debug)]
#[non_exhaustive]
pub enum Taken {
    /// Bytes have come.
    Bytes,
    /// None, until the time given.
    Nothing,
    /// None will come any more.
    Ended(io::Result<()>),
}

#[derive(Default)]
struct State {
    bytes: Vec<u8>,
    ended: Option<io::Result<()>>,
    closed: bool,
}

struct Inbox {
    state: Mutex<State>,
    changed: Condvar,
    most: usize,
}

impl Inbox {
    fn lock(&self) -> MutexGuard<'_, State> {
        // A thread that panicked has left whole chunks.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Where bytes go in.
pub struct Inlet(Arc<Inbox>);

/// Where bytes come out.
pub struct Outlet(Arc<Inbox>);

/// A queue that takes no more while it holds `most` bytes.
pub fn inbox(most: usize) -> (Inlet, Outlet) {
    let state = Mutex::new(State::default());
    let inbox = Arc::new(Inbox { state, changed: Condvar::new(), most });
    (Inlet(inbox.clone()), Outlet(inbox))
}

impl Inlet {
    /// Puts bytes in, when there is room.
    ///
    /// # Errors
    /// Nobody takes them any more.
    pub fn put(&self, bytes: &[u8]) -> io::Result<()> {
        let mut state = self.0.lock();
        while state.bytes.len() >= self.0.most && !state.closed {
            state = self.0.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        if state.closed {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        state.bytes.extend_from_slice(bytes);
        self.0.changed.notify_all();
        Ok(())
    }

    /// Says why no more will come. Without it, the end is one in good order.
    pub fn fail(&self, error: io::Error) {
        self.0.lock().ended.get_or_insert(Err(error));
    }
}

impl Drop for Inlet {
    fn drop(&mut self) {
        self.0.lock().ended.get_or_insert(Ok(()));
        self.0.changed.notify_all();
    }
}

impl Outlet {
    /// Puts all bytes that have come in place of `chunk`; waits for some until a time.
    pub fn take(&self, chunk: &mut Vec<u8>, until: Instant) -> Taken {
        let mut state = self.0.lock();
        while state.bytes.is_empty() {
            if let Some(how) = state.ended.take() {
                state.ended = Some(Ok(()));
                return Taken::Ended(how);
            }
            let wait = until.saturating_duration_since(Instant::now());
            if wait.is_zero() {
                return Taken::Nothing;
            }
            let woken = self.0.changed.wait_timeout(state, wait);
            state = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
        chunk.clear();
        std::mem::swap(chunk, &mut state.bytes);
        self.0.changed.notify_all();
        Taken::Bytes
    }
}

impl Drop for Outlet {
    fn drop(&mut self) {
        self.0.lock().closed = true;
        self.0.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_writer_waits_for_room_and_ends_when_nobody_takes() {
        let (inlet, outlet) = inbox(100);
        let writer = std::thread::spawn(move || {
            let chunks = (0..1000).take_while(|_| inlet.put(&[7; 60]).is_ok());
            chunks.count()
        });
        let (mut chunk, mut total) = (Vec::new(), 0);
        while total < 6000 {
            assert!(matches!(outlet.take(&mut chunk, later()), Taken::Bytes));
            assert!(chunk.len() < 100 + 60, "{} bytes waited", chunk.len());
            total += chunk.len();
        }
        drop(outlet);
        assert!(writer.join().unwrap() < 1000);
    }

    fn later() -> Instant {
        Instant::now() + Duration::from_secs(60)
    }

    #[test]
    fn what_was_put_in_comes_out_before_the_end() {
        let (inlet, outlet) = inbox(100);
        let mut chunk = Vec::new();
        assert!(matches!(outlet.take(&mut chunk, Instant::now()), Taken::Nothing));
        inlet.put(b"ab").unwrap();
        inlet.put(b"c").unwrap();
        inlet.fail(io::ErrorKind::ConnectionReset.into());
        drop(inlet);
        assert!(matches!(outlet.take(&mut chunk, later()), Taken::Bytes));
        assert_eq!(chunk, b"abc");
        assert!(matches!(outlet.take(&mut chunk, later()), Taken::Ended(Err(_))));
        assert!(matches!(outlet.take(&mut chunk, later()), Taken::Ended(Ok(()))));
    }
}

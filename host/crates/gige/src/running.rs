//! A device that threads share: its clock, its end, and the camera in the calling thread.

use crate::camera::{Camera, Order, Taken};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest wait of any thread, after which it looks whether the server ends.
pub const LOOK: Duration = Duration::from_millis(50);

/// A device that orders frames.
pub trait Orders {
    /// The next frame to take, if it is time.
    fn order<C: Camera>(&mut self, now: Duration, camera: &mut C) -> Option<Order>;

    /// When the next frame may begin, if that is known.
    fn next_order(&self) -> Option<Duration>;

    /// What became of the order.
    fn deliver(&mut self, taken: Taken);
}

/// A device that threads share. Times are since it was switched on.
#[derive(Debug)]
pub struct Running<D> {
    device: Mutex<D>,
    changed: Condvar,
    began: Instant,
    ends: AtomicBool,
}

/// Held by the threads that the device cannot do without: with the first that returns or panics,
/// all end.
#[derive(Debug)]
pub struct Ending<'a, D>(&'a Running<D>);

impl<D> Drop for Ending<'_, D> {
    fn drop(&mut self) {
        self.0.ends.store(true, Ordering::Release);
        self.0.tell();
    }
}

impl<D> Running<D> {
    /// A device that is switched on now.
    pub fn new(device: D) -> Self {
        Self {
            device: Mutex::new(device),
            changed: Condvar::new(),
            began: Instant::now(),
            ends: AtomicBool::new(false),
        }
    }

    /// The device, which no other thread has meanwhile.
    pub fn device(&self) -> MutexGuard<'_, D> {
        // With a thread that panicked the server ends.
        self.device.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The time.
    pub fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// Ends the device when it is dropped.
    pub fn ending(&self) -> Ending<'_, D> {
        Ending(self)
    }

    /// Whether the device ends.
    pub fn has_ended(&self) -> bool {
        self.ends.load(Ordering::Acquire)
    }

    /// Wakes the threads that wait: something has changed.
    pub fn tell(&self) {
        self.changed.notify_all();
    }

    /// Waits until something changes, or until a time; at most [`LOOK`].
    pub fn wait(&self, device: MutexGuard<'_, D>, until: Option<Duration>) {
        let wait = until.map_or(LOOK, |until| until.saturating_sub(self.now()).min(LOOK));
        drop(self.changed.wait_timeout(device, wait));
    }
}

impl<D: Orders> Running<D> {
    /// Takes frames as the device orders them, until `stops` or until the device ends.
    ///
    /// # Errors
    /// Those of the camera.
    pub fn take_frames<C: Camera>(
        &self,
        camera: &mut C,
        stops: impl Fn() -> bool,
    ) -> Result<(), C::Error> {
        let _ending = self.ending();
        while !stops() && !self.has_ended() {
            let mut device = self.device();
            match device.order(self.now(), camera) {
                Some(order) => {
                    drop(device);
                    let taken = camera.take(&order)?;
                    self.device().deliver(taken);
                    self.tell();
                }
                None => {
                    let until = device.next_order().filter(|due| *due > self.now());
                    self.wait(device, until);
                }
            }
        }
        Ok(())
    }
}

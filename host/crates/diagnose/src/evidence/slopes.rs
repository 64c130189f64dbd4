//! Derivatives of the figures of targets with respect to parameters of effects, found by
//! simulation and kept.

use crate::statistics::statistic::Key;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// Change of every figure, on its scale, per unit of a parameter (of defocus: per µm², since it
/// acts by its square).
pub type Slope = BTreeMap<Key, f64>;

/// Derivatives found so far. Each takes a run of the optics stage, and they change little while
/// other parameters do.
#[derive(Default)]
pub struct Slopes {
    known: Mutex<BTreeMap<Parameter, Option<Slope>>>,
}

/// Names a derivative: kind and key of the parameter, whether its value differs from 0, and how
/// many of the named kinds are those without which it has no effect.
pub type Parameter = (&'static str, &'static str, bool, usize);

impl Slopes {
    /// The derivative of a name, simulated by `ask` the first time; `None` where that gave none.
    pub fn of(&self, name: Parameter, ask: impl FnOnce() -> Option<Slope>) -> Option<Slope> {
        let known = self.known.lock().ok().and_then(|k| k.get(&name).cloned());
        known.unwrap_or_else(|| {
            let slope = ask();
            if let Ok(mut known) = self.known.lock() {
                known.insert(name, slope.clone());
            }
            slope
        })
    }

    /// Forgets all derivatives, so that they are simulated again at the present model.
    pub fn forget(&self) {
        if let Ok(mut known) = self.known.lock() {
            known.clear();
        }
    }
}

//! Names by evidence: every effect from the statistic that shows it, whatever else is left.
//!
//! [`camrig_estimates`] gives the same figures, with errors, of the captures and of frames that a
//! model simulates under the same conditions. An effect stands out where the two differ by
//! [`MIN_DEVIATION`] standard errors, so that what a model has already, the converter's rounding
//! and the bias of an estimator cancel. Of small frames the model's gains of sites are means over
//! several simulations, whose own scatter would hide a difference. Against the model as given this
//! gives proposals; against the improved model it tells what the effects that were named have
//! explained.

mod effects;
mod gather;

use crate::candidates::proposal::{Proposal, with_all};
use crate::report::{Amount, Evidence, EvidenceStatus};
use crate::search::Outcome;
use camrig_base::{Result, tails};
use camrig_camera::Camera;
use camrig_clean::{Cleaned, Finding, Kind};
use camrig_estimates::Estimates;
use effects::Test;
use gather::Gathered;

/// Standard errors from which an effect stands out: of some thirty tests, one in sixty thousand
/// sets has one by chance.
const MIN_DEVIATION: f64 = 5.0;

/// Estimates against the model with those before.
const SIMULATED_ESTIMATES: usize = 2;

/// What the captures show, and the conditions under which models are asked for the same.
pub struct Names {
    gathered: Gathered,
    found: Estimates,
    /// Of frames that the model as given simulates.
    pub(crate) given: Estimates,
    /// What the frames themselves show.
    of_frames: Vec<Evidence>,
}

impl Names {
    /// Of the dark and flat stacks of one gain and temperature; none where there is no dark stack
    /// of two frames.
    ///
    /// # Errors
    /// Files that cannot be read, a model that cannot be simulated.
    pub(crate) fn of(
        camera: &Camera,
        set: &Cleaned,
        measured: &crate::Measured,
    ) -> Result<Option<Self>> {
        let Some(gathered) = Gathered::of(camera, set, measured) else { return Ok(None) };
        let Ok(found) = gathered.measured(set)? else { return Ok(None) };
        let Ok(given) = gathered.modelled(camera)? else { return Ok(None) };
        let pixels = set.set().sensor.width * set.set().sensor.height;
        let dn_per_e = found.gain.map(|g| g.value);
        let of_frames = measured
            .findings
            .iter()
            .filter_map(|f| of_finding(f, pixels as f64, dn_per_e))
            .collect();
        Ok(Some(Self { of_frames, gathered, found, given }))
    }

    /// The effects that stand out against the model as given, with their parameters.
    ///
    /// # Errors
    /// A model that cannot be simulated.
    pub(crate) fn proposals(&self, camera: &Camera) -> Result<Vec<Proposal>> {
        let tests = effects::all(&self.found, &self.given);
        let of = |t: &Test, model: &Estimates, camera: &Camera| {
            let given = self.gathered.given();
            let p = effects::proposal(t, &self.found, model, camera, given)?;
            p.is_possible().then_some(Proposal { by_evidence: true, ..p })
        };
        let stands_out = |effect: &str| {
            tests.iter().any(|t| t.effect == effect && t.deviation.abs() >= MIN_DEVIATION)
        };
        // What sites have more than the lowest is beside a dark current of all.
        let is_needed =
            |t: &Test| t.effect == "dark-current" && stands_out("dark-current-by-site");
        let out: Vec<&Test> =
            tests.iter().filter(|t| stands_out(t.effect) || is_needed(t)).collect();
        let mut proposals: Vec<Proposal> = Vec::new();
        // Of several of one effect that which says the most.
        for p in out.iter().filter_map(|t| of(t, &self.given, camera)) {
            match proposals.iter_mut().find(|other| other.kind == p.kind) {
                Some(other) if other.parameters.len() < p.parameters.len() => *other = p,
                Some(_) => {}
                None => proposals.push(p),
            }
        }
        // Not all of what blinks is seen: what the model with it shows tells how much.
        for _ in 0..SIMULATED_ESTIMATES {
            if !proposals.iter().any(|p| effects::is_seen_in_part(p.kind)) {
                break;
            }
            let improved = with_all(camera, &proposals);
            let Ok(model) = self.gathered.simulated(&improved, 0)? else { break };
            for p in proposals.iter_mut().filter(|p| effects::is_seen_in_part(p.kind)) {
                let test = out.iter().find(|t| t.effect == p.kind);
                if let Some(again) = test.and_then(|t| of(t, &model, &improved)) {
                    *p = again;
                }
            }
        }
        Ok(proposals)
    }

    /// The largest deviation of frames that the model simulates once more, and its effect.
    #[cfg(test)]
    pub(crate) fn by_chance(&self, camera: &Camera, seed: u64) -> (f64, &'static str) {
        // Apart from the model's own.
        const AFTER_RUNS: u64 = 100;
        let found = self.gathered.simulated(camera, AFTER_RUNS + seed).unwrap().unwrap();
        let all = effects::all(&found, &self.given).into_iter();
        let all = all.map(|t| (t.deviation.abs(), t.effect));
        all.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, ""))
    }

    /// Every effect with its evidence, in the light of what the search found: a deviation that a
    /// model has which passes for the right one, without the effect, is explained by others.
    ///
    /// # Errors
    /// A model that cannot be simulated.
    pub(crate) fn judge(&self, outcome: &Outcome) -> Result<Vec<Evidence>> {
        let named: Vec<&str> = outcome.after.named.iter().map(|p| p.kind).collect();
        if outcome.steps.is_empty() && outcome.shapes.is_empty() {
            return Ok(self.evidence(&self.given, &named, false));
        }
        let improved = self.gathered.modelled(&outcome.after.camera)?;
        let improved = improved.unwrap_or_else(|_| self.given.clone());
        Ok(self.evidence(&improved, &named, outcome.after.passes()))
    }

    /// Every effect with its evidence. `named` are those of an improved model, which `passes` for
    /// the right one or not.
    pub(crate) fn evidence(
        &self,
        improved: &Estimates,
        named: &[&str],
        passes: bool,
    ) -> Vec<Evidence> {
        let before = effects::all(&self.found, &self.given);
        let after = effects::all(&self.found, improved);
        let count = before.len() as f64;
        let evidence = before.into_iter().map(|test| {
            let left = after.iter().find(|t| t.effect == test.effect);
            let left = left.map_or(test.deviation, |t| t.deviation);
            let by_others = passes && !named.contains(&effects::kind(test.effect));
            let status = match test.deviation.abs() >= MIN_DEVIATION {
                _ if test.undecided.is_some() => EvidenceStatus::NotDecidable,
                false => EvidenceStatus::Absent,
                true if by_others && left.abs() < MIN_DEVIATION => EvidenceStatus::Explained,
                true if test.in_part => EvidenceStatus::InPart,
                true => EvidenceStatus::Named,
            };
            let chance = 2.0 * count * libm::exp(tails::ln_upper(test.deviation.abs()));
            Evidence {
                amounts: test.amounts,
                description: test.undecided.unwrap_or(test.shown_by).into(),
                deviation: test.deviation,
                deviation_after: left,
                effect: test.effect.into(),
                false_alarm: chance.min(1.0),
                status,
            }
        });
        self.of_frames.iter().cloned().chain(evidence).collect()
    }
}

/// Torn frames and particle hits as evidence.
fn of_finding(found: &Finding, pixels: f64, dn_per_e: Option<f64>) -> Option<Evidence> {
    let (effect, amounts) = match found.kind {
        Kind::TornFrames => ("torn-frames", Vec::new()),
        Kind::ParticleHits => ("particle-hits", of_hits(found, pixels, dn_per_e)),
        _ => return None,
    };
    Some(Evidence {
        amounts,
        description: format!("{}: {}", found.place, found.description),
        deviation: f64::NAN,
        deviation_after: f64::NAN,
        effect: effect.into(),
        false_alarm: 0.0,
        status: EvidenceStatus::Named,
    })
}

/// How many particles hit, how often, and with what charge.
fn of_hits(found: &Finding, pixels: f64, dn_per_e: Option<f64>) -> Vec<Amount> {
    let amount = |name: &str, value: f64, std_error: f64, unit: &str| Amount {
        name: name.into(),
        std_error,
        unit: unit.into(),
        value,
    };
    let mut amounts = vec![amount("hits", found.count as f64, 0.0, "1")];
    if let Some(rate) = found.rate {
        amounts.push(amount("per_frame", rate.per_frame, rate.per_frame_std_error, "1"));
        if let Some((value, error)) = rate.per_s.zip(rate.per_s_std_error) {
            let per_mpx = 1e6 / pixels;
            amounts.push(amount("rate_per_mpx_s", value * per_mpx, error * per_mpx, "1/s"));
        }
    }
    let charges: Vec<f64> = found.hits.iter().map(|h| h.charge_dn).collect();
    let charge = camrig_estimates::robust::mean(&charges);
    amounts.push(amount("mean_charge", charge.value, charge.std_error, "DN"));
    if let Some(k) = dn_per_e {
        amounts.push(amount("mean_charge_e", charge.value / k, charge.std_error / k, "e-"));
    }
    amounts
}

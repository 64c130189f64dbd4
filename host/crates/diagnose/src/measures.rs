//! The measures of Chen et al. 2009, section VI, on a diagnosed set: MTF at the Nyquist frequency, scatter of the
//! luminance in the patches of a ColorChecker (Table I), the profile of a row. Held-out frames, the model before and
//! after.

use super::looks::Figure;
use super::search::Outcome;
use super::session::{Session, State};
use super::statistics::{Place, What};
use camrig_base::Plane;
use camrig_camera::Camera;
use camrig_captures::Role;
use camrig_measure::patches::DARK;
use camrig_measure::profile::{self, Along};
use serde::Serialize;

/// The middle part of an edge, and half a cycle per pixel.
const NYQUIST: (u8, u8) = (1, 5);
/// The paper's row, of 1536.
const ROW: (usize, usize) = (510, 1536);

/// The measures of a set.
#[derive(Debug, Default, Serialize)]
pub struct Measures {
    /// Of each edge and channel.
    pub mtf_at_nyquist: Vec<Response>,
    /// Of each ColorChecker.
    pub luminance_scatter: Vec<Scatter>,
    /// Of each ColorChecker.
    pub row_profile: Vec<Row>,
}

/// A response at the Nyquist frequency.
#[derive(Debug, Serialize)]
pub struct Response {
    /// The capture's id.
    pub capture: String,
    /// Name of the channel.
    pub channel: String,
    /// Of the held-out frames.
    pub measured: f64,
    /// Of the model as given.
    pub before: f64,
    /// Of the improved model.
    pub after: f64,
    /// Standard deviation of a measurement.
    pub std_dev: f64,
}

/// Mean absolute difference of the luminance's standard deviation from the model's over the patches, per cent.
#[derive(Debug, Serialize)]
pub struct Scatter {
    /// The capture's id.
    pub capture: String,
    /// Of the model as given: all patches, and without the paper's four dark ones.
    pub before: [f64; 2],
    /// Of the improved model.
    pub after: [f64; 2],
    /// What another sensor that the improved model is right for would give.
    pub expected: [f64; 2],
}

/// Root mean square difference of a row from the model's, DN.
#[derive(Debug, Serialize)]
pub struct Row {
    /// The capture's id.
    pub capture: String,
    /// Of the model as given.
    pub before: f64,
    /// Of the improved model.
    pub after: f64,
}

/// The measures of what was found.
pub fn measures(session: &Session, outcome: &Outcome) -> Measures {
    let half = &session.holdout;
    let states = [&outcome.before, &outcome.after];
    let mut out = Measures::default();
    for (i, look) in half.design.looks.iter().enumerate() {
        let seen = |figure: Figure| {
            let key = (Place::Look(i), What::Of(figure));
            let model = |s: &State| s.holdout.of.get(&key).map(|p| p.value);
            let sd = states[1].holdout.of.get(&key)?.sd;
            Some((half.values.get(&key)?.value, [model(states[0])?, model(states[1])?], sd))
        };
        let capture = look.id.clone();
        for (c, channel) in outcome.before.camera.sensor.channel_names.iter().enumerate() {
            let figure = Figure::Response(NYQUIST.0, c as u8, NYQUIST.1);
            if let Some((measured, [before, after], std_dev)) = seen(figure) {
                let (capture, channel) = (capture.clone(), channel.clone());
                out.mtf_at_nyquist.push(Response {
                    capture,
                    channel,
                    measured,
                    before,
                    after,
                    std_dev,
                });
            }
        }
        if look.role != Role::Chart {
            continue;
        }
        let patches: Vec<(usize, [f64; 3])> = (1..=camrig_measure::patches::COUNT)
            .filter_map(|n| {
                let (measured, model, sd) = seen(Figure::PatchScatter(n as u8))?;
                let off = |k: usize| 100.0 * (measured / model[k] - 1.0).abs();
                // Mean of |z| of a normal deviate.
                let luck = 100.0 * sd * (2.0 / std::f64::consts::PI).sqrt();
                Some((n, [off(0), off(1), luck]))
            })
            .collect();
        let mean = |k: usize, keep: &dyn Fn(usize) -> bool| {
            let kept: Vec<f64> = patches.iter().filter(|p| keep(p.0)).map(|p| p.1[k]).collect();
            kept.iter().sum::<f64>() / kept.len() as f64
        };
        if !patches.is_empty() {
            let [before, after, expected] =
                [0, 1, 2].map(|k| [mean(k, &|_| true), mean(k, &|n| !DARK.contains(&n))]);
            out.luminance_scatter.push(Scatter {
                capture: capture.clone(),
                before,
                after,
                expected,
            });
        }
        let rows = states.map(|s| {
            let model = session.picture(&s.camera, look).ok()?;
            row_difference(&s.camera, &half.pictures.get(i)?.mean, &model)
        });
        if let [Some(before), Some(after)] = rows {
            out.row_profile.push(Row { capture, before, after });
        }
    }
    out
}

/// Root mean square difference of the row in two pictures: two lines around it, so that every filter pattern has the
/// channel.
fn row_difference(camera: &Camera, seen: &Plane<f32>, model: &Plane<f32>) -> Option<f64> {
    let cfa = &camera.sensor.cfa;
    let letter = *cfa.channels().get(super::looks::densest(camera))?;
    let first = ROW.0 * seen.height / ROW.1 / cfa.height * cfa.height;
    let black = camera.sensor.black_level_dn;
    let of = |frame| profile::along(frame, cfa, letter, black, Along::Row, first, cfa.height).ok();
    Some(profile::difference(&of(seen)?, &of(model)?).ok()?.rms_dn)
}

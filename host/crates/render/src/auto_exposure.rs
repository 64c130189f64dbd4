//! Automatic exposure: the integration time at which a frame has the brightness that is asked for.
//!
//! Trial frames are taken and judged as a camera does it, by their samples; each time the exposure
//! is scaled by what lacks. The result is rounded to three digits, so that it can be typed again.

use super::{SimulatedSensor, metadata};
use camrig_base::{Error, RawFrame, Result};
use camrig_camera::Camera;
use camrig_exposure::IrradianceCube;

/// What a frame is to be like.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Brightness {
    /// 99.9 % of the samples of each channel lie below 0.85 of the range above black: highlights
    /// keep a quarter of a stop. Lower, where the camera's noise is so large that five standard
    /// deviations above that level are clipped.
    Highlights,
    /// The mean of the green channel (of all, where none is green) is this share of the range
    /// above black. Where more than 0.1 % of the samples of a channel lie within five standard
    /// deviations of the camera's noise of its end, as `Highlights`.
    Mean(f64),
}

/// Share of the range above black at which 99.9 % of the samples end.
const HIGHLIGHTS: f64 = 0.85;
/// The share of the brightest channel's samples that lies below it: a patch of a chart is more than
/// the rest, hot pixels are less.
const BELOW: f64 = 0.999;
/// Standard deviations of noise for which a level leaves room: of a patch of 3.5 million pixels, one
/// is beyond.
const NOISE: f64 = 5.0;
/// The least level that highlights get: that of a grey card. At gains whose noise is wider, a
/// picture has clipped noise or nothing else.
const GREY: f64 = 0.18;
/// Shortest and longest exposure, s: a global shutter's least, and a minute.
const EXPOSURES_S: [f64; 2] = [1e-6, 60.0];
/// Exposure of the first trial, s.
const FIRST_S: f64 = 0.01;
/// Relative error of the share with which the search ends.
const ENOUGH: f64 = 0.01;
/// Trials at most: 18 steps of [`STEP`] span the exposures, and six follow a straight line.
const TRIALS: usize = 24;
/// Factor of the exposure where a trial is saturated or black.
const STEP: f64 = 4.0;
/// Share from which a trial counts as saturated, and below which as black.
const SATURATED: f64 = 0.97;
const BLACK: f64 = 0.01;

/// An exposure time that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Found {
    /// The exposure time, s.
    pub exposure_s: f64,
    /// The exposure, s, that has the mean that was asked for, where it clips the highlights of a
    /// channel: the exposure is that of [`Brightness::Highlights`] then.
    pub clipping_s: Option<f64>,
}

/// The exposure time for irradiance on the sensor at analog gain `gain` (the camera file's unless
/// given).
///
/// # Errors
/// A share that is not between 0 and 1; light that no exposure from 1 µs to a minute brings to
/// that brightness.
pub fn exposure_s(
    camera: &Camera,
    sensor: &SimulatedSensor,
    cube: &IrradianceCube,
    gain: Option<f64>,
    brightness: Brightness,
) -> Result<Found> {
    let top = unclipped(camera, gain.unwrap_or(camera.sensor.analog_gain));
    let highlights = f64::min(HIGHLIGHTS, top);
    let trials = Trials { camera, sensor, cube, gain };
    let Brightness::Mean(mean) = brightness else {
        let (exposure_s, _) = trials.search(brightness, highlights)?;
        return Ok(Found { exposure_s, clipping_s: None });
    };
    let (exposure_s, frame) = trials.search(brightness, mean)?;
    if share(&frame, Brightness::Highlights) <= top {
        return Ok(Found { exposure_s, clipping_s: None });
    }
    let (shorter_s, _) = trials.search(Brightness::Highlights, highlights)?;
    Ok(Found { exposure_s: shorter_s, clipping_s: Some(exposure_s) })
}

/// The level, as a share of the range above black, that is [`NOISE`] standard deviations below its
/// end: m + n √(S m + O + p² m²) = w, with the camera's noise profile (S, O), PRNU p and saturation
/// at w, each of the converter's range; [`GREY`] where noise is larger.
fn unclipped(camera: &Camera, gain: f64) -> f64 {
    let sensor = &camera.sensor;
    let (shot, dark) = metadata::noise_profile(camera, gain)[0];
    let at = sensor.at_gain(gain);
    let range_dn = f64::from((1u32 << sensor.bits) - 1) - at.black_level_dn;
    let end = sensor.saturation_e(gain) * at.dn_per_e / range_dn;
    let n2 = NOISE * NOISE;
    // a m² − b m + c = 0, of which the smaller solution is the one below the end.
    let (a, b, c) = (
        1.0 - n2 * sensor.noise.prnu * sensor.noise.prnu,
        2.0 * end + n2 * shot,
        end * end - n2 * dark,
    );
    (2.0 * c / (b + (b * b - 4.0 * a * c).sqrt()) / end).max(GREY)
}

/// What trial frames are taken of.
struct Trials<'a> {
    camera: &'a Camera,
    sensor: &'a SimulatedSensor,
    cube: &'a IrradianceCube,
    gain: Option<f64>,
}

impl Trials<'_> {
    /// The exposure time, s, at which the brightness is `goal`, and its last trial.
    fn search(&self, brightness: Brightness, goal: f64) -> Result<(f64, RawFrame)> {
        if !(goal > BLACK && goal < SATURATED) {
            return Err(Error::input(format!("automatic exposure to {goal} of the range"))
                .help(format!("give a share from {BLACK} to {SATURATED}, such as 0.18")));
        }
        let [shortest, longest] = EXPOSURES_S;
        let mut exposure_s = FIRST_S;
        for _ in 0..TRIALS {
            let settings = self.camera.settings(0, exposure_s, self.gain);
            let frame = self.sensor.frame(self.cube, &settings)?;
            let factor = towards(goal, share(&frame, brightness));
            if (1.0 / factor - 1.0).abs() < ENOUGH {
                return Ok((three_digits(exposure_s), frame));
            }
            let next = exposure_s * factor;
            if next < shortest || next > longest {
                break;
            }
            exposure_s = next;
        }
        Err(Error::limit("automatic exposure finds no exposure time").help(format!(
            "no exposure from {shortest} to {longest} s brings the frame to {goal} of the range \
             above black: change light or gain, or give the time"
        )))
    }
}

/// The factor by which the exposure of a frame is to be multiplied, as far as the frame tells:
/// where it is saturated or black it tells the direction alone.
pub fn correction(frame: &RawFrame, brightness: Brightness) -> f64 {
    let goal = match brightness {
        Brightness::Highlights => HIGHLIGHTS,
        Brightness::Mean(share) => share,
    };
    towards(goal, share(frame, brightness))
}

/// The factor from a share of the range to another.
fn towards(goal: f64, share: f64) -> f64 {
    match share {
        s if s > SATURATED => 1.0 / STEP,
        s if s < BLACK => STEP,
        s => goal / s,
    }
}

/// How bright a frame is, of the range above black.
fn share(frame: &RawFrame, brightness: Brightness) -> f64 {
    let level = match brightness {
        Brightness::Highlights => {
            let mut channels = vec![Vec::new(); frame.cfa.channels().len()];
            for (i, dn) in frame.data.iter().enumerate() {
                channels[frame.cfa.channel(i % frame.width, i / frame.width)].push(*dn);
            }
            let ends = channels.iter_mut().filter(|samples| !samples.is_empty()).map(|samples| {
                let place = ((BELOW * samples.len() as f64) as usize).min(samples.len() - 1);
                *samples.select_nth_unstable(place).1
            });
            f64::from(ends.max().unwrap_or(0))
        }
        Brightness::Mean(_) => {
            let cfa = &frame.cfa;
            let any_green = cfa.letters.contains(&'G');
            let counts = |i: usize| {
                let (x, y) = (i % frame.width, i / frame.width);
                let letter = cfa.letters[y % cfa.height * cfa.width + x % cfa.width];
                !any_green || letter == 'G'
            };
            let samples = frame.data.iter().enumerate().filter(|(i, _)| counts(*i));
            let (sum, n) = samples.fold((0u64, 0u64), |(s, n), (_, v)| (s + u64::from(*v), n + 1));
            sum as f64 / n.max(1) as f64
        }
    };
    let range = f64::from(frame.white_level_dn) - frame.black_level_dn;
    (level - frame.black_level_dn) / range
}

fn three_digits(v: f64) -> f64 {
    format!("{v:.2e}").parse().unwrap_or(v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SceneLight, scene_irradiance};
    use camrig_optics::Options;

    fn exposed(scene: &str, lux: f64, brightness: Brightness) -> Result<(Found, RawFrame)> {
        exposed_in("D65", scene, lux, brightness)
    }

    fn exposed_in(
        light: &str,
        scene: &str,
        lux: f64,
        brightness: Brightness,
    ) -> Result<(Found, RawFrame)> {
        let mut camera = Camera::load("mt9t012").unwrap();
        (camera.sensor.width, camera.sensor.height) = (64, 48);
        let light = SceneLight::lux(light, lux);
        let options = Options::default();
        let cube = scene_irradiance(&camera, scene, &light, &options, |_, _| ()).unwrap().cube;
        let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
        let found = exposure_s(&camera, &sensor, &cube, None, brightness)?;
        let settings = camera.settings(7, found.exposure_s, None);
        Ok((found, sensor.frame(&cube, &settings).unwrap()))
    }

    #[test]
    fn frames_have_the_brightness_that_is_asked_for() {
        let mut times = Vec::new();
        for lux in [3.0, 300.0, 30_000.0] {
            let (Found { exposure_s, .. }, frame) =
                exposed("colorchecker", lux, Brightness::Highlights).unwrap();
            let found = share(&frame, Brightness::Highlights);
            assert!((found - HIGHLIGHTS).abs() < 0.03, "{lux}: {found}");
            times.push(exposure_s);
        }
        // A hundred times the light takes a hundredth of the time.
        assert!((times[1] / times[2] / 100.0 - 1.0).abs() < 0.05, "{times:?}");
        let mean = Brightness::Mean(0.18);
        let (found, frame) = exposed("colorchecker", 300.0, mean).unwrap();
        assert!((share(&frame, mean) - 0.18).abs() < 0.01 && found.clipping_s.is_none());
        let green = frame.channel_means();
        assert!(green.iter().any(|channel| channel.name.starts_with('g')));
    }

    /// The white patch, 1.4 % of the green samples, is the brightest of every channel.
    #[test]
    fn the_white_patch_of_a_chart_is_not_clipped() {
        let (_, frame) = exposed("colorchecker", 300.0, Brightness::Highlights).unwrap();
        for channel in frame.channel_means() {
            assert_eq!(channel.saturated, 0.0, "{}", channel.name);
        }
    }

    /// At high gain, noise of a level of 0.85 would be clipped: m + 5 √(m + 3²) = 8500/40 e⁻ has
    /// m = 149 e⁻, 0.70 of it.
    #[test]
    fn highlights_leave_room_for_the_noise() {
        let mut camera = Camera::load("mt9t012").unwrap();
        let sensor = &mut camera.sensor;
        (sensor.full_well_e, sensor.full_scale_e, sensor.black_level_dn) = (8500.0, 8500.0, 0.0);
        sensor.noise.prnu = 0.0;
        (sensor.noise.read_e, sensor.noise.read_e_post) = (3.0, 0.0);
        let m = 0.70 * 8500.0 / 40.0;
        let with_noise = m + 5.0 * f64::sqrt(m + 9.0);
        assert!((with_noise / (8500.0 / 40.0) - 1.0).abs() < 0.005, "{with_noise}");
        assert!((unclipped(&camera, 40.0) - 0.70).abs() < 0.005);
        assert!(unclipped(&camera, 1.0) > 0.94);
        assert_eq!(unclipped(&camera, 1e4), GREY);
    }

    /// In tungsten light, red of the white patch ends before green has its mean; the darker mean
    /// that fits is the one that was asked for.
    #[test]
    fn a_mean_that_clips_a_channel_gives_way_to_the_highlights() {
        let (mean, highlights) = (Brightness::Mean(0.3), Brightness::Highlights);
        let (found, frame) = exposed_in("A", "colorchecker", 200.0, mean).unwrap();
        for channel in frame.channel_means() {
            assert_eq!(channel.saturated, 0.0, "{}", channel.name);
        }
        let alone = exposed_in("A", "colorchecker", 200.0, highlights).unwrap().0;
        assert_eq!(found.exposure_s, alone.exposure_s);
        assert!(found.clipping_s.unwrap() > 1.1 * found.exposure_s, "{found:?}");
        let darker = Brightness::Mean(0.1);
        let (found, frame) = exposed_in("A", "colorchecker", 200.0, darker).unwrap();
        assert!(found.clipping_s.is_none() && (share(&frame, darker) - 0.1).abs() < 0.005);
    }

    #[test]
    fn light_that_no_exposure_suits_is_refused() {
        let error = exposed("uniform:0.5", 1e12, Brightness::Highlights).unwrap_err();
        assert!(error.to_string().contains("no exposure time"), "{error}");
        assert!(exposed("uniform:0.5", 300.0, Brightness::Mean(1.5)).is_err());
        assert_eq!(three_digits(0.0123456), 0.0123);
    }
}

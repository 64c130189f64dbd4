//! Candidates that show over time.

use super::{Proposal, deviation, list};
use crate::captures::Role;
use crate::diagnose::evidence::{Estimated, Evidence, pooled, slope};
use crate::diagnose::maps::MapKind;
use crate::diagnose::model::current;
use crate::diagnose::statistics::{Place, What};
use crate::diagnose::temporal::Temporal;
use sensor_core::effects::{
    Effect, brighter_fatter::BrighterFatter, charge_coupling::ChargeCoupling,
    column_temporal_noise::ColumnTemporalNoise, flicker_banding::FlickerBanding,
    frame_offset_noise::FrameOffsetNoise, heavy_tailed_read_noise::HeavyTailedReadNoise,
    light_flicker::LightFlicker, periodic_pattern_noise::PeriodicPatternNoise,
    random_telegraph_noise::RandomTelegraphNoise, read_noise::ReadNoise,
    read_noise_spread::ReadNoiseSpread, row_correlated_noise::RowCorrelatedNoise,
    row_temporal_noise::RowTemporalNoise,
};

/// Size of a stack as f64.
fn size(e: &Evidence<'_>) -> (f64, f64) {
    (f64::from(e.camera.sensor.width), f64::from(e.camera.sensor.height))
}

/// Excess of a component that is the same in every stack, e⁻².
fn common(e: &Evidence<'_>, what: What, across: f64) -> Option<Estimated> {
    pooled(e.design.conditions.iter().enumerate().filter_map(|(i, c)| {
        let k = e.gain(c).powi(2);
        let x = e.component(i, what, across)?;
        Some(Estimated { value: x.value / k, se: x.se / k })
    }))
}

/// Variance of row means beyond white noise / pixels.
pub fn row_temporal(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let excess = common(e, What::RowVariance, size(e).0)?;
        let present = match current(e.camera, "row-temporal-noise") {
            Some(Effect::RowTemporalNoise(x)) => f64::from(x.sigma_e),
            _ => 0.0,
        };
        let s = deviation(present, excess)?;
        let effect = RowTemporalNoise { sigma_e: s.value as f32 };
        Some(
            Proposal::new("row-temporal-noise", effect.into(), excess.z().abs())
                .with("sigma_e", s.value, s.se),
        )
    })())
}

/// The same over columns.
pub fn column_temporal(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let excess = common(e, What::ColumnVariance, size(e).1)?;
        let present = match current(e.camera, "column-temporal-noise") {
            Some(Effect::ColumnTemporalNoise(x)) => f64::from(x.sigma_e),
            _ => 0.0,
        };
        let s = deviation(present, excess)?;
        let effect = ColumnTemporalNoise { sigma_e: s.value as f32 };
        Some(
            Proposal::new("column-temporal-noise", effect.into(), excess.z().abs())
                .with("sigma_e", s.value, s.se),
        )
    })())
}

/// Variance of row means with the slope of its spectrum.
pub fn row_correlated(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (w, _) = size(e);
        let (present, held) = match current(e.camera, "row-correlated-noise") {
            Some(Effect::RowCorrelatedNoise(x)) => (f64::from(x.sigma_e), Some(x.exponent)),
            _ => (0.0, None),
        };
        let excess = common(e, What::RowVariance, w)?;
        let exponent = match held {
            Some(a) => f64::from(a),
            // Flatter than this it is white.
            None => spectral_slope(e).filter(|a| *a > 0.2)?,
        };
        let s = deviation(present, excess)?;
        let effect = RowCorrelatedNoise { sigma_e: s.value as f32, exponent: exponent as f32 };
        let strength = excess.z().abs();
        Some(
            Proposal::new("row-correlated-noise", effect.into(), strength)
                .with("sigma_e", s.value, s.se)
                .with("exponent", exponent, f64::NAN),
        )
    })())
}

/// −slope of ln power over ln frequency of dark row means, white part taken off, octave by octave.
fn spectral_slope(e: &Evidence<'_>) -> Option<f64> {
    let (w, _) = size(e);
    let darks: Vec<&Temporal> = e.of_role(Role::Dark).map(|(i, _)| &e.stacks[i]).collect();
    let bins = darks.first()?.row_power.len();
    let (mut sum, mut dof) = (vec![0.0; bins], 0.0);
    for t in &darks {
        let white = t.pixel_variance.iter().map(|&v| f64::from(v)).sum::<f64>()
            / t.pixel_variance.len() as f64
            / w;
        for (s, p) in sum.iter_mut().zip(&t.row_power) {
            *s += t.dof * (p - white);
        }
        dof += t.dof;
    }
    let white = darks
        .iter()
        .map(|t| {
            t.pixel_variance.iter().map(|&v| f64::from(v)).sum::<f64>()
                / t.pixel_variance.len() as f64
                / w
                * t.dof
        })
        .sum::<f64>()
        / dof;
    // Weighted least squares over octaves whose power stands out.
    let (mut sw, mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let mut from = 0;
    let mut width = 1;
    while from < bins {
        let to = (from + width).min(bins);
        let n = (to - from) as f64;
        let power = sum[from..to].iter().sum::<f64>() / n / dof;
        let se = (power.max(0.0) + white) / (n * dof).sqrt();
        if power > 2.0 * se {
            let x = ((from + to + 1) as f64 / 2.0).ln();
            let weight = (power / se).powi(2);
            let y = power.ln();
            sw += weight;
            sx += weight * x;
            sy += weight * y;
            sxx += weight * x * x;
            sxy += weight * x * y;
        }
        from = to;
        width *= 2;
    }
    let det = sw * sxx - sx * sx;
    (det > 0.0).then(|| (-(sw * sxy - sx * sy) / det).clamp(0.05, 2.0)).filter(|a| a.is_finite())
}

/// The strongest line of the dark frames' power.
pub fn periodic(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (w, h) = size(e);
        let (stack, c) = e.of_role(Role::Dark).max_by_key(|(_, c)| c.frames)?;
        let place = Place::Stack(stack);
        let plane = e.difference(place, What::PlanePeak).map_or(0.0, |d| d.z());
        let row = e.difference(place, What::RowPeak).map_or(0.0, |d| d.z());
        let t = &e.stacks[stack];
        let k = e.gain(c);
        // A plane wave's power is A²wh/4, a wave along the column only shows as row means with A²h/4.
        let (fx, fy, square, strength) = if plane >= row {
            let (fx, fy, power) = plane_peak(t)?;
            (fx, fy, 4.0 * power / (w * h), plane)
        } else {
            let (f, power) = line_peak(&t.row_power, h);
            (0.0, f, 4.0 * power / h, row)
        };
        let amplitude = square.max(0.0).sqrt() / k;
        // Relative error of an amplitude seen in `dof` frames against white noise.
        let v = e.variance(stack)?.0 / (k * k);
        let se = (2.0 * v / (w * h) / t.dof).sqrt();
        let effect = PeriodicPatternNoise {
            amplitude_e: amplitude as f32,
            cycles_per_column: fx as f32,
            cycles_per_row: fy as f32,
        };
        let mut p = Proposal::new("periodic-pattern-noise", effect.into(), strength)
            .with("amplitude_e", amplitude, se)
            .with("cycles_per_column", fx, f64::NAN)
            .with("cycles_per_row", fy, f64::NAN);
        p.beside = true;
        Some(p)
    })())
}

/// Frequencies and power above white of the strongest wave: a wave between two bins leaks, so the bins around count.
fn plane_peak(t: &Temporal) -> Option<(f64, f64, f64)> {
    let power = t.power.as_ref()?;
    let (w, h) = (t.width, t.height);
    let half = w / 2 + 1;
    let at = (0..power.len()).max_by(|&a, &b| power[a].total_cmp(&power[b]))?;
    let (y, x) = (at / half, at % half);
    let white = power.iter().map(|&p| f64::from(p)).sum::<f64>() / power.len() as f64;
    let get = |dy: isize, dx: isize| -> f64 {
        let yy = (y as isize + dy).rem_euclid(h as isize) as usize;
        let xx = x as isize + dx;
        if xx < 0 || xx >= half as isize {
            0.0
        } else {
            f64::from(power[yy * half + xx as usize]) - white
        }
    };
    let mut sum = 0.0;
    for dy in -3..=3 {
        for dx in -3..=3 {
            sum += get(dy, dx).max(0.0);
        }
    }
    let between = |low: f64, here: f64, high: f64| {
        let root = |p: f64| p.max(0.0).sqrt();
        let (l, m, r) = (root(low), root(here), root(high));
        if r > l { r / (m + r) } else { -l / (m + l) }
    };
    let fx = (x as f64 + between(get(0, -1), get(0, 0), get(0, 1))) / w as f64;
    let fy = (y as f64 + between(get(-1, 0), get(0, 0), get(1, 0))) / h as f64;
    // On the edges of the half spectrum a wave is there once, elsewhere its mirror image is left out.
    Some((fx.clamp(0.0, 0.5), if fy > 0.5 { fy - 1.0 } else { fy }, sum))
}

fn line_peak(power: &[f64], n: f64) -> (f64, f64) {
    let at = (0..power.len()).max_by(|&a, &b| power[a].total_cmp(&power[b])).unwrap_or(0);
    let mut sorted = power.to_vec();
    sorted.sort_by(f64::total_cmp);
    let white = sorted[sorted.len() / 2];
    let get = |i: isize| power.get(i.max(0) as usize).map_or(0.0, |p| (p - white).max(0.0));
    let i = at as isize;
    let (l, m, r) = (get(i - 1).sqrt(), get(i).sqrt(), get(i + 1).sqrt());
    let shift = if r > l { r / (m + r) } else { -l / (m + l) };
    let sum: f64 = (-3..=3).map(|d| get(i + d)).sum();
    ((at as f64 + 1.0 + shift) / n, sum)
}

/// Variance of frame means in the dark.
pub fn frame_offset(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (w, h) = size(e);
        let excess = pooled(e.design.conditions.iter().enumerate().filter_map(|(i, c)| {
            let k = e.gain(c).powi(2);
            let x = e.component(i, What::FrameVariance, w * h)?;
            Some(Estimated { value: x.value / k, se: x.se / k })
        }))?;
        let (present, held) = match current(e.camera, "frame-offset-noise") {
            Some(Effect::FrameOffsetNoise(x)) => (f64::from(x.sigma_e), f64::from(x.correlation)),
            _ => (0.0, 0.0),
        };
        let s = deviation(present, excess)?;
        let memory = pooled(
            e.of_role(Role::Dark)
                .filter_map(|(i, _)| e.difference(Place::Stack(i), What::FrameLag)),
        );
        // Below three standard errors drift is taken as white. A short stack's own mean hides part of the memory: the
        // difference to the model is repeated until it is gone.
        let correlation = match memory {
            Some(m) if held != 0.0 || m.z() > 3.0 => (held + 1.3 * m.value).clamp(0.0, 0.95),
            _ => held,
        };
        let effect = FrameOffsetNoise { sigma_e: s.value as f32, correlation: correlation as f32 };
        let stacks = 0..e.stacks.len();
        let frames = stacks.map(|i| (Place::Stack(i), What::FrameVariance));
        let strength = e.stands_out(frames).abs().max(excess.z().abs());
        Some(
            Proposal::new("frame-offset-noise", effect.into(), strength)
                .with("sigma_e", s.value, s.se)
                .with("correlation", correlation, memory.map_or(f64::NAN, |m| m.se)),
        )
    })())
}

/// Variance of frame means in proportion to the square of the signal.
pub fn light_flicker(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (w, h) = size(e);
        let excess = pooled(e.flats().filter_map(|(i, _)| {
            let square = e.signal(i)?.powi(2);
            let x = e.component(i, What::FrameVariance, w * h)?;
            Some(Estimated { value: x.value / square, se: x.se / square })
        }))?;
        let present = match current(e.camera, "light-flicker") {
            Some(Effect::LightFlicker(x)) => f64::from(x.sigma),
            _ => 0.0,
        };
        let s = deviation(present, excess)?;
        let effect = LightFlicker { sigma: s.value as f32 };
        let frames = e.flats().map(|(i, _)| (Place::Stack(i), What::FrameVariance));
        let strength = e.stands_out(frames).abs().max(excess.z().abs());
        Some(Proposal::new("light-flicker", effect.into(), strength).with("sigma", s.value, s.se))
    })())
}

/// Frequencies tried for light that pulsates, Hz: 30 to 3000 in steps of 1 %.
fn frequencies() -> impl Iterator<Item = f64> {
    (0..463).map(|i| 30.0 * 1.01f64.powi(i))
}

/// |sin(πx)/(πx)|: what is left of a wave of x periods in an exposure.
fn sinc(x: f64) -> f64 {
    let x = std::f64::consts::PI * x;
    if x.abs() < 1e-6 { 1.0 } else { (x.sin() / x).abs() }
}

/// Bins to either side of a line that a wave between two bins leaks into.
const LEAK: usize = 3;

/// The line in the spectra of row means that grows with the signal: cycles per row, and for each flat its exposure and
/// the mean square of the wave relative to the signal, over its scatter in that line alone.
fn bands(e: &Evidence<'_>) -> Option<(f64, Vec<(f64, Estimated)>)> {
    let (_, h) = size(e);
    // Exposure, signal, degrees of freedom, spectrum.
    let flats: Vec<(f64, f64, f64, &[f64])> = e
        .flats()
        .filter_map(|(i, c)| {
            let t = &e.stacks[i];
            Some((c.exposure_s, e.signal(i)?, t.dof, t.row_power.as_slice()))
        })
        .collect();
    let mean = |power: &[f64]| power.iter().sum::<f64>() / power.len() as f64;
    let mut pooled = vec![0.0; flats.first()?.3.len()];
    for (_, signal, dof, power) in &flats {
        let weight = dof * (signal / mean(power).max(1e-12)).powi(2);
        pooled.iter_mut().zip(*power).for_each(|(sum, p)| *sum += weight * p);
    }
    let (rows, _) = line_peak(&pooled, h);
    let at = ((rows * h).round() as usize).clamp(1, pooled.len()) - 1;
    let (from, to) = (at.saturating_sub(LEAK), (at + LEAK + 1).min(pooled.len()));
    let of_flat = |&(exposure, signal, dof, power): &(f64, f64, f64, &[f64])| {
        // What is there without the wave, from the bins around.
        let mut around: Vec<f64> = power[from.saturating_sub(12)..from].to_vec();
        around.extend(&power[to..(to + 12).min(power.len())]);
        around.sort_by(f64::total_cmp);
        let white = around.get(around.len() / 2)? / (1.0 - 1.0 / (9.0 * dof)).powi(3);
        let line = &power[from..to];
        let excess = line.iter().sum::<f64>() - white * line.len() as f64;
        // A wave and white noise: (2 s + white) white in each bin, over the frames.
        let variance: f64 = line.iter().map(|p| (2.0 * p.max(white) - white) * white / dof).sum();
        let scale = (h / 2.0) * signal * signal / 2.0;
        let mean_square = Estimated { value: excess / scale, se: variance.sqrt() / scale };
        (signal > 0.0 && white > 0.0).then_some((exposure, mean_square))
    };
    Some((rows, flats.iter().filter_map(of_flat).collect()))
}

/// The frequency of light whose bands exposures of different length average: least squares of A² sinc².
fn light_frequency(bands: &[(f64, Estimated)]) -> Option<f64> {
    let misfit = |f: f64| {
        let a = slope(bands.iter().map(|(t, b)| (sinc(f * t).powi(2).max(1e-9), *b)))?;
        let left =
            bands.iter().map(|(t, b)| ((b.value - a.value * sinc(f * t).powi(2)) / b.se).powi(2));
        Some(left.sum::<f64>())
    };
    let all: Vec<(f64, f64)> = frequencies().filter_map(|f| Some((f, misfit(f)?))).collect();
    let best = all.iter().map(|x| x.1).fold(f64::MAX, f64::min);
    // Of frequencies that serve as well (within two standard deviations) the one next to that of mains lamps.
    let mains = |f: f64| (f / 100.0).ln().abs().min((f / 120.0).ln().abs());
    let good = all.into_iter().filter(|x| x.1 < best + 4.0);
    Some(good.min_by(|a, b| mains(a.0).total_cmp(&mains(b.0)))?.0)
}

/// A line of the row means in proportion to the signal.
pub fn flicker_banding(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (rows, bands) = bands(e)?;
        let (present, rows, frequency) = match current(e.camera, "flicker-banding") {
            Some(Effect::FlickerBanding(x)) => {
                let rows = f64::from(x.frequency_hz) * f64::from(x.row_time_us) * 1e-6;
                (f64::from(x.depth), rows, f64::from(x.frequency_hz))
            }
            _ => (0.0, rows, light_frequency(&bands)?),
        };
        let square = slope(bands.iter().map(|(t, b)| (sinc(frequency * t).powi(2).max(1e-9), *b)))?;
        let depth = deviation(0.0, square)?;
        let effect = FlickerBanding {
            depth: depth.value as f32,
            frequency_hz: frequency as f32,
            row_time_us: (rows / frequency * 1e6) as f32,
        };
        let strength = (square.value - present * present).abs() / square.se;
        Some(
            Proposal::new("flicker-banding", effect.into(), strength)
                .with("depth", depth.value, depth.se)
                .with("frequency_hz", frequency, f64::NAN)
                .with("row_time_us", rows / frequency * 1e6, f64::NAN),
        )
    })())
}

/// Pixel variance of the dark stacks.
pub fn read_noise(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let short = short_darks(e);
        let excess = pooled(short.iter().filter_map(|&i| {
            let k = e.gain(&e.design.conditions[i]).powi(2);
            let x = e.variance_excess(i)?;
            Some(Estimated { value: x.value / k, se: x.se / k })
        }))?;
        let noise = &e.camera.sensor.noise;
        let s = deviation(noise.read_e, excess)?;
        let post = noise.read_e_post.min(s.value);
        let effect = ReadNoise { read_e: s.value as f32, read_e_post: post as f32 };
        Some(
            Proposal::new("read-noise", effect.into(), excess.z().abs())
                .with("read_e", s.value, s.se),
        )
    })())
}

/// Dark stacks whose dark charge is small against read noise, else the shortest.
fn short_darks(e: &Evidence<'_>) -> Vec<usize> {
    let noise = &e.camera.sensor.noise;
    let few: Vec<usize> = e
        .of_role(Role::Dark)
        .filter(|(_, c)| {
            let growth =
                ((c.temperature_c - noise.temperature_ref_c) / noise.dark_doubling_c).exp2();
            noise.dark_current_e_per_s * growth * c.exposure_s < 0.1 * noise.read_e.powi(2)
                && c.before_e.iter().all(|&b| b == 0.0)
        })
        .map(|(i, _)| i)
        .collect();
    if few.is_empty() {
        super::super::maps::reference_dark(e.design).into_iter().collect()
    } else {
        few
    }
}

/// Excess over the model of Var(σ²)/mean², e⁻⁴, and dark variance, e⁻², of the dark stack with most frames.
fn variance_of_variance(e: &Evidence<'_>) -> Option<(usize, Estimated, f64)> {
    let (stack, c) = short_darks(e)
        .into_iter()
        .map(|i| (i, &e.design.conditions[i]))
        .max_by_key(|(_, c)| c.frames)?;
    let f = e.stacks[stack].dof;
    let place = Place::Stack(stack);
    let (vd, vm) = e.variance(stack)?;
    let k4 = e.gain(c).powi(4);
    // Spread = f/2 (M (1 + 2/f) − 1), M the mean square of the pixels' relative variance.
    let of = |spread: f64, v: f64| (2.0 * spread / f + 1.0) / (1.0 + 2.0 / f) * v * v;
    let d = of(e.measured(place, What::Spread)?, vd) - vd * vd;
    let m = of(e.predicted(place, What::Spread)?, vm) - vm * vm;
    let se = e.difference(place, What::Spread)?.se * 2.0 / (f + 2.0) * vm * vm;
    Some((stack, Estimated { value: (d - m) / k4, se: se / k4 }, vd / e.gain(c).powi(2)))
}

/// Spread of the pixels' dark variance.
pub fn read_noise_spread(e: &Evidence<'_>) -> Vec<Proposal> {
    let made = (|| {
        let (_, excess, _) = variance_of_variance(e)?;
        let read = e.camera.sensor.noise.read_e.powi(2);
        let present = match current(e.camera, "read-noise-spread") {
            Some(Effect::ReadNoiseSpread(x)) => f64::from(x.spread),
            _ => 0.0,
        };
        // Var(r² e^(2sz)) = r⁴ e^(4s²) (e^(4s²) − 1).
        let now = {
            let g = (4.0 * present * present).exp();
            read * read * g * (g - 1.0)
        };
        let target = ((now + excess.value) / (read * read)).max(0.0);
        let g = 0.5 + (0.25 + target).sqrt();
        let s = (g.ln() / 4.0).sqrt();
        let se = excess.se / (read * read) / (8.0 * s.max(0.01) * g * (2.0 * g - 1.0));
        let effect = ReadNoiseSpread { spread: s as f32 };
        let one = Proposal::new("read-noise-spread", effect.into(), excess.z().abs())
            .with("spread", s, se);
        // The median that leaves the mean square where it was.
        let median = e.camera.sensor.noise.read_e * (present * present - s * s).exp();
        let post = e.camera.sensor.noise.read_e_post.min(median);
        let read = ReadNoise { read_e: median as f32, read_e_post: post as f32 };
        let both = one.clone().and(read.into()).with("read_e", median, f64::NAN);
        Some([one, both])
    })();
    made.into_iter().flatten().collect()
}

/// A few pixels that switch between two levels: outliers of the offset map, or where few frames make that, of the
/// map of noise.
pub fn telegraph(e: &Evidence<'_>) -> Vec<Proposal> {
    let made = (|| {
        let reference = super::super::maps::reference_dark(e.design)?;
        let t = &e.stacks[reference];
        let place = Place::Map(MapKind::Offset);
        let s = &e.map(MapKind::Offset)?.spatial;
        let k = e.reference_gain()?;
        let pixels = (s.rows.len() * s.columns.len()) as f64;
        let count = |place, what| {
            let (d, m) = (e.measured(place, what)?, e.predicted(place, what)?);
            Some((d, m, crate::diagnose::tails::count(d, m * 16.0, 16.0)))
        };
        let (high, expected, z_high) = count(place, What::High)?;
        let noisy = count(Place::Stack(reference), What::NoisyPixels);
        let spread = variance_of_variance(e).map_or(0.0, |v| v.1.z());
        let strength = z_high.max(noisy.map_or(0.0, |n| n.2)).max(spread);
        let renewal = renewal(e, reference, t.dof);
        let propose = |fraction: f64, amplitude: f64, width: f32| {
            let effect = RandomTelegraphNoise {
                fraction: fraction as f32,
                amplitude_e: amplitude as f32,
                renewal: renewal as f32,
                duty: 0.5,
                spread: width,
            };
            let root = (fraction * pixels).max(1.0).sqrt();
            Proposal::new("random-telegraph-noise", effect.into(), strength)
                .with("fraction", fraction, fraction * 2.0 / root)
                .with("amplitude_e", amplitude, amplitude / root)
                .with("renewal", renewal, f64::NAN)
                .with("spread", f64::from(width), f64::NAN)
        };
        if let Some(Effect::RandomTelegraphNoise(x)) = current(e.camera, "random-telegraph-noise") {
            // The counts of outliers follow the fraction; the amplitude stays.
            let noisy = noisy.map_or((0.0, 0.0), |n| (n.0, n.1));
            let ratio = (high + noisy.0 + 1.0) / (expected + noisy.1 + 1.0);
            let fraction = f64::from(x.fraction) * ratio;
            return Some(vec![propose(fraction, f64::from(x.amplitude_e), x.spread)]);
        }
        let mut out = Vec::new();
        // Cumulants of the map: f (A/2)³ and f (A/2)⁴ for one amplitude, 6 and 24 times that for exponential ones.
        let [third, fourth] = s.cumulants;
        for (width, c3, c4) in [(1.0f32, 6.0, 24.0), (0.0, 1.0, 1.0)] {
            let half = fourth / third * c3 / c4;
            if half > 0.0 && third > 0.0 {
                out.push(propose(third / (c3 * half.powi(3)), 2.0 * half / k, width));
            }
        }
        // The same from the variances of the pixels, f A²/4 and f (A²/4)².
        if let Some((m1, m2)) = variance_excess(e, reference) {
            for (width, c1, c2) in [(1.0f32, 2.0, 24.0), (0.0, 1.0, 1.0)] {
                let quarter = m2 / m1 * c1 / c2;
                if quarter > 0.0 && m1 > 0.0 {
                    out.push(propose(m1 / (c1 * quarter), 2.0 * quarter.sqrt(), width));
                }
            }
        }
        Some(out)
    })();
    made.unwrap_or_default()
}

/// Chance of a renewal from the memory of the noisiest pixels.
fn renewal(e: &Evidence<'_>, stack: usize, dof: f64) -> f64 {
    let place = Place::Stack(stack);
    let lag = e.measured(place, What::TopTimeLag).zip(e.predicted(place, What::TopTimeLag));
    let held = match current(e.camera, "random-telegraph-noise") {
        Some(Effect::RandomTelegraphNoise(x)) => Some(f64::from(x.renewal)),
        _ => None,
    };
    match (lag, held) {
        (Some((d, m)), Some(held)) => held - (d - m),
        // A stack's own mean hides part of the memory.
        (Some((d, _)), None) => 1.0 - d - 2.0 / dof,
        (None, held) => held.unwrap_or(0.2),
    }
    .clamp(0.03, 1.0)
}

/// Mean and mean square, e⁻² and e⁻⁴, of what pixels beyond the 99.9 % point of χ² have above the median variance, over
/// all pixels.
fn variance_excess(e: &Evidence<'_>, stack: usize) -> Option<(f64, f64)> {
    let t = &e.stacks[stack];
    let k2 = e.gain(&e.design.conditions[stack]).powi(2);
    let mut sorted: Vec<f32> = t.pixel_variance.clone();
    let middle = sorted.len() / 2;
    let median = f64::from(*sorted.select_nth_unstable_by(middle, f32::total_cmp).1);
    let white = median / (1.0 - 2.0 / (9.0 * t.dof)).powi(3);
    let h = 2.0 / (9.0 * t.dof);
    let limit = white * (1.0 - h + 3.1 * h.sqrt()).powi(3);
    let (mut first, mut second) = (0.0, 0.0);
    for v in t.pixel_variance.iter().map(|&v| f64::from(v)).filter(|v| *v > limit) {
        first += v - white;
        // The scatter of a pixel's own variance, 2v²/(f + 2), is no spread.
        second += (v - white).powi(2) - 2.0 * v * v / (t.dof + 2.0);
    }
    let n = t.pixel_variance.len() as f64;
    // χ² itself leaves a thousandth above the limit, 1.1 times as far above white as the limit.
    let chance = 0.001 * 1.1 * (limit - white);
    let (first, second) = ((first / n - chance) / k2, second / n / (k2 * k2));
    (first > 0.0 && second > 0.0).then_some((first, second))
}

/// Kurtosis of a Tukey lambda law less 3.
fn tukey_kurtosis(l: f64) -> f64 {
    if l.abs() < 0.01 {
        return 1.2;
    }
    let g = libm::tgamma;
    // Moments of Q(u) (Joiner & Rosenblatt 1971).
    let beta = |a: f64, b: f64| g(a) * g(b) / g(a + b);
    let m2 = 2.0 / (l * l) * (1.0 / (1.0 + 2.0 * l) - beta(1.0 + l, 1.0 + l));
    let m4 = 2.0 / l.powi(4)
        * (1.0 / (1.0 + 4.0 * l) - 4.0 * beta(1.0 + 3.0 * l, 1.0 + l)
            + 3.0 * beta(1.0 + 2.0 * l, 1.0 + 2.0 * l));
    m4 / (m2 * m2) - 3.0
}

/// Kurtosis of the dark residuals.
pub fn heavy_tails(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (stack, c) = short_darks(e)
            .into_iter()
            .map(|i| (i, &e.design.conditions[i]))
            .max_by_key(|(_, c)| c.frames)?;
        let k = e.difference(Place::Stack(stack), What::Kurtosis)?;
        let v = e.variance(stack)?.0 / e.gain(c).powi(2);
        let noise = &e.camera.sensor.noise;
        let (read, now) = match current(e.camera, "heavy-tailed-read-noise") {
            Some(Effect::HeavyTailedReadNoise(x)) => {
                (f64::from(x.sigma_e), tukey_kurtosis(f64::from(x.lambda)))
            }
            _ => (noise.read_e, 0.0),
        };
        // All of the read noise follows one law: its kurtosis is that of the sum over its share squared.
        let target = now + k.value * (v / (read * read)).powi(2);
        if target < 0.02 {
            return None;
        }
        let (mut low, mut high) = (-0.22, 0.13);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if tukey_kurtosis(middle) > target { low = middle } else { high = middle }
        }
        let lambda: f64 = 0.5 * (low + high);
        let step = (tukey_kurtosis(lambda - 0.005) - tukey_kurtosis(lambda + 0.005)) / 0.01;
        let effect = HeavyTailedReadNoise { sigma_e: read as f32, lambda: lambda as f32 };
        let none = ReadNoise { read_e: 0.0, read_e_post: 0.0 };
        Some(
            Proposal::new("heavy-tailed-read-noise", effect.into(), k.z().abs())
                .and(none.into())
                .with("sigma_e", read, f64::NAN)
                .with("lambda", lambda, k.se * (v / (read * read)).powi(2) / step),
        )
    })())
}

/// Correlation of neighbours in flats over the share of shot noise: constant.
pub fn charge_coupling(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let of = |lag: u8| {
            slope(e.flats().filter_map(|(i, c)| {
                let r = e.difference(Place::Stack(i), What::Covariance(lag))?;
                Some((2.0 * shot_share(e, i, c)?, r))
            }))
        };
        let (x, y) = (of(0)?, of(1)?);
        let (px, py) = match current(e.camera, "charge-coupling") {
            Some(Effect::ChargeCoupling(k)) => (f64::from(k.side), f64::from(k.vertical)),
            _ => (0.0, 0.0),
        };
        let (side, vertical) = ((px + x.value).max(0.0), (py + y.value).max(0.0));
        let effect = ChargeCoupling { side: side as f32, vertical: vertical as f32, diagonal: 0.0 };
        Some(
            Proposal::new("charge-coupling", effect.into(), x.z().hypot(y.z()))
                .with("side", side, x.se)
                .with("vertical", vertical, y.se),
        )
    })())
}

/// Share of shot noise in a stack's variance.
fn shot_share(
    e: &Evidence<'_>,
    stack: usize,
    c: &crate::diagnose::design::Condition,
) -> Option<f64> {
    let (v, _) = e.variance(stack)?;
    Some((e.signal(stack)? * e.gain(c) / v).clamp(0.0, 1.0))
}

/// Correlation of neighbours in flats in proportion to the signal.
pub fn brighter_fatter(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let found = slope(e.flats().flat_map(|(i, c)| {
            let x = (|| Some(2.0 * shot_share(e, i, c)? * e.signal(i)? / e.gain(c)))();
            [0, 1].into_iter().filter_map(move |lag| {
                Some((x?, e.difference(Place::Stack(i), What::Covariance(lag))?))
            })
        }))?;
        let present = match current(e.camera, "brighter-fatter") {
            Some(Effect::BrighterFatter(k)) => f64::from(k.coefficient),
            _ => 0.0,
        };
        let a = (present + found.value).max(0.0);
        let effect = BrighterFatter { coefficient: a as f32 };
        Some(Proposal::new("brighter-fatter", effect.into(), found.z().abs()).with(
            "coefficient",
            a,
            found.se,
        ))
    })())
}

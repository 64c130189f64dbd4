//! Plane waves that are stationary from frame to frame: interference of a clock with the pixel
//! rate, locked to the frame.
//!
//! The catalogue's `periodic-pattern-noise` has a new phase in each frame, and
//! `readout-channel-mismatch` repeats every 2, 4 or 8 lines; both are left to it.

use super::profile;
use super::seen::Seen;
use super::stage;
use super::view::{View, change_mean, gain};
use super::{FALSE_ALARMS, Shape};
use crate::data::design::Design;
use crate::finding::{Finding, number};
use crate::numerics::spectrum::{Background, Spectrum, Spectrum2};
use crate::report::{Domain, Form};
use crate::statistics::maps::{self, MapKind};
use crate::statistics::temporal::Temporal;
use camrig_base::Plane;
use camrig_base::Value;
use camrig_base::median::median;
use camrig_camera::Camera;
use camrig_camera::empirical::{Empirical, Sine, Table, Wave as Waves};
use camrig_sensor_core::effects::empirical::Quantity;
use std::f64::consts::{LN_2, PI, TAU};

/// Waves of a map, at most: harmonics and beats of a clock.
const MAX_WAVES: usize = 8;
/// Maps that are searched.
const MAPS: [MapKind; 3] = [MapKind::Offset, MapKind::DarkCurrent, MapKind::Gain];
/// Lines after which every pattern of the catalogue repeats: readout channels of 2, 4 or 8 lines,
/// lattices of 16.
const CATALOGUED_PERIOD: f64 = 16.0;
/// Distance in bins from a frequency of the catalogue's patterns at which a wave that is not one of
/// them, but differs in frequency by half as much, has more power than there.
const DETUNING: f64 = 0.25;
/// Fraction of a wave's amplitude that the held-out frames must have, at the same phase. The mean
/// of a wave with a random phase in each frame passes in one set of eight per map, before the
/// stacks of each half are compared too.
const MIN_CONFIRMED: f64 = 0.75;
/// Periods over the sensor up to which line means are a smooth profile rather than a wave: effects
/// of the catalogue have two, and what is steep at an edge has more.
const MAX_SMOOTH_PERIODS: usize = 4;
/// Bins of the phase in which a wave is plotted.
const PHASES: usize = 24;
/// Halvings of the step with which a frequency is refined, from a quarter of a bin: 1/65536 of it.
const HALVINGS: usize = 16;

/// A plane wave a sin(2π(f_x x + f_y y) + φ) in one map.
pub(crate) struct Wave {
    kind: MapKind,
    cycles: [Value; 2],
    amplitude: Value,
    phase: f64,
    /// Decimals of a frequency in words: a tenth of a bin.
    digits: usize,
    evidence: [f64; 2],
}

/// Waves that both halves show.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    let mut found: Vec<Box<dyn Shape>> = Vec::new();
    for kind in MAPS {
        let (Some(a), Some(b)) = (fit.plane(kind), held_out.plane(kind)) else { continue };
        let pattern = fit.camera.sensor.pattern();
        let border = [pattern.width, pattern.height].map(usize::from);
        let [mut a, mut b] = [fit.levelled(a), held_out.levelled(b)];
        for plane in [&mut a, &mut b] {
            remove_profiles(plane);
            clear_border(plane, border);
        }
        for _ in 0..MAX_WAVES {
            let Some(wave) = strongest(&mut a, &mut b, kind, fit.unit(kind), border) else {
                break;
            };
            for plane in [&mut a, &mut b] {
                let w = plane.width;
                for (i, v) in plane.data.iter_mut().enumerate() {
                    *v -= (wave.at(i % w, i / w) / fit.unit(kind)) as f32;
                }
                clear_border(plane, border);
            }
            found.push(Box::new(wave));
        }
    }
    found
}

/// Subtracts what is smooth over columns and over rows, so that no wave is found in it.
fn remove_profiles(plane: &mut Plane<f32>) {
    let smooth_of = |lines: Vec<f64>| -> Vec<f64> {
        let line = profile::slope(&lines);
        let bent: Vec<f64> = lines.iter().zip(&line).map(|(v, l)| v - l).collect();
        let bent = profile::smooth(&bent, 2 * MAX_SMOOTH_PERIODS);
        line.iter().zip(bent).map(|(l, b)| l + b).collect()
    };
    let [columns, rows] = line_means(plane).map(smooth_of);
    for (row, of_row) in plane.data.chunks_mut(plane.width).zip(rows) {
        for (v, of_column) in row.iter_mut().zip(&columns) {
            *v -= (of_column + of_row) as f32;
        }
    }
}

/// Sets the outermost pixels, which are copies of others, to zero.
fn clear_border(plane: &mut Plane<f32>, [across, down]: [usize; 2]) {
    let (w, h) = (plane.width, plane.height);
    for (i, v) in plane.data.iter_mut().enumerate() {
        let inner = (across..w - across.min(w)).contains(&(i % w))
            && (down..h - down.min(h)).contains(&(i / w));
        if !inner {
            *v = 0.0;
        }
    }
}

/// The strongest wave of a map, if it is significant and the held-out frames confirm it, after
/// those of the catalogue are subtracted from both. The `border` is cleared.
fn strongest(
    a: &mut Plane<f32>,
    b: &mut Plane<f32>,
    kind: MapKind,
    unit: f64,
    border: [usize; 2],
) -> Option<Wave> {
    let (w, h) = (a.width, a.height);
    let n = (w.saturating_sub(2 * border[0]) * h.saturating_sub(2 * border[1])) as f64;
    if n < 1.0 {
        return None;
    }
    // The power of a bin of white noise has an exponential distribution.
    let limit = libm::log((MAPS.len() * h * (w / 2 + 1)) as f64 / FALSE_ALARMS);
    let (times, place) = loop {
        let (times, place) = highest_in_plane(a)?;
        if times < limit || !is_catalogued(place[0], place[1], w, h) || !repeats(a, place) {
            break (times, place);
        }
        for plane in [&mut *a, &mut *b] {
            subtract_sinusoid(plane, catalogued(place), n, border);
        }
    };
    // In the plane, along rows alone, along columns alone.
    let [columns, rows] = line_means(a).map(|lines| highest(&lines));
    let candidates = [
        (times, place, [true, true]),
        (columns.0, [columns.1, 0.0], [true, false]),
        (rows.0, [0.0, rows.1], [false, true]),
    ];
    let (times, start, free) = candidates.into_iter().max_by(|x, y| x.0.total_cmp(&y.0))?;
    if times < limit {
        return None;
    }
    let f = refined(a, start, free);
    if is_catalogued(f[0], f[1], w, h) && repeats(a, f) {
        return None;
    }
    let amplitudes = |p| projection(p, f).map(|v| 2.0 * v / n);
    let [c, s] = amplitudes(a);
    let [held_c, held_s] = amplitudes(b);
    let amplitude = libm::hypot(c, s);
    // In the held-out frames, at the phase of those to fit.
    let again = (c * held_c + s * held_s) / amplitude;
    let other = (c * held_s - s * held_c) / amplitude;
    if again < MIN_CONFIRMED * amplitude || other.abs() > 0.5 * amplitude {
        return None;
    }
    let rest = |p: &Plane<f32>, a: f64| {
        p.data.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>() / n - a * a / 2.0
    };
    let evidence = |p: &Plane<f32>, a: f64| {
        let left = rest(p, a).max(1e-30);
        n * libm::log(1.0 + a * a / (2.0 * left))
    };
    let variance = rest(a, amplitude).max(0.0);
    // The mean of both halves: their temporal noise halves, a pattern of pixels does not.
    let mean = [(c + held_c) / 2.0, (s + held_s) / 2.0];
    let size = libm::hypot(mean[0], mean[1]);
    // Cramér-Rao bounds of a sinusoid (Rife & Boorstyn 1974), one dimension at a time.
    let of_frequency = |side: usize| {
        let lines = (side * side) as f64 - 1.0;
        (24.0 * variance / (size * size * n * lines)).sqrt() / TAU
    };
    Some(Wave {
        kind,
        cycles: [
            Value { value: f[0], std_error: of_frequency(w) },
            Value { value: f[1], std_error: of_frequency(h) },
        ],
        amplitude: Value { value: size * unit, std_error: (2.0 * variance / n).sqrt() * unit },
        phase: libm::atan2(mean[0], mean[1]),
        digits: libm::log10(w.max(h) as f64).ceil() as usize + 1,
        evidence: [evidence(a, amplitude), evidence(b, again)],
    })
}

/// The frequency at which a map has most power over its background, and the ratio; not those of
/// lines.
fn highest_in_plane(map: &Plane<f32>) -> Option<(f64, [f64; 2])> {
    let (w, h) = (map.width, map.height);
    let bins = w / 2 + 1;
    let mut power = vec![0.0; h * bins];
    Spectrum2::new(w, h).add(&without_lines(map), &mut power);
    let background = Background::of(&power, w);
    // The mean of an exponential distribution is its median over ln 2.
    let over = |i: usize| f64::from(power[i]) / f64::from(background.at(i)).max(1e-30) * LN_2;
    let searched = |i: &usize| i % bins > 1 && (i / bins).min(h - i / bins) > 1;
    let all = (0..power.len()).filter(searched);
    let at = all.max_by(|&i, &j| over(i).total_cmp(&over(j)))?;
    Some((over(at), [(at % bins) as f64 / w as f64, signed((at / bins) as f64 / h as f64)]))
}

/// A frequency between −½ and ½.
fn signed(f: f64) -> f64 {
    if f > 0.5 { f - 1.0 } else { f }
}

/// Whether a frequency is that of a pattern of the catalogue, to a bin.
fn is_catalogued(fx: f64, fy: f64, w: usize, h: usize) -> bool {
    let near = |f: f64, n: usize| {
        let lines = f * CATALOGUED_PERIOD;
        (lines - lines.round()).abs() / CATALOGUED_PERIOD < 1.0 / n as f64
    };
    near(fx, w) && near(fy, h)
}

/// The frequency of the catalogue's patterns that is nearest.
fn catalogued(near: [f64; 2]) -> [f64; 2] {
    near.map(|f| (f * CATALOGUED_PERIOD).round() / CATALOGUED_PERIOD)
}

/// Subtracts the sinusoid of a frequency from the `n` pixels of a map within its border.
fn subtract_sinusoid(map: &mut Plane<f32>, [fx, fy]: [f64; 2], n: f64, border: [usize; 2]) {
    // A checkerboard has no quadrature.
    let parts = if [fx, fy].iter().all(|f| (2.0 * f).fract() == 0.0) { 1.0 } else { 2.0 };
    let [c, s] = projection(map, [fx, fy]).map(|v| parts * v / n);
    let w = map.width;
    for (i, v) in map.data.iter_mut().enumerate() {
        let (sin, cos) = libm::sincos(TAU * (fx * (i % w) as f64 + fy * (i / w) as f64));
        *v -= (c * cos + s * sin) as f32;
    }
    clear_border(map, border);
}

/// Whether the wave near a frequency repeats as the catalogue's patterns do: a map has more power
/// at exactly that frequency than at frequencies nearby.
fn repeats(map: &Plane<f32>, near: [f64; 2]) -> bool {
    let exact = catalogued(near);
    let power = |f: [f64; 2]| power(map, f);
    let most = power(exact);
    let detuning = [DETUNING / map.width as f64, DETUNING / map.height as f64];
    let moves = [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)];
    moves
        .iter()
        .all(|(i, j)| power([exact[0] + i * detuning[0], exact[1] + j * detuning[1]]) < most)
}

/// A map without the means of its rows and columns.
fn without_lines(map: &Plane<f32>) -> Vec<f32> {
    let (w, h) = (map.width, map.height);
    let mut out = map.data.clone();
    let mut columns = vec![0.0; w];
    for row in out.chunks_mut(w) {
        let mean = row.iter().sum::<f32>() / w as f32;
        row.iter_mut().zip(&mut columns).for_each(|(v, c)| {
            *v -= mean;
            *c += *v / h as f32;
        });
    }
    for row in out.chunks_mut(w) {
        row.iter_mut().zip(&columns).for_each(|(v, c)| *v -= c);
    }
    out
}

/// Sums with cosine and sine at a frequency.
fn projection(map: &Plane<f32>, [fx, fy]: [f64; 2]) -> [f64; 2] {
    let w = map.width;
    let columns: Vec<(f64, f64)> = (0..w).map(|x| libm::sincos(TAU * fx * x as f64)).collect();
    let (mut c, mut s) = (0.0, 0.0);
    for (y, row) in map.data.chunks(w).enumerate() {
        let (mut of_cos, mut of_sin) = (0.0, 0.0);
        for (&v, (sin, cos)) in row.iter().zip(&columns) {
            of_cos += f64::from(v) * cos;
            of_sin += f64::from(v) * sin;
        }
        let (sin, cos) = libm::sincos(TAU * fy * y as f64);
        c += of_cos * cos - of_sin * sin;
        s += of_sin * cos + of_cos * sin;
    }
    [c, s]
}

/// Power at a frequency.
fn power(map: &Plane<f32>, frequency: [f64; 2]) -> f64 {
    let [c, s] = projection(map, frequency);
    c * c + s * s
}

/// Means of columns and of rows.
fn line_means(map: &Plane<f32>) -> [Vec<f64>; 2] {
    let (w, h) = (map.width, map.height);
    let (mut columns, mut rows) = (vec![0.0; w], vec![0.0; h]);
    for (row, of_row) in map.data.chunks(w).zip(&mut rows) {
        for (&v, of_column) in row.iter().zip(&mut columns) {
            *of_column += f64::from(v) / h as f64;
            *of_row += f64::from(v) / w as f64;
        }
    }
    [columns, rows]
}

/// The highest bin of line means that is not of the catalogue: its ratio to that of white lines,
/// and its frequency.
fn highest(lines: &[f64]) -> (f64, f64) {
    let n = lines.len();
    let power = Spectrum::of(lines);
    let middle = median(&mut power.clone(), f64::total_cmp).max(1e-30);
    let frequency = |i: usize| (i + 1) as f64 / n as f64;
    let searched =
        (MAX_SMOOTH_PERIODS..power.len()).filter(|&i| !is_catalogued(frequency(i), 0.0, n, n));
    let of = searched.map(|i| (power[i] / middle * LN_2, frequency(i)));
    of.fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
}

/// The frequency near a bin where a map has most power; a frequency that is not `free` stays.
fn refined(map: &Plane<f32>, start: [f64; 2], free: [bool; 2]) -> [f64; 2] {
    let power = |f: [f64; 2]| power(map, f);
    let (mut f, mut most) = (start, power(start));
    let mut step = [0.25 / map.width as f64, 0.25 / map.height as f64];
    for _ in 0..HALVINGS {
        loop {
            let (from, before) = (f, most);
            let moves = [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)];
            for (i, j) in moves.into_iter().filter(|m| if m.1 == 0.0 { free[0] } else { free[1] })
            {
                let near = [from[0] + i * step[0], from[1] + j * step[1]];
                let here = power(near);
                if here > most {
                    (f, most) = (near, here);
                }
            }
            if most <= before {
                break;
            }
        }
        step = step.map(|s| s / 2.0);
    }
    f
}

impl Wave {
    /// Its value at a pixel.
    fn at(&self, x: usize, y: usize) -> f64 {
        let turns = self.cycles[0].value * x as f64 + self.cycles[1].value * y as f64;
        self.amplitude.value * libm::sin(TAU * turns + self.phase)
    }
}

impl Shape for Wave {
    fn subtract(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        let Some(dark) = maps::reference_dark(design) else { return };
        let offset = design.conditions[dark].stack.exposure_s;
        let black = stacks[dark].level();
        for (c, t) in design.conditions.iter().zip(stacks) {
            let k = gain(camera, c);
            // The dark-current map is of the increase from the shortest exposure on.
            let times = match self.kind {
                MapKind::DarkCurrent => k * (c.stack.exposure_s - offset),
                _ => k,
            };
            change_mean(camera, t, &|x, y, v| match self.kind {
                MapKind::Gain => black + (v - black) / (1.0 + self.at(x, y)),
                _ => v - times * self.at(x, y),
            });
        }
    }

    fn stages(&self, camera: &mut Camera, design: &Design) -> Vec<Empirical> {
        let amount = self.amplitude.value;
        let wave = |more: Option<f64>| {
            // A wave of zero frequency at a quarter of a period is a constant.
            let sine = |f: [f64; 2], phase_turns, amplitude| Sine {
                cycles_per_column: f[0],
                cycles_per_row: f[1],
                phase_turns,
                amplitude,
            };
            let own = sine(self.cycles.map(|f| f.value), self.phase / TAU, 1.0);
            let level = more.map(|level| sine([0.0; 2], 0.25, level));
            Table::Wave(Waves { wave: [own].into_iter().chain(level).collect() })
        };
        match self.kind {
            MapKind::Gain => vec![Empirical::new(Quantity::Gain, wave(None), amount)],
            MapKind::DarkCurrent => {
                let level = stage::take_dark(camera, design, amount) / amount;
                let before = -amount * stage::shortest_s(design);
                vec![
                    stage::dark(camera, design, wave(Some(level)), amount),
                    // The offset map, whose waves are reported, includes the dark current of its
                    // darks.
                    Empirical::new(Quantity::Offset, wave(None), before),
                ]
            }
            _ => vec![Empirical::new(Quantity::Offset, wave(None), amount)],
        }
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let plane = view.levelled(view.plane(self.kind)?);
        let mut sums = [(0.0, 0.0); PHASES];
        for (i, &v) in plane.data.iter().enumerate() {
            let (x, y) = ((i % plane.width) as f64, (i / plane.width) as f64);
            let turns = self.cycles[0].value * x + self.cycles[1].value * y + self.phase / TAU;
            let sum = &mut sums[(turns.rem_euclid(1.0) * PHASES as f64) as usize % PHASES];
            sum.0 += f64::from(v) * view.unit(self.kind);
            sum.1 += 1.0;
        }
        let y = match self.kind {
            MapKind::Gain => "relative gain",
            MapKind::DarkCurrent => "dark current, e⁻/s",
            _ => "offset, e⁻",
        };
        let point =
            |(i, (sum, n)): (usize, &(f64, f64))| [(i as f64 + 0.5) / PHASES as f64, sum / n];
        Some(Seen::curve("phase of the wave, turns", y, sums.iter().enumerate().map(point)))
    }

    fn findings(&self) -> Vec<Finding> {
        let (domain, key, unit) = match self.kind {
            MapKind::DarkCurrent => (Domain::Dark, "amplitude_e_per_s", " e⁻/s"),
            MapKind::Gain => (Domain::Gain, "amplitude", " of the signal"),
            _ => (Domain::Offset, "amplitude_e", " e⁻"),
        };
        let [fx, fy] = self.cycles;
        let digits = self.digits;
        let period = |f: f64, lines: &str| match f == 0.0 {
            true => format!("constant over {lines}"),
            false => format!("period {:.2} {lines}", 1.0 / f.abs()),
        };
        let grows = match domain {
            Domain::Dark => "it grows with the exposure",
            Domain::Gain => "it grows with the light",
            _ => "the same in every frame, in the dark and in light",
        };
        vec![Finding {
            parameters: vec![
                (key, self.amplitude),
                ("cycles_per_column", fx),
                ("cycles_per_row", fy),
                ("phase_turns", Value::chosen((self.phase / TAU).rem_euclid(1.0))),
            ],
            description: format!(
                "a stationary plane wave: amplitude {}{unit}, {:.digits$} cycles per \
                 column and {:.digits$} per row ({}, {}), {:.0}° at the first pixel; {grows}",
                number(self.amplitude),
                fx.value,
                fy.value,
                period(fx.value, "columns"),
                period(fy.value, "rows"),
                (self.phase * 180.0 / PI).rem_euclid(360.0),
            ),
            ..Finding::new(domain, Form::Wave, self.evidence)
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::bench::{Hidden, Shot, WIDTH, figure, shoot};

    /// Adds 2 sin(2π(0.21 x − 0.34 y) + turn) e⁻.
    fn add(e: &mut [f64], turn: f64) {
        for (i, v) in e.iter_mut().enumerate() {
            let turns = 0.21 * (i % WIDTH) as f64 - 0.34 * (i / WIDTH) as f64;
            *v += 2.0 * (TAU * turns + turn).sin();
        }
    }

    #[test]
    fn a_wave_that_stands_still_is_found_with_its_frequency() {
        let volts = |e: &mut [f64], _: &mut Shot<'_>| add(e, 0.5);
        let bench = shoot(21, &Hidden { volts: Some(&volts), ..Hidden::default() });
        let found = find(&bench.view(0), &bench.view(1));
        let findings: Vec<Finding> = found.iter().flat_map(|s| s.findings()).collect();
        let [wave] = &findings[..] else { panic!("{findings:?}") };
        assert_eq!(wave.domain, Domain::Offset);
        // Of 4032 pixels and 20 frames: 5 √(2/80640) e⁻, three errors and the border's.
        assert!((figure(wave, "amplitude_e") - 2.0).abs() < 0.1, "{wave:?}");
        let (fx, fy) = (figure(wave, "cycles_per_column"), figure(wave, "cycles_per_row"));
        assert!((fx - 0.21).abs() < 5e-4 && (fy + 0.34).abs() < 5e-4, "{wave:?}");
    }

    /// Frequencies a third of a bin from 3/16 and 5/16, which patterns of 16 lines have.
    #[test]
    fn a_wave_beside_the_catalogues_is_found_and_a_pattern_of_sixteen_lines_is_not() {
        let [fx, fy] = [3.0 / 16.0 + 0.3 / 72.0, 5.0 / 16.0 - 0.3 / 56.0];
        let of = |[fx, fy]: [f64; 2]| {
            let volts = |e: &mut [f64], _: &mut Shot<'_>| {
                for (i, v) in e.iter_mut().enumerate() {
                    let turns = fx * (i % WIDTH) as f64 + fy * (i / WIDTH) as f64;
                    *v += 3.0 * (TAU * turns + 0.4).sin();
                }
            };
            let bench = shoot(23, &Hidden { volts: Some(&volts), ..Hidden::default() });
            find(&bench.view(0), &bench.view(1)).iter().flat_map(|s| s.findings()).collect()
        };
        let findings: Vec<Finding> = of([fx, fy]);
        let [wave] = &findings[..] else { panic!("{findings:?}") };
        assert!((figure(wave, "cycles_per_column") - fx).abs() < 5e-4, "{wave:?}");
        assert!((figure(wave, "cycles_per_row") - fy).abs() < 5e-4, "{wave:?}");
        let pattern = of([3.0 / 16.0, 5.0 / 16.0]);
        assert!(pattern.is_empty(), "{pattern:?}");
        let checkerboard = of([0.5, 0.5]);
        assert!(checkerboard.is_empty(), "{checkerboard:?}");
    }

    #[test]
    fn a_new_phase_in_each_frame_is_the_catalogues_and_nothing_is_nothing() {
        let volts = |e: &mut [f64], shot: &mut Shot<'_>| {
            let turn = 10.0 * shot.normal();
            add(e, turn);
        };
        for hidden in [Hidden::default(), Hidden { volts: Some(&volts), ..Hidden::default() }] {
            let bench = shoot(22, &hidden);
            assert!(find(&bench.view(0), &bench.view(1)).is_empty());
        }
    }
}

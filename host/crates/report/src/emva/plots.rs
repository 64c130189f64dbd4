//! The plots of the standard, all channels in each.

use super::reference;
use crate::numbers::{amount, count, counted, setting};
use crate::page::Page;
use crate::plot::{Colour, Mark, Plot};
use camrig_measure::Value;
use camrig_measure::emva::{ChannelEmva, Checked, LevelRow, Profile};
use camrig_measure::spectrogram::{Histogram, Spectrogram};

/// Upper end of the fit of K, and range of the linearity fit, over saturation.
const TRANSFER_RANGE: f64 = 0.7;
const LINEARITY_RANGE: std::ops::RangeInclusive<f64> = 0.05..=0.95;
/// Photons from which axes count them in thousands.
const MANY_PHOTONS: f64 = 1e4;
/// Maximum number of points of a spectrum or profile.
const POINTS: usize = 400;
/// Maximum share of the pixels beyond the axis of a histogram.
const BEYOND: f64 = 2e-4;

/// A part of what was measured of a channel.
type Of<T> = fn(&ChannelEmva) -> Option<&T>;

/// Adds all plots that the captures allow.
pub(crate) fn all(page: &mut Page, result: &Checked) {
    let channels = &result.channels[..];
    let ladder = [photon_transfer(channels), sensitivity(channels), snr(channels)];
    let dark = dark_current(result).into_iter().flatten();
    for plot in ladder.into_iter().flatten().chain(linearity(channels)).chain(dark) {
        page.plot(&plot);
    }
    let spectrograms: [(&str, Of<Spectrogram>); 2] =
        [("DSNU", |c| c.spectrogram_dark.as_ref()), ("PRNU", |c| c.spectrogram_prnu.as_ref())];
    for (name, of) in spectrograms {
        for plot in [false, true].into_iter().filter_map(|way| spectra(channels, name, of, way)) {
            page.plot(&plot);
        }
    }
    let histograms: [(&str, Of<Histogram>); 2] =
        [("DSNU", |c| c.histogram_dsnu.as_ref()), ("PRNU", |c| c.histogram_prnu.as_ref())];
    for (name, of) in histograms {
        let both = [histogram(channels, name, of), accumulated(channels, name, of)];
        for plot in both.iter().flatten() {
            page.plot(plot);
        }
    }
    for plot in profiles(channels) {
        page.plot(&plot);
    }
}

/// Name of a channel in legends; a single one needs none.
fn name(channels: &[ChannelEmva], c: &ChannelEmva) -> String {
    if channels.len() > 1 { c.channel.to_uppercase() } else { String::new() }
}

/// "of G" where there are several channels.
fn of(channels: &[ChannelEmva], c: &ChannelEmva) -> String {
    if channels.len() > 1 { format!(" of {}", c.channel.to_uppercase()) } else { String::new() }
}

/// Adds a series of each channel.
fn each(
    plot: &mut Plot,
    channels: &[ChannelEmva],
    mark: Mark,
    points: impl Fn(&ChannelEmva) -> Vec<[f64; 2]>,
) {
    for c in channels {
        plot.series(&name(channels, c), mark, Colour::of_channel(&c.channel), points(c));
    }
}

/// Adds a dashed line in the colour of references.
fn dashed(plot: &mut Plot, label: &str, line: Vec<[f64; 2]>) {
    plot.series(label, Mark::Dashed, Colour::Reference, line);
}

/// The levels up to saturation, where the variance is largest.
fn to_saturation(c: &ChannelEmva) -> &[LevelRow] {
    let levels = &c.levels;
    let last = (0..levels.len())
        .max_by(|&a, &b| levels[a].variance_dn2.total_cmp(&levels[b].variance_dn2));
    &levels[..last.map_or(0, |i| i + 1)]
}

/// Signal at saturation, DN.
fn full(c: &ChannelEmva) -> f64 {
    to_saturation(c).last().map_or(0.0, |l| l.signal_dn)
}

/// Factor and name of an axis of photons.
fn photons(channels: &[ChannelEmva]) -> Option<(f64, &'static str)> {
    let all = channels.iter().flat_map(|c| &c.levels).map(|l| l.photons);
    let most = all.collect::<Option<Vec<f64>>>()?.into_iter().fold(0.0, f64::max);
    Some(match most > MANY_PHOTONS {
        true => (1e-3, "photons per pixel, thousands"),
        false => (1.0, "photons per pixel"),
    })
}

fn photon_transfer(channels: &[ChannelEmva]) -> Option<Plot> {
    let c = reference(channels)?;
    let mut plot = Plot::new(
        "Photon transfer",
        "mean signal above dark, DN",
        "temporal variance above dark, DN²",
    );
    plot.note(
        "Dots: light levels. Dashed: K · signal, fitted from 0 to 70 % of saturation. Pixels \
         saturate where the variance falls.",
    );
    each(&mut plot, channels, Mark::Points, |c| {
        c.levels.iter().map(|l| [l.signal_dn, l.variance_dn2]).collect()
    });
    let end = TRANSFER_RANGE * full(c);
    let k = c.figures.overall_system_gain?.value;
    dashed(&mut plot, &format!("fit{}", of(channels, c)), vec![[0.0, 0.0], [end, end * k]]);
    Some(plot)
}

fn sensitivity(channels: &[ChannelEmva]) -> Option<Plot> {
    let (factor, axis) = photons(channels)?;
    let c = reference(channels)?;
    let mut plot = Plot::new("Sensitivity", axis, "mean signal above dark, DN");
    plot.note("Dots: light levels. Dashed: responsivity · photons, to 70 % of saturation.");
    each(&mut plot, channels, Mark::Points, |c| {
        c.levels.iter().filter_map(|l| Some([factor * l.photons?, l.signal_dn])).collect()
    });
    if let Some(r) = c.figures.responsivity_dn_per_photon {
        let end = TRANSFER_RANGE * full(c);
        let line = vec![[0.0, 0.0], [factor * end / r.value, end]];
        dashed(&mut plot, &format!("fit{}", of(channels, c)), line);
    }
    Some(plot)
}

/// Signal-to-noise ratio against photons; none if the captures do not state photons.
pub(super) fn snr(channels: &[ChannelEmva]) -> Option<Plot> {
    photons(channels)?;
    let most = channels.iter().flat_map(|c| &c.levels).filter_map(|l| l.photons);
    let top = libm::ceil(libm::log10(most.fold(10.0, f64::max)));
    let mut plot = Plot::new("Signal-to-noise ratio", "photons per pixel", "SNR");
    let best = libm::pow(10.0, libm::ceil(0.5 * top));
    plot.log_x().log_y().x_range(1.0, libm::pow(10.0, top)).y_range(0.1, best);
    plot.note(
        "Dots: measured. Lines: the standard's model with η, K and σ of the table. Noise is \
               temporal.",
    );
    each(&mut plot, channels, Mark::Points, measured_snr);
    let grid: Vec<f64> =
        (0..=20 * top as i32).map(|i| libm::pow(10.0, 0.05 * f64::from(i))).collect();
    for c in channels {
        let f = &c.figures;
        let (Some(eta), Some(k), Some(dark)) =
            (f.quantum_efficiency, f.overall_system_gain, f.temporal_dark_noise_dn)
        else {
            continue;
        };
        let (eta, noise) = (eta.value, (dark.value / k.value).powi(2));
        let model = |&p: &f64| [p, eta * p / (noise + eta * p).sqrt()];
        let line = grid.iter().map(model).filter(|p| p[1] >= 0.1).collect();
        plot.series("", Mark::Line, Colour::of_channel(&c.channel), line);
    }
    dashed(&mut plot, "ideal sensor", grid.iter().map(|&p| [p, p.sqrt()]).collect());
    plot.limit_y(1.0, "SNR 1: threshold");
    Some(plot)
}

/// Of the levels below saturation whose noise is not below quantisation.
fn measured_snr(c: &ChannelEmva) -> Vec<[f64; 2]> {
    let dark = c.figures.temporal_dark_noise_dn.map_or(0.0, |noise| noise.value.powi(2));
    let upper = LINEARITY_RANGE.end() * full(c);
    let levels = to_saturation(c).iter().filter(|l| l.signal_dn < upper);
    let point = |l: &LevelRow| {
        let noise = l.variance_dn2 + dark;
        (noise > 0.0 && l.signal_dn > 0.0).then_some([l.photons?, l.signal_dn / noise.sqrt()])
    };
    levels.filter_map(point).collect()
}

fn linearity(channels: &[ChannelEmva]) -> Option<Plot> {
    let photons = photons(channels);
    let (factor, axis) = photons.unwrap_or((1e3, "exposure time, ms"));
    let light = |l: &LevelRow| photons.map_or(Some(l.exposure_s), |_| l.photons);
    let measured = |c: &ChannelEmva| c.figures.linearity_error_percent.is_some();
    if !channels.iter().any(measured) {
        return None;
    }
    let mut plot = Plot::new("Linearity", axis, "deviation from the fit, %");
    plot.note(
        "Levels of the fit, 5 to 95 % of saturation, weighted by 1/signal as in the standard.",
    );
    each(&mut plot, channels, Mark::Points, |c| {
        let [low, high] =
            [LINEARITY_RANGE.start(), LINEARITY_RANGE.end()].map(|share| share * full(c));
        let inside = to_saturation(c).iter().filter(|l| (low..=high).contains(&l.signal_dn));
        inside.filter_map(|l| Some([factor * light(l)?, l.linearity_deviation_percent?])).collect()
    });
    plot.without_outliers().limit_y(0.0, "fit");
    Some(plot)
}

/// Mean and variance of the darks over exposure, where there is more than one.
fn dark_current(result: &Checked) -> Option<[Plot; 2]> {
    let channels = &result.channels[..];
    let c = reference(channels)?;
    if c.darks.iter().all(|d| d.exposure_s == c.darks[0].exposure_s) {
        return None;
    }
    let k = c.figures.overall_system_gain?.value;
    let axis = "exposure time, s";
    let mut mean = Plot::new("Dark current from the mean", axis, "mean of dark frames, DN");
    each(&mut mean, channels, Mark::Points, |c| {
        c.darks.iter().map(|d| [d.exposure_s, d.mean_dn]).collect()
    });
    let of_mean = c.darks.iter().map(|d| [d.exposure_s, d.mean_dn]);
    mean.note(&dark_note(result, c, c.figures.dark_current_mean_e_per_s));
    if let Some(rate) = c.figures.dark_current_mean_e_per_s {
        dashed(
            &mut mean,
            &format!("fit{}", of(channels, c)),
            line(of_mean.collect(), k * rate.value),
        );
    }
    let mut variance =
        Plot::new("Dark current from the variance", axis, "temporal variance of dark frames, DN²");
    each(&mut variance, channels, Mark::Points, |c| {
        c.darks.iter().map(|d| [d.exposure_s, d.variance_dn2]).collect()
    });
    let of_variance = c.darks.iter().map(|d| [d.exposure_s, d.variance_dn2]);
    variance.note(&dark_note(result, c, c.figures.dark_current_variance_e_per_s));
    if let Some(rate) = c.figures.dark_current_variance_e_per_s {
        let slope = k * k * rate.value;
        let line = line(of_variance.collect(), slope);
        dashed(&mut variance, &format!("fit{}", of(channels, c)), line);
    }
    Some([mean, variance])
}

/// The unweighted line of a slope through the middle of points.
fn line(points: Vec<[f64; 2]>, slope: f64) -> Vec<[f64; 2]> {
    let n = points.len() as f64;
    let [x, y] = [0, 1].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / n);
    let longest = points.iter().map(|p| p[0]).fold(0.0, f64::max);
    [0.0, longest].map(|t| [t, y + slope * (t - x)]).to_vec()
}

fn dark_note(result: &Checked, c: &ChannelEmva, rate: Option<Value>) -> String {
    let Some(rate) = rate else { return "Dots: dark stacks.".into() };
    let of = of(&result.channels, c);
    let at = match result.conditions.temperature_c {
        Some([low, high]) if low == high => format!(" at {}\u{a0}°C", setting(low)),
        _ => String::new(),
    };
    let doubling = c.figures.dark_current_doubling_c;
    let doubling = doubling.map_or(String::new(), |t| {
        format!(", doubling every {}", amount(t.value, Some(t.std_error), "°C"))
    });
    let rate = amount(rate.value, Some(rate.std_error), "e⁻/s");
    format!("Dots: dark stacks. Slope{of}: {rate}{at}{doubling}.")
}

fn spectra(
    channels: &[ChannelEmva],
    what: &str,
    of: Of<Spectrogram>,
    upright: bool,
) -> Option<Plot> {
    channels.iter().find_map(of)?;
    let way = if upright { "vertical" } else { "horizontal" };
    let mut plot = Plot::new(
        &format!("{what} spectrogram, {way}"),
        "cycles per pixel of the channel",
        "root of the power, DN",
    );
    plot.log_y().x_range(0.0, 0.5);
    plot.note("White noise is flat; a peak is a periodic pattern.");
    each(&mut plot, channels, Mark::Line, |c| {
        let Some(s) = of(c) else { return Vec::new() };
        spectrum(if upright { &s.vertical } else { &s.horizontal })
    });
    Some(plot)
}

/// Root of a power spectrum without its mean. The largest of neighbouring values keeps the page
/// small without losing narrow lines.
fn spectrum(power: &[f64]) -> Vec<[f64; 2]> {
    let last = (power.len() - 1).max(1) as f64;
    let bin = power.len().div_ceil(POINTS).max(1);
    let parts = power.get(1..).unwrap_or_default().chunks(bin).enumerate();
    parts
        .map(|(i, part)| {
            let middle = 1.0 + i as f64 * bin as f64 + 0.5 * (part.len() - 1) as f64;
            [0.5 * middle / last, part.iter().copied().fold(0.0, f64::max).sqrt()]
        })
        .collect()
}

/// Deviation within which all but [`BEYOND`] of the values lie, DN, and how many do not.
fn reach(h: &Histogram) -> (f64, u64) {
    let mut sides = deviations(h);
    sides.sort_by(|a, b| b.0.total_cmp(&a.0));
    let most = (BEYOND * h.values as f64) as u64;
    let mut out = 0;
    for (deviation, n) in sides {
        if out + n > most {
            return (deviation, out);
        }
        out += n;
    }
    (h.step, 0)
}

/// Size of the deviation and number of values of each bin that has any.
fn deviations(h: &Histogram) -> Vec<(f64, u64)> {
    let bins = h.counts.iter().enumerate().filter(|c| *c.1 > 0);
    bins.map(|(i, &n)| ((h.start + (i as f64 + 0.5) * h.step).abs(), n)).collect()
}

/// The widest reach of the channels, and how many pixels lie beyond it.
fn common_reach(all: &[(&ChannelEmva, &Histogram)]) -> (f64, u64) {
    let widest = all.iter().map(|(_, h)| reach(h).0 + h.step).fold(0.0, f64::max);
    let beyond = |h: &Histogram| -> u64 {
        deviations(h).iter().filter(|d| d.0 > widest).map(|d| d.1).sum()
    };
    (widest, all.iter().map(|(_, h)| beyond(h)).sum())
}

fn histogram(channels: &[ChannelEmva], what: &str, of: Of<Histogram>) -> Option<Plot> {
    let all: Vec<_> = channels.iter().filter_map(|c| Some((c, of(c)?))).collect();
    let c = reference(channels)?;
    let h = of(c)?;
    let mut plot =
        Plot::new(&format!("{what} histogram"), "deviation from the mean, DN", "pixels per bin");
    let (reach, beyond) = common_reach(&all);
    plot.log_y().x_range(-reach, reach);
    for (c, h) in &all {
        let counts: Vec<f64> = h.counts.iter().map(|&n| n as f64).collect();
        let colour = Colour::of_channel(&c.channel);
        plot.bins(&name(channels, c), colour, [h.start, h.step], &counts);
    }
    let of = self::of(channels, c);
    if h.core_sigma > 0.0 {
        let peak = h.values as f64 * h.step / (h.core_sigma * std::f64::consts::TAU.sqrt());
        let gauss = |x: f64| peak * libm::exp(-0.5 * (x / h.core_sigma).powi(2));
        let at = (-60..=60).map(|i| reach * f64::from(i) / 60.0);
        let model = at.map(|x| [x, gauss(x)]).filter(|p| p[1] >= 0.5).collect();
        dashed(&mut plot, &format!("Gaussian{of}"), model);
    }
    let mut note = format!(
        "Of {} pixels{of}, {} {} beyond five standard deviations of the core.",
        count(h.values),
        count(h.outliers),
        lie(h.outliers)
    );
    if beyond > 0 {
        note += &beyond_axis(beyond);
    }
    plot.note(&note);
    Some(plot)
}

fn lie(n: u64) -> &'static str {
    if n == 1 { "lies" } else { "lie" }
}

fn beyond_axis(n: u64) -> String {
    format!(" {} {} beyond the axis.", counted(n as usize, "pixel"), lie(n))
}

fn accumulated(channels: &[ChannelEmva], what: &str, of: Of<Histogram>) -> Option<Plot> {
    let all: Vec<_> = channels.iter().filter_map(|c| Some((c, of(c)?))).collect();
    if all.is_empty() {
        return None;
    }
    let mut plot = Plot::new(
        &format!("{what} accumulated"),
        "minimum deviation from the mean, DN",
        "share of the pixels, %",
    );
    let (reach, beyond) = common_reach(&all);
    plot.log_y().x_range(0.0, reach);
    let left_out = match beyond {
        0 => String::new(),
        n => beyond_axis(n),
    };
    plot.note(&format!("Share of pixels that deviate by at least this much.{left_out}"));
    for (c, h) in all {
        let mut sides = deviations(h);
        sides.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut left = h.values;
        let points = sides.into_iter().map(|(deviation, n)| {
            let share = 100.0 * left as f64 / h.values as f64;
            left -= n;
            [deviation, share]
        });
        let colour = Colour::of_channel(&c.channel);
        plot.series(&name(channels, c), Mark::Line, colour, points.collect());
    }
    Some(plot)
}

/// Profiles of the channel that gets most light: of the dark frames, and of the flats less these.
fn profiles(channels: &[ChannelEmva]) -> Vec<Plot> {
    let Some(c) = reference(channels) else { return Vec::new() };
    let Some(profiles) = &c.profiles else { return Vec::new() };
    let of = of(channels, c);
    let values = [format!("mean dark frame{of}, DN"), format!("mean flat minus dark{of}, DN")];
    let mut all = Vec::new();
    for ((both, value), what) in profiles.iter().zip(&values).zip(["Dark", "Flat"]) {
        let ways = [
            (&both.horizontal, "horizontal", "column of the channel"),
            (&both.vertical, "vertical", "row of the channel"),
        ];
        for (profile, way, axis) in ways {
            let mut plot = Plot::new(&format!("{what} profile, {way}"), axis, value);
            let (mean, ends) = thinned(profile);
            let colour = Colour::of_channel(&c.channel);
            plot.band("range", Colour::Reference, ends);
            plot.series("mean", Mark::Line, colour, mean);
            plot.note("Mean of the pixels in each line, and their range.");
            all.push(plot);
        }
    }
    all
}

/// A profile of at most [`POINTS`] points: means of neighbouring lines, and the ends of all of
/// them.
fn thinned(profile: &Profile) -> (Vec<[f64; 2]>, Vec<[f64; 3]>) {
    let bin = profile.mean.len().div_ceil(POINTS).max(1);
    let parts = profile.mean.chunks(bin).zip(profile.lowest.chunks(bin));
    let parts = parts.zip(profile.highest.chunks(bin)).enumerate();
    parts
        .map(|(i, ((mean, low), high))| {
            let x = i as f64 * bin as f64 + 0.5 * (mean.len() - 1) as f64;
            let low = low.iter().copied().fold(f64::INFINITY, f64::min);
            let high = high.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            ([x, mean.iter().sum::<f64>() / mean.len() as f64], [x, low, high])
        })
        .unzip()
}

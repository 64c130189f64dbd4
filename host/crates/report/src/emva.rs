//! The page of EMVA 1288 measurements: figures and plots in the order of the standard's data
//! sheet.

use super::numbers::{NOT_DETERMINED, count, fixed, number};
use super::page::{Page, Table};
use super::plot::{Colour, Mark, Plot};
use camrig_measure::emva::{ChannelEmva, Checked, Figures};
use camrig_measure::spectrogram::{Histogram, Spectrogram};

/// The page; `title` names the camera.
pub fn page(title: &str, result: &Checked) -> String {
    let mut page = Page::new(title);
    page.kind("Data sheet").subtitle("EMVA Standard 1288, release 4.0 linear");
    if !result.warnings.is_empty() {
        page.heading("Where these captures or this sensor do not meet the standard's assumptions");
        for warning in &result.warnings {
            page.note(warning);
        }
    }
    page.heading("Figures");
    sheet(&mut page, &result.channels);
    for channel in &result.channels {
        page.heading(&format!("Plots of the standard, channel {}", channel.channel));
        page.grid(|page| plots(page, channel));
    }
    page.html()
}

type Row = (&'static str, &'static str, usize, fn(&Figures) -> Option<f64>);

/// Name, unit, decimals and value of the figures, in the standard's order.
const ROWS: [Row; 29] = [
    ("Quantum efficiency", "%", 2, |f| f.quantum_efficiency.map(|q| 100.0 * q)),
    ("Overall system gain K", "DN/e⁻", 5, |f| Some(f.overall_system_gain)),
    ("1/K", "e⁻/DN", 4, |f| Some(1.0 / f.overall_system_gain)),
    ("K without the curvature of the response", "DN/e⁻", 5, |f| f.linearised_system_gain),
    ("Responsivity", "DN/photon", 5, |f| f.responsivity_dn_per_photon),
    ("Temporal dark noise", "e⁻", 3, |f| f.temporal_dark_noise_e),
    ("Temporal dark noise", "DN", 3, |f| Some(f.temporal_dark_noise_dn)),
    ("Absolute sensitivity threshold", "photons", 2, |f| f.absolute_sensitivity_threshold_p),
    ("Absolute sensitivity threshold", "e⁻", 2, |f| Some(f.absolute_sensitivity_threshold_e)),
    ("Saturation capacity", "photons", 0, |f| f.saturation_capacity_p),
    ("Saturation capacity", "e⁻", 0, |f| Some(f.saturation_capacity_e)),
    ("SNRmax", "1", 1, |f| Some(f.snr_max)),
    ("SNRmax", "dB", 1, |f| Some(f.snr_max_db)),
    ("Dynamic range", "1", 0, |f| Some(f.dynamic_range)),
    ("Dynamic range", "dB", 1, |f| Some(f.dynamic_range_db)),
    ("DSNU1288", "e⁻", 3, |f| f.dsnu_1288_e),
    ("DSNU1288 row", "e⁻", 3, |f| f.dsnu_1288_row_e),
    ("DSNU1288 column", "e⁻", 3, |f| f.dsnu_1288_column_e),
    ("DSNU1288 pixel", "e⁻", 3, |f| f.dsnu_1288_pixel_e),
    ("PRNU1288", "%", 3, |f| f.prnu_1288_percent),
    ("PRNU1288 row", "%", 3, |f| f.prnu_1288_row_percent),
    ("PRNU1288 column", "%", 3, |f| f.prnu_1288_column_percent),
    ("PRNU1288 pixel", "%", 3, |f| f.prnu_1288_pixel_percent),
    ("Linearity error LE", "%", 3, |f| f.linearity_error_percent),
    ("Linearity error, lowest", "%", 3, |f| f.linearity_error_min_percent),
    ("Linearity error, highest", "%", 3, |f| f.linearity_error_max_percent),
    ("Dark current, from the mean", "e⁻/s", 2, |f| f.dark_current_mean_e_per_s),
    ("Dark current, from the variance", "e⁻/s", 2, |f| f.dark_current_variance_e_per_s),
    ("Doubling temperature interval", "°C", 2, |f| f.dark_current_doubling_c),
];

/// The table of figures, a column per channel.
pub fn sheet(page: &mut Page, channels: &[ChannelEmva]) {
    let names: Vec<String> = channels.iter().map(|c| format!("channel {}", c.channel)).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut table = Table::new(&["figure", "unit"]).numbers(&names);
    table.rows(ROWS.iter().map(|(name, unit, decimals, value)| {
        let mut cells = vec![(*name).to_owned(), (*unit).to_owned()];
        cells.extend(channels.iter().map(|c| match value(&c.figures) {
            Some(v) => fixed(v, *decimals),
            None => NOT_DETERMINED.to_owned(),
        }));
        cells
    }));
    page.rows(&table);
}

/// The plots of one channel.
pub fn plots(page: &mut Page, channel: &ChannelEmva) {
    page.plot(&photon_transfer(channel));
    if channel.levels.iter().all(|l| l.photons.is_some()) {
        page.plot(&sensitivity(channel)).plot(&snr(channel)).plot(&linearity(channel));
    }
    if channel.darks.len() > 1 {
        page.plot(&dark_current(channel));
    }
    for (name, spectrogram) in
        [("DSNU", &channel.spectrogram_dark), ("PRNU", &channel.spectrogram_prnu)]
    {
        if let Some(s) = spectrogram {
            page.plot(&spectra_of(name, s));
        }
    }
    for (name, histogram) in [("DSNU", &channel.histogram_dsnu), ("PRNU", &channel.histogram_prnu)]
    {
        if let Some(h) = histogram {
            page.plot(&histogram_of(name, h));
        }
    }
}

fn photon_transfer(c: &ChannelEmva) -> Plot {
    let mut plot = Plot::new("Photon transfer", "signal, DN", "variance, DN²");
    plot.note("Temporal variance over signal, both above dark. Line: K · signal to 70 %.");
    let points: Vec<[f64; 2]> = c.levels.iter().map(|l| [l.signal_dn, l.variance_dn2]).collect();
    let top = points.iter().fold(0.0f64, |m, p| m.max(p[0]));
    let k = c.figures.overall_system_gain;
    plot.series("levels", Mark::Points, Colour::of_channel(&c.channel), points);
    let line = vec![[0.0, 0.0], [0.7 * top, 0.7 * top * k]];
    plot.series("K · signal", Mark::Dashed, Colour::Reference, line);
    plot
}

fn sensitivity(c: &ChannelEmva) -> Plot {
    let mut plot = Plot::new("Sensitivity", "photons per pixel", "signal, DN");
    let points: Vec<[f64; 2]> =
        c.levels.iter().filter_map(|l| Some([l.photons?, l.signal_dn])).collect();
    let top = points.iter().fold(0.0f64, |m, p| m.max(p[0]));
    plot.note("Signal over photons. Line: responsivity · photons to 70 %.");
    plot.series("levels", Mark::Points, Colour::of_channel(&c.channel), points);
    if let Some(r) = c.figures.responsivity_dn_per_photon {
        let line = vec![[0.0, 0.0], [0.7 * top, 0.7 * top * r]];
        plot.series("R · photons", Mark::Dashed, Colour::Reference, line);
    }
    plot
}

fn snr(c: &ChannelEmva) -> Plot {
    let mut plot = Plot::new("Signal to noise", "photons per pixel", "SNR");
    plot.log_x().log_y().note("Dots: measured, temporal noise. Dashed: the standard's model.");
    let dark = c.figures.temporal_dark_noise_dn.powi(2);
    let measured = c.levels.iter().filter_map(|l| {
        let noise = l.variance_dn2 + dark;
        (noise > 0.0).then_some([l.photons?, l.signal_dn / noise.sqrt()])
    });
    let colour = Colour::of_channel(&c.channel);
    plot.series("levels", Mark::Points, colour, measured.collect());
    let photons = c.levels.iter().filter_map(|l| l.photons);
    let top = photons.fold(1.0f64, f64::max);
    let grid = (0..=60).map(|i| top.powf(f64::from(i) / 60.0));
    if let Some(eta) = c.figures.quantum_efficiency {
        let noise = dark / c.figures.overall_system_gain.powi(2);
        let model = grid.clone().map(|p| [p, eta * p / (noise + eta * p).sqrt()]);
        plot.series("model", Mark::Dashed, colour, model.collect());
    }
    plot.series(
        "ideal sensor",
        Mark::Dashed,
        Colour::Reference,
        grid.map(|p| [p, p.sqrt()]).collect(),
    );
    plot
}

fn linearity(c: &ChannelEmva) -> Plot {
    let mut plot = Plot::new("Linearity", "photons per pixel", "deviation, %");
    let points = c.levels.iter().filter_map(|l| {
        let deviation = l.linearity_deviation_percent.filter(|d| d.abs() < 10.0)?;
        Some([l.photons?, deviation])
    });
    plot.note("Deviation from the line of the linearity fit.");
    plot.series("", Mark::Points, Colour::of_channel(&c.channel), points.collect());
    plot
}

fn dark_current(c: &ChannelEmva) -> Plot {
    let mut plot = Plot::new("Dark signal", "exposure, s", "mean, DN");
    plot.note("Mean of dark frames over exposure time.");
    let points = c.darks.iter().map(|d| [d.exposure_s, d.mean_dn]).collect();
    plot.series("", Mark::Points, Colour::of_channel(&c.channel), points);
    plot
}

fn spectra_of(name: &str, s: &Spectrogram) -> Plot {
    let title = format!("{name} spectrogram");
    let mut plot = Plot::new(&title, "cycles per pixel of the channel", "root of the power, DN");
    plot.log_y().note("Root of the mean power spectrum; white noise is flat.");
    let sides = [("horizontal", &s.horizontal), ("vertical", &s.vertical)];
    for (i, (label, power)) in sides.into_iter().enumerate() {
        let last = (power.len() - 1).max(1) as f64;
        // The largest of neighbouring values keeps the page small without losing narrow lines.
        let bin = power.len().div_ceil(512).max(1);
        let points = power.chunks(bin).enumerate().map(|(i, part)| {
            let middle = i as f64 * bin as f64 + 0.5 * (part.len() - 1) as f64;
            [0.5 * middle / last, part.iter().copied().fold(0.0, f64::max).sqrt()]
        });
        plot.series(label, Mark::Line, Colour::Series(i), points.collect());
    }
    plot
}

fn histogram_of(name: &str, h: &Histogram) -> Plot {
    let title = format!("{name} histogram");
    let mut plot = Plot::new(&title, "deviation, DN", "pixels");
    plot.log_y().note(&format!(
        "{} of {} pixels lie beyond five standard deviations of the core, {} DN. Dashed: a \
         Gaussian.",
        count(h.outliers),
        count(h.values),
        number(h.core_sigma)
    ));
    let at = |i: usize| h.start + (i as f64 + 0.5) * h.step;
    let points = h.counts.iter().enumerate().filter(|c| *c.1 > 0);
    let points = points.map(|(i, &n)| [at(i), n as f64]).collect();
    plot.series("", Mark::Points, Colour::Measured, points);
    if h.core_sigma > 0.0 {
        let peak = h.values as f64 * h.step / (h.core_sigma * std::f64::consts::TAU.sqrt());
        let model = |i: usize| [at(i), peak * (-0.5 * (at(i) / h.core_sigma).powi(2)).exp()];
        let model = (0..h.counts.len()).map(model).filter(|p| p[1] >= 0.5);
        plot.series("", Mark::Dashed, Colour::Reference, model.collect());
    }
    plot
}

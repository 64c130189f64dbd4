//! The page of EMVA 1288 measurements: figures and plots in the order of the standard's data
//! sheet. The first A4 page has the figures, the operating point and the signal-to-noise ratio.

mod plots;
mod table;

use super::numbers::{amount, at_least, counted, seconds, setting};
use super::page::{KeyFigure, Page};
use super::plot::Size;
use camrig_measure::Value;
use camrig_measure::emva::{ChannelEmva, Checked, Conditions};
use std::collections::BTreeSet;

pub(crate) use plots::all as plots;
pub(crate) use table::further;

/// Height of the signal-to-noise ratio on the first sheet, px.
const FIRST_SNR: f64 = 196.0;
/// Remarks that the first sheet has room for.
const FIRST_REMARKS: usize = 2;

/// The page; `title` names the camera, `source` is the origin of the captures, `command` is
/// what was typed.
pub fn page(title: &str, source: &str, result: &Checked, command: &str) -> String {
    let mut page = Page::new(title);
    page.kind("Data sheet").command(command);
    page.subtitle("EMVA Standard 1288, release 4.0 linear · measured at one operating point");
    first_sheet(&mut page, result, &operating_point(&result.conditions, source));
    page.heading_on_new_sheet("Plots of the standard");
    page.grid(|page| plots(page, result));
    page.heading("Further figures").rows(&further(&result.channels));
    further_remarks(&mut page, result);
    page.html()
}

/// Key figures, remarks, the table of the standard, operating point and signal-to-noise ratio.
pub(crate) fn first_sheet(page: &mut Page, result: &Checked, facts: &[(&str, String)]) {
    page.key_figures(&key_figures(result));
    let remarks = remarks(&result.warnings);
    let first = &remarks[..remarks.len().min(FIRST_REMARKS)];
    if !first.is_empty() {
        let more = match remarks.len() - first.len() {
            0 => String::new(),
            n => format!(" {} on the last page.", counted(n, "further remark")),
        };
        page.note(&(first.join(" ") + &more));
    }
    page.data_sheet(
        |page| {
            page.subheading("Figures of merit").rows(&table::merit(&result.channels));
            page.small(
                "Value ± standard error; a figure without ± has no error estimate. ≥: a lower \
                 limit, because the light did not reach saturation. –: not determined from these \
                 captures.",
            );
        },
        |page| {
            page.subheading("Operating point").facts(facts);
        },
        |page| {
            if let Some(mut snr) = plots::snr(&result.channels) {
                page.plot(snr.size(Size::FIGURE.high(FIRST_SNR)).note(""));
            }
        },
    );
}

/// The remarks that the first sheet has no room for.
pub(crate) fn further_remarks(page: &mut Page, result: &Checked) {
    let remarks = remarks(&result.warnings);
    let Some(more) = remarks.get(FIRST_REMARKS..).filter(|more| !more.is_empty()) else { return };
    page.heading("Further remarks on the captures");
    more.iter().for_each(|text| {
        page.note(text);
    });
}

/// The channel that gets most light, for which the levels were chosen.
pub(crate) fn reference(channels: &[ChannelEmva]) -> Option<&ChannelEmva> {
    let signal = |c: &&ChannelEmva| c.levels.iter().map(|l| l.signal_dn).sum::<f64>();
    channels.iter().max_by(|a, b| signal(a).total_cmp(&signal(b)))
}

fn key_figures(result: &Checked) -> Vec<KeyFigure> {
    let Some(c) = reference(&result.channels) else { return Vec::new() };
    let f = &c.figures;
    let of = match result.channels.len() {
        1 => String::new(),
        _ => format!(", {}", c.channel.to_uppercase()),
    };
    let of_value = |v: Value, unit: &str| amount(v.value, Some(v.std_error), unit);
    let limit = |v: Value, unit: &str| match c.saturates {
        true => of_value(v, unit),
        false => format!("{}\u{a0}{unit}", at_least(v.value)),
    };
    let mut all = Vec::new();
    let light = result.conditions.wavelength_nm.map(|nm| format!("{}\u{a0}nm", setting(nm)));
    if let Some(eta) = f.quantum_efficiency {
        let text = of_value(eta.scaled(100.0), "%");
        let figure = KeyFigure::new(&format!("Quantum efficiency{of}"), &text);
        all.push(figure.below(&light.unwrap_or_default()));
    }
    if let Some(noise) = f.temporal_dark_noise_e {
        let text = of_value(noise, "e⁻");
        let figure = KeyFigure::new(&format!("Temporal dark noise{of}"), &text);
        let below = f.temporal_dark_noise_dn.map(|dn| of_value(dn, "DN"));
        all.push(figure.below(&below.unwrap_or_default()));
    }
    if let Some(capacity) = f.saturation_capacity_e {
        let photons = f.saturation_capacity_p.map(|p| limit(p, "photons"));
        let figure = KeyFigure::new(&format!("Saturation capacity{of}"), &limit(capacity, "e⁻"));
        all.push(figure.below(&photons.unwrap_or_default()));
    }
    if let (Some(range), Some(snr)) = (f.dynamic_range_db, f.snr_max_db) {
        let figure = KeyFigure::new(&format!("Dynamic range{of}"), &limit(range, "dB"));
        all.push(figure.below(&format!("maximum SNR {}", limit(snr, "dB"))));
    }
    all
}

/// How the captures were taken, as far as they state it.
pub(crate) fn operating_point(c: &Conditions, source: &str) -> Vec<(&'static str, String)> {
    let s = &c.sensor;
    let mut all = Vec::new();
    all.extend(c.camera.clone().map(|name| ("Camera", name)));
    let pitch = s.pitch_um.map_or(String::new(), |p| format!(" of {}\u{a0}µm", setting(p)));
    let pattern = s.cfa.as_ref().map_or(String::new(), |cfa| format!(", {cfa}"));
    all.push(("Region", format!("{} × {} pixels{pitch}{pattern}", s.width, s.height)));
    let black = s.black_level_dn;
    let black = black.map_or(String::new(), |b| format!(", black level {}\u{a0}DN", setting(b)));
    let gain = setting(c.analog_gain);
    all.push(("Data", format!("{} bits{black}, analog gain {gain}", s.bits)));
    let light = match (c.wavelength_nm, &c.illuminant) {
        (Some(nm), _) => Some(format!("{}\u{a0}nm", setting(nm))),
        (None, name) => name.clone(),
    };
    all.extend(light.map(|text| ("Light", text)));
    let [shortest, longest] = c.exposure_s;
    let exposure = match shortest == longest {
        true => format!("{}, light varied", seconds(shortest)),
        false => format!("{} to {}", seconds(shortest), seconds(longest)),
    };
    all.push(("Exposure", exposure));
    all.extend(c.temperature_c.map(|[low, high]| ("Temperature", temperature(c, low, high))));
    all.push(("Frames", frames(c)));
    all.push(("Source", source.to_owned()));
    all.push(("Program", format!("camrig {}", env!("CARGO_PKG_VERSION"))));
    all
}

fn temperature(c: &Conditions, low: f64, high: f64) -> String {
    let mut text = match low == high {
        true => format!("{}\u{a0}°C", setting(low)),
        false => format!("{} to {}\u{a0}°C", setting(low), setting(high)),
    };
    if !c.other_temperatures_c.is_empty() {
        let others: Vec<String> = c.other_temperatures_c.iter().map(|&t| setting(t)).collect();
        text += &format!("; doubling from {}\u{a0}°C", others.join(", "));
    }
    text
}

fn frames(c: &Conditions) -> String {
    let [fewest, most] = c.level_frames;
    let each = match fewest == most {
        true => fewest.to_string(),
        false => format!("{fewest} to {most}"),
    };
    let spatial = c.spatial_frames.map_or(String::new(), |[dark, flat]| {
        format!("; spatial figures: {dark} dark, {flat} flat")
    });
    let levels = counted(c.levels, "level");
    format!("{levels} of {each} frames; {}{spatial}", counted(c.darks, "dark stack"))
}

/// Warnings as sentences; the same one for several channels is merged.
fn remarks(warnings: &[String]) -> Vec<String> {
    let parts = |warning: &str| match warning.strip_prefix("channel ") {
        Some(rest) => match rest.split_once(": ") {
            Some((name, text)) => (Some(name.to_uppercase()), text.to_owned()),
            None => (None, warning.to_owned()),
        },
        None => (None, warning.to_owned()),
    };
    let all: Vec<(Option<String>, String)> = warnings.iter().map(|w| parts(w)).collect();
    let mut said = BTreeSet::new();
    let mut out = Vec::new();
    for (_, text) in &all {
        if !said.insert(text) {
            continue;
        }
        let names: Vec<&str> = all
            .iter()
            .filter(|(_, other)| other == text)
            .filter_map(|(name, _)| name.as_deref())
            .collect();
        let sentence = match names.len() {
            0 => capitalised(text),
            1 => format!("Channel {}: {text}", names[0]),
            _ => format!("Channels {}: {text}", names.join(", ")),
        };
        out.push(format!("{sentence}."));
    }
    out
}

/// With a capital first letter.
pub(crate) fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_alike_for_channels_is_said_once() {
        let all = ["few levels", "channel r: low", "channel b: low", "channel g: odd"];
        let said = remarks(&all.map(String::from));
        assert_eq!(said, ["Few levels.", "Channels R, B: low.", "Channel G: odd."]);
    }
}

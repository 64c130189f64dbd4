//! Checks `[sensor.hdr]` and converts it to values with units.

use super::file::{CaptureFile, HdrFile, PhotodiodeFile, RoundingFile};
use super::{Capture, EffectOn, Hdr, HdrOutput, Photodiode};
use crate::check::fraction_curve;
use crate::file::TimingFile;
use crate::named_files::{FileName, FractionOrFile};
use crate::{AnyEffect, Camera, Folder};
use camrig_base::{Error, Outside, Result, Spectrum, mistakes};
use camrig_sensor_core::arith::MAX_SIGNAL_E;
use camrig_sensor_core::effects::{Domain, Effect};
use camrig_sensor_core::hdr::{Companding, Curve, Flicker, Hand, Level, Merge, Rounding};

/// Standard deviations of the deciding code that a hand-over ends below its capture's end, so that
/// noise there does not decide.
const ROOM_SIGMA: f64 = 4.0;
/// Gains of the merge are multiples of 1 over this.
const PARTS: f64 = 256.0;

/// The captures of a sensor, or all that is wrong with them.
pub(crate) fn hdr(
    file: &HdrFile,
    timing: Option<&TimingFile>,
    folder: &Folder<'_>,
) -> Result<Hdr> {
    let mut wrong = Vec::new();
    let mut keep = |e: Error| wrong.push(e);
    names(file).into_iter().for_each(&mut keep);
    row_time(file, timing).into_iter().for_each(&mut keep);
    let photodiodes: Vec<Photodiode> = (0..file.photodiode.len())
        .filter_map(|i| photodiode(file, i, folder).map_err(&mut keep).ok())
        .collect();
    let captures: Vec<Capture> =
        (0..file.capture.len()).filter_map(|i| capture(file, i).map_err(&mut keep).ok()).collect();
    windows(file).into_iter().for_each(&mut keep);
    let merge = merge(file).map_err(&mut keep).ok();
    let companding = companding(file).map_err(&mut keep).ok();
    let (Some(merge), Some(companding), true) = (merge, companding, wrong.is_empty()) else {
        return Err(mistakes::all(wrong));
    };
    let hdr = Hdr {
        output: file.output,
        row_time_us: file.row_time_us,
        photodiodes,
        captures,
        merge,
        companding,
        effects: Vec::new(),
    };
    hand_overs(file, &hdr)?;
    Ok(hdr)
}

fn of_table(table: &str, name: &str) -> String {
    format!("[[sensor.hdr.{table}]] {name:?}")
}

/// Times of a row that differ: the file says it twice.
fn row_time(file: &HdrFile, timing: Option<&TimingFile>) -> Option<Error> {
    let (ours, other) = (file.row_time_us, timing?.line_time_us);
    ((ours - other).abs() > 1e-6 * ours).then(|| {
        Error::disagreement(format!(
            "row_time_us = {ours} in [sensor.hdr], line_time_us = {other} in [sensor.timing]"
        ))
        .help("both are the time from one row to the next, µs")
    })
}

/// Names that stand twice, and lists that are too short or too long.
fn names(file: &HdrFile) -> Vec<Error> {
    let mut wrong = Vec::new();
    let photodiodes: Vec<&str> = file.photodiode.iter().map(|p| p.name.as_str()).collect();
    let captures: Vec<&str> = file.capture.iter().map(|c| c.name.as_str()).collect();
    for (table, names, [least, most]) in
        [("photodiode", &photodiodes, [1, 4]), ("capture", &captures, [2, 4])]
    {
        if !(least..=most).contains(&names.len()) {
            let what = format!("{} tables [[sensor.hdr.{table}]]", names.len());
            wrong.push(Error::input(what).help(format!("give {least} to {most}")));
        }
        let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
        if let Some(name) = names.iter().find(|n| n.is_empty() || !n.chars().all(plain)) {
            // Names of captures are in names of files.
            wrong.push(
                Error::input(format!("the name {name:?}"))
                    .at(of_table(table, name))
                    .help("use letters, digits, - and _"),
            );
        }
        if let Some(i) = (0..names.len()).find(|&i| names[..i].contains(&names[i])) {
            let what = format!("the name {:?} stands twice", names[i]);
            wrong.push(Error::input(what).at(of_table(table, names[i])));
        }
    }
    wrong
}

/// The position of a name among others.
fn position<'a>(
    name: &str,
    of: &str,
    mut names: impl Iterator<Item = &'a str> + Clone,
    place: String,
) -> Result<usize> {
    let known = names.clone().collect::<Vec<_>>().join(", ");
    names.position(|n| n == name).ok_or_else(|| {
        Error::input(format!("no {of} {name:?}")).at(place).help(format!("there are {known}"))
    })
}

fn capture_position(file: &HdrFile, name: &str, place: String) -> Result<usize> {
    position(name, "capture", file.capture.iter().map(|c| c.name.as_str()), place)
}

fn response(file: &PhotodiodeFile, folder: &Folder<'_>) -> Result<Spectrum> {
    match &file.response_ratio {
        FractionOrFile::Number(ratio) => Ok(Spectrum::constant(*ratio)),
        FractionOrFile::File(FileName(name)) => fraction_curve(name, Outside::Held, folder),
    }
    .map_err(|e| e.at(of_table("photodiode", &file.name)))
}

fn photodiode(file: &HdrFile, i: usize, folder: &Folder<'_>) -> Result<Photodiode> {
    let own = &file.photodiode[i];
    let place = || of_table("photodiode", &own.name);
    if own.full_well_e + own.overflow_e > f64::from(MAX_SIGNAL_E) {
        return Err(Error::limit(format!(
            "a well of {} and a capacitor of {} e-",
            own.full_well_e, own.overflow_e
        ))
        .at(place())
        .help(format!("both together hold at most {MAX_SIGNAL_E} e-")));
    }
    if own.overflow_leak > 0.0 {
        return Err(Error::unsupported("overflow_leak: charge from a photodiode that is full")
            .at(place())
            .help("use 0; light that leaks in is optical_leak"));
    }
    let mut ratio = response(own, folder)?;
    if own.optical_leak > 0.0 {
        if file.photodiode.len() == 1 {
            return Err(Error::input("optical_leak of the only photodiode")
                .at(place())
                .help("it is the share of the light of others: use 0"));
        }
        for (_, other) in file.photodiode.iter().enumerate().filter(|(k, _)| *k != i) {
            ratio = sum(&ratio, own.optical_leak, &response(other, folder)?)?;
        }
    }
    Ok(Photodiode {
        name: own.name.clone(),
        response: ratio,
        full_well_e: own.full_well_e,
        overflow_e: own.overflow_e,
        dark_current_e_per_s: own.dark_current_e_per_s,
        dsnu_e_per_s: own.dsnu_e_per_s,
        prnu: own.prnu,
    })
}

/// a + share b, at the wavelengths of both.
fn sum(a: &Spectrum, share: f64, b: &Spectrum) -> Result<Spectrum> {
    let mut nm: Vec<f64> = a.samples().chain(b.samples()).map(|(nm, _)| nm).collect();
    nm.sort_by(f64::total_cmp);
    nm.dedup();
    let values = nm.iter().map(|&nm| a.at(nm) + share * b.at(nm)).collect();
    Spectrum::new(nm, values)
}

fn capture(file: &HdrFile, i: usize) -> Result<Capture> {
    let own = &file.capture[i];
    let place = || of_table("capture", &own.name);
    let photodiodes = file.photodiode.iter().map(|p| p.name.as_str());
    let photodiode = position(&own.photodiode, "photodiode", photodiodes, place())?;
    let top = (1u32 << own.bits.min(16)) - 1;
    if u32::from(own.black_level_dn) >= top {
        return Err(Error::input(format!("black_level_dn = {}", own.black_level_dn))
            .at(place())
            .help(format!("use 0 to {}: the converter ends at {top}", top - 1)));
    }
    if own.read_e_post > own.read_e {
        return Err(Error::input(format!("read_e_post = {}", own.read_e_post))
            .at(place())
            .help(format!("use 0 to {} e-, the whole", own.read_e)));
    }
    Ok(Capture {
        name: own.name.clone(),
        photodiode,
        window: own.window,
        start_us: own.start_us,
        exposure_ratio: own.exposure_ratio,
        gain_ratio: own.gain_ratio,
        full_scale_e: own.full_scale_e,
        bits: own.bits,
        black_level_dn: own.black_level_dn,
        read_e: own.read_e,
        read_e_post: own.read_e_post,
        row_fpn_e: own.row_fpn_e,
        overflow: own.overflow,
        virtual_channel: own.virtual_channel,
        gain: file.merge.gains.get(i).copied().unwrap_or(1.0),
    })
}

/// Captures that say of one window what they cannot share.
fn windows(file: &HdrFile) -> Vec<Error> {
    let differs = |a: &CaptureFile, b: &CaptureFile| {
        a.photodiode != b.photodiode
            || a.start_us != b.start_us
            || a.exposure_ratio != b.exposure_ratio
    };
    let mut wrong = Vec::new();
    for (i, b) in file.capture.iter().enumerate() {
        let first = file.capture[..i].iter().find(|a| a.window == b.window);
        if let Some(a) = first.filter(|a| differs(a, b)) {
            wrong.push(
                Error::input(format!("window {} is not that of capture {:?}", b.window, a.name))
                    .at(of_table("capture", &b.name))
                    .help(
                        "captures of one window read one charge: the same photodiode, start_us \
                         and exposure_ratio; give another integration a number of its own",
                    ),
            );
        }
    }
    wrong
}

fn merge(file: &HdrFile) -> Result<Merge> {
    let merge = &file.merge;
    let place = "[sensor.hdr.merge]";
    let captures = file.capture.len();
    if merge.gains.len() != captures || merge.step.len() + 1 != captures {
        return Err(Error::input(format!(
            "{} gains and {} steps for {captures} captures",
            merge.gains.len(),
            merge.step.len()
        ))
        .at(place)
        .help("give a gain for each capture, and a step to each but the first"));
    }
    let mut levels = Vec::new();
    for (gain, capture) in merge.gains.iter().zip(&file.capture) {
        let parts = gain * PARTS;
        if parts.fract() != 0.0 || !(1.0..=f64::from(u32::MAX)).contains(&parts) {
            return Err(Error::input(format!("gain {gain}"))
                .at(place)
                .help("gains are multiples of 1/256 above 0"));
        }
        levels.push(Level { black_dn: capture.black_level_dn, gain: parts as u32 });
    }
    let mut hands = Vec::new();
    for (k, step) in merge.step.iter().enumerate() {
        let place = || of_table("merge.step", &step.to);
        let to = capture_position(file, &step.to, place())?;
        let decide = capture_position(file, &step.decide, place())?;
        if to != k + 1 {
            return Err(Error::input(format!("step {} leads to capture {:?}", k + 1, step.to))
                .at(place())
                .help(format!("steps follow the captures: to {:?}", file.capture[k + 1].name)));
        }
        let (low_dn, high_dn) = (step.low_dn, step.high_dn);
        hands.push(Hand { decide: decide as u8, low_dn, high_dn });
    }
    let core = |e: camrig_sensor_core::hdr::HdrError| Error::input(e.to_string()).at(place);
    let merged =
        Merge::new(&levels, &hands, merge.linear_bits, merge.pedestal_dn).map_err(core)?;
    if merge.flicker_capture == "none" {
        return Ok(merged);
    }
    let capture = capture_position(file, &merge.flicker_capture, place.to_string())? as u8;
    merged.with_flicker(Flicker { capture, margin_dn: merge.flicker_margin_dn }).map_err(core)
}

fn companding(file: &HdrFile) -> Result<Option<Companding>> {
    let place = "[sensor.hdr.companding]";
    let Some(own) = &file.companding else {
        return match file.output {
            HdrOutput::Companded => Err(Error::input("output = \"companded\" without a curve")
                .at("[sensor.hdr]")
                .help("give the table [sensor.hdr.companding], or output = \"linear\"")),
            _ => Ok(None),
        };
    };
    let end = 1u64 << file.merge.linear_bits;
    if let Some((x, _)) = own.knees.iter().find(|(x, _)| u64::from(*x) > end) {
        return Err(Error::input(format!("a knee at {x}"))
            .at(place)
            .help(format!("the linear signal ends below {end}")));
    }
    let rounding = match own.rounding {
        RoundingFile::Floor => Rounding::Floor,
        RoundingFile::Nearest => Rounding::Nearest,
    };
    let core = |e: camrig_sensor_core::hdr::HdrError| Error::input(e.to_string()).at(place);
    let curve = Curve::new(&own.knees, rounding).map_err(core)?;
    let (bits, subtract_dn, pedestal_dn) = (own.bits, own.subtract_dn, own.pedestal_dn);
    let companding = Companding { curve, bits, subtract_dn, pedestal_dn };
    companding.check().map_err(core)?;
    Ok(Some(companding))
}

/// Hand-overs that end where noise reaches the end of the deciding capture.
fn hand_overs(file: &HdrFile, hdr: &Hdr) -> Result<()> {
    for step in &file.merge.step {
        let place = of_table("merge.step", &step.to);
        let decide = &hdr.captures[capture_position(file, &step.decide, place.clone())?];
        let (end, gain) = (hdr.end_dn(decide, 1.0), decide.dn_per_e(1.0));
        let signal_e = (f64::from(step.high_dn) - f64::from(decide.black_level_dn)) / gain;
        let variance =
            gain * gain * (signal_e.max(0.0) + decide.read_e * decide.read_e) + 1.0 / 12.0;
        let room = ROOM_SIGMA * libm::sqrt(variance);
        if f64::from(step.high_dn) + room > end {
            return Err(Error::input(format!(
                "high_dn = {}, and {:?} ends at {end:.0} DN",
                step.high_dn, decide.name
            ))
            .at(place)
            .help(format!(
                "use at most {:.0}: {ROOM_SIGMA} standard deviations of its noise below the end",
                (end - room).floor()
            )));
        }
    }
    Ok(())
}

/// An effect that some captures have: `on` names the photodiodes of an effect on light or charge,
/// and the captures of one on the voltage.
pub(crate) fn effect_on(
    hdr: Option<&Hdr>,
    names: &toml::Value,
    effect: &AnyEffect,
) -> Result<EffectOn> {
    let hdr = hdr.ok_or_else(|| {
        Error::input("on = ... without [sensor.hdr]").help("a sensor has all its effects")
    })?;
    let AnyEffect::Sensor(effect) = effect else {
        return Err(Error::input("on = ... of an effect of the optics")
            .help("light passes the optics once, for all captures"));
    };
    let names: Option<Vec<&str>> =
        names.as_array().and_then(|names| names.iter().map(toml::Value::as_str).collect());
    let names = names.filter(|names| !names.is_empty()).ok_or_else(|| {
        Error::input("on is no list of names").help("on = [\"hcg\"], for instance")
    })?;
    let name_of = |capture: &Capture| match effect.domain() {
        Domain::Voltage => capture.name.clone(),
        _ => hdr.photodiodes[capture.photodiode].name.clone(),
    };
    let all: Vec<String> = hdr.captures.iter().map(name_of).collect();
    if let Some(unknown) = names.iter().find(|name| !all.iter().any(|a| a == **name)) {
        let of = if effect.domain() == Domain::Voltage { "captures" } else { "photodiodes" };
        return Err(Error::input(format!("on names {unknown:?}")).help(format!(
            "an effect on {} names {of}: {}",
            effect.domain(),
            all.join(", ")
        )));
    }
    let captures = all.iter().map(|name| names.contains(&name.as_str())).collect();
    Ok(EffectOn { effect: *effect, captures })
}

/// Checks that each capture's effects fit the sensor model, and that codes are companded once.
pub(crate) fn check_chains(camera: &Camera) -> Result<()> {
    let Some(hdr) = &camera.sensor.hdr else { return Ok(()) };
    let of_captures = hdr.effects.iter().map(|e| &e.effect);
    let mut all = camera.effects.iter().chain(of_captures);
    if hdr.companding.is_some() && all.any(|e| matches!(e, Effect::Companding(_))) {
        return Err(Error::input("the effect companding beside [sensor.hdr.companding]")
            .help("remove one: the effect compands a capture, the table the merged signal"));
    }
    let mut captures = (0..hdr.captures.len()).filter_map(|i| camera.of_capture(i));
    captures.try_for_each(|capture| capture.check_chain())
}

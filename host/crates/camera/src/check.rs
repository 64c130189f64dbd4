//! Checks the content of a camera file and converts it to values with units.

use super::effects::{AnyEffect, read_effect};
use super::empirical::{self, Empirical};
use super::file::{CameraFile, LensFile, NumberOrFile, SensorFile};
use super::prescription;
use super::{
    Camera, CrosstalkTable, Folder, KeptNoise, LensKind, LensModel, Noise, RelativeIllumination,
    SensorModel, SensorTiming, Shutter, csv_reader,
};
use camrig_base::table::{SpectralTable, Wanted};
use camrig_base::{Cfa, Error, Outside, Result, Spectrum, mistakes, toml_text};
use std::cell::RefCell;

/// Widest gap between wavelengths of a curve, nm: colour filters and infrared cut filters change
/// within 30 nm, so that a straight line over a wider gap would miss their edges.
const WIDEST_GAP_NM: f64 = 25.0;
/// Widest gap of a quantum efficiency, nm, of which a data sheet may give no more than a few
/// points; what is wider than [`WIDEST_GAP_NM`] is told. Colour filters are about so wide: a line
/// over more could pass one by.
const WIDEST_GAP_OF_QE_NM: f64 = 100.0;
/// Gap over the table's median step from which on lines are missing, where the gap is wider than
/// [`WIDEST_GAP_NM`]: points of a data sheet are more even than that.
const HOLE: f64 = 3.0;
/// The visible range that every curve must cover, nm: the bands of built-in scenes.
const VISIBLE_NM: [f64; 2] = [400.0, 700.0];
/// Range of fields and ratios in a table of relative illumination. Both are 1 at most by
/// definition; beyond the corner and for lenses that brighten off the axis there is some room.
const FIELD_TABLE: std::ops::RangeInclusive<f64> = 0.0..=1.5;
/// Default of `row_fpn_e` over `read_e` (Chen et al. 2009: half of the largest read noise, which
/// is that at unity gain).
const ROW_FPN_OVER_READ: f64 = 0.5;

/// Finds the keys of one table in the file's text, for messages, and collects what is wrong with
/// them.
pub(super) struct Keys<'a> {
    text: &'a str,
    table: &'static str,
    wrong: &'a RefCell<Vec<Error>>,
}

impl Keys<'_> {
    pub(super) fn place(&self, key: &str) -> String {
        match toml_text::line_of_key(self.text, self.table, key) {
            Some(line) => format!("line {line}, key {key:?} of [{}]", self.table),
            None => format!("key {key:?} of [{}]", self.table),
        }
    }

    /// A value, if it lies within its limits; else the nearest limit, and a mistake collected.
    /// `unit` is for the message.
    pub(super) fn within(
        &self,
        key: &str,
        v: f64,
        ok: std::ops::RangeInclusive<f64>,
        unit: &str,
    ) -> Result<f64> {
        if ok.contains(&v) {
            return Ok(v);
        }
        let wrong = Error::input(format!("{key} = {v}")).at(self.place(key));
        let help = format!("use {} to {} {unit}", ok.start(), ok.end());
        self.wrong.borrow_mut().push(wrong.help(help));
        Ok(if v > *ok.end() { *ok.end() } else { *ok.start() })
    }

    pub(super) fn required<T>(&self, key: &str, value: Option<T>, kind: &str) -> Result<T> {
        value.ok_or_else(|| {
            Error::input(format!("key {key:?} is missing"))
                .at(format!("[{}]", self.table))
                .help(format!("kind = {kind:?} needs it"))
        })
    }
}

pub(super) fn camera(
    file: CameraFile,
    text: &str,
    default_name: &str,
    folder: &Folder<'_>,
) -> Result<Camera> {
    let wrong = RefCell::new(Vec::new());
    let keep = |e: Error| wrong.borrow_mut().push(e);
    let keys = Keys { text, table: "lens", wrong: &wrong };
    let lens = lens(file.lens, &keys, folder).map_err(keep).ok();
    let sensor = sensor(file.sensor, text, folder, &wrong).map_err(keep).ok();
    let mut effects = Vec::new();
    for table in &file.effects {
        let line = toml_text::line_of(text, table.span().start);
        match listed(table.get_ref(), folder) {
            Ok(effect) => effects.push(effect),
            Err(e) => keep(e.at(format!("[[effect]] at line {line}"))),
        }
    }
    let (Some(lens), Some(sensor), true) = (lens, sensor, wrong.borrow().is_empty()) else {
        return Err(mistakes::all(wrong.take()));
    };
    let name = file.name.unwrap_or_else(|| default_name.to_string());
    let mut camera = Camera {
        name,
        lens,
        sensor,
        effects: Vec::new(),
        empirical: Vec::new(),
        first_frame: 0,
        optical_effects: Vec::new(),
        text: text.to_string(),
    };
    for effect in effects {
        match effect {
            Listed::Empirical(effect) => {
                let stage = camera.keep(effect)?;
                camera.effects.push(stage);
            }
            Listed::Catalogued(AnyEffect::Sensor(effect)) => camera.effects.push(effect),
            Listed::Catalogued(AnyEffect::Optical(effect)) => camera.optical_effects.push(effect),
        }
    }
    camera.check_chain()?;
    Ok(camera)
}

/// What an `[[effect]]` table is.
enum Listed {
    Catalogued(AnyEffect),
    Empirical(Empirical),
}

fn listed(table: &toml::Table, folder: &Folder<'_>) -> Result<Listed> {
    if table.get("kind").and_then(toml::Value::as_str) == Some(empirical::KIND) {
        return Empirical::read(table, folder).map(Listed::Empirical);
    }
    read_effect(table).map(Listed::Catalogued)
}

fn lens(file: LensFile, keys: &Keys<'_>, folder: &Folder<'_>) -> Result<LensModel> {
    let kind = file.kind.as_str();
    let given = [
        ("relative_illumination", file.relative_illumination.is_some()),
        ("data", file.data.is_some()),
        ("file", file.file.is_some()),
    ];
    let foreign: &[&str] = match kind {
        "diffraction-limited" => &["data", "file"],
        "characterised" => &["file", "relative_illumination"],
        "prescription" => &["data", "relative_illumination"],
        _ => {
            let known = ["diffraction-limited", "characterised", "prescription"];
            return Err(Error::input(format!("lens kind {kind:?}"))
                .at(keys.place("kind"))
                .help(toml_text::did_you_mean(kind, &known)));
        }
    };
    let foreign = given.iter().filter(|(key, given)| *given && foreign.contains(key));
    let foreign = foreign.map(|(key, _)| *key);
    let of_prescription = (kind != "prescription").then(|| prescription::given(&file)).flatten();
    if let Some(key) = foreign.chain(of_prescription).next() {
        return Err(Error::input(format!("key {key:?} means nothing for kind = {kind:?}"))
            .at(keys.place(key))
            .help("remove it, or change the kind"));
    }
    let transmittance = match &file.transmittance {
        None => Spectrum::constant(1.0),
        Some(NumberOrFile::Number(t)) => {
            Spectrum::constant(keys.within("transmittance", *t, 0.0..=1.0, "")?)
        }
        Some(NumberOrFile::File(name)) => fraction_curve(name, Outside::Held, folder)
            .map_err(|e| e.at(keys.place("transmittance")))?,
    };
    let kind = match kind {
        "characterised" => LensKind::Characterised(folder.path(&keys.required(
            "data",
            file.data,
            "characterised",
        )?)),
        "prescription" => {
            LensKind::Prescription(Box::new(prescription::setup(&file, keys, folder)?))
        }
        kind => LensKind::DiffractionLimited {
            f_number: keys.within(
                "f_number",
                keys.required("f_number", file.f_number, kind)?,
                0.5..=128.0,
                "(focal length over pupil diameter)",
            )?,
            focal_length_mm: keys.within(
                "focal_length_mm",
                keys.required("focal_length_mm", file.focal_length_mm, kind)?,
                0.1..=10_000.0,
                "mm",
            )?,
            magnification: keys.within(
                "magnification",
                file.magnification.unwrap_or(0.0).abs(),
                0.0..=100.0,
                "(image size over object size)",
            )?,
            relative_illumination: match file.relative_illumination.as_deref() {
                None | Some("cos4") => RelativeIllumination::Cos4,
                Some("none") => RelativeIllumination::Flat,
                Some(name) => RelativeIllumination::Table(
                    field_table(name, folder)
                        .map_err(|e| e.at(keys.place("relative_illumination")))?,
                ),
            },
        },
    };
    Ok(LensModel { kind, transmittance })
}

fn sensor(
    file: SensorFile,
    text: &str,
    folder: &Folder<'_>,
    wrong: &RefCell<Vec<Error>>,
) -> Result<SensorModel> {
    let keys = Keys { text, table: "sensor", wrong };
    let side = |key, v: u32| {
        keys.within(
            key,
            f64::from(v),
            1.0..=f64::from(camrig_sensor_core::config::MAX_SIDE),
            "pixels",
        )
    };
    side("width", file.width)?;
    let height = side("height", file.height)? as u32;
    let cfa = Cfa::parse(&file.cfa).map_err(|e| e.at(keys.place("cfa")))?;
    if cfa.channels().len() > camrig_sensor_core::config::MAX_CHANNELS {
        return Err(Error::input(format!(
            "cfa = {:?} has {} channels",
            file.cfa,
            cfa.channels().len()
        ))
        .at(keys.place("cfa"))
        .help(format!("use at most {} letters", camrig_sensor_core::config::MAX_CHANNELS)));
    }
    let (channel_names, qe) = channels(&file, &cfa, &keys, folder)?;
    let ir_cut = match &file.ir_cut {
        Some(name) => Some(
            fraction_curve(name, Outside::Zero, folder).map_err(|e| e.at(keys.place("ir_cut")))?,
        ),
        None => None,
    };
    let crosstalk = match &file.crosstalk {
        Some(name) => Some(
            folder
                .read(name)
                .and_then(|text| CrosstalkTable::parse(&text))
                .and_then(|table| table.for_channels(&channel_names))
                .map_err(|e| e.at(name).at(keys.place("crosstalk")))?,
        ),
        None => None,
    };
    let bits = keys.within("bits", f64::from(file.bits), 8.0..=16.0, "bits")? as u8;
    let max_dn = f64::from((1u32 << bits) - 1);
    Ok(SensorModel {
        width: file.width,
        height: file.height,
        pitch_um: keys.within("pitch_um", file.pitch_um, 0.1..=1000.0, "µm")?,
        fill_factor: keys.within("fill_factor", file.fill_factor, 0.001..=1.0, "(area ratio)")?,
        cfa,
        channel_names,
        qe,
        ir_cut,
        crosstalk,
        conversion_gain_uv_per_e: file
            .conversion_gain_uv_per_e
            .map(|v| {
                keys.within("conversion_gain_uv_per_e", v, 0.001..=10_000.0, "µV per electron")
            })
            .transpose()?,
        full_well_e: keys.within(
            "full_well_e",
            file.full_well_e,
            1.0..=f64::from(camrig_sensor_core::arith::MAX_SIGNAL_E),
            "e-",
        )?,
        bits,
        black_level_dn: keys.within(
            "black_level_dn",
            file.black_level_dn,
            0.0..=max_dn - 1.0,
            "DN",
        )?,
        analog_gain: keys.within("analog_gain", file.analog_gain, 0.01..=1000.0, "")?,
        temperature_c: keys.within("temperature_c", file.temperature_c, -100.0..=150.0, "°C")?,
        seed: file.seed,
        timing: match &file.timing {
            Some(file) => {
                let keys = Keys { text, table: "sensor.timing", wrong };
                Some(timing(file, height, &keys)?)
            }
            None => None,
        },
        noise: noise(&file.noise, &Keys { text, table: "sensor.noise", wrong })?,
        kept_noise: KeptNoise::default(),
    })
}

/// The channels' names and the quantum efficiency of each.
fn channels(
    file: &SensorFile,
    cfa: &Cfa,
    keys: &Keys<'_>,
    folder: &Folder<'_>,
) -> Result<(Vec<String>, Vec<Spectrum>)> {
    match &file.qe {
        NumberOrFile::Number(_) if file.qe_peak.is_some() => {
            Err(Error::input("qe_peak beside a number of qe")
                .at(keys.place("qe_peak"))
                .help("remove one of them: qe_peak scales a table"))
        }
        NumberOrFile::Number(q) => {
            let q = keys.within("qe", *q, 0.0..=1.0, "electrons per photon")?;
            let names: Vec<String> =
                cfa.channels().iter().map(|c| c.to_lowercase().to_string()).collect();
            let curves = vec![Spectrum::constant(q); names.len()];
            Ok((names, curves))
        }
        NumberOrFile::File(name) => {
            let peak = file.qe_peak;
            let within = |v| keys.within("qe_peak", v, 0.001..=1.0, "electrons per photon");
            let peak = peak.map(within).transpose()?;
            quantum_efficiency(name, cfa, peak, folder).map_err(|e| e.at(keys.place("qe")))
        }
    }
}

fn timing(file: &super::file::TimingFile, rows: u32, keys: &Keys<'_>) -> Result<SensorTiming> {
    let lines = file.frame_length_lines.unwrap_or(rows);
    // Those of a register of 16 bits.
    let lines = keys.within("frame_length_lines", f64::from(lines), 1.0..=65_535.0, "lines")?;
    let one_of = |key, given: &Option<String>, names: [&str; 2]| match given.as_deref() {
        None => Ok(0),
        Some(name) => names.iter().position(|n| *n == name).ok_or_else(|| {
            let wrong = Error::input(format!("{key} = {name:?}")).at(keys.place(key));
            wrong.help(toml_text::did_you_mean(name, &names))
        }),
    };
    let shutters = [Shutter::Rolling, Shutter::Global];
    let shutter = shutters[one_of("shutter", &file.shutter, SensorTiming::SHUTTERS)?];
    let upwards = one_of("direction", &file.direction, SensorTiming::DIRECTIONS)? == 1;
    let Some(line_time_us) = file.line_time_us else {
        return Err(Error::input("key \"line_time_us\" is missing")
            .at("[sensor.timing]")
            .help("it is the time from one row to the next, µs"));
    };
    Ok(SensorTiming {
        line_time_us: keys.within("line_time_us", line_time_us, 0.1..=10_000.0, "µs")?,
        frame_length_lines: lines as u32,
        shutter,
        upwards,
    })
}

fn noise(file: &super::file::NoiseFile, keys: &Keys<'_>) -> Result<Noise> {
    let read_e = keys.within("read_e", file.read_e, 0.0..=1e5, "e-")?;
    // A read noise out of range says nothing about its part.
    let whole = if read_e == file.read_e { read_e } else { f64::MAX };
    let dark = |key, v| keys.within(key, v, 0.0..=1e6, "e-/s");
    Ok(Noise {
        read_e,
        read_e_post: keys.within("read_e_post", file.read_e_post, 0.0..=whole, "e-, the whole")?,
        dark_current_e_per_s: dark("dark_current_e_per_s", file.dark_current_e_per_s)?,
        dark_doubling_c: keys.within("dark_doubling_c", file.dark_doubling_c, 1.0..=100.0, "K")?,
        temperature_ref_c: keys.within(
            "temperature_ref_c",
            file.temperature_ref_c,
            -100.0..=150.0,
            "°C",
        )?,
        dsnu_e_per_s: dark("dsnu_e_per_s", file.dsnu_e_per_s)?,
        prnu: keys.within("prnu", file.prnu, 0.0..=0.14, "(relative standard deviation)")?,
        row_fpn_e: keys.within(
            "row_fpn_e",
            file.row_fpn_e.unwrap_or(ROW_FPN_OVER_READ * read_e),
            0.0..=1e5,
            "e-",
        )?,
    })
}

/// A curve of fractions over wavelength: a table of one column, and what it is outside the table
/// unless that says otherwise.
fn fraction_curve(name: &str, outside: Outside, folder: &Folder<'_>) -> Result<Spectrum> {
    let table = spectral_table(name, Wanted::Transmittance, WIDEST_GAP_NM, folder)?;
    if table.curves.len() != 1 {
        return Err(Error::input(format!("{} columns", table.curves.len() + 1))
            .at(name)
            .help("the columns are wavelength_nm,transmittance"));
    }
    Ok(table.spectrum(0)?.from_table(name).outside(table.outside.unwrap_or(outside)))
}

/// Reads a table and checks that its values are fractions and that it covers the visible range
/// without holes and gaps wider than `widest_nm`.
fn spectral_table(
    name: &str,
    wanted: Wanted,
    widest_nm: f64,
    folder: &Folder<'_>,
) -> Result<SpectralTable> {
    let table = SpectralTable::parse(&folder.read(name)?).map_err(|e| e.at(name))?;
    let mut table = table.named(name);
    table.convert_to_fractions(wanted).map_err(|e| e.at(name))?;
    let mut steps: Vec<f64> = table.wavelength_nm.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    let hole = (HOLE * steps.get(steps.len() / 2).unwrap_or(&0.0)).max(WIDEST_GAP_NM);
    let allowed = widest_nm.min(hole);
    if let Some(gap) = table.wavelength_nm.windows(2).find(|w| w[1] - w[0] > allowed) {
        return Err(Error::input(format!("no values between {} and {} nm", gap[0], gap[1]))
            .at(name)
            .help(format!("give a value at least every {allowed} nm")));
    }
    let widest = steps.last().copied().unwrap_or_default();
    if widest > WIDEST_GAP_NM {
        table.remark(format!("straight lines join its points, up to {widest} nm apart"));
    }
    table.must_cover(VISIBLE_NM).map_err(|e| e.at(name))?;
    Ok(table)
}

/// Names of columns by the colours of the pattern's letters.
const COLOURS: [(&str, &str); 3] = [("r", "red"), ("g", "green"), ("b", "blue")];

/// Scales all columns of a table so that its largest value is `peak`.
fn scaled_to(peak: f64, table: &mut SpectralTable) -> Result<()> {
    let largest = table.curves.iter().flat_map(|(_, v)| v).fold(0.0f64, |m, &v| m.max(v));
    if largest == 0.0 {
        return Err(Error::input("a table of zeros cannot be scaled to a peak"));
    }
    let values = table.curves.iter_mut().flat_map(|(_, values)| values);
    values.for_each(|v| *v = *v / largest * peak);
    Ok(())
}

/// Channel names and curves, scaled to a peak where one is given; zero outside the table unless
/// that says otherwise. The table's columns are r,g,b or r,gr,gb,b for Bayer patterns, one column
/// for mono, else one column per letter of the pattern; none twice.
fn quantum_efficiency(
    name: &str,
    cfa: &Cfa,
    peak: Option<f64>,
    folder: &Folder<'_>,
) -> Result<(Vec<String>, Vec<Spectrum>)> {
    let wanted = if peak.is_some() { Wanted::EfficiencyShape } else { Wanted::Efficiency };
    let mut table = spectral_table(name, wanted, WIDEST_GAP_OF_QE_NM, folder)?;
    if let Some(peak) = peak {
        scaled_to(peak, &mut table).map_err(|e| e.at(name))?;
    }
    let outside = table.outside.unwrap_or(Outside::Zero);
    let letters: Vec<String> =
        cfa.channels().iter().map(|c| c.to_lowercase().to_string()).collect();
    let names = if cfa.is_mono() && table.curves.len() == 1 {
        return Ok((letters, vec![table.spectrum(0)?.from_table(name).outside(outside)]));
    } else if table.column("gr").is_some() && table.column("gb").is_some() {
        ["r", "gr", "gb", "b"].map(String::from).to_vec()
    } else {
        letters
    };
    let mut curves = Vec::new();
    for channel in &names {
        let colour = COLOURS.iter().find(|(letter, _)| letter == channel);
        let called = |called: &str| table.only_column(called).map_err(|e| e.at(name));
        let named = match (called(channel)?, colour) {
            (None, Some((_, colour))) => called(colour)?,
            (column, _) => column,
        };
        let column = named.ok_or_else(|| {
            let known: Vec<&str> = table.curves.iter().map(|(n, _)| n.as_str()).collect();
            Error::input(format!("no column {channel:?}")).at(name).help(format!(
                "the pattern needs columns wavelength_nm,{}; the table has {}",
                names.join(","),
                known.join(",")
            ))
        })?;
        let curve = table.spectrum(column)?.from_table(format!("{name}, column {channel:?},"));
        curves.push(curve.outside(outside));
    }
    Ok((names, curves))
}

/// A table of `field,ratio`, with field 0 at the axis and 1 at the sensor's corner.
fn field_table(name: &str, folder: &Folder<'_>) -> Result<Vec<(f64, f64)>> {
    let text = folder.read(name)?;
    let mut reader = csv_reader(&text);
    let mut table: Vec<(f64, f64)> = Vec::new();
    for line in reader.deserialize() {
        let (field, ratio): (f64, f64) = line.map_err(|e| {
            Error::input(format!("not a table of field,ratio: {e}"))
                .at(name)
                .help("two numbers in each line below the header field,ratio")
        })?;
        let rises = table.last().is_none_or(|&(before, _)| field > before);
        if !FIELD_TABLE.contains(&field) || !FIELD_TABLE.contains(&ratio) || !rises {
            return Err(Error::input(format!("field {field}, ratio {ratio}")).at(name).help(
                "fields rise from 0 (axis) to 1 (corner); ratios to the axis lie in 0 to 1.5",
            ));
        }
        table.push((field, ratio));
    }
    if table.len() < 2 {
        return Err(Error::input("fewer than two lines").at(name).help("give field,ratio lines"));
    }
    let (first, last) = (table[0].0, table[table.len() - 1].0);
    if first != 0.0 || last < 1.0 {
        return Err(Error::input(format!("the fields run from {first} to {last}"))
            .at(name)
            .help("give lines from 0 (axis) to 1 (corner): nothing is made up for the rest"));
    }
    Ok(table)
}

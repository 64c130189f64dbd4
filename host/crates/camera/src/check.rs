//! Checks the content of a camera file and converts it to values with units.

use super::effects::{AnyEffect, read_effect};
use super::empirical::{self, Empirical};
use super::file::{self, CameraFile, Direction, FallOff, Law};
use super::file::{LensFile, NoiseFile, SensorFile, TimingFile};
use super::hdr::{self, EffectOn};
use super::named_files::{FileName, FractionOrFile};
use super::prescription;
use super::{
    Camera, CrosstalkTable, Directions, FilterAngles, Folder, Gains, KeptNoise, LensKind,
    LensModel, Noise, RelativeIllumination, SensorModel, SensorTiming, csv_reader,
};
use camrig_base::alternatives::Alternatives;
use camrig_base::table::{SpectralTable, Wanted};
use camrig_base::toml_text::{line_of, place_of_key as place};
use camrig_base::{Cfa, Error, Outside, Result, Spectrum, mistakes};
use camrig_sensor_core::effects::{Effect, Entry};

/// Widest gap between wavelengths of a curve, nm: colour filters and infrared cut filters change
/// within 30 nm, so that a straight line over a wider gap would miss their edges.
const MAX_GAP_NM: f64 = 25.0;
/// Widest gap of a quantum efficiency, nm, of which a data sheet may give no more than a few
/// points; what is wider than [`MAX_GAP_NM`] is noted. Colour filters are about so wide: a line
/// over more could pass one by.
const MAX_QE_GAP_NM: f64 = 100.0;
/// Gap over the table's median step from which on lines are missing, where the gap is wider than
/// [`MAX_GAP_NM`]: points of a data sheet are more even than that.
const HOLE: f64 = 3.0;
/// The visible range that every curve must cover, nm: the bands of built-in scenes.
const VISIBLE_NM: [f64; 2] = [400.0, 700.0];
/// Range of fields and ratios in a table of relative illumination. Both are 1 at most by
/// definition; beyond the corner and for lenses that brighten off the axis there is some room.
const FIELD_TABLE: std::ops::RangeInclusive<f64> = 0.0..=1.5;
/// Default of `row_fpn_e` over `read_e` (Chen et al. 2009: half of the largest read noise, which
/// is that at unity gain).
const ROW_FPN_OVER_READ: f64 = 0.5;

/// The camera of a file, unless there are mistakes in it already or more are found here.
pub(super) fn camera(
    file: CameraFile,
    mut wrong: Vec<Error>,
    text: &str,
    default_name: &str,
    folder: &Folder<'_>,
) -> Result<Camera> {
    let mut keep = |e: Error| wrong.push(e);
    let lens = lens(file.lens, text, folder).map_err(&mut keep).ok().flatten();
    let effective_index = file.sensor.ir_cut_effective_index;
    let mut sensor = sensor(file.sensor, text, folder).map_err(&mut keep).ok();
    if let (Some(index), Some(lens), Some(sensor)) = (effective_index, &lens, &mut sensor) {
        let place = place(text, "sensor", "ir_cut_effective_index");
        match filter_angles(index, lens, sensor) {
            Ok(angles) => sensor.filter_angles = Some(angles),
            Err(e) => keep(e.at(place)),
        }
    }
    let mut effects = Vec::new();
    for table in &file.effects {
        let line = line_of(text, table.span().start);
        match listed(table.get_ref().clone(), sensor.as_ref(), folder) {
            Ok(effect) => effects.push(effect),
            Err(e) => keep(e.at(format!("[[effect]] at line {line}"))),
        }
    }
    let (Some(lens), Some(sensor), true) = (lens, sensor, wrong.is_empty()) else {
        return Err(mistakes::all(wrong));
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
            Listed::OfCaptures(effect) => {
                camera.sensor.hdr.iter_mut().for_each(|hdr| hdr.effects.push(effect.clone()));
            }
            Listed::Catalogued(AnyEffect::Sensor(effect)) => camera.effects.push(effect),
            Listed::Catalogued(AnyEffect::Optical(effect)) => camera.optical_effects.push(effect),
        }
    }
    camera.check_chain()?;
    hdr::check_chains(&camera)?;
    Ok(camera)
}

/// What an `[[effect]]` table is.
enum Listed {
    Catalogued(AnyEffect),
    Empirical(Empirical),
    /// One of some captures only.
    OfCaptures(EffectOn),
}

fn listed(
    mut table: toml::Table,
    sensor: Option<&SensorModel>,
    folder: &Folder<'_>,
) -> Result<Listed> {
    if let Some(sensor) = sensor {
        grow_as_dark_current(&mut table, &sensor.noise);
    }
    if let Some(names) = table.remove("on") {
        let hdr = sensor.and_then(|sensor| sensor.hdr.as_ref());
        return hdr::effect_on(hdr, &names, &read_effect(&table)?).map(Listed::OfCaptures);
    }
    let table = &table;
    if table.get("kind").and_then(toml::Value::as_str) == Some(empirical::KIND) {
        return Empirical::read(table, folder).map(Listed::Empirical);
    }
    read_effect(table).map(Listed::Catalogued)
}

/// What an effect grows with temperature by, unless its table says otherwise: as the dark current.
fn grow_as_dark_current(table: &mut toml::Table, noise: &Noise) {
    let kind = table.get("kind").and_then(toml::Value::as_str);
    let catalogued = Effect::CATALOGUE.iter().filter(|e| e.kind != empirical::KIND);
    let entry = catalogued.into_iter().find(|e| Some(e.kind) == kind);
    let law = [("doubling_c", noise.dark_doubling_c), ("reference_c", noise.temperature_ref_c)];
    let grows = |e: &&Entry| e.parameters.iter().any(|p| p.key == law[0].0);
    for parameter in entry.iter().copied().filter(grows).flat_map(|e| e.parameters) {
        if let Some((key, value)) = law.iter().find(|(key, _)| *key == parameter.key) {
            table.entry(*key).or_insert((*value).into());
        }
    }
}

/// The lens; `None` where a key is missing that its kind needs, which was found already.
fn lens(file: LensFile, text: &str, folder: &Folder<'_>) -> Result<Option<LensModel>> {
    let place = |key| place(text, "lens", key);
    let transmittance = match &file.transmittance {
        None => Spectrum::constant(1.0),
        Some(FractionOrFile::Number(t)) => Spectrum::constant(*t),
        Some(FractionOrFile::File(FileName(name))) => fraction_curve(name, Outside::Held, folder)
            .map_err(|e| e.at(place("transmittance")))?,
    };
    let kind = match file.kind {
        file::LensKind::Characterised => {
            let Some(FileName(name)) = &file.data else { return Ok(None) };
            LensKind::Characterised(folder.path(name))
        }
        file::LensKind::Prescription => {
            let Some(setup) = prescription::setup(&file, text, folder)? else { return Ok(None) };
            LensKind::Prescription(Box::new(setup))
        }
        file::LensKind::DiffractionLimited => {
            let (Some(f_number), Some(focal_length_mm)) = (file.f_number, file.focal_length_mm)
            else {
                return Ok(None);
            };
            LensKind::DiffractionLimited {
                f_number,
                focal_length_mm,
                magnification: file.magnification.unwrap_or(0.0).abs(),
                relative_illumination: match &file.relative_illumination {
                    None | Some(FallOff::Law(Law::Cos4)) => RelativeIllumination::Cos4,
                    Some(FallOff::Law(Law::None)) => RelativeIllumination::Flat,
                    Some(FallOff::File(FileName(name))) => RelativeIllumination::Table(
                        field_table(name, folder)
                            .map_err(|e| e.at(place("relative_illumination")))?,
                    ),
                },
            }
        }
    };
    Ok(Some(LensModel { kind, transmittance }))
}

fn sensor(file: SensorFile, text: &str, folder: &Folder<'_>) -> Result<SensorModel> {
    let place = |key| place(text, "sensor", key);
    let pattern = match &file.cfa {
        Alternatives::One(pattern) => pattern.clone(),
        // A row alone is the same as twice, but not as two halves.
        Alternatives::List(rows) if rows.len() == 1 => [&rows[..], rows].concat().join("/"),
        Alternatives::List(rows) => rows.join("/"),
        _ => String::new(),
    };
    let cfa = Cfa::parse(&pattern).map_err(|e| e.at(place("cfa")))?;
    if cfa.channels().len() > camrig_sensor_core::config::MAX_CHANNELS {
        return Err(Error::input(format!(
            "cfa = {pattern:?} has {} channels",
            cfa.channels().len()
        ))
        .at(place("cfa"))
        .help(format!("use at most {} letters", camrig_sensor_core::config::MAX_CHANNELS)));
    }
    let (channel_names, qe) = channels(&file, &cfa, text, folder)?;
    let ir_cut = match &file.ir_cut {
        Some(FileName(name)) => {
            Some(fraction_curve(name, Outside::Zero, folder).map_err(|e| e.at(place("ir_cut")))?)
        }
        None => None,
    };
    let crosstalk = match &file.crosstalk {
        Some(FileName(name)) => Some(
            folder
                .read(name)
                .and_then(|text| CrosstalkTable::parse(&text))
                .and_then(|table| table.for_channels(&channel_names))
                .map_err(|e| e.at(name).at(place("crosstalk")))?,
        ),
        None => None,
    };
    // Bits out of range are a mistake of their own.
    let top = f64::from((1u32 << file.bits.min(16)) - 1);
    if file.black_level_dn >= top {
        return Err(Error::input(format!("black_level_dn = {}", file.black_level_dn))
            .at(place("black_level_dn"))
            .help(format!("use 0 to {} DN: the converter ends at {top}", top - 1.0)));
    }
    let gains = file.gains.map(|gains| Gains::new(gains, top)).transpose();
    let gains = gains.map_err(|e| e.at("[sensor.gains]"))?;
    if gains.is_some() && file.hdr.is_some() {
        return Err(Error::input("[sensor.gains] beside [sensor.hdr]")
            .help("remove [sensor.gains]: each capture has its own gain and noise"));
    }
    Ok(SensorModel {
        width: file.width,
        height: file.height,
        pitch_um: file.pitch_um,
        fill_factor: file.fill_factor,
        cfa,
        channel_names,
        qe,
        ir_cut,
        filter_angles: None,
        crosstalk,
        conversion_gain_uv_per_e: file.conversion_gain_uv_per_e,
        full_well_e: file.full_well_e,
        full_scale_e: file.full_scale_e.unwrap_or(file.full_well_e),
        bits: file.bits,
        black_level_dn: file.black_level_dn,
        analog_gain: file.analog_gain,
        temperature_c: file.temperature_c,
        seed: file.seed,
        timing: file.timing.as_ref().map(|timing| sensor_timing(timing, file.height)),
        noise: noise(&file.noise, text)?,
        gains,
        hdr: file
            .hdr
            .as_ref()
            .map(|hdr| hdr::hdr(hdr, file.timing.as_ref(), folder))
            .transpose()?,
        streams: Default::default(),
        kept_noise: KeptNoise::default(),
    })
}

/// The angles of light on the filter of a sensor.
fn filter_angles(index: f64, lens: &LensModel, sensor: &SensorModel) -> Result<FilterAngles> {
    if sensor.ir_cut.is_none() {
        return Err(Error::input("ir_cut_effective_index without ir_cut")
            .help("give the filter's transmittance at normal incidence as ir_cut"));
    }
    if sensor.crosstalk.is_some() {
        return Err(Error::unsupported("ir_cut_effective_index beside a crosstalk table")
            .help("put the filter's shift into the table, or leave one of them out"));
    }
    let directions = match lens.kind {
        LensKind::DiffractionLimited { f_number, focal_length_mm, magnification, .. } => {
            let stretch = 1.0 + magnification;
            Directions::Cones {
                image_distance_mm: focal_length_mm * stretch,
                sin: (0.5 / (f_number * stretch)).min(1.0),
            }
        }
        LensKind::Prescription(_) => Directions::Untraced,
        LensKind::Characterised(_) => {
            return Err(Error::unsupported("ir_cut_effective_index behind a characterised lens")
                .help(
                    "use lens.kind = \"diffraction-limited\" or \"prescription\", whose angles of \
                     light are known",
                ));
        }
    };
    Ok(FilterAngles { effective_index: index, directions })
}

/// The channels' names and the quantum efficiency of each.
fn channels(
    file: &SensorFile,
    cfa: &Cfa,
    text: &str,
    folder: &Folder<'_>,
) -> Result<(Vec<String>, Vec<Spectrum>)> {
    let place = |key| place(text, "sensor", key);
    match &file.qe {
        FractionOrFile::Number(_) if file.qe_peak.is_some() => {
            Err(Error::input("qe_peak beside a number of qe")
                .at(place("qe_peak"))
                .help("remove one of them: qe_peak scales a table"))
        }
        FractionOrFile::Number(q) => {
            let names: Vec<String> =
                cfa.channels().iter().map(|c| c.to_lowercase().to_string()).collect();
            let curves = vec![Spectrum::constant(*q); names.len()];
            Ok((names, curves))
        }
        FractionOrFile::File(FileName(name)) => {
            quantum_efficiency(name, cfa, file.qe_peak, folder).map_err(|e| e.at(place("qe")))
        }
    }
}

fn sensor_timing(file: &TimingFile, rows: u32) -> SensorTiming {
    SensorTiming {
        line_time_us: file.line_time_us,
        frame_length_lines: file.frame_length_lines.unwrap_or(rows),
        shutter: file.shutter,
        upwards: file.direction == Direction::Up,
    }
}

fn noise(file: &NoiseFile, text: &str) -> Result<Noise> {
    // A read noise out of range, which is a mistake of its own, is no limit for its part.
    if file.read_e >= 0.0 && file.read_e_post > file.read_e {
        return Err(Error::input(format!("read_e_post = {}", file.read_e_post))
            .at(place(text, "sensor.noise", "read_e_post"))
            .help(format!("use 0 to {} e-, the whole", file.read_e)));
    }
    Ok(Noise {
        read_e: file.read_e,
        read_e_post: file.read_e_post,
        dark_current_e_per_s: file.dark_current_e_per_s,
        dark_doubling_c: file.dark_doubling_c,
        temperature_ref_c: file.temperature_ref_c,
        dsnu_e_per_s: file.dsnu_e_per_s,
        prnu: file.prnu,
        row_fpn_e: file.row_fpn_e.unwrap_or(ROW_FPN_OVER_READ * file.read_e),
    })
}

/// A curve of fractions over wavelength: a table of one column, and what it is outside the table
/// unless that states otherwise.
pub(crate) fn fraction_curve(
    name: &str,
    outside: Outside,
    folder: &Folder<'_>,
) -> Result<Spectrum> {
    let table = spectral_table(name, Wanted::Transmittance, MAX_GAP_NM, folder)?;
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
    let hole = (HOLE * steps.get(steps.len() / 2).unwrap_or(&0.0)).max(MAX_GAP_NM);
    let allowed = widest_nm.min(hole);
    if let Some(gap) = table.wavelength_nm.windows(2).find(|w| w[1] - w[0] > allowed) {
        return Err(Error::input(format!("no values between {} and {} nm", gap[0], gap[1]))
            .at(name)
            .help(format!("give a value at least every {allowed} nm")));
    }
    let widest = steps.last().copied().unwrap_or_default();
    if widest > MAX_GAP_NM {
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
/// that states otherwise. The table's columns are r,g,b or r,gr,gb,b for Bayer patterns, one column
/// for mono, else one column per letter of the pattern; none twice.
fn quantum_efficiency(
    name: &str,
    cfa: &Cfa,
    peak: Option<f64>,
    folder: &Folder<'_>,
) -> Result<(Vec<String>, Vec<Spectrum>)> {
    let wanted = if peak.is_some() { Wanted::EfficiencyShape } else { Wanted::Efficiency };
    let mut table = spectral_table(name, wanted, MAX_QE_GAP_NM, folder)?;
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

//! The draft of the camera file from what was measured.

use super::gains::{Law, Place, digital_above};
use super::noise::{MIN_SHARE, Noise, prnu, shared};
use super::response::Response;
use super::stacks::AtGain;
use super::{Options, Unity};
use camrig_base::numbers::counted;
use camrig_base::tails::misfit;
use camrig_base::{Bands, Result, Value};
use camrig_camera::draft::{Basis, Draft, Known, Request};
use camrig_camera::typical::rounded;
use camrig_camera::{Camera, Change};
use camrig_captures::CaptureSet;
use camrig_light::photometry::HC;
use std::path::Path;

/// Pitch that is written where nothing tells it, µm: the middle of machine vision's.
const PITCH_UM: f64 = 3.0;

/// Everything that was measured.
pub struct Found<'a> {
    pub set: &'a CaptureSet,
    pub gains: &'a [AtGain],
    /// Their analog gains.
    pub places: &'a [Place],
    /// Which of the gains have flats, as the gains of the response are numbered.
    pub lit: &'a [usize],
    pub response: Option<Response>,
    /// Wavelengths, for each of which the response has an efficiency of each site.
    pub wavelengths: Vec<Option<f64>>,
    pub unity: Option<Unity>,
    pub noise: Noise,
    /// DN per electron at each gain.
    pub per_gain: Vec<Value>,
}

/// Values for the draft, and what a person should know of them.
#[derive(Default)]
struct Values {
    known: Vec<Known>,
    notes: Vec<String>,
}

impl Values {
    fn measured(&mut self, key: &str, value: Value, frames: &str) {
        let change = Change::new(key, to_error(value));
        let mut basis = Basis::measured(value.std_error, frames);
        // What was chosen by other figures, such as a number of channels, has no error of its own.
        basis.std_error = basis.std_error.filter(|e| *e > 0.0);
        self.known.push(Known { change, basis });
    }

    fn unknown(&mut self, key: &str, value: f64, reason: &str) {
        let change = Change::new(key, value);
        self.known.push(Known { change, basis: Basis::typical(reason) });
    }
}

/// A value with two digits more than its error has places.
fn to_error(v: Value) -> f64 {
    let ratio = (v.value / v.std_error).abs();
    let digits =
        if ratio.is_finite() && ratio > 0.0 { libm::log10(ratio).floor() + 3.0 } else { 6.0 };
    rounded(v.value, digits.clamp(2.0, 10.0) as usize)
}

impl Found<'_> {
    /// The draft, with notes.
    pub fn draft(&self, options: &Options) -> Result<(Draft, Vec<String>)> {
        let mut values = Values::default();
        self.add_gain(&mut values);
        self.add_read_noise(&mut values);
        self.add_dark(&mut values);
        self.add_patterns(&mut values);
        self.add_sites(&mut values);
        self.add_table(&mut values);
        let mut given = self.given();
        if self.set.sensor.pitch_um.is_none() && options.like.is_none() {
            let reason = "unknown: no noise depends on it, but amounts of light per area do";
            values.unknown("sensor.pitch_um", PITCH_UM, reason);
        }
        given.extend(options.given.iter().cloned());
        let name = match options.name.is_empty() {
            true => self.set.name(),
            false => options.name.clone(),
        };
        let request = Request {
            name,
            like: options.like.clone(),
            given,
            known: values.known,
            ..Request::default()
        };
        let mut draft = self.with_efficiency(request, &mut values.notes)?;
        draft.about = format!(
            "Fitted to {} of {}. {}",
            counted(self.frames(), "frame"),
            self.set.name(),
            draft.about
        );
        Ok((draft, values.notes))
    }

    /// What the manifest states.
    fn given(&self) -> Vec<Change> {
        let sensor = &self.set.sensor;
        let mut given = vec![
            Change::new("sensor.width", sensor.width as i64),
            Change::new("sensor.height", sensor.height as i64),
            Change::new("sensor.bits", i64::from(sensor.bits)),
            Change::new("sensor.cfa", self.set.cfa().to_string()),
        ];
        given.extend(sensor.pitch_um.map(|pitch| Change::new("sensor.pitch_um", pitch)));
        let temperatures: Vec<f64> =
            self.set.captures.iter().filter_map(|c| c.temperature_c).collect();
        if !temperatures.is_empty() {
            let mean = temperatures.iter().sum::<f64>() / temperatures.len() as f64;
            let mean = rounded(mean, 4);
            given.push(Change::new("sensor.temperature_c", mean));
            given.push(Change::new("sensor.noise.temperature_ref_c", mean));
        }
        given
    }

    fn frames(&self) -> usize {
        self.gains.iter().map(|g| g.frames[0] + g.frames[1]).sum()
    }

    /// What a figure was measured on: frames of darks, or of flats too, at some gains.
    fn of(&self, flats: bool, which: &[usize]) -> String {
        let frames = |g: &AtGain| g.frames[0] + if flats { g.frames[1] } else { 0 };
        let count: usize = which.iter().map(|i| frames(&self.gains[*i])).sum();
        let gains: Vec<String> = which.iter().map(|i| self.gains[*i].gain.to_string()).collect();
        let gains = match &gains[..] {
            [first, .., last] if gains.len() > 3 => format!("gains {first} to {last}"),
            [one] => format!("gain {one}"),
            _ => format!("gains {}", gains.join(", ")),
        };
        let kind = if flats { "frame" } else { "dark frame" };
        format!("{}, {gains}", counted(count, kind))
    }

    fn all(&self) -> Vec<usize> {
        (0..self.gains.len()).collect()
    }

    /// Full well and response.
    fn add_gain(&self, values: &mut Values) {
        let top = f64::from((1u32 << self.set.sensor.bits) - 1);
        let Some((response, unity)) = self.response.as_ref().zip(self.unity.as_ref()) else {
            let k = self.per_gain[0].value / self.gains[0].gain;
            let reason = "from the gain that was given: darks alone tell none";
            values.unknown("sensor.full_well_e", rounded(top / k, 6), reason);
            return;
        };
        let frames = self.of(true, self.lit);
        if self.gains.iter().any(|g| !g.scenes.is_empty()) {
            values.notes.push(
                "no flats: the gain is that of areas of a scene, by their noise over their level; \
                 nothing may have moved in it. PRNU and quantum efficiency are not known from it"
                    .into(),
            );
        }
        let k = unity.dn_per_e;
        let full = Value::new(top / k.value, top / k.value * k.std_error / k.value);
        values.measured("sensor.full_well_e", full, &frames);
        if let Some(misfit) = unity.misfit {
            values.notes.push(format!(
                "DN per electron are not in proportion to the stated gains (chi2 per degree of \
                 freedom {misfit:.0}): [sensor.gains] has those measured"
            ));
        }
        if let Some(bend) = response.bend {
            values.measured("effect.nonlinearity.loss", bend.loss, &frames);
            let (key, error) = ("effect.nonlinearity.exponent", response.exponent_step());
            values.measured(key, Value::new(bend.exponent, error), &frames);
        }
        if response.light_error > 0.0 {
            values.notes.push(format!(
                "the means of the flats scatter by {:.2} % about any response: that much is the \
                 stated light in error, and the gain rests on the variances",
                100.0 * response.light_error
            ));
        }
        let freedom = response.data as f64 - self.lit.len() as f64;
        if misfit(response.chi2, freedom).is_some() {
            values.notes.push(format!(
                "the variances of the flats are on no curve of gain and response (chi2 {:.0} of \
                 {freedom:.0}): the errors of the gain are widened by that",
                response.chi2
            ));
        }
    }

    fn add_read_noise(&self, values: &mut Values) {
        let frames = self.of(false, &self.all());
        let first = self.noise.read[0];
        let gain = self.gains[0].gain;
        let (read, post) = ("sensor.noise.read_e", "sensor.noise.read_e_post");
        match &self.noise.law {
            Some(law) => {
                let at_unity = law.at_unity().unwrap_or(first);
                values.measured(read, at_unity, &frames);
                let behind = law.post().unwrap_or(Value::new(0.0, at_unity.std_error));
                let behind = Value::new(behind.value.min(at_unity.value), behind.std_error);
                values.measured(post, behind, &frames);
                if let Some(step) = &law.step {
                    values.notes.push(format!(
                        "the conversion gain has a step between the gains {} and {}: \
                         [sensor.gains] puts it at the latter",
                        self.places[step.first - 1].analog,
                        self.places[step.first].analog
                    ));
                }
            }
            None => {
                values.measured(read, first, &self.of(false, &self.places[0].of));
                if self.places.len() > 1 {
                    values.notes.push(
                        "the read noise over the gains is no law of a part before and a part \
                         after the gain stage, with or without a step: [sensor.gains] has that of \
                         each gain"
                            .into(),
                    );
                }
                if self.places.len() > 1 || gain != 1.0 {
                    let reason = "unknown: several gains on one law tell it; with 0, read_e holds \
                                  at the gain of these captures";
                    values.unknown(post, 0.0, reason);
                }
            }
        }
        let black = self.noise.black[0];
        values.measured("sensor.black_level_dn", black, &self.of(false, &self.places[0].of));
        if gain != 1.0 {
            values.unknown("sensor.analog_gain", gain, "the lowest of the captures");
        }
    }

    fn add_dark(&self, values: &mut Values) {
        let (rate, spread) = ("sensor.noise.dark_current_e_per_s", "sensor.noise.dsnu_e_per_s");
        let Some(dark) = &self.noise.dark else {
            let reason = "unknown: darks of a second, longer exposure tell it; 0 keeps the levels \
                          of these captures";
            values.unknown(rate, 0.0, reason);
            values.unknown(spread, 0.0, reason);
            return;
        };
        let frames = self.of(false, &dark.gains);
        values.measured(rate, dark.rate, &frames);
        values.measured(
            spread,
            dark.spread.unwrap_or(Value::new(0.0, dark.rate.std_error)),
            &frames,
        );
        if let Some([fraction, mean]) = dark.hot {
            values.measured("effect.hot-pixels.fraction", fraction, &frames);
            values.measured("effect.hot-pixels.mean_e_per_s", mean, &frames);
        }
        let doubling = self.gains.iter().filter_map(|g| g.ptc.as_ref()?.figures.dark_doubling_c);
        if let Some(doubling) = doubling.min_by(|a, b| a.std_error.total_cmp(&b.std_error)) {
            values.measured("sensor.noise.dark_doubling_c", doubling, &frames);
        }
        if self.set.captures.iter().all(|c| c.temperature_c.is_none()) {
            values.notes.push(
                "no capture states its temperature: the dark current is that at theirs, written \
                 as if at 25 °C"
                    .into(),
            );
        }
    }

    fn add_patterns(&self, values: &mut Values) {
        let frames = self.of(false, &self.all());
        if let Some(rows) = self.noise.rows {
            values.measured("sensor.noise.row_fpn_e", rows, &frames);
        }
        let spread = self.noise.dark.as_ref().and_then(|d| d.spread).map_or(0.0, |s| s.value);
        let own = self.response.as_ref().and_then(|r| prnu(self.gains, r, self.lit, spread));
        if let Some((prnu, first)) = own.zip(self.lit.first()) {
            let flats = self.of(true, &[*first]);
            let shared = shared(&prnu);
            let alone = if shared.is_some() { prnu.own() } else { prnu.variance };
            let alone = alone.sqrt().unwrap_or(Value::new(0.0, alone.std_error.sqrt()));
            values.measured("sensor.noise.prnu", alone, &flats);
            if let Some(shared) = shared.and_then(Value::sqrt) {
                values.measured("effect.prnu-correlated.sigma", shared, &flats);
            }
        }
        for effect in &self.noise.effects {
            let which = if effect.misfit.is_some() { vec![0] } else { self.all() };
            for (key, value) in &effect.parameters {
                let key = format!("effect.{}.{key}", effect.kind);
                values.measured(&key, *value, &self.of(false, &which));
            }
            if let Some(misfit) = effect.misfit {
                values.notes.push(format!(
                    "{} is not the same in electrons at all gains (chi2 per degree of freedom \
                     {misfit:.0}): that of gain {} is written",
                    effect.kind, self.gains[0].gain
                ));
            }
        }
    }

    /// `[sensor.gains]`, with the columns that no law gives.
    fn add_table(&self, values: &mut Values) {
        let apart = self.unity.as_ref().is_some_and(|u| u.misfit.is_some());
        let blacks = differ(&self.noise.black);
        let many = self.places.len() > 1;
        let steps = self.noise.law.as_ref().and_then(|law: &Law| law.table(self.places));
        let of_places = || self.places.iter().map(|p| p.analog).collect();
        let digital = digital_above(self.gains);
        let (at, read) = match steps {
            Some((at, read)) => (at, Some(read)),
            None if many && self.noise.law.is_none() => {
                (of_places(), Some(self.noise.read.clone()))
            }
            None => (of_places(), None),
        };
        if read.is_none() && !(many && (apart || blacks)) && digital.is_none() {
            return;
        }
        let mut column = |key: &str, numbers: camrig_camera::Value, basis: Basis| {
            let change = Change::new(format!("sensor.gains.{key}"), numbers);
            values.known.push(Known { change, basis });
        };
        // A column has a number for each gain of `at`, where one may stand twice.
        let frames = self.of(true, &self.all());
        let place = |gain: &f64| self.places.iter().position(|p| p.analog == *gain).unwrap_or(0);
        let spread = |of: &dyn Fn(usize) -> Value| at.iter().map(|g| of(place(g))).collect();
        let analog = |i: usize| {
            let of_gain = |i: usize| self.per_gain[i].scaled(self.gains[i].digital.recip());
            let each: Vec<Value> = (0..self.gains.len()).map(of_gain).collect();
            self.places[i].mean(&each)
        };
        let per_e: Option<Vec<Value>> = (many && apart).then(|| spread(&analog));
        let black: Option<Vec<Value>> = (many && blacks).then(|| spread(&|i| self.noise.black[i]));
        column("at", at.clone().into(), Basis::given("the gains of these captures"));
        let columns = [("read_e", read), ("dn_per_e", per_e), ("black_level_dn", black)];
        for (key, values) in columns.into_iter().filter_map(|(key, v)| Some((key, v?))) {
            let worst = values.iter().map(|v| v.std_error).fold(0.0, f64::max);
            let numbers: Vec<f64> = values.into_iter().map(to_error).collect();
            column(key, numbers.into(), Basis::measured(worst, &frames));
        }
        if let Some(above) = digital {
            column(
                "digital_above",
                rounded(above, 7).into(),
                Basis::measured(0.0, "codes at larger gains"),
            );
        }
    }

    /// Black levels of the places of 2 x 2 pixels about their mean, where they differ by more than
    /// their errors and more than a small share of the noise.
    fn add_sites(&self, values: &mut Values) {
        let bias = &self.gains[0].found.bias;
        let sites = &bias.black_by_site;
        let read_dn = bias.read_noise_variance.value.max(0.0).sqrt();
        let mean = sites.iter().map(|s| s.value).sum::<f64>() / sites.len() as f64;
        let most = sites.iter().map(|s| (s.value - mean).abs()).fold(0.0, f64::max);
        let cfa = self.set.cfa();
        if (cfa.width, cfa.height) != (2, 2) || !differ(sites) || most < MIN_SHARE * read_dn {
            return;
        }
        let frames = self.of(false, &[0]);
        for (i, site) in sites.iter().enumerate() {
            let key = format!("effect.black-level-offset.plane_{i}_dn");
            values.measured(&key, Value::new(site.value - mean, site.std_error), &frames);
        }
    }

    /// The draft whose efficiency is that measured, in the shape of a known curve.
    fn with_efficiency(&self, request: Request, notes: &mut Vec<String>) -> Result<Draft> {
        let draft = Draft::of(&request)?;
        let chosen = request.given.iter().any(|c| c.key.starts_with("sensor.qe"));
        let measured = self.efficiencies();
        if measured.is_empty() || chosen {
            if !chosen {
                notes.push(
                    "no light is stated in photons or W/m² at a wavelength, so the quantum \
                     efficiency is typical: exposures depend on it, noise does not"
                        .into(),
                );
            }
            return Ok(draft);
        }
        let camera = draft.camera(Path::new(""))?;
        let ratios = self.over_predicted(&camera, &measured);
        let points = ratios.iter().map(|r| {
            let own = rounded(r.ratio * camera.sensor.qe[r.channel].at(r.nm), 5);
            match camera.sensor.cfa.is_mono() {
                true => format!("{}:{own}", r.nm),
                false => format!("{}:{}:{own}", r.letter, r.nm),
            }
        });
        let through = Request { efficiency: points.collect(), ..request.clone() };
        if let Ok(draft) = Draft::of(&through) {
            return Ok(draft);
        }
        let peak = peak(&camera, &ratios);
        let told = peak.map_or(String::new(), |p| {
            format!(": the curve is scaled so that the strongest is right, to a peak of {p:.3}")
        });
        notes.push(format!(
            "the quantum efficiencies measured are on no usual curve of this filter pattern{told}"
        ));
        let Some(peak) = peak else { return Ok(draft) };
        let mut request = request;
        let change = Change::new("sensor.qe_peak", rounded(peak, 5));
        let basis = Basis::typical("from the strongest channel of the flats");
        request.known.push(Known { change, basis });
        Draft::of(&request)
    }

    /// Efficiency of each channel and wavelength: letter, nm, electrons per photon.
    fn efficiencies(&self) -> Vec<(char, f64, Value)> {
        let Some(response) = &self.response else { return Vec::new() };
        let cfa = self.set.cfa();
        let sites = cfa.width * cfa.height;
        let mut found = Vec::new();
        for (w, nm) in self.wavelengths.iter().enumerate() {
            let Some(nm) = nm else { continue };
            for letter in cfa.channels() {
                let of = |site: &usize| cfa.letters[*site] == letter;
                let own = (0..sites).filter(of);
                let own = own.filter_map(|s| response.efficiency.get(w * sites + s).copied());
                let value = Value::combine(own);
                found.extend(value.map(|v| (letter.to_ascii_lowercase(), *nm, v)));
            }
        }
        found
    }

    /// Measured efficiencies over those of a camera in the same light.
    fn over_predicted(&self, camera: &Camera, measured: &[(char, f64, Value)]) -> Vec<Efficiency> {
        let sensor = &camera.sensor;
        let lights = || self.set.captures.iter().filter_map(|c| c.light.as_ref());
        let of = |&(letter, nm, q): &(char, f64, Value)| {
            let channel = sensor.channel_names.iter().position(|name| name.starts_with(letter));
            // A sensor without filters has one channel, whatever its name.
            let channel = if sensor.cfa.is_mono() { 0 } else { channel? };
            let width = lights().find(|l| l.wavelength_nm == Some(nm)).and_then(|l| l.width_nm);
            let band = Bands { start_nm: nm, step_nm: width.unwrap_or(1.0), count: 1 };
            let electrons = sensor.response(&band)[channel][0] / band.step_nm;
            let photons = (sensor.pitch_um * 1e-6).powi(2) * nm * 1e-9 / HC;
            Some(Efficiency { letter, channel, nm, ratio: q.value * photons / electrons })
        };
        measured.iter().filter_map(of).collect()
    }
}

/// A measured efficiency over that of a camera.
struct Efficiency {
    letter: char,
    channel: usize,
    nm: f64,
    ratio: f64,
}

/// Peak of the camera's curves with which the channel that sees most has its measured efficiency.
fn peak(camera: &Camera, ratios: &[Efficiency]) -> Option<f64> {
    let curves = &camera.sensor.qe;
    let seen = |r: &Efficiency| r.ratio * curves[r.channel].at(r.nm);
    let strongest = ratios.iter().max_by(|a, b| seen(a).total_cmp(&seen(b)))?;
    let samples = curves.iter().flat_map(|curve| curve.samples());
    let peak = strongest.ratio * samples.fold(0.0f64, |most, (_, v)| most.max(v));
    (peak > 0.0 && peak <= 1.0).then_some(peak)
}

/// Whether values differ by more than their errors.
fn differ(values: &[Value]) -> bool {
    let Some(mean) = Value::combine(values.iter().copied()) else { return false };
    let chi2: f64 = values.iter().map(|v| ((v.value - mean.value) / v.std_error).powi(2)).sum();
    misfit(chi2, values.len() as f64 - 1.0).is_some()
}

//! What the user adds to a cube's file: a sidecar next to it (`cube.toml` for `cube.npy`), or the
//! same keys as options of its name (`cube.npy:quantity=radiance,scale=0.01`), which take
//! precedence. A key is optional where the file itself has its value:
//! ```toml
//! quantity = "reflectance"     # or "radiance", W m⁻² sr⁻¹ nm⁻¹
//! wavelength_nm = [400, 410]   # band centres, or start_nm and step_nm
//! start_nm = 400
//! step_nm = 10
//! axes = "yxb"                 # order of rows, columns, bands in an array
//! unit = "W/m2/sr/um"          # of the samples, in place of quantity and scale
//! scale = 1.0                  # multiplies the samples
//! array = "cube"               # name of the array in a file of several; of an EXR's layer or part
//! negative = "zero"            # takes samples below zero as 0, however far below
//! beyond = "dark"              # outside its bands; "hold" keeps a reflectance's end values
//! ```

use super::cube::{BandSource, Cube};
use super::selection::Stated;
use super::{Beyond, Quantity};
use camrig_base::numbers::counted;
use camrig_base::unit::Unit;
use camrig_base::{Error, Result, options};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The content of a sidecar.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sidecar {
    #[serde(default, deserialize_with = "quantity")]
    pub quantity: Option<Quantity>,
    wavelength_nm: Option<Vec<f64>>,
    start_nm: Option<f64>,
    step_nm: Option<f64>,
    pub axes: Option<String>,
    pub scale: Option<f32>,
    unit: Option<String>,
    pub array: Option<String>,
    negative: Option<Negative>,
    #[serde(default, deserialize_with = "beyond")]
    beyond: Beyond,
    /// The file, where there is one.
    #[serde(skip)]
    file: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Negative {
    Zero,
}

/// What a scene is beyond its bands, by name.
pub(super) fn beyond<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Beyond, D::Error> {
    let name = String::deserialize(from)?;
    Beyond::parse(&name).ok_or_else(|| {
        serde::de::Error::custom(format!("beyond {name:?} is not {}", Beyond::NAMES.join(" or ")))
    })
}

fn quantity<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<Quantity>, D::Error> {
    let name = String::deserialize(from)?;
    Quantity::parse(&name).map(Some).ok_or_else(|| {
        serde::de::Error::custom(format!("quantity {name:?} is not reflectance or radiance"))
    })
}

impl Sidecar {
    /// The sidecar of `path`, if there is one, with `options` (`KEY=VALUE,...`) taking precedence.
    pub fn read(path: &Path, options: &str) -> Result<Self> {
        let file = path.with_extension("toml");
        let there = file.exists();
        let said: Self = options::read(
            there.then_some(&*file),
            options,
            "the keys are quantity, wavelength_nm, start_nm, step_nm, axes, unit, scale, array, \
             negative (which is \"zero\") and beyond (\"dark\" or \"hold\")",
        )
        .and_then(Self::with_unit)
        .map_err(|e| if there { e } else { e.at(path.display()) })?;
        Ok(Self { file: there.then_some(file), ..said })
    }

    /// What the unit says of quantity and scale.
    fn with_unit(self) -> Result<Self> {
        let Some(unit) = &self.unit else { return Ok(self) };
        let parsed = Unit::parse(unit)?;
        let (quantity, factor) = match parsed.radiance() {
            Some(factor) => (Quantity::Radiance, factor),
            None if parsed.is_dimensionless() => (Quantity::Reflectance, parsed.factor()),
            None => {
                return Err(Error::input(format!("the unit {unit:?} of a scene"))
                    .help("a scene is radiance, such as W/m2/sr/um, or reflectance: 1 or %"));
            }
        };
        if self.scale.is_some() || self.quantity.is_some_and(|said| said != quantity) {
            return Err(Error::input(format!("the unit {unit:?} beside quantity or scale"))
                .help("give the unit alone: it says both"));
        }
        Ok(Self { quantity: Some(quantity), scale: Some(factor as f32), ..self })
    }

    /// Whether the user says what stored samples are multiplied by, whatever the file says.
    pub fn scales_samples(&self) -> bool {
        self.scale.is_some() && self.unit.is_none()
    }

    /// Refuses keys that mean nothing for `what`.
    pub fn without(&self, keys: &[&str], what: &str) -> Result<()> {
        let given = [("axes", self.axes.is_some()), ("array", self.array.is_some())];
        match given.into_iter().find(|(key, given)| *given && keys.contains(key)) {
            None => Ok(()),
            Some((key, _)) => Err(Error::input(format!("the key {key} means nothing for {what}"))
                .help("leave it out")),
        }
    }

    /// The cube of `source`, of which the file says `own`; what the user says takes precedence.
    ///
    /// # Errors
    /// Wavelengths that are not known; those of [`Cube::stated`].
    pub fn cube(&self, source: Box<dyn BandSource>, own: Own) -> Result<Cube> {
        let Own { nm, usual, quantity, mut stated, other_wavelengths, mut understood, mut notes } =
            own;
        stated.scale = stated.scale.or(self.scale);
        let bands = source.bands();
        let (width, height) = source.size();
        let given = self.given(bands).is_some();
        let (nm, assumed) = self.wavelengths(bands, nm, usual)?;
        if let (Some(_), Some(name)) = (&assumed, other_wavelengths) {
            return Err(Error::input(format!(
                "the wavelengths of the {bands} bands are not known: {name:?}, which may state \
                 them, is not understood"
            ))
            .help("give wavelength_nm, or start_nm and step_nm"));
        }
        notes.extend(assumed);
        notes.extend(
            self.file
                .iter()
                .map(|file| format!("{} lies beside it and says how it is read", file.display())),
        );
        let (least, most) =
            nm.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &nm| (a.min(nm), b.max(nm)));
        understood.push(format!(
            "{width} x {height} pixels, {}, {least} to {most} nm{}",
            counted(bands, "band"),
            if given { " as the sidecar or options say" } else { "" }
        ));
        if let Some(scale) = self.scale {
            understood.push(format!("samples times {scale}, as asked for"));
        }
        if self.quantity.or(quantity).is_none() {
            understood.push("reflectance, as nothing says otherwise".into());
        }
        let quantity = self.quantity.or(quantity).unwrap_or(Quantity::Reflectance);
        let cube = Cube::stated(source, &nm, quantity, stated)?.with_beyond(self.beyond)?;
        Ok(cube.with(self.negative.is_some(), understood, notes))
    }

    /// The wavelengths of the bands, nm: the user's, else the file's own, else those usual for
    /// such files; and what is assumed of them.
    pub fn wavelengths(
        &self,
        bands: usize,
        own: Option<Vec<f64>>,
        usual: Option<(f64, String)>,
    ) -> Result<(Vec<f64>, Option<String>)> {
        if bands > MAX_BANDS {
            return Err(Error::limit(format!("a cube of {bands} bands"))
                .help(format!("at most {MAX_BANDS} are read; is the order of axes right?")));
        }
        if let Some(given) = self.given(bands) {
            return Ok((given?, None));
        }
        if let Some(own) = own {
            return Ok((own, None));
        }
        let (start, of) = match usual {
            Some(usual) => usual,
            None if bands == 31 => (400.0, "as is usual for 31 bands".to_string()),
            None => return Err(unknown(bands)),
        };
        let list = regular(start, USUAL_STEP_NM, bands);
        let end = list.last().copied().unwrap_or(start);
        let note = format!(
            "nothing gives the wavelengths of the {bands} bands: {start} to {end} nm is assumed, \
             {of} (start_nm={start},step_nm={USUAL_STEP_NM} says so)"
        );
        Ok((list, Some(note)))
    }

    /// The wavelengths that the user gives, nm.
    pub fn given(&self, bands: usize) -> Option<Result<Vec<f64>>> {
        match (&self.wavelength_nm, self.start_nm, self.step_nm) {
            (None, None, None) => None,
            (Some(list), None, None) => Some(Ok(list.clone())),
            (None, Some(start), Some(step)) => Some(Ok(regular(start, step, bands))),
            _ => Some(Err(unknown(bands))),
        }
    }
}

/// What a file says of its cube.
#[derive(Default)]
pub(super) struct Own {
    /// Centres of the bands, nm.
    pub nm: Option<Vec<f64>>,
    /// Where files of this kind usually begin, nm, in steps of 10 nm, and whose they are; for
    /// files that do not say.
    pub usual: Option<(f64, String)>,
    /// What may state wavelengths and is not understood: then none are assumed.
    pub other_wavelengths: Option<String>,
    /// What the samples are.
    pub quantity: Option<Quantity>,
    /// What is said of the bands; their scale, where it is not the user's.
    pub stated: Stated,
    /// What was understood, for `scene info`.
    pub understood: Vec<String>,
    /// What was assumed or ignored.
    pub notes: Vec<String>,
}

/// Most bands of a cube: far more than any spectrometer has.
const MAX_BANDS: usize = 1 << 16;
/// Step of the bands of the public sets of scenes, nm.
const USUAL_STEP_NM: f64 = 10.0;

fn regular(start: f64, step: f64, bands: usize) -> Vec<f64> {
    (0..bands).map(|b| start + step * b as f64).collect()
}

fn unknown(bands: usize) -> Error {
    Error::input(format!("the wavelengths of the {bands} bands are not known"))
        .help("give wavelength_nm, or start_nm and step_nm, in the sidecar .toml")
}

//! Bands of a source in order of wavelength, without those that cannot be used, and each in the
//! unit that its file states by a gain and an offset.

use super::band_source::BandSource;
use camrig_base::numbers::counted;
use camrig_base::{Error, Plane, Result};

/// What a file says of its bands beside their samples: the value is `(gain * sample + offset) *
/// scale`.
#[derive(Default)]
pub struct Stated {
    /// Gain per band (ENVI `data gain values`).
    pub gain: Option<Vec<f64>>,
    /// Offset per band (ENVI `data offset values`).
    pub offset: Option<Vec<f64>>,
    /// Scale of all bands: the unit of `gain * sample + offset` in that of the scene.
    pub scale: Option<f32>,
    /// Whether a band is good (ENVI `bbl`).
    pub good: Option<Vec<bool>>,
    /// The sample that stands for no data (ENVI `data ignore value`).
    pub ignored: Option<f32>,
}

/// Some bands of a source, in another order and unit.
struct Selection {
    source: Box<dyn BandSource>,
    bands: Vec<Chosen>,
    scale: f32,
    ignored: Option<f32>,
}

struct Chosen {
    stored: usize,
    gain: f64,
    offset: f64,
}

impl BandSource for Selection {
    fn size(&self) -> (usize, usize) {
        self.source.size()
    }

    fn bands(&self) -> usize {
        self.bands.len()
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let Chosen { stored, gain, offset } = self.bands[band];
        let offset = offset * f64::from(self.scale);
        let mut plane = self.source.read(stored)?;
        for sample in &mut plane.data {
            *sample = match self.ignored {
                Some(no) if *sample == no || sample.is_nan() && no.is_nan() => 0.0,
                _ => (gain * f64::from(*sample * self.scale) + offset) as f32,
            };
        }
        Ok(plane)
    }
}

/// A source with its wavelengths, and what to tell the user of them.
pub struct Arranged {
    /// The source, bands in order of wavelength.
    pub source: Box<dyn BandSource>,
    /// Centres of its bands, nm, strictly rising.
    pub wavelength_nm: Vec<f64>,
    /// Bands that were left out, samples without data.
    pub notes: Vec<String>,
}

/// Applies what the file states, leaves out bad bands, those outside `usable_nm` where others lie
/// within, and repeated wavelengths, and orders the rest: descending lists and spectrometers that
/// overlap are usual.
///
/// # Errors
/// Lists that are not one per band; wavelengths that are not finite; no band left.
pub fn arrange(
    source: Box<dyn BandSource>,
    wavelength_nm: &[f64],
    stated: Stated,
    usable_nm: std::ops::RangeInclusive<f64>,
) -> Result<Arranged> {
    let count = source.bands();
    let per_band = |what: &str, found: usize| {
        if found == count {
            return Ok(());
        }
        Err(Error::input(format!("{found} {what} for {count} bands"))
            .help("the list has one entry per band"))
    };
    per_band("wavelengths", wavelength_nm.len())?;
    for (what, list) in [("gains", &stated.gain), ("offsets", &stated.offset)] {
        list.as_ref().map_or(Ok(()), |list| per_band(what, list.len()))?;
    }
    stated.good.as_ref().map_or(Ok(()), |good| per_band("marks of bad bands", good.len()))?;
    if let Some(nm) = wavelength_nm.iter().find(|nm| !nm.is_finite()) {
        return Err(Error::input(format!("wavelength {nm}")).help("wavelengths are numbers in nm"));
    }

    let (mut kept, mut bad, mut outside) = (Vec::new(), Vec::new(), Vec::new());
    for (band, nm) in wavelength_nm.iter().enumerate() {
        match &stated.good {
            Some(good) if !good[band] => bad.push(*nm),
            _ if !usable_nm.contains(nm) => outside.push(*nm),
            _ => kept.push(band),
        }
    }
    if kept.is_empty() {
        let (first, last) = (wavelength_nm[0], wavelength_nm[count - 1]);
        return Err(Error::input(format!("no usable band from {first} to {last} nm")).help(
            format!(
                "wavelengths are in nanometres, {} to {}, and not all bands bad",
                usable_nm.start(),
                usable_nm.end()
            ),
        ));
    }
    kept.sort_by(|&a, &b| wavelength_nm[a].total_cmp(&wavelength_nm[b]));
    let all = kept.len();
    kept.dedup_by(|b, a| wavelength_nm[*b] == wavelength_nm[*a]);

    let mut notes = Vec::new();
    let mut left_out = |list: &[f64], why: &str| {
        if !list.is_empty() {
            let list: Vec<String> = list.iter().map(f64::to_string).collect();
            notes.push(format!("left out, as {why}: the bands at {} nm", list.join(", ")));
        }
    };
    left_out(&bad, "the file marks them as bad (bbl)");
    left_out(
        &outside,
        &format!("they lie outside {} to {} nm", usable_nm.start(), usable_nm.end()),
    );
    if kept.len() < all {
        let more = counted(all - kept.len(), "band");
        notes.push(format!("left out: {more} of the wavelength of another"));
    }
    if let Some(value) = stated.ignored {
        notes.push(format!("samples of {value} (no data) are taken as black"));
    }
    let of = |list: &Option<Vec<f64>>, band: usize, missing| {
        list.as_ref().map_or(missing, |list| list[band])
    };
    let bands = kept.iter().map(|&stored| Chosen {
        stored,
        gain: of(&stated.gain, stored, 1.0),
        offset: of(&stated.offset, stored, 0.0),
    });
    let bands: Vec<Chosen> = bands.collect();
    let wavelength_nm = kept.iter().map(|&band| wavelength_nm[band]).collect();
    let scale = stated.scale.unwrap_or(1.0);
    let as_stored = kept.iter().copied().eq(0..count)
        && stated.gain.is_none()
        && stated.offset.is_none()
        && scale == 1.0
        && stated.ignored.is_none();
    let source: Box<dyn BandSource> = if as_stored {
        source
    } else {
        Box::new(Selection { source, bands, scale, ignored: stated.ignored })
    };
    Ok(Arranged { source, wavelength_nm, notes })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One pixel whose sample is the number of the band.
    struct Numbers(usize);

    impl BandSource for Numbers {
        fn size(&self) -> (usize, usize) {
            (1, 1)
        }

        fn bands(&self) -> usize {
            self.0
        }

        fn read(&self, band: usize) -> Result<Plane<f32>> {
            Ok(Plane::filled(1, 1, band as f32))
        }
    }

    fn arranged(nm: &[f64], stated: Stated) -> Result<Arranged> {
        arrange(Box::new(Numbers(nm.len())), nm, stated, 200.0..=2500.0)
    }

    fn values(arranged: &Arranged) -> Vec<f32> {
        (0..arranged.source.bands()).map(|b| arranged.source.read(b).unwrap().data[0]).collect()
    }

    #[test]
    fn bands_are_ordered_and_those_of_no_use_left_out() {
        let stated =
            Stated { good: Some(vec![true, false, true, true, true]), ..Stated::default() };
        let found = arranged(&[2600.0, 520.0, 530.0, 400.0, 530.0], stated).unwrap();
        assert_eq!(found.wavelength_nm, [400.0, 530.0]);
        assert_eq!(values(&found), [3.0, 2.0]);
        let notes = found.notes.join("\n");
        for part in
            ["bad (bbl): the bands at 520 nm", "2500 nm: the bands at 2600", "left out: 1 band of"]
        {
            assert!(notes.contains(part), "{notes}");
        }
    }

    #[test]
    fn gains_offsets_and_samples_without_data() {
        let stated = Stated {
            gain: Some(vec![2.0, 0.5, 1.0]),
            offset: Some(vec![0.25, 0.0, 1.0]),
            ignored: Some(2.0),
            scale: Some(4.0),
            ..Stated::default()
        };
        let found = arranged(&[600.0, 500.0, 400.0], stated).unwrap();
        assert_eq!(values(&found), [0.0, 2.0, 1.0]);
        assert!(found.notes[0].contains("samples of 2 (no data)"), "{:?}", found.notes);
    }

    #[test]
    fn lists_that_do_not_fit_are_refused() {
        let stated = Stated { gain: Some(vec![1.0]), ..Stated::default() };
        assert!(arranged(&[400.0, 500.0], stated).err().unwrap().to_string().contains("1 gains"));
        let error = arranged(&[0.4, 0.5], Stated::default()).err().unwrap().to_string();
        assert!(error.contains("no usable band from 0.4 to 0.5 nm"), "{error}");
        assert!(arranged(&[400.0, f64::NAN], Stated::default()).is_err());
    }
}

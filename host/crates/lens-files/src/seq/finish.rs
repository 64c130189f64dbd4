//! From what a `.seq` file says to a prescription in mm.

use super::{Across, Draft, File, INFINITE, radii};
use camrig_base::{Error, Result};
use camrig_glass::Catalogue;
use camrig_prescription::{
    Aperture, FieldKind, Fields, Form, Medium, Object, Prescription, Surface,
};

impl File {
    pub(super) fn finish(mut self, glasses: &Catalogue) -> Result<Prescription> {
        let glasses = self.private.catalogue(glasses)?;
        if self.stop.is_none() {
            let note = "STO is not given: the first surface is the stop, as in CODE V";
            self.notes.push(note.into());
        }
        if self.weights.len() > self.waves.len() {
            let (weights, waves) = (self.weights.len(), self.waves.len());
            return Err(Error::input(format!(
                "WTW has {weights} weights for {waves} wavelengths"
            ))
            .help("give one weight for each value of WL"));
        }
        if let (None, [first, _, ..]) = (self.reference, &self.waves[..]) {
            let note = format!(
                "REF is not given: the first wavelength, {first} nm, is taken as the reference"
            );
            self.notes.push(note);
        }
        let radius_mode = match self.radius_mode {
            Some(mode) => mode,
            None => {
                let (mode, note) = radii::decide(&self, |mode| self.prescription(mode, &glasses));
                self.notes.push(note.into());
                mode
            }
        };
        self.prescription(radius_mode, &glasses)
    }

    /// The prescription, with surfaces taken by radius or by curvature.
    fn prescription(&self, radius_mode: bool, glasses: &Catalogue) -> Result<Prescription> {
        let Some((object_bend, object)) = self.object else {
            return Err(
                Error::input("no object (SO)").help("is this a CODE V lens file, and complete?")
            );
        };
        let Some(defocus) = self.image else {
            return Err(
                Error::input("no image (SI)").help("the file ends before its last surface")
            );
        };
        if self.image_bent {
            return Err(Error::unsupported("the image surface is curved").help("sensors are flat"));
        }
        if object_bend != 0.0 && object.abs() < INFINITE {
            return Err(Error::unsupported("the object surface is curved")
                .help("only flat objects are traced"));
        }
        let Some(aperture) = self.aperture else {
            return Err(Error::input("no aperture").help("EPD, FNO, NA or NAO gives one"));
        };
        let scale = self.scale;
        let finite = object.abs() < INFINITE;
        let aperture = match aperture {
            Aperture::EntrancePupil(d) => Aperture::EntrancePupil(d * scale),
            // With the object at infinity the f-number is EFL/EPD.
            Aperture::WorkingFNumber(n) if !finite => Aperture::FNumber(n),
            other => other,
        };
        let last = self.surfaces.len().saturating_sub(1);
        let mut notes = self.notes.clone();
        let mut surfaces = Vec::with_capacity(self.surfaces.len());
        for (i, draft) in self.surfaces.iter().enumerate() {
            let mut surface = draft
                .surface(radius_mode, scale, glasses, &self.waves, &mut notes)
                .map_err(|e| e.at(format!("surface {} (line {})", i + 1, draft.line)))?;
            if i == last {
                surface.thickness += defocus * scale;
            }
            surfaces.push(surface);
        }
        let (entry, _) =
            self.image_decentre.frames(scale, false).map_err(|e| e.at("the image"))?;
        if entry.is_some() && defocus != 0.0 {
            return Err(Error::unsupported("a tilted or decentred image with a defocus (SI)")
                .help("add the defocus to the last thickness before it"));
        }
        if entry.is_some() {
            surfaces.push(Surface { form: Form::Break, entry, ..Surface::plane(0.0) });
        }
        let reference = self.reference.unwrap_or(1);
        let Some(&reference_nm) = self.waves.get(reference - 1) else {
            let count = self.waves.len();
            return Err(Error::input(format!("reference wavelength {reference} of {count}"))
                .help("REF names one of the values of WL"));
        };
        let on_axis = (FieldKind::Angle, Default::default());
        let (kind, [x, y]) = self.fields.as_ref().unwrap_or(&on_axis);
        let unit = if *kind == FieldKind::Angle { 1.0 } else { scale };
        let at = |list: &[f64], i: usize| list.get(i).copied().unwrap_or(0.0);
        let count = x.len().max(y.len()).max(1);
        let values: Vec<f64> =
            (0..count).map(|i| kind.off_axis(at(x, i), at(y, i)) * unit).collect();
        let place = |i| [at(x, i), at(y, i)].map(|v: f64| v * unit);
        let places = (0..count).map(place).collect();
        let [ux, lx, uy, ly] = &self.vignetting;
        // VUX alone is for both sides.
        let lx = if lx.is_empty() { ux } else { lx };
        let any = self.vignetting.iter().flatten().any(|v| *v != 0.0);
        let vignetting = match any {
            true => (0..count).map(|i| [ux, lx, uy, ly].map(|list| at(list, i))).collect(),
            false => Vec::new(),
        };
        let prescription = Prescription {
            name: self.title.clone(),
            surfaces,
            stop: self.stop.unwrap_or(0),
            object: if finite { Object::Distance(object * scale) } else { Object::Infinity },
            aperture,
            telecentric: false,
            object_glass: match self.object_glass.as_deref() {
                None | Some("AIR") => None,
                Some(name) => Some(glasses.find(name, &[])?.noted(&self.waves, &mut notes)),
            },
            wavelengths_nm: self.waves.clone(),
            wavelength_weights: self.weights(),
            reference_nm,
            fields: Fields { kind: *kind, values, places, vignetting, elliptical: false },
            notes,
        };
        prescription.validate()?;
        Ok(prescription)
    }

    /// A weight for each wavelength: 1 where `WTW` ends before them.
    fn weights(&self) -> Vec<f64> {
        let mut weights = self.weights.clone();
        if !weights.is_empty() {
            weights.resize(self.waves.len(), 1.0);
        }
        weights
    }
}

impl Draft {
    fn surface(
        &self,
        radius_mode: bool,
        scale: f64,
        glasses: &Catalogue,
        wavelengths_nm: &[f64],
        notes: &mut Vec<String>,
    ) -> Result<Surface> {
        let curvature = match (radius_mode, self.bend) {
            (false, c) => c / scale,
            (true, 0.0) => 0.0,
            (true, r) => 1.0 / (r * scale),
        };
        let in_mm = |a: f64, power: usize| a * scale / libm::pow(scale, power as f64);
        let mut even: Vec<f64> =
            self.even.iter().enumerate().map(|(i, a)| in_mm(*a, 2 * i + 2)).collect();
        let mut odd = Vec::new();
        for (i, a) in self.odd_terms.iter().enumerate() {
            let a = in_mm(*a, i + 1);
            if i % 2 == 0 {
                odd.push(a);
            } else {
                even.resize(even.len().max(i / 2 + 1), 0.0);
                even[i / 2] += a;
            }
        }
        let medium = match self.glass.as_deref() {
            None => Medium::Air,
            Some(name) if name.eq_ignore_ascii_case("AIR") => Medium::Air,
            Some(name) if name.to_ascii_uppercase().starts_with("REFL") => Medium::Mirror,
            Some(name) => Medium::Glass(glasses.find(name, &[])?.noted(wavelengths_nm, notes)),
        };
        let form = match &self.across {
            None => Form::Plain,
            Some(Across { curvature: Some(c), conic }) => {
                Form::Biconic { curvature: c / scale, conic: *conic }
            }
            Some(_) => {
                return Err(Error::input("AAS or CYL without CUX or RDX")
                    .help("give the curvature or the radius in x too"));
            }
        };
        let (entry, exit) = self.decentre.frames(scale, medium == Medium::Mirror)?;
        Ok(Surface {
            curvature,
            conic: self.conic,
            even,
            odd,
            thickness: self.thickness * scale,
            medium,
            clips: self.apertures.clips(scale)?,
            form,
            entry,
            exit,
        })
    }
}

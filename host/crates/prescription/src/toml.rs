//! Prescriptions in TOML: a lens table written by hand.
//!
//! ```toml
//! format = "camrig-prescription/1"
//! name = "singlet"
//! # object_distance_mm = 250.0        # in front of the first surface; absent: at infinity
//! # telecentric = true                # chief rays are parallel to the axis in object space
//! wavelengths_nm = [486.1, 587.6, 656.3]
//! reference_nm = 587.6                # absent: the middle one of the list
//! fields_deg = [0.0, 10.0, 14.0]
//!
//! [aperture]                          # one of: entrance_pupil_mm, f_number, working_f_number,
//! f_number = 4.0                      #   stop_radius_mm, object_na, image_na
//!
//! [[surface]]
//! radius_mm = 50.0                    # or curvature = 0.02 (1/mm); absent or 0: plane
//! thickness_mm = 4.0                  # to the next surface; of the last one: to the sensor
//! glass = "N-BK7"                     # a catalogue name, "1.5168:64.17" (n_d:V_d), a name of
//!                                     #   [glass], "mirror"; absent: air
//! conic = 0.0
//! even = [0.0, 1e-5]                  # coefficients of r², r⁴, ...
//! odd = []                            # coefficients of r, r³, ...
//! aperture_radius_mm = 8.0            # what light passes; absent: everything
//! obscuration_radius_mm = 0.0
//! # aperture_rectangle_mm = [6.0, 4.0]  # half of its width in x and in y; or aperture_ellipse_mm
//! # obscuration_ellipse_mm = [1.0, 2.0] # or obscuration_rectangle_mm
//! aperture_centre_mm = [0.0, 0.0]     # from the vertex
//! stop = true
//! # One of these makes it more than conic and polynomials:
//! # forbes = { kind = "q-con", radius_mm = 3.2, coefficients_mm = [0.01, -0.002] }  # or "q-bfs"
//! # biconic = { radius_mm = 80.0, conic = 0.0 }      # those in x; radius_mm, conic are those in y
//! # toroid_radius_mm = 80.0           # the curve in y turned about an axis this far behind; or
//! #                                   #   inf: a cylinder
//! # focal_length_mm = 50.0            # an ideal thin lens
//! # Tilts about x, y and z after a decentre, right-handed; they move what follows too.
//! # decentre_mm = [0.0, 0.2, 0.0]
//! # tilt_deg = [1.5, 0.0, 0.0]
//! # after = "stay"                    # or "return": only this surface is moved; or "bend": tilted
//! #                                   #   once more, so that the axis follows a mirror
//!
//! [[surface]]
//! radius_mm = -50.0
//! thickness_mm = 47.0
//!
//! [glass.resin]                       # glasses of one's own: n_d and V_d, or a table
//! nd = 1.53
//! vd = 56.0
//! [glass.other]
//! table_nm = [[400.0, 1.55], [700.0, 1.52]]
//! ```

use super::forbes::{Forbes, Kind};
use super::{
    Aperture, Clip, FieldKind, Fields, Form, Medium, Object, Pose, Prescription, Shape, Surface,
};
use camrig_base::{Error, Result, toml_text};
use camrig_glass::{Catalogue, Glass};
use schemars::{JsonSchema, Schema, schema_for};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ops::Range;

/// Value of the `format` key.
const FORMAT: &str = "camrig-prescription/1";

/// A lens written by hand: surfaces in the order of the light.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// `"camrig-prescription/1"`.
    format: String,
    /// Name for people.
    #[serde(default)]
    name: String,
    /// Distance of the object in front of the first surface, mm; left out: infinity.
    object_distance_mm: Option<f64>,
    /// Whether chief rays are parallel to the axis in object space, whatever the stop.
    #[serde(default)]
    telecentric: bool,
    /// Wavelengths of figures, nm.
    wavelengths_nm: Vec<f64>,
    /// What each of `wavelengths_nm` counts in an MTF of several wavelengths; left out: all the
    /// same.
    #[serde(default)]
    wavelength_weights: Vec<f64>,
    /// Wavelength of paraxial figures and of the stop's radius, nm; left out: the middle one of
    /// `wavelengths_nm`.
    reference_nm: Option<f64>,
    /// Field angles of figures, degrees.
    fields_deg: Vec<f64>,
    /// One of `entrance_pupil_mm`, `f_number`, `working_f_number`, `stop_radius_mm`, `object_na`,
    /// `image_na`.
    aperture: BTreeMap<String, f64>,
    /// The surfaces, from the object to the sensor.
    #[schemars(with = "Vec<Row>")]
    surface: Vec<::toml::Spanned<Row>>,
    /// Glasses of one's own, by name.
    #[serde(default)]
    glass: BTreeMap<String, OwnGlass>,
}

/// A surface, and what is behind it.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Row {
    /// Radius of curvature, mm; 0 or left out: plane.
    radius_mm: Option<f64>,
    /// Curvature, 1/mm, instead of the radius.
    curvature: Option<f64>,
    /// Distance to the next surface, mm; of the last one: to the sensor.
    thickness_mm: f64,
    /// What is behind it: a glass of a catalogue, `"1.5168:64.17"` (n_d:V_d), a name of `[glass]`,
    /// or `"mirror"`; left out: air.
    glass: Option<String>,
    /// Conic constant.
    #[serde(default)]
    conic: f64,
    /// Coefficients of r², r⁴ and so on, mm¹⁻ⁿ for rⁿ.
    #[serde(default)]
    even: Vec<f64>,
    /// Coefficients of r, r³ and so on, mm¹⁻ⁿ for rⁿ.
    #[serde(default)]
    odd: Vec<f64>,
    /// Radius within which light passes, mm; left out: everywhere.
    aperture_radius_mm: Option<f64>,
    /// Radius within which light is stopped, mm.
    #[serde(default)]
    obscuration_radius_mm: f64,
    /// Half of the widths in x and y of a rectangle within which light passes, mm.
    aperture_rectangle_mm: Option<[f64; 2]>,
    /// Half of the widths in x and y of an ellipse within which light passes, mm.
    aperture_ellipse_mm: Option<[f64; 2]>,
    /// Half of the widths in x and y of a rectangle within which light is stopped, mm.
    obscuration_rectangle_mm: Option<[f64; 2]>,
    /// Half of the widths in x and y of an ellipse within which light is stopped, mm.
    obscuration_ellipse_mm: Option<[f64; 2]>,
    /// Centre of apertures and obscurations, (x, y) from the vertex, mm.
    #[serde(default)]
    aperture_centre_mm: [f64; 2],
    /// Whether this surface is the aperture stop; one is.
    #[serde(default)]
    stop: bool,
    /// The departure of a Forbes asphere, added to the conic (of `q-bfs`: along its normal).
    forbes: Option<ForbesRow>,
    /// Makes it a biconic: radius and conic constant in x.
    biconic: Option<BiconicRow>,
    /// Makes it a toroid: the curve in y is turned about an axis parallel to y this far behind the
    /// vertex, mm; `inf`: a cylinder.
    toroid_radius_mm: Option<f64>,
    /// Makes it an ideal thin lens in air with this focal length, mm.
    focal_length_mm: Option<f64>,
    /// Decentre (x, y, z) of this surface and of what follows, mm.
    #[serde(default)]
    decentre_mm: [f64; 3],
    /// Tilts about x, the new y and the new z after the decentre, degrees, right-handed.
    #[serde(default)]
    tilt_deg: [f64; 3],
    /// What follows the tilted surface: `stay` (default) in its coordinates, `return` to those
    /// before it, or `bend`: tilted once more, as the axis is by a mirror.
    #[serde(default)]
    after: After,
}

/// A Forbes asphere.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct ForbesRow {
    /// `"q-con"` or `"q-bfs"`.
    kind: ForbesKind,
    /// Normalisation radius, mm.
    radius_mm: f64,
    /// Coefficients a₀, a₁ and so on, mm.
    coefficients_mm: Vec<f64>,
}

/// Which of Forbes' polynomials.
#[derive(Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum ForbesKind {
    /// Strong: departure from a conic.
    QCon,
    /// Mild: departure along the normal of a sphere or conic.
    QBfs,
}

/// A biconic in x.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct BiconicRow {
    /// Radius of curvature in x, mm; 0 or `inf`: none.
    radius_mm: f64,
    /// Conic constant in x.
    #[serde(default)]
    conic: f64,
}

/// The coordinates behind a tilted or decentred surface.
#[derive(Clone, Copy, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum After {
    /// Those of the surface.
    #[default]
    Stay,
    /// Those before it.
    Return,
    /// Those of the surface, tilted once more.
    Bend,
}

/// A glass: its index and Abbe number, or a table.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct OwnGlass {
    /// Index at 587.6 nm.
    nd: Option<f64>,
    /// Abbe number.
    vd: Option<f64>,
    /// Pairs of wavelength, nm, and index.
    table_nm: Option<Vec<[f64; 2]>>,
}

/// The JSON schema of a prescription.
pub fn schema() -> Schema {
    schema_for!(File)
}

/// A prescription from the text of a TOML file.
///
/// # Errors
/// What is wrong in the file, with its line.
pub fn read(text: &str, glasses: &Catalogue) -> Result<Prescription> {
    let file: File = toml_text::read(text)?;
    if file.format != FORMAT {
        return Err(Error::input(format!("format \"{}\"", file.format))
            .help(format!("a prescription has format = \"{FORMAT}\"")));
    }
    let mut glasses = glasses.clone();
    for (name, own) in &file.glass {
        let glass = own.glass(name).map_err(|e| e.at(format!("[glass.{name}]")))?;
        glasses.insert(name, glass);
    }
    let mut surfaces = Vec::with_capacity(file.surface.len());
    let (mut stops, mut notes) = (Vec::new(), Vec::new());
    for (i, row) in file.surface.iter().enumerate() {
        let line = line_of(text, row.span());
        let row = row.get_ref();
        surfaces.push(
            row.surface(&glasses, &file.wavelengths_nm, &mut notes)
                .map_err(|e| e.at(format!("surface {}", i + 1)).at(format!("line {line}")))?,
        );
        stops.extend(row.stop.then_some(i));
    }
    let [stop] = stops[..] else {
        return Err(Error::input(format!("{} surfaces are the stop", stops.len()))
            .help("mark one surface with stop = true"));
    };
    let reference_nm = match file.reference_nm {
        Some(nm) => nm,
        None => file.wavelengths_nm.get(file.wavelengths_nm.len() / 2).copied().unwrap_or(0.0),
    };
    let prescription = Prescription {
        name: file.name,
        surfaces,
        stop,
        object: file.object_distance_mm.map_or(Object::Infinity, Object::Distance),
        aperture: aperture(&file.aperture)?,
        telecentric: file.telecentric,
        object_glass: None,
        wavelengths_nm: file.wavelengths_nm,
        wavelength_weights: file.wavelength_weights,
        reference_nm,
        fields: Fields {
            kind: FieldKind::Angle,
            values: file.fields_deg,
            places: Vec::new(),
            vignetting: Vec::new(),
            elliptical: false,
        },
        notes,
    };
    prescription.validate()?;
    Ok(prescription)
}

fn line_of(text: &str, span: Range<usize>) -> usize {
    text.bytes().take(span.start).filter(|b| *b == b'\n').count() + 1
}

fn aperture(table: &BTreeMap<String, f64>) -> Result<Aperture> {
    let entries: Vec<(&str, f64)> = table.iter().map(|(k, v)| (k.as_str(), *v)).collect();
    match entries[..] {
        [("entrance_pupil_mm", v)] => Ok(Aperture::EntrancePupil(v)),
        [("f_number", v)] => Ok(Aperture::FNumber(v)),
        [("working_f_number", v)] => Ok(Aperture::WorkingFNumber(v)),
        [("stop_radius_mm", v)] => Ok(Aperture::StopRadius(v)),
        [("object_na", v)] => Ok(Aperture::ObjectNa(v)),
        [("image_na", v)] => Ok(Aperture::ImageNa(v)),
        _ => Err(Error::input(format!("[aperture] holds {:?}", table.keys().collect::<Vec<_>>()))
            .help(
                "give exactly one of entrance_pupil_mm, f_number, working_f_number, \
                 stop_radius_mm, object_na, image_na",
            )),
    }
}

impl Row {
    fn surface(
        &self,
        glasses: &Catalogue,
        wavelengths_nm: &[f64],
        notes: &mut Vec<String>,
    ) -> Result<Surface> {
        let curvature = match (self.radius_mm, self.curvature) {
            (Some(_), Some(_)) => {
                return Err(Error::input("both radius_mm and curvature").help("give one of them"));
            }
            (Some(r), None) if r != 0.0 => 1.0 / r,
            (_, c) => c.unwrap_or(0.0),
        };
        let medium = match self.glass.as_deref() {
            None | Some("air") => Medium::Air,
            Some("mirror") => Medium::Mirror,
            Some(name) => Medium::Glass(glasses.find(name, &[])?.noted(wavelengths_nm, notes)),
        };
        let (entry, exit) = self.frames()?;
        Ok(Surface {
            curvature,
            conic: self.conic,
            even: self.even.clone(),
            odd: self.odd.clone(),
            thickness: self.thickness_mm,
            medium,
            clips: self.clips()?,
            form: self.form()?,
            entry,
            exit,
        })
    }

    /// What light passes: between two circles, then rectangles and ellipses.
    fn clips(&self) -> Result<Vec<Clip>> {
        let outer = self.aperture_radius_mm.unwrap_or(f64::INFINITY);
        let ring = Clip::ring(self.obscuration_radius_mm, outer);
        let mut clips = Vec::new();
        if ring != Clip::circle(f64::INFINITY) {
            clips.push(ring);
        }
        let (rectangle, ellipse) = (Shape::Rectangle, Shape::Ellipse);
        for (key, half_mm, shape, obscures) in [
            ("aperture_rectangle_mm", self.aperture_rectangle_mm, rectangle, false),
            ("aperture_ellipse_mm", self.aperture_ellipse_mm, ellipse, false),
            ("obscuration_rectangle_mm", self.obscuration_rectangle_mm, rectangle, true),
            ("obscuration_ellipse_mm", self.obscuration_ellipse_mm, ellipse, true),
        ] {
            let Some(half_mm) = half_mm else { continue };
            if !half_mm.iter().all(|v| v.is_finite() && *v > 0.0) {
                return Err(Error::input(format!("{key} = {half_mm:?}"))
                    .help("give half of the widths in x and y, each above 0"));
            }
            let opening = Clip::opening(shape, half_mm);
            clips.push(if obscures { opening.obstacle() } else { opening });
        }
        Ok(clips.into_iter().map(|clip| clip.placed(1.0, self.aperture_centre_mm)).collect())
    }

    fn form(&self) -> Result<Form> {
        let curvature = |radius: f64| if radius == 0.0 { 0.0 } else { 1.0 / radius };
        let forms = [
            self.forbes.as_ref().map(ForbesRow::form),
            self.biconic
                .as_ref()
                .map(|b| Ok(Form::Biconic { curvature: curvature(b.radius_mm), conic: b.conic })),
            self.toroid_radius_mm.map(|r| Ok(Form::Toroid { curvature: curvature(r) })),
            self.focal_length_mm.map(|focal_mm| Ok(Form::Ideal { focal_mm })),
        ];
        let mut given = forms.into_iter().flatten();
        match (given.next(), given.next()) {
            (None, _) => Ok(Form::Plain),
            (Some(form), None) => form,
            (Some(_), Some(_)) => Err(Error::input("more than one kind of surface")
                .help("give one of forbes, biconic, toroid_radius_mm and focal_length_mm")),
        }
    }

    /// Coordinates of the surface, and those behind it.
    fn frames(&self) -> Result<(Option<Pose>, Option<Pose>)> {
        if self.decentre_mm.iter().chain(&self.tilt_deg).all(|v| *v == 0.0) {
            return Ok((None, None));
        }
        let frame = Pose::decentred_then_tilted(self.decentre_mm, self.tilt_deg);
        let exit = match self.after {
            After::Stay => None,
            After::Return => Some(frame.inverse()),
            After::Bend => {
                let [x, y, z] = self.tilt_deg;
                if z != 0.0 || (x != 0.0 && y != 0.0) {
                    return Err(Error::unsupported("after = \"bend\" of tilts about two axes")
                        .help("tilt a mirror about x or y, or use \"stay\""));
                }
                Some(frame.turn_only())
            }
        };
        Ok((Some(frame), exit))
    }
}

impl ForbesRow {
    fn form(&self) -> Result<Form> {
        let kind = match self.kind {
            ForbesKind::QCon => Kind::Con,
            ForbesKind::QBfs => Kind::Bfs,
        };
        Ok(Form::Forbes(Forbes::new(kind, self.radius_mm, self.coefficients_mm.clone())?))
    }
}

impl OwnGlass {
    fn glass(&self, name: &str) -> Result<Glass> {
        match (self.nd, self.vd, &self.table_nm) {
            (Some(nd), Some(vd), None) => {
                Ok(Glass { name: name.to_owned(), ..Glass::model(nd, vd)? })
            }
            (Some(n), None, None) => Ok(Glass { name: name.to_owned(), ..Glass::constant(n)? }),
            (None, None, Some(table)) => Glass::table(name, table.clone()),
            _ => Err(Error::input("neither n_d and V_d nor a table")
                .help("give nd and vd, nd alone (no dispersion), or table_nm")),
        }
    }
}

//! Where the tables of a lens end, and what to tell of a sensor or of light that goes beyond.
//!
//! Nothing is refused: a table of the axis alone is a fair description of a long lens, and no
//! share of the frame separates what may be continued from what may not. The note has the share,
//! and says what is done.

use super::Characterisation;
use super::plane::PlaneCharacterisation;
use super::tables::LensTables;
use crate::engine::{Lens, SensorGrid};
use camrig_base::{Bands, Spectrum};

/// Pixels across and down, at most, of which places are looked up: shares of the frame are then
/// right to a per cent.
const PROBES: usize = 129;

/// Where the tables of a lens end.
#[derive(Clone, Debug, PartialEq)]
pub struct Extent {
    /// Of distortion and relative illumination; in a lens over the plane, of PSFs, too.
    tables: Area,
    /// Of PSFs, where they have heights of their own.
    psfs: Option<Area>,
    wavelengths_nm: [f64; 2],
    psf_wavelengths_nm: [f64; 2],
    transmittance: Spectrum,
}

/// Ideal places over which something is tabulated, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Area {
    /// From the axis to this height.
    Disc(f64),
    /// From one place to another, right of the origin and below it.
    Rectangle([[f64; 2]; 2]),
}

/// What of the frame lies beyond an area.
struct Beyond {
    /// Share of the frame.
    share: f64,
    /// What the frame needs, as the area.
    needed: Area,
}

impl Area {
    /// What of the ideal `places` of a frame lies beyond, if anything does.
    fn beyond(self, places: &[[f64; 2]]) -> Option<Beyond> {
        let outside = |&&[x, y]: &&[f64; 2]| match self {
            Self::Disc(height) => libm::hypot(x, y) > height,
            Self::Rectangle(sides) => {
                [x, y].iter().zip(sides).any(|(v, [low, high])| *v < low || *v > high)
            }
        };
        let count = places.iter().filter(outside).count();
        let needed = match self {
            Self::Disc(_) => {
                Self::Disc(places.iter().map(|&[x, y]| libm::hypot(x, y)).fold(0.0, f64::max))
            }
            Self::Rectangle(_) => Self::Rectangle([0, 1].map(|k| {
                let along = || places.iter().map(|place| place[k]);
                [along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max)]
            })),
        };
        (count > 0).then(|| Beyond { share: count as f64 / places.len() as f64, needed })
    }

    fn words(self) -> String {
        match self {
            Self::Disc(height) => format!("{height:.3} mm"),
            Self::Rectangle([[left, right], [top, bottom]]) => format!(
                "{left:.3} to {right:.3} mm right of the origin and {top:.3} to {bottom:.3} mm \
                 below it"
            ),
        }
    }
}

impl Beyond {
    /// "... end at A, and the sensor needs B".
    fn words(&self, what: &str, area: Area) -> String {
        let share = match 100.0 * self.share {
            share if share < 1.0 => "less than 1 %".to_owned(),
            share => format!("{share:.0} %"),
        };
        let (area, needed) = (area.words(), self.needed.words());
        format!(
            "{what} end at {area} (ideal image), and the sensor reaches {needed}: on {share} of \
             the frame"
        )
    }
}

fn ends(axis: &[f64]) -> [f64; 2] {
    [axis[0], axis[axis.len() - 1]]
}

impl LensTables {
    /// Where the tables end.
    #[must_use]
    pub fn extent(&self) -> Extent {
        match self {
            Self::Heights(lens) => Extent::of_heights(lens),
            Self::Plane(lens) => Extent::of_plane(lens),
        }
    }
}

impl Extent {
    fn of_heights(lens: &Characterisation) -> Self {
        let disc = |heights: &[f64]| Area::Disc(ends(heights)[1]);
        let (tables, psfs) = (disc(&lens.heights_mm), disc(&lens.psf.heights_mm));
        Self {
            tables,
            psfs: (psfs != tables).then_some(psfs),
            wavelengths_nm: ends(&lens.wavelengths_nm),
            psf_wavelengths_nm: ends(&lens.psf.wavelengths_nm),
            transmittance: lens.transmittance.clone(),
        }
    }

    fn of_plane(lens: &PlaneCharacterisation) -> Self {
        Self {
            tables: Area::Rectangle([ends(&lens.x_mm), ends(&lens.y_mm)]),
            psfs: None,
            wavelengths_nm: ends(&lens.wavelengths_nm),
            psf_wavelengths_nm: ends(&lens.wavelengths_nm),
            transmittance: lens.transmittance.clone(),
        }
    }

    /// What to tell the user where the frame of `grid` or light in `bands` goes beyond the tables
    /// that are called `name`; `lens` is what was made of them.
    #[must_use]
    pub fn notes(
        &self,
        name: &str,
        lens: &dyn Lens,
        grid: &SensorGrid,
        bands: &Bands,
    ) -> Vec<String> {
        let light = ends_of(bands);
        let places = ideal_places(lens, grid, 0.5 * (light[0] + light[1]));
        let mut notes = Vec::new();
        let remedy = "use tables that reach further if the lens is not so";
        let of_psfs = self.psfs.and_then(|area| Some((area, area.beyond(&places)?)));
        if let Some(beyond) = self.tables.beyond(&places) {
            let what = if self.psfs.is_some() {
                "distortion and relative illumination"
            } else {
                "distortion, relative illumination and PSFs"
            };
            let held = if self.psfs.is_some() { "is that" } else { "and PSFs are those" };
            notes.push(format!(
                "{name}: {} distortion goes on along its last slope, and relative illumination \
                 {held} of the end; {remedy}",
                beyond.words(what, self.tables)
            ));
        }
        if let Some((area, beyond)) = of_psfs {
            let words = beyond.words("PSFs", area);
            notes.push(format!("{name}: {words} they are those of the end; {remedy}"));
        }
        let colours = [
            ("distortion and relative illumination", self.wavelengths_nm),
            ("PSFs", self.psf_wavelengths_nm),
        ];
        let same = self.wavelengths_nm == self.psf_wavelengths_nm;
        for (what, own) in colours.into_iter().skip(usize::from(same)) {
            let what = if same { "distortion, relative illumination and PSFs" } else { what };
            notes.extend(of_light(what, own, light).map(|words| format!("{name}: {words}")));
        }
        // One sample is a lens that is equally clear everywhere.
        if self.transmittance.samples().nth(1).is_some() {
            let curve = self.transmittance.clone();
            notes.extend(curve.from_table(format!("{name}: transmittance")).beyond(bands));
        }
        notes
    }
}

fn ends_of(bands: &Bands) -> [f64; 2] {
    [bands.nm(0), bands.nm(bands.count.saturating_sub(1))]
}

/// What is taken for light beyond the wavelengths of a table.
fn of_light(what: &str, own: [f64; 2], light: [f64; 2]) -> Option<String> {
    let ([first, last], [low, high]) = (own, light);
    let known = match first == last {
        true => format!("of {first} nm alone"),
        false => format!("of {first} to {last} nm"),
    };
    (low < first || high > last).then(|| {
        format!(
            "{what} are {known}, and the light of {low} to {high} nm: beyond, those of the \
             nearest are taken; give more wavelengths if the lens is not so"
        )
    })
}

/// Ideal places, mm from the axis, of pixels all over the frame, the outermost among them.
fn ideal_places(lens: &dyn Lens, grid: &SensorGrid, nm: f64) -> Vec<[f64; 2]> {
    let axis = lens.axis_mm();
    let along = |n: usize, axis: f64| -> Vec<f64> {
        let count = n.min(PROBES);
        let pixel = |i: usize| (i * (n - 1)) as f64 / count.saturating_sub(1).max(1) as f64;
        let centre = (n - 1) as f64 / 2.0;
        (0..count).map(|i| (pixel(i) - centre) * 1e-3 * grid.pitch_um - axis).collect()
    };
    let (x, y) = (along(grid.width, axis.0), along(grid.height, axis.1));
    let ideal = lens.ideal_place(nm);
    let place = |x: f64, y: f64| ideal.as_ref().map_or((x, y), |ideal| ideal.at(x, y)).into();
    y.iter().flat_map(|&y| x.iter().map(move |&x| (x, y))).map(|(x, y)| place(x, y)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::plane::tests::twice;
    use super::*;

    const GREEN: Bands = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };

    fn notes(tables: LensTables, (width, height): (usize, usize), bands: &Bands) -> Vec<String> {
        let grid = SensorGrid { width, height, pitch_um: 5.0, fill_factor: 1.0 };
        let extent = tables.extent();
        let lens = tables.into_lens(Spectrum::constant(1.0));
        extent.notes("x", &*lens, &grid, bands)
    }

    /// The share of a frame that a note states.
    fn share(note: &str) -> f64 {
        let (before, _) = note.split_once(" % of the frame").unwrap();
        before.rsplit(' ').next().unwrap().parse().unwrap()
    }

    #[test]
    fn a_sensor_beyond_the_heights_is_told_with_its_share() {
        // Real heights h(1 − 0.2 h²) up to h = 0.5 mm: 0.475 mm.
        let (lens, _) = twice(41, 5);
        let of =
            |lens: &Characterisation, size| notes(LensTables::Heights(lens.clone()), size, &GREEN);
        // Corner pixel at hypot(94.5, 94.5) * 5 µm = 0.668 mm; inside 0.4719 mm.
        assert_eq!(of(&lens, (134, 134)), [""; 0]);
        let found = of(&lens, (190, 190));
        let [note] = &found[..] else { panic!("{found:?}") };
        let beyond = "x: distortion, relative illumination and PSFs end at 0.500 mm";
        assert!(note.starts_with(beyond), "{note}");
        // A circle of radius R = 0.475 mm within a square of side a = 0.95 mm: 1 − π/4.
        assert!(
            (share(note) - 100.0 * (1.0 - std::f64::consts::FRAC_PI_4)).abs() <= 1.0,
            "{note}"
        );
        // PSFs of the axis alone, and tables that reach the corner.
        let mut axial = lens.clone();
        axial.psf.heights_mm.truncate(1);
        axial.psf.data.truncate(33 * 33);
        axial.validate().unwrap();
        let found = of(&axial, (134, 134));
        let [note] = &found[..] else { panic!("{found:?}") };
        assert!(note.starts_with("x: PSFs end at 0.000 mm") && share(note) == 100.0, "{note}");
    }

    #[test]
    fn a_sensor_beyond_the_places_is_told_with_its_share() {
        let (_, lens) = twice(41, 33);
        // Ideal places to 0.36 mm: on the axes, real ones to 0.36·(1 − 0.2·0.36²) = 0.3507 mm.
        let of = |size| notes(LensTables::Plane(lens.clone()), size, &GREEN);
        assert_eq!(of((134, 134)), [""; 0]);
        let found = of((200, 100));
        let [note] = &found[..] else { panic!("{found:?}") };
        assert!(note.contains("-0.360 to 0.360 mm right of the origin"), "{note}");
        // Columns beyond 0.3507 mm (and a little less towards the corners) of ±0.5 mm.
        assert!((share(note) - 100.0 * (1.0 - 0.3507 / 0.5)).abs() <= 1.5, "{note}");
    }

    #[test]
    fn light_beyond_the_wavelengths_is_told() {
        let (lens, plane) = twice(5, 5);
        let visible = Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
        for tables in [LensTables::Heights(lens.clone()), LensTables::Plane(plane)] {
            let found = notes(tables, (40, 40), &visible);
            let [note] = &found[..] else { panic!("{found:?}") };
            assert!(note.contains("PSFs are of 550 nm alone, and the light of 400 to"), "{note}");
        }
        let mut filtered = lens;
        filtered.transmittance = Spectrum::new(vec![450.0, 700.0], vec![0.5, 0.9]).unwrap();
        let found = notes(LensTables::Heights(filtered), (40, 40), &visible);
        let said = "x: transmittance begins at 450 nm with 0.500, and is held down to 400 nm";
        assert!(found.len() == 2 && found[1].starts_with(said), "{found:?}");
    }
}

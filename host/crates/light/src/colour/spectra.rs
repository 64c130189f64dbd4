//! The spectra of all pixels of a picture.
//!
//! Each distinct colour is solved once. Where there are more of them than there are nodes under
//! them of the lattice, spectra are interpolated between its nodes. An emission's colour is divided
//! by its largest component, which scales the spectrum: it lies on three faces of the lattice.
//!
//! A pixel keeps a place in the lattice, 16 bytes; a plane of a band costs eight look-ups a pixel.

use super::gamut::Reached;
use super::lattice::{Lattice, NODES, Place, SIDE};
use super::smoothest::Domain;
use super::space::luminance;
use super::transfer::Transfer;
use camrig_base::color::srgb_code;
use camrig_base::{Plane, Result};
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Steps of the codes (0 to 1, by the curve of sRGB) to which colours outside the cube of sRGB are
/// rounded before they are solved: ΔE2000 stays below 0.1, and a photograph has few of them.
const CODE_STEP: f64 = 1.0 / 1024.0;

/// Spectra of a picture.
pub struct Spectra {
    size: (usize, usize),
    domain: Domain,
    /// The spectra that places name: those of the lattice's nodes that are used, by the nodes'
    /// numbers, then those of colours solved for themselves.
    solved: Vec<Option<Arc<Reached>>>,
    places: Vec<Place>,
    /// What a pixel's spectrum is multiplied by; none where by 1.
    scale: Option<Vec<f32>>,
}

/// Values that go together through the look-ups of a pixel.
pub const TOGETHER: usize = 4;

/// Pixels whose colour no spectrum has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moved {
    /// How many.
    pub pixels: usize,
    /// Largest ΔE2000 by which they were moved.
    pub delta_e: f64,
}

impl Spectra {
    /// The spectra of pixels in linear sRGB, row by row.
    ///
    /// # Errors
    /// None in practice: the tables are built in.
    pub fn of(size: (usize, usize), pixels: &[[f32; 3]], domain: Domain) -> Result<(Self, Moved)> {
        let lattice = Lattice::of(domain)?;
        let (colours, scale) = match domain {
            Domain::Reflectance => (None, None),
            Domain::Emission => {
                let (colours, scale): (Vec<_>, Vec<_>) = pixels.iter().map(relative).unzip();
                (Some(colours), Some(scale))
            }
        };
        let colours = colours.as_deref().unwrap_or(pixels);
        let under = Under::of(lattice, colours);
        let (places, wanted, used) = match list(colours, under.needed) {
            Some((places, wanted)) => (places, wanted, None),
            None => {
                let (places, wanted, used) = under.completed(colours);
                (places, wanted, Some(used))
            }
        };
        let node = |n: usize| {
            let is_used = used.as_ref().is_some_and(|used| used[n].load(Ordering::Relaxed));
            is_used.then(|| Arc::clone(lattice.solved(n)))
        };
        let mut solved: Vec<_> = (0..NODES).into_par_iter().map(node).collect();
        solved.par_extend(wanted.par_iter().map(|rgb| Some(lattice.solve(*rgb))));
        let moved = moved(&places, &solved);
        Ok((Self { size, domain, solved, places, scale }, moved))
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// What spectra they are.
    pub fn domain(&self) -> Domain {
        self.domain
    }

    /// Whether spectra lie between the nodes of the lattice.
    #[cfg(test)]
    pub fn interpolates(&self) -> bool {
        self.places.iter().any(|p| p.share != [0.0; 3])
    }

    /// The spectra that pixels have or lie between: of the lattice's nodes by their numbers, then
    /// others.
    pub fn entries(&self) -> &[Option<Arc<Reached>>] {
        &self.solved
    }

    /// The largest factor of a spectrum.
    pub fn brightest(&self) -> f32 {
        let scale = |scale: &Vec<f32>| scale.iter().fold(0.0f32, |m, s| m.max(*s));
        self.scale.as_ref().map_or(1.0, scale)
    }

    /// The values of a band, times `unit`.
    pub fn plane(&self, band: usize, unit: f64) -> Plane<f32> {
        let unit = unit as f32;
        let value = |r: &Option<Arc<Reached>>| r.as_ref().map_or(0.0, |r| r.values[band] as f32);
        let entries: Vec<[f32; 1]> = self.solved.iter().map(|r| [value(r)]).collect();
        let [mut plane] = self.values(&entries);
        plane.data.iter_mut().zip(self.scales()).for_each(|(v, scale)| *v = unit * *v * scale);
        plane
    }

    /// Planes of values that entries have and that mix as spectra do.
    pub fn mixed(&self, entries: &[[f32; TOGETHER]]) -> [Plane<f32>; TOGETHER] {
        let mut planes = self.values(entries);
        if self.scale.is_some() {
            for plane in &mut planes {
                plane.data.iter_mut().zip(self.scales()).for_each(|(v, scale)| *v *= scale);
            }
        }
        planes
    }

    fn scales(&self) -> impl Iterator<Item = f32> + '_ {
        (0..self.places.len()).map(|i| self.scale.as_ref().map_or(1.0, |scale| scale[i]))
    }

    /// The values of every pixel, where `entries` are those that places name.
    fn values<const N: usize>(&self, entries: &[[f32; N]]) -> [Plane<f32>; N] {
        let (width, height) = self.size;
        let mut planes: [Plane<f32>; N] =
            std::array::from_fn(|_| Plane::filled(width, height, 0.0));
        let mut rows: Vec<Vec<&mut [f32]>> = (0..height).map(|_| Vec::with_capacity(N)).collect();
        for plane in &mut planes {
            let of_plane = plane.data.chunks_exact_mut(width);
            rows.iter_mut().zip(of_plane).for_each(|(row, values)| row.push(values));
        }
        let of_row = |(mut row, places): (Vec<&mut [f32]>, &[Place])| {
            for (x, place) in places.iter().enumerate() {
                let values = value(place, entries);
                row.iter_mut().zip(values).for_each(|(row, value)| row[x] = value);
            }
        };
        rows.into_par_iter().zip(self.places.par_chunks(width)).for_each(of_row);
        planes
    }
}

/// The values at a place.
#[inline(always)]
fn value<const N: usize>(place: &Place, entries: &[[f32; N]]) -> [f32; N] {
    let at = place.entry as usize;
    if place.share == [0.0; 3] {
        return entries[at];
    }
    let [x, y, z] = place.share;
    let along = |step: usize| blend(x, &entries[at + step], &entries[at + step + 1]);
    let across = |step: usize| blend(y, &along(step), &along(step + SIDE));
    blend(z, &across(0), &across(SIDE * SIDE))
}

#[inline(always)]
fn blend<const N: usize>(t: f32, a: &[f32; N], b: &[f32; N]) -> [f32; N] {
    let mut between = [0.0; N];
    for ((between, a), b) in between.iter_mut().zip(a).zip(b) {
        *between = (1.0 - t) * a + t * b;
    }
    between
}

/// A colour over its largest component, and the component; black is no white at all.
fn relative(rgb: &[f32; 3]) -> ([f32; 3], f32) {
    let largest = rgb.iter().copied().fold(0.0, f32::max);
    if largest > 0.0 && luminance(rgb.map(f64::from)) > 0.0 {
        (rgb.map(|c| c / largest), largest)
    } else {
        ([1.0; 3], 0.0)
    }
}

/// The distinct colours and the number of each pixel's, where there are at most `most`.
fn list(colours: &[[f32; 3]], most: usize) -> Option<(Vec<Place>, Vec<[f64; 3]>)> {
    let mut numbers = FxHashMap::default();
    let mut wanted = Vec::new();
    let mut places = Vec::with_capacity(colours.len());
    for colour in colours {
        let entry = *numbers.entry(colour.map(f32::to_bits)).or_insert_with(|| {
            wanted.push(colour.map(f64::from));
            number(&wanted)
        });
        if wanted.len() > most {
            return None;
        }
        places.push(Place::alone(entry));
    }
    Some((places, wanted))
}

/// The nodes of the lattice under some colours.
struct Under {
    /// Of each colour; [`OUTSIDE`] of one outside the cube of sRGB.
    places: Vec<Place>,
    used: Vec<AtomicBool>,
    /// Whether colours lie outside.
    any_outside: bool,
    /// Number of nodes used, with the colours outside.
    needed: usize,
}

/// The entry of a colour that has no place in the lattice.
const OUTSIDE: u32 = u32::MAX;

impl Under {
    fn of(lattice: &Lattice, colours: &[[f32; 3]]) -> Self {
        let marks = || -> Vec<AtomicBool> { (0..NODES).map(|_| AtomicBool::new(false)).collect() };
        // Cells of which all corners count are marked as such: one mark a pixel in place of eight.
        let (used, cells) = (marks(), marks());
        let mark = |marks: &[AtomicBool], n: usize| {
            // Most are marked: reading leaves the line to the other threads.
            if !marks[n].load(Ordering::Relaxed) {
                marks[n].store(true, Ordering::Relaxed);
            }
        };
        let place = |colour: &[f32; 3]| {
            let Some(place) = lattice.place(colour) else { return Place::alone(OUTSIDE) };
            match place.is_within() {
                true => mark(&cells, place.entry as usize),
                false => place.corners().for_each(|node| mark(&used, node)),
            }
            place
        };
        let places: Vec<Place> = colours.par_iter().map(place).collect();
        for (entry, _) in cells.iter().enumerate().filter(|(_, c)| c.load(Ordering::Relaxed)) {
            let cell = Place { entry: entry as u32, share: [0.5; 3] };
            cell.corners().for_each(|node| mark(&used, node));
        }
        let beyond = colours.par_iter().zip(&places).filter(|(_, place)| place.entry == OUTSIDE);
        let outside: FxHashSet<[i32; 3]> = beyond.map(|(colour, _)| rounded(colour)).collect();
        let inside = used.iter().filter(|used| used.load(Ordering::Relaxed)).count();
        Self { places, used, any_outside: !outside.is_empty(), needed: inside + outside.len() }
    }

    /// The place of every colour, the colours outside, and the nodes that are used.
    fn completed(mut self, colours: &[[f32; 3]]) -> (Vec<Place>, Vec<[f64; 3]>, Vec<AtomicBool>) {
        let (mut numbers, mut outside) = (FxHashMap::default(), Vec::new());
        let mut entry = |colour: &[f32; 3]| {
            let colour = rounded(colour);
            *numbers.entry(colour).or_insert_with(|| {
                outside.push(colour.map(|code| decoded(f64::from(code))));
                number(&outside)
            })
        };
        if self.any_outside {
            let without = self.places.iter_mut().zip(colours);
            without
                .filter(|(place, _)| place.entry == OUTSIDE)
                .for_each(|(place, colour)| place.entry = entry(colour));
        }
        (self.places, outside, self.used)
    }
}

/// The number of the last of the entries that follow the nodes.
fn number(own: &[[f64; 3]]) -> u32 {
    (NODES + own.len() - 1) as u32
}

/// The code of a component outside the cube, in steps.
fn rounded(colour: &[f32; 3]) -> [i32; 3] {
    colour.map(|component| {
        let code = srgb_code(f64::from(component));
        (code / CODE_STEP).round() as i32
    })
}

fn decoded(steps: f64) -> f64 {
    Transfer::Srgb.linear(steps * CODE_STEP)
}

/// How many pixels have a colour that was moved, and by how much.
fn moved(places: &[Place], solved: &[Option<Arc<Reached>>]) -> Moved {
    let mut moved = Moved::default();
    if solved.iter().flatten().all(|reached| reached.delta_e == 0.0) {
        return moved;
    }
    let delta_e = |entry: u32| solved[entry as usize].as_ref().map_or(0.0, |r| r.delta_e);
    for place in places.iter().filter(|p| p.share == [0.0; 3]) {
        let by = delta_e(place.entry);
        if by > 0.0 {
            moved.pixels += 1;
            moved.delta_e = moved.delta_e.max(by);
        }
    }
    moved
}

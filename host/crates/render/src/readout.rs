//! What a sensor gives of its pixels: a region of interest, and binning.
//!
//! Digital binning averages n x n samples of one colour behind the converter and rounds to whole
//! DN; levels and range stay. Charge binning adds the charges of n x n pixels before they are
//! read: read noise counts once. It is a sensor of its own ([`charge_binned`]).

use camrig_base::{Dn, Error, ErrorCode, RawFrame, Result};
use camrig_camera::Camera;

/// A region of interest, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Region {
    /// The region of a frame: the same samples as without it.
    ///
    /// # Errors
    /// A region that is empty, not inside the frame, or does not start at a whole period of the
    /// colour filter pattern.
    pub fn of<S: Dn>(&self, frame: &RawFrame<S>) -> Result<RawFrame<S>> {
        let Self { x, y, width, height } = *self;
        let inside = |start: usize, length: usize, all: usize| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= all)
        };
        let region = format!("region {x},{y},{width},{height}");
        if !inside(x, width, frame.width) || !inside(y, height, frame.height) {
            return Err(Error::input(format!("{region} of {} x {}", frame.width, frame.height))
                .help("give a region inside the frame")
                .with_code(ErrorCode::RegionOutside));
        }
        let (step_x, step_y) = (frame.cfa.width, frame.cfa.height);
        if !x.is_multiple_of(step_x) || !y.is_multiple_of(step_y) {
            return Err(Error::unsupported(format!("{region} inside a period of {}", frame.cfa))
                .help(format!(
                    "start at multiples of {step_x} columns and {step_y} rows, as windows of \
                     sensors do"
                )));
        }
        let rows = frame.data.chunks_exact(frame.width).skip(y).take(height);
        let data = rows.flat_map(|row| &row[x..x + width]).copied().collect();
        Ok(RawFrame { width, height, data, ..without_data(frame) })
    }
}

/// What of a frame is read, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Readout {
    /// The region; all of the frame unless given.
    pub region: Option<Region>,
    /// Samples of one colour that are averaged, in a row and in a column; not binned unless given.
    pub binning: Option<u32>,
}

impl Readout {
    /// What is read of a frame.
    ///
    /// # Errors
    /// Those of [`Region::of`] and [`digitally_binned`].
    pub fn of<S: Dn>(&self, frame: RawFrame<S>) -> Result<RawFrame<S>> {
        let frame = match self.region {
            Some(region) => region.of(&frame)?,
            None => frame,
        };
        match self.binning {
            Some(n) => digitally_binned(&frame, n as usize),
            None => Ok(frame),
        }
    }

    /// First column and row that are read.
    pub fn begin(&self) -> [usize; 2] {
        self.region.map_or([0, 0], |r| [r.x, r.y])
    }

    /// Pixels that become one, in a row and in a column.
    pub fn side(&self) -> u32 {
        self.binning.unwrap_or(1)
    }
}

/// The mean of n x n samples of one colour each, rounded; what is left at the right and lower
/// border is dropped.
///
/// # Errors
/// A frame of less than n periods of the colour filter pattern.
pub fn digitally_binned<S: Dn>(frame: &RawFrame<S>, n: usize) -> Result<RawFrame<S>> {
    let (step_x, step_y) = (frame.cfa.width, frame.cfa.height);
    let side = |pixels: usize, step: usize| pixels / n.saturating_mul(step).max(1) * step;
    let (width, height) = (side(frame.width, step_x), side(frame.height, step_y));
    if n == 0 || width == 0 || height == 0 {
        return Err(Error::input(format!(
            "binning {n} x {n} of {} x {} pixels",
            frame.width, frame.height
        ))
        .help("bin fewer pixels together"));
    }
    let count = (n * n) as u64;
    let at = |place: usize, step: usize, i: usize| (place / step * n + i) * step + place % step;
    let mut data = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let mut sum = 0u64;
            for j in 0..n {
                let row = at(y, step_y, j) * frame.width;
                sum += (0..n)
                    .map(|i| u64::from(frame.data[row + at(x, step_x, i)].into()))
                    .sum::<u64>();
            }
            data.push(S::of(((sum + count / 2) / count).into()).unwrap_or_default());
        }
    }
    Ok(RawFrame { width, height, data, ..without_data(frame) })
}

fn without_data<S: Dn>(frame: &RawFrame<S>) -> RawFrame<S> {
    RawFrame {
        width: 0,
        height: 0,
        bits: frame.bits,
        cfa: frame.cfa.clone(),
        black_level_dn: frame.black_level_dn,
        white_level_dn: frame.white_level_dn,
        data: Vec::new(),
    }
}

/// The camera whose pixels are n x n pixels of `camera` with their charges added: n times the
/// pitch, dark current n², its scatter n, PRNU 1/n (independent pixels). Read noise, row pattern
/// and full well are those of one pixel: the node that is read stays the same. Fixed patterns are
/// drawn anew, with the same seed.
///
/// # Errors
/// Colour filters, effects or crosstalk of single pixels, or a side of less than n pixels.
pub fn charge_binned(camera: &Camera, n: u32) -> Result<Camera> {
    let refuse = |what: &str| {
        Error::unsupported(format!("charge binning of {what}")).help(
            "bin digitally, or take a monochrome camera without effects beyond the base model",
        )
    };
    if camera.sensor.hdr.is_some() {
        return Err(refuse("a sensor of several captures"));
    }
    if camera.sensor.cfa.letters.len() != 1 {
        return Err(refuse(&format!("the pattern {}", camera.sensor.cfa)));
    }
    if !camera.effects.is_empty() {
        return Err(refuse("a sensor with effects beyond the base model"));
    }
    if camera.sensor.differs_over_the_field() {
        return Err(refuse("a sensor whose response differs over the field"));
    }
    let mut binned = camera.clone();
    let sensor = &mut binned.sensor;
    (sensor.width, sensor.height) = (sensor.width / n.max(1), sensor.height / n.max(1));
    if n == 0 || sensor.width == 0 || sensor.height == 0 {
        return Err(Error::input(format!("charge binning {n} x {n}"))
            .help("bin fewer pixels together than the sensor has"));
    }
    let side = f64::from(n);
    sensor.pitch_um *= side;
    sensor.noise.dark_current_e_per_s *= side * side;
    sensor.noise.dsnu_e_per_s *= side;
    sensor.noise.prnu /= side;
    Ok(binned)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;
    use camrig_camera::Change;

    fn frame(cfa: &str) -> RawFrame {
        RawFrame {
            width: 12,
            height: 8,
            bits: 10,
            cfa: Cfa::parse(cfa).unwrap(),
            black_level_dn: 64.0,
            white_level_dn: 1023,
            data: (0..96).map(|i| (i % 12 * 10 + i / 12 * 3) as u16).collect(),
        }
    }

    #[test]
    fn a_region_has_the_samples_of_the_frame() {
        let whole = frame("RGGB");
        let part = Region { x: 4, y: 2, width: 5, height: 3 }.of(&whole).unwrap();
        assert_eq!((part.width, part.height, part.data.len()), (5, 3, 15));
        assert_eq!((part.data[0], part.data[14]), (46, 92));
        assert_eq!(part.cfa, whole.cfa);
        for (x, y, width, height) in [(4, 2, 9, 3), (12, 0, 1, 1), (0, 0, 0, 4)] {
            let error = Region { x, y, width, height }.of(&whole).unwrap_err().to_string();
            assert!(error.contains("12 x 8"), "{error}");
        }
        let odd = Region { x: 3, y: 2, width: 4, height: 4 };
        assert!(odd.of(&whole).unwrap_err().to_string().contains("multiples of 2 columns"));
        assert!(odd.of(&frame("mono")).is_ok());
        let huge = Region { x: 2, y: 0, width: usize::MAX, height: 1 };
        assert!(huge.of(&whole).is_err());
    }

    #[test]
    fn digital_binning_averages_samples_of_one_colour() {
        let mono = digitally_binned(&frame("mono"), 2).unwrap();
        assert_eq!((mono.width, mono.height), (6, 4));
        // 0, 10, 3, 13: 6.5 is rounded up.
        assert_eq!((mono.data[0], mono.data[1]), (7, 27));
        let colour = digitally_binned(&frame("RGGB"), 2).unwrap();
        assert_eq!((colour.width, colour.height), (6, 4));
        // Red at columns 0 and 2, rows 0 and 2; green beside it one column on.
        assert_eq!((colour.data[0], colour.data[1]), (13, 23));
        assert_eq!(digitally_binned(&frame("mono"), 1).unwrap(), frame("mono"));
        // 12 / 5 and 8 / 5.
        assert_eq!(digitally_binned(&frame("mono"), 5).unwrap().data.len(), 2);
        for n in [0, 9] {
            assert!(digitally_binned(&frame("mono"), n).is_err());
        }
    }

    #[test]
    fn charge_binning_is_a_sensor_of_larger_pixels() {
        let mono = [Change::new("sensor.cfa", "mono"), Change::new("sensor.qe", 0.5)];
        let camera = Camera::load_with("mt9v024", mono).unwrap();
        let binned = charge_binned(&camera, 2).unwrap();
        let (one, four) = (&camera.sensor, &binned.sensor);
        assert_eq!((four.width, four.height), (one.width / 2, one.height / 2));
        assert_eq!(four.pitch_um, 2.0 * one.pitch_um);
        assert_eq!(four.noise.dark_current_e_per_s, 4.0 * one.noise.dark_current_e_per_s);
        assert_eq!((four.noise.read_e, four.full_well_e), (one.noise.read_e, one.full_well_e));
        let colour = Camera::load("mt9t012").unwrap();
        assert!(charge_binned(&colour, 2).unwrap_err().to_string().contains("pattern"));
        assert!(charge_binned(&camera, 10_000).is_err());
    }
}

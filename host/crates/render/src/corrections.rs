//! What a factory calibration would hand to the raw converter: lens shading and bad pixels of a
//! camera, as DNG opcodes that undo them.

use super::reach::Sight;
use super::{SimulatedSensor, lens};
use camrig_base::Bands;
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_formats::opcodes::{Opcode, bad_pixels, gain_maps};
use camrig_optics::Options;
use camrig_sensor_core::config::FrameSettings;
use camrig_sensor_core::effects::{Class, Effect};

/// Opcodes of a camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Corrections {
    /// For DNG's OpcodeList1: bad pixels.
    pub list1: Vec<Opcode>,
    /// For DNG's OpcodeList2: gain maps, one per cell of the colour filter pattern.
    pub list2: Vec<Opcode>,
}

/// Wavelength at which the shading is taken, nm: the peak of vision.
const SHADING_NM: f64 = 555.0;
/// Relative illumination below which the gain grows no further: where a lens vignettes to black
/// there is only noise to amplify, and 100 is more gain than any raw converter is asked for.
const MIN_ILLUMINATION: f64 = 0.01;
/// Rows and columns of nodes of the gain map: those of the crosstalk table of Chen et al. 2009.
const NODES: [u32; 2] = [13, 17];
/// Deviation from the signal of a good pixel, relative to it, beyond which a pixel is listed as
/// bad. It trades pixels left in the picture against pixels interpolated for nothing: a tenth lies
/// above the pixel response non-uniformity of real sensors (a few per cent) and below what stands
/// out in a converted picture.
const BAD: f64 = 0.1;

/// The corrections for frames taken with `settings` (hot pixels come and go with exposure and
/// temperature).
pub fn corrections(camera: &Camera, settings: &FrameSettings) -> Result<Corrections> {
    let list1 = bad_pixels(&camera.sensor.cfa, bad_points(camera, settings)?);
    Ok(Corrections { list1: list1.into_iter().collect(), list2: shading(camera)? })
}

/// Gains that undo the lens's relative illumination; none where it has none.
fn shading(camera: &Camera) -> Result<Vec<Opcode>> {
    let sensor = &camera.sensor;
    let band = Bands { start_nm: SHADING_NM, step_nm: 10.0, count: 1 };
    let lens = lens(camera, &band, &Options::default())?;
    let Some(illumination) = lens.illumination(SHADING_NM) else { return Ok(Vec::new()) };
    let size = [sensor.width as usize, sensor.height as usize];
    let [width_mm, height_mm] = size.map(|n| n as f64 * sensor.pitch_um * 1e-3);
    let (axis_x, axis_y) = lens.axis_mm();
    let gain = |x: f64, y: f64| {
        let ratio = illumination.at((x - 0.5) * width_mm - axis_x, (y - 0.5) * height_mm - axis_y);
        1.0 / ratio.max(MIN_ILLUMINATION)
    };
    Ok(gain_maps(&sensor.cfa, size, NODES, gain))
}

/// (row, column) of the pixels that the defect effects move by more than [`BAD`] in a frame
/// without noise lit evenly to half the full well.
fn bad_points(camera: &Camera, settings: &FrameSettings) -> Result<Vec<(u32, u32)>> {
    let is_defect = |effect: &Effect| effect.class() == Class::Defect;
    let sensor = &camera.sensor;
    let all = [0.0, f64::INFINITY];
    let bands = Sight::new(camera, None).bands(all).unwrap_or(Bands::VISIBLE);
    let header =
        CubeHeader::new((sensor.width as usize, sensor.height as usize), &bands, "even light");
    let mut simulated = SimulatedSensor::new(camera, &header)?;
    let per_channel = sensor.response(&bands);
    let strongest = per_channel.iter().map(|r| r.iter().sum::<f64>()).fold(0.0, f64::max);
    let half = 0.5 * sensor.full_well_e
        / (strongest * f64::from(settings.exposure_s) * f64::from(settings.analog_gain).max(1.0));
    let cube = IrradianceCube::uniform(header, &vec![half as f32; bands.count])?;
    simulated.config.effects =
        simulated.config.effects.iter().filter(|e| is_defect(e)).copied().collect();
    if simulated.config.effects.is_empty() {
        return Ok(Vec::new());
    }
    let with = simulated.frame(&cube, settings)?;
    simulated.config.effects.clear();
    let without = simulated.frame(&cube, settings)?;
    let is_bad = |(with, without): (&u16, &u16)| {
        let signal = f64::from(*without) - sensor.black_level_dn;
        (f64::from(*with) - f64::from(*without)).abs() > BAD * signal
    };
    let width = sensor.width as usize;
    let pixels = with.data.iter().zip(&without.data).enumerate();
    Ok(pixels
        .filter(|(_, pair)| is_bad(*pair))
        .map(|(i, _)| ((i / width) as u32, (i % width) as u32))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor_grid;
    use camrig_sensor_core::effects::stuck_pixels::StuckPixels;

    const WIDTH: u32 = 128;
    const HEIGHT: u32 = 96;

    /// The preset `mt9t012` on fewer, larger pixels.
    fn camera() -> Camera {
        let mut camera = Camera::load("mt9t012").unwrap();
        camera.sensor.pitch_um *= f64::from(camera.sensor.width) / f64::from(WIDTH);
        (camera.sensor.width, camera.sensor.height) = (WIDTH, HEIGHT);
        camera
    }

    /// Gain times illumination is 1 all over, to what bilinear interpolation leaves: h²/8 of the
    /// second derivative of (1 + (r/f)²)² in each direction, at most 8/f² for r/f up to 1/√3, over
    /// gains of 1 to 1.8, with h = 4.5 mm / 16 and f = 4.9 mm: 0.4 % at most.
    #[test]
    fn shading_is_undone() {
        let camera = camera();
        let maps = corrections(&camera, &camera.settings(0, 0.01, None)).unwrap().list2;
        assert_eq!(maps.len(), 4);
        let lens = lens(&camera, &Bands::VISIBLE, &Options::default()).unwrap();
        let illumination = lens.illumination(SHADING_NM).unwrap();
        let pitch_mm = sensor_grid(&camera).pitch_um * 1e-3;
        let Opcode::GainMap(map) = &maps[3] else { panic!("{maps:?}") };
        assert_eq!((map.area, map.pitch), ([1, 1, HEIGHT, WIDTH], [2, 2]));
        let gain = |u: f64, v: f64| {
            let (x, y) = (u / map.spacing[1], v / map.spacing[0]);
            let (left, top) = (x.floor().min(15.0), y.floor().min(11.0));
            let at =
                |dx: f64, dy: f64| f64::from(map.gains[((top + dy) * 17.0 + left + dx) as usize]);
            let (s, t) = (x - left, y - top);
            (1.0 - t) * ((1.0 - s) * at(0.0, 0.0) + s * at(1.0, 0.0))
                + t * ((1.0 - s) * at(0.0, 1.0) + s * at(1.0, 1.0))
        };
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                let (right, down) = (x - f64::from(WIDTH) / 2.0, y - f64::from(HEIGHT) / 2.0);
                let ratio = illumination.at(right * pitch_mm, down * pitch_mm);
                let flat = gain(x / f64::from(WIDTH), y / f64::from(HEIGHT)) * ratio;
                assert!((flat - 1.0).abs() < 0.004, "{x} {y}: {flat}");
            }
        }
    }

    /// The pixels listed are those, and only those, that are stuck white in a real frame of the
    /// dark.
    #[test]
    fn bad_pixels_are_those_of_the_frame() {
        let mut camera = camera();
        camera.effects.push(StuckPixels { fraction: 0.003, level: 1.0 }.into());
        camera.sensor.noise.read_e = 5.0;
        let settings = camera.settings(3, 0.01, None);
        let found = corrections(&camera, &settings).unwrap().list1;
        let Opcode::FixBadPixelsList { bayer_phase: 1, points } = &found[0] else {
            panic!("{found:?}")
        };
        // 12288 pixels x 0.003: 37 on average, 6 standard deviations about it.
        assert!((5..74).contains(&points.len()), "{}", points.len());
        let header = CubeHeader::new(
            (WIDTH as usize, HEIGHT as usize),
            &Bands { start_nm: 550.0, step_nm: 10.0, count: 1 },
            "dark",
        );
        let cube = IrradianceCube::uniform(header.clone(), &[0.0]).unwrap();
        let simulated = SimulatedSensor::new(&camera, &header).unwrap();
        let frame = simulated.frame(&cube, &settings).unwrap();
        let white: Vec<(u32, u32)> = (0..HEIGHT)
            .flat_map(|y| (0..WIDTH).map(move |x| (y, x)))
            .filter(|(y, x)| frame.data[(y * WIDTH + x) as usize] > 500)
            .collect();
        assert_eq!(&white, points);
    }

    #[test]
    fn a_camera_without_faults_needs_no_corrections() {
        let mut camera = camera();
        if let camrig_camera::LensKind::DiffractionLimited { relative_illumination, .. } =
            &mut camera.lens.kind
        {
            *relative_illumination = camrig_camera::RelativeIllumination::Flat;
        }
        let found = corrections(&camera, &camera.settings(0, 0.01, None)).unwrap();
        assert_eq!(found, Corrections::default());
    }
}

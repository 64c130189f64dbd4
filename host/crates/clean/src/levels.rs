//! The signal of flats against their stated light: the points that [`super::labels`] tests.

use super::scan::Scan;
use super::transfer::{Point, Transfer};
use camrig_captures::{Capture, CaptureSet, Light, Role};

/// Share of saturated samples from which a flat is left out: its mean is too low for its light.
const SATURATED: f64 = 1e-5;
/// Variance relative to the dark's from which it is mainly shot noise.
const SHOT_NOISE: f64 = 2.0;

/// The signal of a flat.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Level {
    pub capture: usize,
    /// Stated light × exposure.
    pub x: f64,
    pub exposure_s: f64,
    /// Mean above dark, DN.
    pub y: f64,
    /// Its standard error, DN.
    pub se: f64,
    /// Variance above the dark's over y, DN; `None` where there is too little shot noise.
    pub slope: Option<f64>,
}

/// The levels of a set, in series taken with one lamp and the same settings.
pub(crate) fn series(set: &CaptureSet, scans: &[Scan], transfer: &Transfer) -> Vec<Vec<Level>> {
    let mut series: Vec<(&Capture, Vec<Level>)> = Vec::new();
    for (i, scan) in scans.iter().enumerate() {
        let capture = &set.captures[scan.capture];
        let Some(level) = level(set, scans, transfer, i) else { continue };
        match series.iter_mut().find(|(c, _)| same_lamp(c, capture)) {
            Some((_, levels)) => levels.push(level),
            None => series.push((capture, vec![level])),
        }
    }
    series.into_iter().map(|(_, levels)| levels).collect()
}

/// Whether two flats were taken in the same light with the same settings. The response to light
/// does not depend on temperature to speak of, and cameras warm up while flats are taken.
fn same_lamp(a: &Capture, b: &Capture) -> bool {
    let light = |c: &Capture| {
        let light = c.light.as_ref()?;
        Some((light.wavelength_nm, amount(light)?.0))
    };
    a.analog_gain == b.analog_gain && light(a) == light(b)
}

/// The stated amount of light of a capture: which of the units is stated, and how much. Of several
/// it is the one that measurements use.
fn amount(light: &Light) -> Option<(usize, f64)> {
    let stated = [light.photons_per_pixel_per_s, light.irradiance_w_m2, light.lux];
    stated.into_iter().enumerate().find_map(|(unit, amount)| Some((unit, amount?)))
}

fn level(set: &CaptureSet, scans: &[Scan], transfer: &Transfer, i: usize) -> Option<Level> {
    let scan = &scans[i];
    let capture = &set.captures[scan.capture];
    if capture.role != Role::Flat || scan.saturated(set.sensor.white_level_dn) > SATURATED {
        return None;
    }
    let x = amount(capture.light.as_ref()?)?.1 * capture.exposure_s;
    let dark = dark(set, scans, transfer, capture)?;
    let Point { level_dn: mean, variance_dn2: variance } = transfer.points[i];
    let (y, n) = (mean - dark.level_dn, scan.frames.len() as f64);
    let pixels = (set.sensor.width * set.sensor.height) as f64;
    // The larger of shot and read noise and the scatter of the frames' means.
    let own = (variance.max(0.0) / (n * pixels)).sqrt();
    let of_frames = (0..scan.frames.len()).map(|f| (scan.level(f) - mean).powi(2)).sum::<f64>();
    let of_frames = (of_frames / (n * (n - 1.0).max(1.0))).sqrt();
    let excess = variance - dark.variance_dn2;
    (x > 0.0 && y > 0.0).then_some(Level {
        capture: scan.capture,
        x,
        exposure_s: capture.exposure_s,
        y,
        se: own.max(of_frames).max(1e-6 * y),
        slope: (excess > SHOT_NOISE * dark.variance_dn2).then_some(excess / y),
    })
}

/// The dark at a capture's gain and temperature, or at any where there is none, interpolated between
/// the exposures on either side of its own.
fn dark(set: &CaptureSet, scans: &[Scan], transfer: &Transfer, of: &Capture) -> Option<Point> {
    let usable = scans.iter().zip(&transfer.points).filter(|(s, _)| {
        let c = &set.captures[s.capture];
        // Those after light may hold an after-image.
        c.role == Role::Dark && c.analog_gain == of.analog_gain && c.preceded_by.is_none()
    });
    let usable: Vec<(&Capture, Point)> =
        usable.map(|(s, p)| (&set.captures[s.capture], *p)).collect();
    let same = |c: &Capture| c.temperature_c == of.temperature_c;
    let any = !usable.iter().any(|(c, _)| same(c));
    let own = usable.into_iter().filter(|(c, _)| any || same(c));
    let mut darks: Vec<(f64, Point)> = own.map(|(c, p)| (c.exposure_s, p)).collect();
    darks.sort_by(|a, b| a.0.total_cmp(&b.0));
    let t = of.exposure_s;
    let (first, last) = (*darks.first()?, *darks.last()?);
    if darks.len() == 1 || t <= first.0 {
        return Some(first.1);
    }
    if t >= last.0 {
        return Some(last.1);
    }
    let after = darks.iter().position(|d| d.0 > t)?;
    let ((t0, a), (t1, b)) = (darks[after - 1], darks[after]);
    let share = (t - t0) / (t1 - t0);
    Some(Point {
        level_dn: a.level_dn + share * (b.level_dn - a.level_dn),
        variance_dn2: a.variance_dn2 + share * (b.variance_dn2 - a.variance_dn2),
    })
}

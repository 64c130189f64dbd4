use super::*;
use crate::engine::{OverField, irradiance};
use crate::{Characterisation, Diffraction, Illumination};
use camrig_base::Spectrum;
use camrig_scene::{Grid, Quantity, Scene};

const BANDS: Bands = Bands { start_nm: 400.0, step_nm: 50.0, count: 7 };
const COMPONENTS: usize = 3;

/// The spectrum of component k; those beyond the first have both signs.
fn basis(k: usize, band: usize) -> f64 {
    [1.0, 0.3 - 0.1 * band as f64, if band % 3 == 1 { 0.4 } else { -0.2 }][k]
}

/// Bars, squares and a disc, so that components have edges of their own at every angle.
fn component(k: usize, u: f64, v: f64) -> f64 {
    let bar = |x: f64, period: f64| if (x / period).rem_euclid(1.0) < 0.5 { 1.0 } else { 0.0 };
    match k {
        0 => 1.0 + bar(u + 0.3 * v, 0.17),
        1 => bar(u, 0.11) * bar(v, 0.23),
        _ => f64::from(u8::from(u.hypot(v) < 0.3)),
    }
}

/// The components themselves, or the bands that are their mixtures.
struct Picture {
    mixed: bool,
}

impl Scene for Picture {
    fn bands(&self) -> Bands {
        if self.mixed { BANDS } else { Bands { count: COMPONENTS, ..BANDS } }
    }
    fn quantity(&self) -> Quantity {
        Quantity::Radiance
    }
    fn aspect(&self) -> Option<f64> {
        None
    }
    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        let place = |i: usize, edge: f64| edge + (i as f64 + 0.5) * grid.cell;
        Ok(Plane::from_fn(grid.width, grid.height, |x, y| {
            let (u, v) = (place(x, grid.left), place(y, grid.top));
            let value = match self.mixed {
                true => (0..COMPONENTS).map(|k| basis(k, band) * component(k, u, v)).sum(),
                false => component(band, u, v),
            };
            value as f32
        }))
    }
}

fn lit(scene: &Picture) -> LitScene<'_> {
    LitScene { scene, white: vec![1.0; scene.bands().count] }
}

/// What a channel takes of a band; the last band counts for none.
fn response(channel: usize, band: usize) -> f64 {
    if band == 6 { 0.0 } else { (-(band as f64 - 1.0 - 2.0 * channel as f64).powi(2)).exp() }
}

fn mixture() -> Mixture {
    let weight = |c: usize, k: usize| (0..7).map(|b| response(c, b) * basis(k, b)).collect();
    let weights = (0..3).map(|c| (0..COMPONENTS).map(|k| weight(c, k)).collect()).collect();
    Mixture { bands: BANDS, weights }
}

const GRID: SensorGrid = SensorGrid { width: 96, height: 72, pitch_um: 4.0, fill_factor: 0.8 };

fn options() -> Options {
    Options { oversample: Some(2), ..Options::default() }
}

/// Channels band by band.
fn exact(lens: &dyn Lens) -> Vec<Plane<f32>> {
    let mut sums = vec![Plane::filled(GRID.width, GRID.height, 0.0f64); 3];
    let add = |band: usize, plane: Plane<f32>| {
        for (c, sum) in sums.iter_mut().enumerate() {
            let values = sum.data.iter_mut().zip(&plane.data);
            values.for_each(|(s, v)| *s += response(c, band) * f64::from(*v));
        }
        Ok(())
    };
    irradiance(&lit(&Picture { mixed: true }), lens, &GRID, &options(), |_, _| (), add).unwrap();
    sums.iter()
        .map(|s| Plane::from_fn(GRID.width, GRID.height, |x, y| s.at(x, y) as f32))
        .collect()
}

fn collapsed(lens: &dyn Lens) -> (Vec<Plane<f32>>, Collapsed) {
    let mut collapsed = Collapsed::new(lens, &GRID, &options(), &mixture()).unwrap();
    let planes = collapsed.channels(&lit(&Picture { mixed: false })).unwrap();
    (planes, collapsed)
}

/// Largest difference of any channel, in parts of its peak.
fn difference(found: &[Plane<f32>], exact: &[Plane<f32>]) -> f64 {
    let of_channel = |(found, exact): (&Plane<f32>, &Plane<f32>)| {
        let peak = exact.data.iter().fold(0.0f32, |m, v| m.max(*v));
        let apart = found.data.iter().zip(&exact.data).map(|(a, b)| (a - b).abs());
        f64::from(apart.fold(0.0, f32::max) / peak)
    };
    assert_eq!(found.len(), exact.len());
    found.iter().zip(exact).map(of_channel).fold(0.0, f64::max)
}

/// A lens whose PSFs change over field and wavelength and reach equally far in all bands, so that
/// bands have the same nodes. Each is an even disc with a spot in it that grows with height.
fn lens(lateral: f64) -> Characterisation {
    let mut lens = Characterisation::example(33, 0.75);
    lens.real_height_mm = lens
        .heights_mm
        .iter()
        .flat_map(|&h| [-1.0, 0.0, 1.0].map(|w| h * (1.0 - 0.2 * h * h + lateral * w)))
        .collect();
    let mut data = Vec::new();
    for &h in &lens.heights_mm {
        for share in [0.3, 0.5, 0.8] {
            let sigma = 1.0 + 4.0 * h + share;
            for k in 0..33 * 33 {
                let (y, x) = ((k / 33) as f64 - 16.0, (k % 33) as f64 - 16.0);
                let spot = (-0.5 * (x * x + y * y) / (sigma * sigma)).exp();
                let disc = if x.hypot(y) <= 14.5 { 1.0 / 660.0 } else { 0.0 };
                let inside =
                    if disc > 0.0 { spot / (std::f64::consts::TAU * sigma * sigma) } else { 0.0 };
                data.push((share * inside + (1.0 - share) * disc) as f32);
            }
        }
    }
    lens.psf.data = data;
    lens.psf.normalise().unwrap();
    lens
}

#[test]
fn channels_are_those_of_the_bands_where_these_share_one_mapping() {
    let lens = lens(0.0);
    let (found, collapsed) = collapsed(&lens);
    let worst = difference(&found, &exact(&lens));
    println!("one mapping: {worst:.1e} of the peak; {:?}", collapsed.report());
    assert!(worst < 1e-5, "{worst}");
    assert_eq!(collapsed.lateral_um(), 0.0);
    assert!(collapsed.report().nodes.is_some());
}

/// A lens that maps all bands as the middle one.
struct OneMapping(Characterisation);

impl Lens for OneMapping {
    fn steradians(&self, nm: f64) -> f64 {
        self.0.steradians(nm)
    }
    fn illumination(&self, nm: f64) -> Option<OverField<'_, f64>> {
        Lens::illumination(&self.0, nm)
    }
    fn ideal_place(&self, _: f64) -> Option<OverField<'_, (f64, f64)>> {
        self.0.ideal_place(550.0)
    }
    fn principal_distance_mm(&self) -> f64 {
        self.0.principal_distance_mm()
    }
    fn blur(&self, nm: f64) -> Blur<'_> {
        self.0.blur(nm)
    }
}

#[test]
fn lateral_colour_is_kept() {
    // At the corner, 0.24 mm, the outermost of the six bands that count land 0.02·(5/6) of that
    // apart: 4 µm, a pixel.
    let lens = lens(0.01);
    let exact = exact(&lens);
    let (found, collapsed) = collapsed(&lens);
    let corner = 1e3 * GRID.corner_mm() * 0.02 * 5.0 / 6.0;
    let lateral = collapsed.lateral_um();
    assert!((lateral / corner - 1.0).abs() < 0.1, "{lateral} for {corner}");
    let worst = difference(&found, &exact);
    let without = difference(&self::collapsed(&OneMapping(self::lens(0.01))).0, &exact);
    println!("a pixel of lateral colour: {worst:.1e} of the peak, {without:.1e} were it dropped");
    // A shifted kernel between nodes is a blend, wrong by δ²/8 of the PSF's second derivative, and
    // the scene is interpolated elsewhere.
    assert!(worst < 1e-2 && worst < without / 4.0, "{worst}, {without}");
}

fn diffraction() -> Diffraction {
    Diffraction {
        f_number: 2.8,
        focal_length_mm: 4.0,
        magnification: 0.0,
        transmittance: Spectrum::new(vec![400.0, 700.0], vec![0.5, 0.9]).unwrap(),
        illumination: Illumination::Cos4,
        defocus_um: 0.0,
    }
}

#[test]
fn one_blur_for_the_whole_field_collapses_too() {
    let lens = diffraction();
    let (found, collapsed) = collapsed(&lens);
    let worst = difference(&found, &exact(&lens));
    println!("diffraction: {worst:.1e} of the peak; {:?}", collapsed.report());
    // Bands have margins of their own, in which light beyond them is folded back.
    assert!(worst < 1e-3, "{worst}");
}

#[test]
fn the_number_of_threads_does_not_matter_and_a_frame_is_repeatable() {
    for lens in [&lens(0.01) as &dyn Lens, &diffraction()] {
        let run = |threads: usize| {
            let options = Options { threads: Some(threads), ..options() };
            let mut collapsed = Collapsed::new(lens, &GRID, &options, &mixture()).unwrap();
            let mut frame = || {
                let planes = collapsed.channels(&lit(&Picture { mixed: false })).unwrap();
                planes.into_iter().map(|p| p.data).collect::<Vec<_>>()
            };
            [frame(), frame()]
        };
        let [first, again] = run(1);
        assert!(first == again);
        assert!(first == run(3)[0]);
    }
}

#[test]
fn what_cannot_be_collapsed_is_refused() {
    struct Coloured(Diffraction);
    impl Lens for Coloured {
        fn steradians(&self, nm: f64) -> f64 {
            self.0.steradians(nm)
        }
        fn illumination(&self, nm: f64) -> Option<OverField<'_, f64>> {
            self.0.illumination(nm)
        }
        fn ideal_place(&self, nm: f64) -> Option<OverField<'_, (f64, f64)>> {
            Some(OverField::Radial(Box::new(move |h| h * (1.0 + 1e-5 * nm))))
        }
        fn principal_distance_mm(&self) -> f64 {
            4.0
        }
        fn blur(&self, nm: f64) -> Blur<'_> {
            self.0.blur(nm)
        }
    }
    let said = |lens: &dyn Lens, mixture: &Mixture| {
        Collapsed::new(lens, &GRID, &options(), mixture).err().unwrap().to_string()
    };
    let text = said(&Coloured(diffraction()), &mixture());
    assert!(text.contains("lateral colour"), "{text}");
    let nothing = Mixture { bands: BANDS, weights: vec![vec![vec![0.0; 7]]] };
    assert!(said(&diffraction(), &nothing).contains("no channel"));
}

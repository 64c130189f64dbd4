//! Two-dimensional fields of a tilted lens against another tracer.

use super::*;
use crate::{Catalogue, Conditions, characterise};
use camrig_lens_files::seq;

fn system(text: &str) -> System {
    System::new(seq::read(text, &Catalogue::default()).unwrap(), Conditions::default()).unwrap()
}

fn traced(system: &System, fields: &[[f64; 2]], nm: f64) -> Vec<Point> {
    points(system, &Map::of(system).unwrap(), fields, &[nm]).unwrap()
}

/// Every way in which `.seq` tilts and decentres: a lens in `DAR` about all axes, a mirror in
/// `BEN`, a plain decentre of a lens behind it, and of the image.
pub(super) const TILTED: &str = "RDM;LEN
TITLE 'tilted and decentred'
EPD 8.0
DIM M
WL 587.5618
XAN 0.0 3.0 -2.0
YAN 0.0 2.0 5.0
SO 0.0 1e13
S 60.0 5.0 620.603
S -90.0 3.0
S 0.0 4.0
  STO
S -40.0 2.0 620.364
  XDE 0.3; YDE -0.5; ZDE 0.1; ADE 2.5; BDE -1.5; CDE 4.0
  DAR
S 45.0 6.0
S 0.0 -20.0 REFL
  ADE 40.0; BEN
S -80.0 -5.0 517.642
  XDE -0.4; ADE 3.0; BDE 1.0
S 50.0 -60.0
SI 0.0 0.0
  ADE 2.0; XDE 0.5
GO
";

/// Chief rays of the same file read and traced by ray-optics 0.9.8 (`trace` on the chief ray aimed
/// at the centre of the stop): place and direction on the image.
#[test]
fn a_tilted_seq_file_traces_as_in_ray_optics() {
    let system = system(TILTED);
    assert!(system.prescription.asymmetry().unwrap().starts_with("surface 4 is tilted"));
    let fields = system.field_places_deg().unwrap();
    assert_eq!(fields, [[0.0, 0.0], [3.0, 2.0], [-2.0, 5.0]]);
    let right = [
        ([-0.862511712, 5.377990972], [-0.017388448, 0.103405718, 0.994487254]),
        ([3.084770118, 8.001869210], [0.011851717, 0.122318253, 0.992420164]),
        ([-3.490147181, 11.961530039], [-0.036428289, 0.150004157, 0.988014035]),
    ];
    for (point, (place, d)) in traced(&system, &fields, 587.5618).iter().zip(right) {
        let angles = [0, 1].map(|k| libm::atan2(d[k], d[2]).to_degrees());
        assert!(distance(point.chief_mm, place) < 1e-6, "{point:?}");
        assert!(distance(point.cra_deg, angles) < 1e-6, "{point:?}");
        assert!((0.9..1.1).contains(&point.relative_illumination), "{point:?}");
    }
}

#[test]
fn what_has_no_two_dimensional_figures_is_refused_in_words() {
    let tilted = TILTED.replace("XAN", "XRI").replace("YAN", "YRI");
    let error = system(&tilted).field_places_deg().unwrap_err().to_string();
    assert!(error.contains("image heights"), "{error}");
    let lens = system(TILTED);
    let error = characterise::field_points(&lens, &[0.0], &[587.6]).unwrap_err();
    assert_eq!(error.code(), Some(camrig_base::ErrorCode::AsymmetricLens));
    assert!(error.to_string().contains("surface 4 is tilted"), "{error}");
    let map = Map::of(&lens).unwrap();
    for field in [[90.0, 0.0], [60.0, 60.0], [f64::NAN, 0.0]] {
        assert!(points(&lens, &map, &[field], &[587.6]).is_err(), "{field:?}");
    }
    let bend = TILTED.replace("ADE 40.0; BEN", "ADE 40.0; BDE 1; BEN");
    let error = seq::read(&bend, &Catalogue::default()).unwrap_err().to_string();
    assert!(error.contains("BEN") && error.contains("surface 6 (line 17)"), "{error}");
}

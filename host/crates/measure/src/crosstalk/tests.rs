//! A hidden table through the bench and back.

use super::*;
use camrig_camera::Camera;
use camrig_capture::bench;

/// A factor of a hidden table: falls with a power of the cosine of the tilt, differently per
/// channel and wavelength, and leans to one side.
fn truth(channel: &str, nm: f64, x: f64, y: f64) -> f64 {
    let steepness = match channel {
        "r" => 1.0,
        "g" => 1.6,
        _ => 2.2,
    };
    let tilt = 0.52 * (0.64 * x * x + 0.36 * y * y).sqrt();
    tilt.cos().powf(steepness * (1.6 - nm / 1000.0)) + 0.02 * x
}

fn hidden() -> String {
    let mut table = String::from("channel,wavelength_nm,x,y,factor\n");
    for channel in ["r", "g", "b"] {
        for nm in bench::FILTERS_NM {
            for j in 0..13 {
                for i in 0..17 {
                    let (x, y) = (f64::from(i) / 8.0 - 1.0, f64::from(j) / 6.0 - 1.0);
                    table.push_str(&format!(
                        "{channel},{nm},{x},{y},{}\n",
                        truth(channel, nm, x, y)
                    ));
                }
            }
        }
    }
    table
}

#[test]
fn hidden_table_comes_back() {
    let directory = tempfile::tempdir().unwrap();
    let table = hidden();
    let mut camera = Camera::load("mt9t012").unwrap();
    (camera.sensor.width, camera.sensor.height) = (272, 208);
    let letters = camera.sensor.channel_names.clone();
    let parsed = camrig_camera::CrosstalkTable::parse(&table).unwrap();
    camera.sensor.crosstalk = Some(parsed.for_channels(&letters).unwrap());
    let out = directory.path().join("bench");
    bench::bench(&camera, 100, 0.01, &out, false, 0, || ()).unwrap();
    let set = CaptureSet::load(&out).unwrap();
    let result = fit(&set).unwrap();
    assert_eq!(result.nodes.len(), 3 * 7 * 13 * 17);
    let (mut worst, mut inside, mut count) = (0.0f64, 0u32, 0u32);
    for n in &result.nodes {
        let error = n.factor.value - truth(&n.channel, n.wavelength_nm, n.x, n.y);
        worst = worst.max(error.abs());
        if n.factor.std_error > 0.0 {
            count += 1;
            inside += u32::from(error.abs() <= 2.0 * n.factor.std_error);
        }
    }
    let share = f64::from(inside) / f64::from(count);
    println!("worst {worst:.4}, within two errors {share:.3}, {:?}", result.consistency);
    assert!(worst < 0.01, "{worst}");
    // A channel's nodes share their pixels at all wavelengths, and a surface's nodes its terms:
    // some thirty independent figures, whose share scatters by 4 % about 95 %. `surface` has the
    // coverage over many draws.
    assert!(share > 0.85, "{share}");
    assert!(result.consistency.iter().all(|c| c.chi2_per_sample < 1.5));
    // The table loads as a camera's.
    camrig_camera::CrosstalkTable::parse(&to_csv(&result)).unwrap();

    // Missing nodes are interpolated, with a note.
    let mut some = set.clone();
    some.captures.retain(|c| !c.id.contains("grid-03-1"));
    let partial = fit(&some).unwrap();
    assert_eq!(partial.nodes.len(), result.nodes.len());
    assert_eq!(partial.nodes.iter().filter(|n| n.interpolated).count(), 3 * 7 * 7);
    assert!(partial.notes.iter().any(|n| n.contains("7 of 221 nodes interpolated")));
    for n in partial.nodes.iter().filter(|n| n.interpolated) {
        let error = n.factor.value - truth(&n.channel, n.wavelength_nm, n.x, n.y);
        assert!(error.abs() < 0.01, "{n:?}");
    }

    // A dark without its point is refused.
    some.captures.retain(|c| c.id != "dark-grid-00-01");
    let said = fit(&some).map(|_| ()).unwrap_err().to_string();
    assert!(said.contains("no dark capture at"), "{said}");
}

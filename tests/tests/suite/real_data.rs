//! Real scenes with a real quantum efficiency through the simulation, and real raw frames through
//! the readers.

use super::{camrig_ok, shared, small_camera};
use camrig::formats;

/// Mean DN of red, green and blue, from closed forms only (`tests/peers/real_scenes.py`).
const MEANS_DN: [(&str, [f64; 3]); 2] = [
    ("samson_hyperspectral_95x95.npz", [97.32, 80.39, 64.67]),
    ("fruitmcc_estimated_reflectance_316x338x31.npz", [93.23, 83.28, 67.82]),
];

/// Tolerance of the mean of a channel, DN. The shot noise of 430 e⁻ is 21 e⁻ or 3.3 DN, which is
/// 0.05 DN in the mean of 4800 pixels; this is three times that. The closed forms leave out blur,
/// which moves light to pixels of another colour. A mistake of 1 % in the light would be 0.3 to
/// 0.7 DN.
const TOLERANCE_DN: f64 = 0.15;

#[test]
fn real_scenes_have_the_means_of_closed_forms() {
    let Some(scenes) = shared("data/scenes") else { return };
    let Some(qe) = shared("data/sensors/onsemi_aptina_MT9V024_RGB.csv") else { return };
    let dir = tempfile::tempdir().unwrap();
    let camera = small_camera(160, 120, &[("qe", "\"qe.csv\""), ("cfa", "\"RGGB\"")]);
    std::fs::write(dir.path().join("c.toml"), camera).unwrap();
    std::fs::copy(qe, dir.path().join("qe.csv")).unwrap();
    for (file, expected) in MEANS_DN {
        let output = camrig_ok(
            dir.path(),
            &format!(
                "simulate --camera c.toml --scene {} --lux 300 --exposure 20ms -o out.dng \
                 --force --json",
                scenes.join(file).display()
            ),
        );
        let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        for (channel, expected) in ["r", "g", "b"].into_iter().zip(expected) {
            let figures = &object["frames"][0]["channels"][channel];
            let mean = figures["mean_dn"]["value"].as_f64().unwrap();
            println!("{file} {channel}: {mean:.2} DN, closed form {expected} DN");
            assert!((mean - expected).abs() < TOLERANCE_DN, "{file} {channel}: {mean}");
        }
    }
}

/// Sum, smallest and largest sample, and the means of the four cells of the Bayer pattern, by
/// NumPy. The patterns are known independently: GBRG for device A and GRBG for the crop of the
/// Pixel 4a. The two greens lie on a diagonal, and in device A, whose target is grey, they agree.
#[test]
fn real_raw_frames_are_read_as_numpy_reads_them() {
    let Some(raw) = shared("data/raw") else { return };
    let means_of = |data: &[u16], width: usize| {
        let mut sums = [[0.0f64; 2]; 4];
        for (i, &value) in data.iter().enumerate() {
            let [sum, count] = &mut sums[i / width % 2 * 2 + i % width % 2];
            *sum += f64::from(value);
            *count += 1.0;
        }
        sums.map(|[sum, count]| sum / count)
    };
    let device_a = [213.261_456, 111.215_469, 249.215_140, 213.444_678];
    let pixel_4a = [1604.210023, 1979.753861, 1989.203053, 1402.478877];
    for (file, size, sum, range, means) in [
        ("deviceA_iso_slantedbar_gbrg_574x212.npy", (212, 574), 23_946_274, (7, 374), device_a),
        ("deviceA_iso_slantedbar_gbrg_574x212.pgm", (212, 574), 23_946_274, (7, 374), device_a),
        ("pixel4a_dng_crop_grbg_258x258.npy", (258, 258), 116_081_722, (1319, 2175), pixel_4a),
    ] {
        let frames = formats::read(&raw.join(file)).unwrap();
        let plane = &frames.planes[0];
        assert_eq!((plane.width, plane.height), size, "{file}");
        assert_eq!(plane.data.iter().map(|&v| u64::from(v)).sum::<u64>(), sum, "{file}");
        let found = (plane.data.iter().min().copied(), plane.data.iter().max().copied());
        assert_eq!(found, (Some(range.0), Some(range.1)), "{file}");
        for (mean, expected) in means_of(&plane.data, plane.width).into_iter().zip(means) {
            assert!((mean - expected).abs() < 1e-6, "{file}: {mean}, {expected}");
        }
    }
}

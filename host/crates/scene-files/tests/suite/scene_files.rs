//! What files of spectral cubes say beside their samples: followed, told or refused.

use camrig_scene::{Grid, Quantity, Scene};
use camrig_scene_files::{open, open_file};
use camrig_testing::shared;
use std::path::Path;

/// Why a file is refused.
fn refused(spec: &str) -> String {
    open_file(spec).err().map(|e| e.to_string()).unwrap_or_default()
}

/// A file as NeXus has them, written by h5py (`make.py` beside it): links by path, of which one
/// leads nowhere, samples of half precision with the big end first, widths of bands beside their
/// centres.
#[test]
fn an_hdf5_file_with_links_is_read() {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/links.h5").display().to_string();
    for spec in [path.clone(), format!("{path}:array=entry/data/cube")] {
        let cube = open_file(&spec).unwrap();
        assert_eq!(cube.size(), (3, 2), "{spec}");
        for band in 0..4 {
            let plane = cube.band(10 * band).unwrap();
            for (i, got) in plane.data.iter().enumerate() {
                let right = (1 + i + band) as f32 / 40.0;
                // Half of the last of eleven bits.
                assert!((got / right - 1.0).abs() < 1.0 / 2048.0, "{spec}: {got}, {right}");
            }
        }
        let understood = cube.understood().join("\n");
        assert!(understood.contains("400 to 700 nm"), "{understood}");
        let notes = cube.notes().join("\n");
        assert!(notes.contains("not used: entry/data/bandwidth_nm"), "{notes}");
    }
}

#[test]
fn an_envi_header_that_cannot_be_right_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cube.hdr");
    let header = "ENVI\nsamples = 1\nlines = 1\nbands = 2\ndata type = 1\n\
                  file type = ENVI Standard\nbyte order = 0\ninterleave = bsq\n\
                  wavelength = {500, 600}\n\
                  wavelength units = Nanometers\n";
    std::fs::write(path.with_extension("img"), [0, 1, 0]).unwrap();
    let spec = path.display().to_string();
    let write = |text: &str| std::fs::write(&path, text).unwrap();
    write(header);
    let notes = open_file(&spec).unwrap().notes().join("\n");
    assert!(notes.contains("1 bytes behind the samples"), "{notes}");
    write(&format!("{header}Lines = 2\n"));
    assert!(refused(&spec).contains("\"lines\" has another value before"), "{}", refused(&spec));
    write(&format!("{header}lines = 1\n"));
    assert!(open_file(&spec).is_ok());
    for kind in ["FFT Result", "Meta File", "Classification"] {
        write(&header.replace("Standard", kind));
        assert!(refused(&spec).contains("file type = envi"), "{}", refused(&spec));
    }
}

#[test]
fn wrong_envi_headers_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cube.hdr");
    std::fs::write(dir.path().join("cube"), [0; 23]).unwrap();
    let good = "ENVI\nsamples = 3\nlines = 2\nbands = 4\ndata type = 1\nstart\n\
                wavelength = {400, 500, 600, 700}\n";
    let message = |text: &str| {
        std::fs::write(&path, text).unwrap();
        open(path.to_str().unwrap()).err().unwrap().to_string()
    };
    assert!(message(good).contains("23 bytes of data where 24"));
    assert!(message(&good.replace("ENVI", "IVNE")).contains("no ENVI header"));
    assert!(message(&good.replace("bands = 4", "")).contains("no key \"bands\""));
    assert!(message(&good.replace("type = 1", "type = 6")).contains("data type = 6"));
    assert!(message(&good.replace("start", "file compression = 1")).contains("compression"));
    let wavenumbers = good.replace("start", "wavelength units = Furlongs");
    assert!(message(&wavenumbers).contains("units = furlongs"));
    assert!(message(&good.replace("start", "quantity = albedo")).contains("quantity = albedo"));
    assert!(message(&good.replace("start", "byte order = 2")).contains("byte order = 2"));
    assert!(message(&good.replace("= 3", "= many")).contains("samples = many"));
    assert!(message(&good.replace('}', "")).contains("closing brace"));
    std::fs::write(dir.path().join("cube"), [0; 24]).unwrap();
    assert!(message(&good.replace(", 700", "")).contains("3 wavelengths for 4 bands"));
    std::fs::remove_file(dir.path().join("cube")).unwrap();
    assert!(message(good).contains("no data file"));
}

#[test]
fn what_an_envi_header_lacks_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cube.hdr");
    std::fs::write(dir.path().join("cube"), [0; 48]).unwrap();
    let header = "ENVI\nsamples = 3\nlines = 2\nbands = 4\ndata type = 12\n\
                  wavelength = {0.4, 0.5, 0.6, 0.7}\n";
    std::fs::write(&path, header).unwrap();
    let said = |spec: &str| open_file(spec).map(|cube| Scene::notes(&cube));
    let spec = path.display().to_string();
    let notes = said(&spec).unwrap().join("\n");
    for words in ["no interleave: bsq", "no byte order: 0", "micrometres, by their size"] {
        assert!(notes.contains(words), "{notes}");
    }
    assert!(!notes.contains("beside"), "{notes}");
    std::fs::write(path.with_extension("img"), [1; 48]).unwrap();
    let notes = said(&spec).unwrap().join("\n");
    assert!(notes.contains("cube.img lies beside the header, too"), "{notes}");
    let error = said(&format!("{spec}:axes=yxb")).err().unwrap().to_string();
    assert!(error.contains("axes means nothing for an ENVI file"), "{error}");
}

#[test]
fn gains_offsets_bad_bands_and_missing_data_count() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cube.hdr");
    // Reflectance 0.1, 0.2, 0.3, 0.4 from 400 to 700 nm as 2 sample - 0.1; one sample of 255.
    std::fs::write(path.with_extension("IMG"), [10, 15, 20, 25, 10, 15, 255, 25]).unwrap();
    let header = "\u{feff}ENVI\nsamples = 1\nlines = 2\nbands = 4\ndata type = 1\n\
                  interleave = bip\nwavelength = {400, 500, 600, 700,\n}\n\
                  data gain values = {0.02, 0.02, 0.02, 0.02}\n\
                  data offset values = {-0.1, -0.1, -0.1, -0.1}\n\
                  data ignore value = 255\nbbl = {1, 0, 1, 1}\n";
    std::fs::write(&path, header).unwrap();
    let scene = open(path.to_str().unwrap()).unwrap();
    // The bad band, the missing sample, and the unit of the wavelengths.
    assert_eq!(scene.notes().len(), 3, "{:?}", scene.notes());
    let grid = Grid { width: 1, height: 2, left: -0.5, top: -1.0, cell: 1.0 };
    // The bad band at 500 nm lies between its neighbours: on the line, as the truth does.
    for (band, expected) in [(10, [0.2, 0.05]), (25, [0.35, 0.2])] {
        let plane = scene.plane(band, &grid).unwrap();
        for (got, expected) in plane.data.iter().zip(expected) {
            assert!((got - expected).abs() < 1e-6, "{band}: {got} for {expected}");
        }
    }
}

/// A sample of 500 with a gain of 0.01 is 5, in the unit that the header or the name states.
#[test]
fn gains_of_radiance_in_an_envi_header_need_a_unit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cube.hdr");
    std::fs::write(path.with_extension("img"), [244, 1, 244, 1]).unwrap();
    let header = "ENVI\nsamples = 1\nlines = 1\nbands = 2\ndata type = 12\nbyte order = 0\n\
                  interleave = bsq\nquantity = radiance\nwavelength = {500, 600}\n\
                  wavelength units = Nanometers\n";
    let gains = "data gain values = {0.01, 0.01}\n";
    let titles = |unit: &str| format!("z plot titles = {{Wavelength (nm), Radiance {unit}}}\n");
    for (more, options, value) in [
        (gains.to_string(), ":unit=W/m2/sr/um", 0.005),
        (gains.to_string(), ":scale=0.001", 0.005),
        (format!("{gains}{}", titles("(W/(m2*um*sr))")), "", 0.005),
        (format!("{gains}{}", titles("[W/m2/sr/nm]")), "", 5.0),
        (titles("(uW/cm2/sr/nm)"), "", 5.0),
    ] {
        std::fs::write(&path, format!("{header}{more}")).unwrap();
        let cube = open_file(&format!("{}{options}", path.display())).unwrap();
        let got = cube.band(0).unwrap().data[0];
        assert!((got / value - 1.0).abs() < 1e-5, "{more}{options}: {got}");
    }
    // The title alone says radiance, and its unit, or not.
    let untold = header.replace("quantity = radiance\n", "");
    std::fs::write(&path, format!("{untold}z plot titles = {{Wavelength, uW/cm^2/SR/nm}}\n"))
        .unwrap();
    let cube = open_file(path.to_str().unwrap()).unwrap();
    assert_eq!(cube.quantity(), Quantity::Radiance);
    assert!((cube.band(0).unwrap().data[0] - 5.0).abs() < 1e-5);
    std::fs::write(&path, format!("{untold}z plot titles = {{Wavelength, Radiance}}\n")).unwrap();
    let error = refused(path.to_str().unwrap());
    assert!(error.contains("of unknown unit") && error.contains("unit=W/m2/sr/um"), "{error}");
    std::fs::write(&path, format!("{header}{gains}")).unwrap();
    let error = refused(path.to_str().unwrap());
    assert!(error.contains("unit=W/m2/sr/um"), "{error}");
    let twice = format!("{header}reflectance scale factor = 100\n");
    std::fs::write(&path, format!("{twice}{gains}")).unwrap();
    let spec = path.display().to_string();
    assert!(refused(&spec).contains("would both scale the samples"), "{}", refused(&spec));
    assert!(open_file(&format!("{spec}:scale=0.001")).is_ok());
    std::fs::write(&path, format!("{twice}data gain values = {{1, 1.0}}\n")).unwrap();
    let stated = open_file(&format!("{spec}:unit=W/m2/sr/nm")).unwrap();
    let got = stated.band(0).unwrap().data[0];
    assert!((got / 5.0 - 1.0).abs() < 1e-5, "{got}");
}

#[test]
fn the_line_gamma_of_a_radiance_picture_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("picture.hdr");
    for (gamma, told) in [("2.2", true), ("1.0", false)] {
        let mut bytes =
            format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nGAMMA={gamma}\n\n-Y 1 +X 1\n")
                .into_bytes();
        bytes.extend([128, 128, 128, 128]);
        std::fs::write(&path, bytes).unwrap();
        let notes = open_file(path.to_str().unwrap()).unwrap().notes().join("\n");
        assert_eq!(notes.contains("GAMMA=2.2 is not used"), told, "{notes}");
    }
}

/// Means over the middle half of the image at 550 nm, computed with NumPy from the same files
/// (for the 156-band cube from its two bands next to 550 nm; the mean over 10 nm differs by 1
/// %).
#[test]
fn real_cubes() {
    let Some(scenes) = shared("data/scenes") else { return };
    for (file, bands, mean, tolerance) in [
        ("fruitmcc_estimated_reflectance_316x338x31.npz", 31, 0.164_038_13, 1e-5),
        ("samson_hyperspectral_95x95.npz", 48, 0.088_530_13, 1e-2), // 401 to 889 nm: 410 to 880
        ("samson_hyperspectral_95x95.npz:array=cube31", 31, 0.088_530_13, 1e-5),
    ] {
        let scene = open(scenes.join(file).to_str().unwrap()).unwrap();
        assert_eq!(scene.bands().count, bands, "{file}");
        let top = -0.25 / scene.aspect().unwrap();
        let cell = 0.5 / 64.0;
        let height = (64.0 / scene.aspect().unwrap()).round() as usize;
        let grid = Grid { width: 64, height, left: -0.25, top, cell };
        let green = scene.bands().centres().position(|nm| nm == 550.0).unwrap();
        let plane = scene.plane(green, &grid).unwrap();
        let got = plane.data.iter().map(|&v| f64::from(v)).sum::<f64>() / plane.data.len() as f64;
        assert!((got / mean - 1.0).abs() < tolerance, "{file}: {got}");
    }
}

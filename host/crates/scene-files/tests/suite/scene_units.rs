//! What files of scenes say of their samples: units, calibrations, kinds, layers, pages.

use camrig_scene::cube::Cube;
use camrig_scene::{Quantity, Scene};
use camrig_scene_files::open_file;
use exr::prelude::*;
use png::chunk::{self, ChunkType};
use std::fs::File;
use std::path::Path;
use tiff::encoder::{TiffEncoder, colortype};
use tiff::tags::Tag;

fn opened(path: &Path, options: &str) -> Cube {
    open_file(&format!("{}:{options}", path.display())).unwrap()
}

/// Why a file is refused.
fn refused(path: &Path, options: &str) -> String {
    let opened = open_file(&format!("{}:{options}", path.display()));
    opened.err().map(|e| e.to_string()).unwrap_or_default()
}

fn notes(cube: &Cube) -> String {
    cube.notes().join("\n")
}

/// A grey PNG of 2 x 1 pixels.
fn grey(path: &Path, bits: png::BitDepth, samples: &[u8], chunks: &[(ChunkType, &[u8])]) {
    let mut info = png::Info::with_size(2, 1);
    (info.color_type, info.bit_depth) = (png::ColorType::Grayscale, bits);
    let encoder = png::Encoder::with_info(File::create(path).unwrap(), info).unwrap();
    let mut writer = encoder.write_header().unwrap();
    chunks.iter().for_each(|(kind, data)| writer.write_chunk(*kind, data).unwrap());
    writer.write_image_data(samples).unwrap();
}

/// Wavelengths that rise, with indices behind them that fall.
const BANDS: [&str; 3] = ["450nm_03.png", "550.5nm_02.png", "650 nm_01.png"];

#[test]
fn bands_of_a_folder_are_of_one_kind_and_named_by_wavelength() {
    use png::BitDepth::{Eight, Sixteen};
    let dir = tempfile::tempdir().unwrap();
    let at = |band: usize| dir.path().join(BANDS[band]);
    (0..3).for_each(|band| grey(&at(band), Eight, &[band as u8, 9], &[]));
    let cube = opened(dir.path(), "scale=0.1");
    assert!(cube.understood().join("\n").contains("3 bands, 450 to 650"));
    assert!((cube.band(cube.bands().count - 1).unwrap().data[0] - 0.2).abs() < 1e-6);
    assert_eq!(notes(&cube).matches("linear").count(), 0, "{}", notes(&cube));
    grey(&at(1), Sixteen, &[0, 1, 0, 9], &[]);
    let error = refused(dir.path(), "");
    assert!(error.contains("integers of 16 bits where others have integers of 8"), "{error}");

    grey(&at(1), Eight, &[1, 9], &[(chunk::sRGB, &[0])]);
    let cube = opened(dir.path(), "scale=0.1");
    assert!(notes(&cube).contains("1 band not linear"), "{}", notes(&cube));
    grey(&at(1), Eight, &[1, 9], &[(chunk::gAMA, &100_000u32.to_be_bytes())]);
    assert!(!notes(&opened(dir.path(), "scale=0.1")).contains("not linear"));
    grey(&at(1), Eight, &[1, 9], &[(chunk::pHYs, &[0, 0, 0, 2, 0, 0, 0, 1, 0])]);
    assert!(refused(dir.path(), "").contains("pHYs"), "{}", refused(dir.path(), ""));
    // Turned by a quarter.
    let exif: &[u8] = b"II\x2a\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    grey(&at(1), Eight, &[1, 9], &[(chunk::eXIf, exif)]);
    assert!(refused(dir.path(), "").contains("EXIF turns"), "{}", refused(dir.path(), ""));
}

/// 0.5 + 0.25 · sample.
#[test]
fn the_calibration_of_imagej_is_applied_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stack.tif");
    let write = |described: &str| {
        let mut encoder = TiffEncoder::new(File::create(&path).unwrap()).unwrap();
        for band in 0..2u8 {
            let mut image = encoder.new_image::<colortype::Gray8>(1, 1).unwrap();
            let text = format!("ImageJ=1.53\nimages=2\n{described}");
            image.encoder().write_tag(Tag::ImageDescription, text.as_str()).unwrap();
            image.write_data(&[band]).unwrap();
        }
    };
    let nm = "start_nm=400,step_nm=50";
    for (described, first, last) in
        [("cf=0\nc0=0.5\nc1=0.25\n", 0.5, 0.75), ("", 0.0, 1.0), ("cf=20\n", 0.0, 1.0)]
    {
        write(described);
        let cube = opened(&path, nm);
        let ends = [0, 1].map(|band| cube.band(band).unwrap().data[0]);
        assert_eq!(ends, [first, last], "{described}");
    }
    write("cf=3\nc0=0.5\nc1=0.25\n");
    assert!(refused(&path, nm).contains("cf=3"), "{}", refused(&path, nm));
    write("cf=0\nc0=0.5\nc1=0.25\n");
    let cube = opened(&path, &format!("{nm},scale=1"));
    assert!(notes(&cube).contains("ImageJ's calibration give way"), "{}", notes(&cube));
}

#[test]
fn pages_of_several_kinds_of_samples_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stack.tif");
    let mut encoder = TiffEncoder::new(File::create(&path).unwrap()).unwrap();
    encoder.write_image::<colortype::Gray16>(1, 1, &[1]).unwrap();
    encoder.write_image::<colortype::Gray32Float>(1, 1, &[1.0]).unwrap();
    drop(encoder);
    let error = refused(&path, "start_nm=400,step_nm=300");
    assert!(error.contains("real numbers of 32 bits"), "{error}");
}

/// An image of one pixel, with a channel of each name and value.
fn exr(path: &Path, channels: &[(&str, f32)], unit: Option<&str>) {
    let channel =
        |(name, value): &(&str, f32)| AnyChannel::new(*name, FlatSamples::F32(vec![*value]));
    let channels: Vec<_> = channels.iter().map(channel).collect();
    let mut attributes = LayerAttributes::named("render");
    if let Some(unit) = unit {
        let unit = AttributeValue::Text(unit.into());
        attributes.other.insert("emissiveUnits".into(), unit);
    }
    let channels = AnyChannels::sort(channels.into());
    let layer = Layer::new((1, 1), attributes, Encoding::UNCOMPRESSED, channels);
    Image::from_layer(layer).write().to_file(path).unwrap();
}

#[test]
fn units_and_names_of_spectral_channels_are_heeded() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cube.exr");
    let s0 = [("S0.400,0nm", 2.0), ("S0.450,0nm", 4.0)];
    for (unit, value) in [
        ("W.m^-2.sr^-1.nm^-1", 2.0),
        // As the library of the layout writes it.
        ("W.m^-2.sr^-1", 2.0),
        ("mW.m^-2.sr^-1.nm^-1", 0.002),
        ("mW.cm^-2.sr^-1.um^-1", 0.02),
        ("uW/cm^2/SR/nm", 0.02),
    ] {
        exr(&path, &s0, Some(unit));
        let cube = opened(&path, "");
        let found = cube.band(0).unwrap().data[0];
        assert!((found / value - 1.0).abs() < 1e-6, "{unit}: {found}");
    }
    exr(&path, &s0, Some("cd.m^-2.nm^-1"));
    assert!(refused(&path, "").contains("unit=W/m2/sr/um"), "{}", refused(&path, ""));
    exr(&path, &s0, Some("mW.m^-2.sr^-1.nm^-1"));
    let cube = opened(&path, "scale=1");
    assert_eq!(cube.band(0).unwrap().data[0], 2.0);
    assert!(notes(&cube).contains("gives way to the scale"), "{}", notes(&cube));

    exr(&path, &[("Radiance_400nm", 2.0), ("Radiance_700nm", 4.0)], None);
    assert!(refused(&path, "").contains("of unknown unit"), "{}", refused(&path, ""));
    assert_eq!(opened(&path, "unit=W/m2/sr/um").quantity(), Quantity::Radiance);
    exr(&path, &[("Irradiance.400nm", 2.0), ("Irradiance.700nm", 4.0)], None);
    assert!(refused(&path, "").contains("irradiance by its name"), "{}", refused(&path, ""));
    assert_eq!(opened(&path, "quantity=radiance").quantity(), Quantity::Radiance);
    exr(&path, &[("w400nm", 0.2), ("w700nm", 0.4)], None);
    assert!(notes(&opened(&path, "")).contains("reflectance is assumed"));
    assert!(!notes(&opened(&path, "quantity=reflectance")).contains("is assumed"));
}

#[test]
fn the_layer_with_the_picture_is_found_and_the_others_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("render.exr");
    let of = |layers: &[(&str, &str, f32)]| -> Vec<(String, f32)> {
        let name = |layer: &str, channel: char| match layer {
            "" => channel.to_string(),
            layer => format!("{layer}.{channel}"),
        };
        let channels = layers.iter().flat_map(|(layer, channels, value)| {
            channels.chars().map(move |channel| (name(layer, channel), *value))
        });
        channels.collect()
    };
    for (layers, value, others) in [
        (vec![("AO", "RGB", 0.9), ("View.Combined", "RGB", 0.5)], 0.5, "another: \"AO\""),
        (vec![("N", "XYZ", 0.9), ("beauty", "RGB", 0.5)], 0.5, ""),
        (vec![("A", "XYZ", 0.9), ("b", "RGB", 0.5)], 0.5, "another: \"A\""),
        (vec![("Vec", "XY", 0.9), ("z", "Y", 0.5)], 0.5, ""),
        (vec![("", "RGB", 0.5), ("beauty", "RGB", 0.9)], 0.5, "another: \"beauty\""),
    ] {
        let channels = of(&layers);
        let channels: Vec<_> = channels.iter().map(|(name, v)| (name.as_str(), *v)).collect();
        exr(&path, &channels, None);
        let cube = opened(&path, "as=reflectance");
        let found = cube.band(15).unwrap().data[0];
        // Greys are flat to 0.4 % of themselves.
        assert!((found / value - 1.0).abs() < 4e-3, "{layers:?}: {found}");
        assert!(notes(&cube).contains(others), "{layers:?}: {}", notes(&cube));
    }
    exr(&path, &[("Y", 0.5), ("RY", 0.1), ("BY", 0.1)], None);
    let error = refused(&path, "as=reflectance");
    assert!(error.contains("luminance and chroma"), "{error}");
    exr(&path, &[("Q", 0.5)], None);
    let error = refused(&path, "as=reflectance");
    assert!(error.contains("render.exr") && !error.contains("render.toml"), "{error}");
}

/// Parts hold layers, too (Houdini): directions are no pictures, and none is taken by its place in
/// the alphabet.
#[test]
fn a_part_is_a_layer() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("parts.exr");
    let write = |parts: &[(&str, f32)]| {
        let layer = |(name, value): &(&str, f32)| {
            let channels = ["B", "G", "R"];
            let channels =
                channels.map(|c| AnyChannel::new(c, FlatSamples::F32(vec![*value]))).to_vec();
            let channels = AnyChannels::sort(channels.into());
            let attributes = LayerAttributes::named(*name);
            Layer::new((1, 1), attributes, Encoding::UNCOMPRESSED, channels)
        };
        let layers: Vec<_> = parts.iter().map(layer).collect();
        let attributes = ImageAttributes::with_size((1, 1));
        Image::from_layers(attributes, layers).write().to_file(&path).unwrap();
    };
    for (parts, options, value) in [
        (vec![("N", 0.9), ("albedo", 0.7), ("C", 0.2)], "", 0.2),
        (vec![("albedo", 0.7), ("emission", 0.1), ("color", 0.2)], "", 0.2),
        (vec![("Normal_world", 0.9), ("scene", 0.2)], "", 0.2),
        (vec![("albedo", 0.7), ("emission", 0.2)], ",array=emission", 0.2),
    ] {
        write(&parts);
        let found = opened(&path, &format!("as=reflectance{options}")).band(15).unwrap().data[0];
        assert!((found / value - 1.0).abs() < 4e-3, "{parts:?}: {found}");
    }
    write(&[("albedo", 0.7), ("emission", 0.2)]);
    let error = refused(&path, "as=reflectance");
    assert!(error.contains("array=NAME") && error.contains("\"emission\""), "{error}");
    write(&[("N", 0.7), ("P", 0.2)]);
    assert!(!refused(&path, "as=reflectance").is_empty());
}

/// Mitsuba 3's specfilm names channels by the user's keys: with wavelengths given, they are the
/// bands in natural order, without the colours beside them.
#[test]
fn channels_of_any_names_are_bands_where_wavelengths_are_given() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.exr");
    exr(&path, &[("band10_x", 3.0), ("band2_x", 2.0), ("band1_x", 1.0), ("R", 9.0)], None);
    let cube = opened(&path, "start_nm=400,step_nm=150,quantity=radiance");
    assert_eq!(cube.quantity(), Quantity::Radiance);
    for (band, value) in [(0, 1.0), (15, 2.0), (30, 3.0)] {
        assert_eq!(cube.band(band).unwrap().data[0], value);
    }
    assert!(notes(&cube).contains("not used: R"), "{}", notes(&cube));
    std::fs::write(path.with_extension("toml"), "wavelength_nm = [400, 500]").unwrap();
    let error = refused(&path, "");
    assert!(error.contains("3 bands") || error.contains("2 wavelengths"), "{error}");
}

/// ImageMagick writes eight zeros where it knows no primaries.
#[test]
fn primaries_of_zeros_say_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("im.hdr");
    let write = |primaries: &str| {
        let head = format!("#?RADIANCE\nPRIMARIES={primaries}\nFORMAT=32-bit_rle_rgbe\n\n");
        let pixel = [128, 64, 32, 128];
        std::fs::write(&path, [head.as_bytes(), b"-Y 1 +X 1\n", &pixel].concat()).unwrap();
    };
    write("0.0 0 0 0 0 0 0 0");
    let cube = opened(&path, "");
    assert!(notes(&cube).contains("PRIMARIES of zeros"), "{}", notes(&cube));
    assert!(!notes(&opened(&path, "primaries=srgb")).contains("zeros"));
    write("0.3 0.3 0.3 0.3 0.3 0.3 0.3 0.3");
    assert!(refused(&path, "").contains("span no colours"));
    opened(&path, "primaries=rec2020");
}

/// ENVI's own programs name a cube by its data file; a spectral library is no scene.
#[test]
fn the_header_beside_a_data_file_is_taken() {
    let dir = tempfile::tempdir().unwrap();
    let (image, header) = (dir.path().join("cube.img"), dir.path().join("cube.img.hdr"));
    let write = |kind: &str| {
        let text = format!(
            "ENVI\nsamples = 1\nlines = 1\nbands = 2\ndata type = 1\nfile type = {kind}\n\
             wavelength units = nm\nwavelength = {{400, 700}}\n"
        );
        std::fs::write(&header, text).unwrap();
    };
    std::fs::write(&image, [1, 0]).unwrap();
    std::fs::write(dir.path().join("cube.dat"), [7, 7]).unwrap();
    assert!(refused(&image, "").contains("is a file of a kind that is no scene"));
    write("ENVI Standard");
    let cube = opened(&image, "");
    assert_eq!([0, 30].map(|band| cube.band(band).unwrap().data[0]), [1.0, 0.0]);
    write("ENVI Spectral Library");
    assert!(refused(&image, "").contains("spectral library"), "{}", refused(&image, ""));
}

/// Pixels of 128/256 times 2, behind headers of other pictures that programs of Radiance repeat.
#[test]
fn lines_of_a_radiance_picture_count_in_the_first_column() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("probe.hdr");
    let write = |lines: &str, resolution: &str| {
        let head = format!("#?RADIANCE\n{lines}FORMAT=32-bit_rle_rgbe\n\n{resolution}\n");
        std::fs::write(&path, [head.as_bytes(), &[128, 128, 128, 129]].concat()).unwrap();
    };
    let repeated = "pcomb a.hdr b.hdr\n\tEXPOSURE=8\n\tFORMAT=32-bit_rle_xyze\n\tPIXASPECT=2\n";
    let value = |path: &Path| opened(path, "as=reflectance").band(15).unwrap().data[0];
    write(repeated, "-Y 1 +X 1");
    let cube = opened(&path, "as=reflectance");
    assert!((value(&path) - 1.0).abs() < 4e-3, "{}", value(&path));
    assert!(cube.understood().join("\n").contains("Rec. 709"), "{:?}", cube.understood());
    write(&format!("{repeated}EXPOSURE=2\n"), "-Y 1 +X 1");
    assert!((value(&path) / 0.5 - 1.0).abs() < 4e-3, "{}", value(&path));
    write("", "+X 1 -Y 1");
    assert!(refused(&path, "").contains("top left"), "{}", refused(&path, ""));
}

#[test]
fn a_tiff_of_pages_is_a_cube() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stack.tif");
    let mut encoder = TiffEncoder::new(File::create(&path).unwrap()).unwrap();
    for band in 0..4u16 {
        let page = [0, 1, 2, 3, 4, 5].map(|i| 10 * i + band);
        encoder.write_image::<colortype::Gray16>(3, 2, &page).unwrap();
    }
    let spec = path.to_str().unwrap();
    let message = open_file(spec).err().unwrap().to_string();
    assert!(message.contains("wavelengths of the 4 bands"), "{message}");
    let cube = open_file(&format!("{spec}:scale=0.01,start_nm=400,step_nm=100")).unwrap();
    assert!((cube.band(10).unwrap().data[4] - 0.41).abs() < 1e-6);
}

/// Two rows of three pixels, a page per band, turned by a quarter; band 2 misses a sample.
#[test]
fn tags_of_pages_are_followed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stack.tif");
    let write = |pages: u16, described: &str| {
        let mut encoder = TiffEncoder::new(File::create(&path).unwrap()).unwrap();
        for band in 0..pages {
            let mut image = encoder.new_image::<colortype::Gray16>(3, 2).unwrap();
            let items = ["scale\">0.01", "offset\">0.1", &format!("wavelength\">{band}00 nm")]
                .map(|item| format!("<Item sample=\"0\" name=\"{item}</Item>"));
            let items = items.concat().replace(">000 nm", ">400 nm").replace(">100", ">500");
            let tags = image.encoder();
            tags.write_tag(Tag::Orientation, 6u16).unwrap();
            tags.write_tag(Tag::GdalNodata, "9").unwrap();
            tags.write_tag(Tag::Unknown(42112), items.as_str()).unwrap();
            tags.write_tag(Tag::ImageDescription, described).unwrap();
            image.write_data(&[0, 1, 2, 3, 4, 5 + 4 * band]).unwrap();
        }
        open_file(path.to_str().unwrap())
    };
    let cube = write(2, "").unwrap();
    assert_eq!(cube.size(), (2, 3));
    for (band, last) in [(0, 0.15), (10, 0.0)] {
        let got = cube.band(band).unwrap().data;
        for (got, right) in got.iter().zip([0.13, 0.10, 0.14, 0.11, last, 0.12]) {
            assert!((got - right).abs() < 1e-6, "{band}: {got}, {right}");
        }
    }
    assert!(cube.understood().join("\n").contains("400 to 500 nm"));
    for described in ["ImageJ=1.53\nimages=3\n", "{\"shape\": [3, 2, 3]}"] {
        for pages in [1, 2] {
            let error = write(pages, described).err().unwrap().to_string();
            assert!(error.contains("3 pictures, says its description"), "{error}");
        }
    }
    assert!(write(2, "ImageJ=1.53\nimages=2\n").is_ok());
}

fn layer(names: &[String], part: &str) -> Layer<AnyChannels<FlatSamples>> {
    let channels: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(b, name)| {
            let samples = (0..6).map(|i| i as f32 / 10.0 + b as f32 / 100.0).collect();
            AnyChannel::new(name.as_str(), FlatSamples::F32(samples))
        })
        .collect();
    let attributes = LayerAttributes::named(part);
    let channels = AnyChannels::sort(channels.into());
    Layer::new((3, 2), attributes, Encoding::SMALL_LOSSLESS, channels)
}

#[test]
fn the_part_and_layer_with_spectra_are_found_and_what_is_left_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("scene.exr");
    let names = |prefix: &str, n: usize| -> Vec<String> {
        (0..n).map(|b| format!("{prefix}{},0nm", 400 + 10 * b)).collect()
    };
    let mut second = names("a.S0.", 31);
    second.extend(names("b.S0.", 30));
    let rgb = ["R", "G", "B"].map(String::from);
    let window = ImageAttributes::new(IntegerBounds::from_dimensions((3, 2)));
    let layers = vec![layer(&rgb, "preview"), layer(&second, "spectra")];
    Image::from_layers(window, layers).write().to_file(&path).unwrap();
    let spec = path.to_str().unwrap();
    let cube = open_file(spec).unwrap();
    assert_eq!((cube.quantity(), cube.size()), (Quantity::Radiance, (3, 2)));
    assert!((cube.band(20).unwrap().data[4] - 0.6).abs() < 1e-6);
    let notes = cube.notes().join("\n");
    assert!(notes.contains("30 more spectral") && notes.contains("R"), "{notes}");
    assert!(cube.understood()[0].contains("layer \"a\""), "{:?}", cube.understood());
    let other = open_file(&format!("{spec}:array=b")).unwrap();
    assert!((other.band(20).unwrap().data[4] - 0.91).abs() < 1e-6);
    let message = open_file(&format!("{spec}:array=c")).err().unwrap().to_string();
    assert!(message.contains("\"a\", \"b\""), "{message}");
}

#[test]
fn the_scene_of_a_cube_is_its_data_window_whatever_is_displayed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("crop.exr");
    let names: Vec<String> = (0..31).map(|b| format!("S0.{},0nm", 400 + 10 * b)).collect();
    let window = ImageAttributes::new(IntegerBounds::from_dimensions((64, 48)));
    let mut crop = layer(&names, "spectra");
    crop.attributes.layer_position = Vec2(8, 4);
    Image::from_layers(window, vec![crop]).write().to_file(&path).unwrap();
    let cube = open_file(path.to_str().unwrap()).unwrap();
    assert_eq!(cube.size(), (3, 2));
    assert!((cube.band(20).unwrap().data[4] - 0.6).abs() < 1e-6);
    let notes = cube.notes().join("\n");
    let words = "3 x 2 from column 8, row 4 on, are the scene, not its display window of 64 x 48";
    assert!(notes.contains(words), "{notes}");
}

//! Readers of files against arbitrary bytes: an error or what the file holds, never a panic, and no
//! memory that the file's size does not explain. `FUZZ_FORMAT` names the reader. What reads several
//! files gets them in one input, a form feed between them.

#![no_main]

use camrig_base::table::SpectralTable;
use camrig_formats::pixel_format::PixelFormat;
use camrig_lens::{Catalogue, Conditions, Prescription, System, characterise, import};
use camrig_scene::Scene;
use libfuzzer_sys::fuzz_target;
use std::alloc::{GlobalAlloc, Layout, System as Memory};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Largest single allocation: inputs have 64 KiB, and compression may make a thousand times as much
/// of them.
const LARGEST: usize = 256 << 20;

/// The system's memory, without allocations beyond [`LARGEST`].
struct Bounded;

// SAFETY: every call is passed on to the system's allocator, or ends the process.
unsafe impl GlobalAlloc for Bounded {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        bounded(layout.size());
        unsafe { Memory.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        bounded(layout.size());
        unsafe { Memory.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        bounded(size);
        unsafe { Memory.realloc(at, layout, size) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { Memory.dealloc(at, layout) }
    }
}

fn bounded(size: usize) {
    if size > LARGEST {
        eprintln!("an allocation of {size} bytes");
        std::process::abort();
    }
}

#[global_allocator]
static MEMORY: Bounded = Bounded;

/// The format, and a file of that ending to read from.
struct Target {
    format: String,
    file: PathBuf,
}

fn target() -> &'static Target {
    static TARGET: OnceLock<Target> = OnceLock::new();
    TARGET.get_or_init(|| {
        let format = std::env::var("FUZZ_FORMAT").expect("FUZZ_FORMAT names the reader");
        let shared = Path::new("/dev/shm");
        let folder = if shared.is_dir() { shared.to_owned() } else { std::env::temp_dir() };
        let folder = folder.join(format!("camrig-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let ending = match &format[..] {
            "envi" => "hdr",
            "radiance" => "hdr",
            other => other,
        };
        let file = folder.join(format!("file.{ending}"));
        if format == "envi" {
            std::fs::write(folder.join("file.img"), [7; 4096]).unwrap();
        }
        Target { format, file }
    })
}

/// Opens a scene and reads its first and last band.
fn scene(bytes: &[u8]) {
    let file = &target().file;
    std::fs::write(file, bytes).unwrap();
    for options in ["", ":as=reflectance", ":as=radiance"] {
        let spec = format!("{}{options}", file.display());
        let Ok(cube) = camrig_scene::open_file(&spec) else { continue };
        let _ = cube.band(0);
        let _ = cube.band(cube.bands().count.saturating_sub(1));
        return;
    }
}

fn lens(read: fn(&str, &Catalogue) -> camrig_base::Result<Prescription>, bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let Ok(lens) = read(&text, &Catalogue::default()) else { return };
    let Ok(system) = System::new(lens, Conditions::default()) else { return };
    let _ = characterise::field_points(&system, &[0.0, 5.0], &[550.0]);
}

fn glasses(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let mut glasses = Catalogue::default();
    glasses.insert_agf("own", &text);
    let names = text.lines().filter_map(|l| l.strip_prefix("NM ")?.split_whitespace().next());
    for name in names.take(20) {
        if let Ok(found) = glasses.find(name, &["own".into()]) {
            let _ = found.glass.index(550.0);
        }
    }
}

/// Imports a lens from `names` files of a folder, the first of which says what the others are.
fn imported(names: &[&str], bytes: &[u8]) {
    let folder = target().file.with_extension("lens");
    // What the manifest names lies in the folder: /dev/zero is none of this reader's business.
    let leads_away = |text: &[u8]| matches!(text, b"\"/" | b"'/" | b".." | b"\\u");
    if bytes.windows(2).any(leads_away) {
        return;
    }
    std::fs::create_dir_all(&folder).unwrap();
    let mut parts = bytes.split(|byte| *byte == FORM_FEED);
    for name in names {
        std::fs::write(folder.join(name), parts.next().unwrap_or_default()).unwrap();
    }
    let _ = import::import(&folder.join(names[0]));
}

/// Stands between the files of one input.
const FORM_FEED: u8 = 0x0c;

/// Headerless pixels: the name of the format and the sizes come first.
fn pixels(bytes: &[u8]) {
    let Some((head, rest)) = bytes.split_at_checked(16) else { return };
    let name = String::from_utf8_lossy(&head[..12]);
    let name = name.trim_end_matches(['\0', ' ']);
    if let Ok(format) = PixelFormat::parse(name) {
        let size = |i: usize| usize::from(head[i]);
        let stride = (size(14) > 0).then(|| size(14) * 8);
        let _ = format.decode(rest, size(12), size(13), stride);
    }
}

fuzz_target!(|bytes: &[u8]| {
    match &target().format[..] {
        "csv" => {
            let text = String::from_utf8_lossy(bytes);
            if let Ok(mut table) = SpectralTable::parse(&text) {
                table.clip_noise();
                let _ = table.spectrum(0);
            }
        }
        "agf" => glasses(bytes),
        "seq" => lens(camrig_lens::seq::read, bytes),
        "zmx" => lens(camrig_lens::zmx::read, bytes),
        "toml" => lens(camrig_lens::toml::read, bytes),
        "import" => imported(&["lens.toml", "a.csv", "b.csv", "c.csv", "d.csv"], bytes),
        "iset" => imported(
            &["ISETPARMS.TXT", "x_DI_.dat", "x_RI_.dat", "x_CRA_.dat", "x_2D_PSF_Fld1_Wave1.dat"],
            bytes,
        ),
        "listing" => {
            let text = String::from_utf8_lossy(bytes);
            if let Ok(psf) = import::listing::psf(&text) {
                let _ = psf.oriented(psf.runs_outwards());
            }
            let _ = import::listing::grid_distortion(&text);
            let _ = import::listing::relative_illumination(&text);
        }
        // Two GiB of a gzip file are allowed: other limits than those looked for here.
        "raw" if bytes.starts_with(&[0x1f, 0x8b]) => {}
        "raw" => drop(camrig_formats::decode(bytes)),
        "pixels" => pixels(bytes),
        _ => scene(bytes),
    }
});

//! Readers of files against arbitrary bytes: an error or what the file holds, never a panic, and no
//! memory that the file's size does not explain. What reads several files gets them in one input, a
//! form feed between them.

use camrig_base::table::SpectralTable;
use camrig_formats::pixel_format::PixelFormat;
use camrig_lens::{Catalogue, Conditions, Prescription, System, characterise};
use camrig_lens_files::import;
use camrig_scene::Scene;
use std::path::{Path, PathBuf};
use tempfile::{TempDir, tempdir, tempdir_in};

/// The reader of one format, and a folder for the files that it reads.
pub struct Reader {
    format: String,
    folder: TempDir,
}

impl Reader {
    /// A reader by the name of its folder in `seeds`.
    pub fn new(format: &str) -> Self {
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempdir_in(memory) } else { tempdir() };
        let reader = Self { format: format.to_string(), folder: folder.expect("a folder") };
        if format == "envi" {
            std::fs::write(reader.file("img"), [7; 4096]).unwrap();
        }
        reader
    }

    fn file(&self, ending: &str) -> PathBuf {
        self.folder.path().join(format!("file.{ending}"))
    }

    /// Reads a file of these bytes.
    pub fn read(&self, bytes: &[u8]) {
        let text = || String::from_utf8_lossy(bytes);
        match &self.format[..] {
            "csv" => {
                if let Ok(mut table) = SpectralTable::parse(&text()) {
                    table.clip_noise();
                    let _ = table.spectrum(0);
                }
            }
            "agf" => glasses(&text()),
            "seq" => lens(camrig_lens_files::seq::read, &text()),
            "zmx" => lens(camrig_lens_files::zmx::read, &text()),
            "toml" => lens(camrig_lens::prescription::toml::read, &text()),
            "import" => {
                self.imported(&["lens.toml", "a.csv", "b.csv", "c.csv", "d.csv"], bytes);
            }
            "iset" => self.imported(
                &[
                    "ISETPARMS.TXT",
                    "x_DI_.dat",
                    "x_RI_.dat",
                    "x_CRA_.dat",
                    "x_2D_PSF_Fld1_Wave1.dat",
                ],
                bytes,
            ),
            "listing" => {
                if let Ok(psf) = import::listing::psf(&text()) {
                    let _ = psf.oriented(psf.runs_outwards());
                }
                let _ = import::listing::grid_distortion(&text());
                let _ = import::listing::relative_illumination(&text());
            }
            // Two GiB of a gzip file are allowed: other limits than those tested here.
            "raw" if bytes.starts_with(&[0x1f, 0x8b]) => {}
            "raw" => drop(camrig_formats::decode(bytes)),
            "pixels" => pixels(bytes),
            "envi" | "radiance" => self.scene("hdr", bytes),
            ending => self.scene(ending, bytes),
        }
    }

    /// Opens a scene and reads its first and last band.
    fn scene(&self, ending: &str, bytes: &[u8]) {
        let file = self.file(ending);
        std::fs::write(&file, bytes).unwrap();
        for options in ["", ":as=reflectance", ":as=radiance"] {
            let spec = format!("{}{options}", file.display());
            let Ok(cube) = camrig_scene_files::open_file(&spec) else { continue };
            let _ = cube.band(0);
            let _ = cube.band(cube.bands().count.saturating_sub(1));
            return;
        }
    }

    /// Imports a lens from `names` files of a folder, the first of which names the others.
    fn imported(&self, names: &[&str], bytes: &[u8]) {
        // What the manifest names lies in the folder: /dev/zero is none of this reader's business.
        let leads_away = |text: &[u8]| matches!(text, b"\"/" | b"'/" | b".." | b"\\u");
        if bytes.windows(2).any(leads_away) {
            return;
        }
        let folder = self.folder.path().join("lens");
        std::fs::create_dir_all(&folder).unwrap();
        let mut parts = bytes.split(|byte| *byte == FORM_FEED);
        for name in names {
            std::fs::write(folder.join(name), parts.next().unwrap_or_default()).unwrap();
        }
        let _ = import::import(&folder.join(names[0]));
    }
}

fn lens(read: fn(&str, &Catalogue) -> camrig_base::Result<Prescription>, text: &str) {
    let Ok(lens) = read(text, &Catalogue::default()) else { return };
    let Ok(system) = System::new(lens, Conditions::default()) else { return };
    let _ = characterise::field_points(&system, &[0.0, 5.0], &[550.0]);
}

fn glasses(text: &str) {
    let mut glasses = Catalogue::default();
    glasses.insert_agf("own", text);
    let names = text.lines().filter_map(|l| l.strip_prefix("NM ")?.split_whitespace().next());
    for name in names.take(20) {
        if let Ok(found) = glasses.find(name, &["own".into()]) {
            let _ = found.glass.index(550.0);
        }
    }
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

//! Helpers shared by the cross-crate tests.

pub mod color;

use std::path::{Path, PathBuf};
use std::process::Command;

/// Clients that are Python modules rather than programs.
const PYTHON_MODULES: [&str; 11] = [
    "astropy",
    "bayerlink",
    "cv2",
    "dngpy",
    "emva1288",
    "jsonschema",
    "mitsuba",
    "numpy",
    "rawpy",
    "rosbags",
    "tifffile",
];

/// Finds a real client: a program on the PATH, or the Python that has a module.
///
/// `None` means the test must be skipped, and a line says so by name. With `CI=true` a missing
/// client is a failure instead, unless `CAMRIG_ALLOW_SKIP` (names separated by commas or spaces)
/// lists it.
pub fn client(name: &str) -> Option<PathBuf> {
    let found = if PYTHON_MODULES.contains(&name) {
        program("python3").filter(|python| {
            let import = Command::new(python).args(["-c", &format!("import {name}")]).output();
            import.is_ok_and(|o| o.status.success())
        })
    } else {
        program(name)
    };
    if found.is_none() {
        let allowed = std::env::var("CAMRIG_ALLOW_SKIP").unwrap_or_default();
        let allowed = allowed.split([',', ' ']).any(|a| a == name);
        let ci = std::env::var("CI").is_ok_and(|v| v == "true");
        assert!(!ci || allowed, "{name} is missing, and CAMRIG_ALLOW_SKIP does not list it");
        println!("SKIP: {name} is not installed");
    }
    found
}

fn program(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|p| p.is_file())
}

/// Runs a client and returns its standard output; panics with what it said when it fails.
pub fn run(program: &Path, arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> Vec<u8> {
    let output = Command::new(program).args(arguments.iter().map(|a| a.as_ref())).output();
    let output = output.unwrap_or_else(|e| panic!("{}: {e}", program.display()));
    assert!(
        output.status.success(),
        "{} failed:\n{}{}",
        program.display(),
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output.stdout
}

/// Pixels of an RGB PNG of 8 or 16 bits as values 0..=1, with its width and height.
pub fn png_rgb(path: &Path) -> (usize, usize, Vec<[f64; 3]>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    let values: Vec<f64> = match info.bit_depth {
        png::BitDepth::Eight => bytes.iter().map(|&b| f64::from(b) / 255.0).collect(),
        _ => bytes
            .chunks_exact(2)
            .map(|b| f64::from(u16::from_be_bytes([b[0], b[1]])) / 65535.0)
            .collect(),
    };
    let pixels = values.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    (info.width as usize, info.height as usize, pixels)
}

/// A pipe as the rig's end of a link.
#[cfg(unix)]
pub struct Pipe(pub std::os::unix::net::UnixStream);

#[cfg(unix)]
impl embedded_io::ErrorType for Pipe {
    type Error = std::io::Error;
}

#[cfg(unix)]
impl embedded_io::Read for Pipe {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        std::io::Read::read(&mut self.0, out)
    }
}

#[cfg(unix)]
impl embedded_io::Write for Pipe {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        std::io::Write::write(&mut self.0, bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        std::io::Write::flush(&mut self.0)
    }
}

//! Video as YUV4MPEG2, uncompressed, from a file or a pipe.
//!
//! Sources: yuv4mpeg(5) of the mjpegtools; the names of deep samples, of sitings and of ranges as
//! FFmpeg's `libavformat/yuv4mpegdec.c` reads them. What the header says is taken: size, frame
//! rate, siting, bits, range. What it cannot say is assumed and said: the matrix (BT.709 from 720
//! lines on, BT.601 below), a limited range, and the colours of sRGB. Keys behind the name decide
//! otherwise: `matrix`, `range`, `siting`, and those of pictures.
//!
//! | key of the header | read |
//! |---|---|
//! | `W`, `H` | size |
//! | `F` | frames per second, `30000:1001`; `0:0` is unknown |
//! | `I` | `p`, `?`; interlaced frames are refused |
//! | `A` | `0:0`, `1:1`; pixels that are not square are refused |
//! | `C` | `420jpeg` (also `420`, and where there is none), `420mpeg2`, `420paldv`, `411`, `422`, `444`, `444alpha`, `mono`, and with 9 to 16 bits `420p10`, `422p10`, `444p10`, `mono10`, ... |
//! | `XCOLORRANGE` | `FULL`, `LIMITED` |

use super::folder::times;
use super::pipe::{broken, read_up_to};
use super::ycbcr::{CENTER, LEFT, Layout, MATRICES, SITINGS, Siting, TOP_LEFT};
use super::{Reading, SceneFrame, SceneSequence};
use crate::rgb;
use camrig_base::{Error, Result};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Longest line of a header, bytes: far more than any has.
const LONGEST_LINE: u64 = 4096;
/// Lines from which on video without a matrix is BT.709: those of high definition.
const LINES_OF_HD: usize = 720;
const MAGIC: &str = "YUV4MPEG2";
const FRAME: &str = "FRAME";

/// Video, frame by frame.
pub struct Video {
    name: String,
    source: Box<dyn Read + Send>,
    /// The file, where it can be read again.
    file: Option<PathBuf>,
    header: Header,
    options: String,
    next: u64,
    notes: Vec<String>,
}

/// What a header says, and what was said instead.
#[derive(Clone, Debug, PartialEq)]
struct Header {
    layout: Layout,
    rate_hz: Option<f64>,
    notes: Vec<String>,
}

impl Video {
    /// Video from a file.
    ///
    /// # Errors
    /// Those of [`Video::new`], and a file that cannot be read.
    pub fn of_file(path: &Path, options: &str, reading: &Reading) -> Result<Self> {
        let name = path.display().to_string();
        let video = Self::new(&name, opened(path)?, options, reading.rate_hz)?;
        Ok(Self { file: Some(path.into()), ..video })
    }

    /// Video from any stream, at its own frame rate or another.
    ///
    /// # Errors
    /// A stream that is none, or of a kind that is not read; options that it does not have.
    pub fn new(
        name: &str,
        mut source: Box<dyn Read + Send>,
        options: &str,
        rate_hz: Option<f64>,
    ) -> Result<Self> {
        let (said, options) = Said::split(options)?;
        rgb::check_options(&options)?;
        let Some(line) = line(&mut *source)? else {
            return Err(Error::input("an empty stream").help(WANTED));
        };
        let mut header = Header::parse(&line, &said)?;
        if let (Some(asked), Some(own)) = (rate_hz, header.rate_hz)
            && asked != own
        {
            header.notes.push(format!("its own {own:.6} frames per second are taken as {asked}"));
        }
        header.rate_hz = rate_hz.or(header.rate_hz);
        let notes = header.notes.clone();
        Ok(Self { name: name.into(), source, file: None, header, options, next: 0, notes })
    }
}

fn opened(path: &Path) -> Result<Box<dyn Read + Send>> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    Ok(Box::new(BufReader::new(file)))
}

const WANTED: &str = "what is read from a stream is video as YUV4MPEG2 (ffmpeg -i VIDEO -f \
                      yuv4mpegpipe -) or camrig-frames/1";

/// A line without its end; none at the end of the stream.
fn line(source: &mut dyn Read) -> Result<Option<String>> {
    let mut bytes = Vec::new();
    loop {
        let mut byte = [0];
        match source.read(&mut byte) {
            Ok(0) if bytes.is_empty() => return Ok(None),
            Ok(0) => return Err(Error::input("the stream ends within a line of text")),
            Ok(_) if byte[0] == b'\n' => break,
            Ok(_) => bytes.push(byte[0]),
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(broken(&e)),
        }
        let looks_right = bytes.first().is_none_or(|b| [b'Y', b'F'].contains(b));
        if !looks_right || bytes.len() as u64 > LONGEST_LINE {
            return Err(Error::input("a stream that is no YUV4MPEG2").help(WANTED));
        }
    }
    Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
}

/// What the user says of video.
#[derive(Default)]
struct Said {
    matrix: Option<super::ycbcr::Matrix>,
    full: Option<bool>,
    siting: Option<Siting>,
}

impl Said {
    /// What the options say of video, and the others.
    fn split(options: &str) -> Result<(Self, String)> {
        let (mut said, mut rest) = (Self::default(), Vec::new());
        let unknown = |key: &str, value: &str, values: &str| {
            Error::input(format!("{key}={value}")).help(format!("it is {values}"))
        };
        for option in options.split(',').filter(|option| !option.is_empty()) {
            let (key, value) = option.split_once('=').unwrap_or((option, ""));
            let (key, value) = (key.trim(), value.trim());
            match key {
                "matrix" => {
                    let found = MATRICES.into_iter().find(|m| m.name == value);
                    said.matrix =
                        Some(found.ok_or_else(|| unknown(key, value, "bt601, bt709 or bt2020"))?);
                }
                "siting" => {
                    let found = SITINGS.into_iter().find(|s| s.name == value);
                    said.siting =
                        Some(found.ok_or_else(|| unknown(key, value, "center, left or topleft"))?);
                }
                "range" => {
                    said.full = Some(match value {
                        "full" => true,
                        "limited" => false,
                        _ => return Err(unknown(key, value, "full or limited")),
                    });
                }
                _ => rest.push(option),
            }
        }
        Ok((said, rest.join(",")))
    }
}

/// Samples of luma to one of chroma, the siting, and whether there is opacity.
type Sampling = (Option<[usize; 2]>, Siting, bool);

/// What a name of samples means, and their bits.
fn samples(name: &str) -> Result<(Sampling, u32)> {
    let unknown = || {
        Error::unsupported(format!("samples of the kind C{name}"))
            .help("let ffmpeg convert them: -pix_fmt yuv420p, yuv422p, yuv444p, gray, gray16le")
    };
    let sampling = |base: &str| -> Option<Sampling> {
        Some(match base {
            "420" | "420jpeg" => (Some([2, 2]), CENTER, false),
            "420mpeg2" => (Some([2, 2]), LEFT, false),
            "420paldv" => (Some([2, 2]), TOP_LEFT, false),
            "411" => (Some([4, 1]), LEFT, false),
            "422" => (Some([2, 1]), LEFT, false),
            "444" => (Some([1, 1]), CENTER, false),
            "444alpha" => (Some([1, 1]), CENTER, true),
            "mono" => (None, CENTER, false),
            _ => return None,
        })
    };
    if let Some(sampling) = sampling(name) {
        return Ok((sampling, 8));
    }
    let digits = name.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let (base, bits) = name.split_at(digits);
    let bits = bits.parse().ok().filter(|bits| (9..=16).contains(bits)).ok_or_else(unknown)?;
    let base = match base.strip_suffix('p') {
        Some(base @ ("420" | "422" | "444")) => base,
        None if base == "mono" => base,
        _ => return Err(unknown()),
    };
    Ok((sampling(base).ok_or_else(unknown)?, bits))
}

impl Header {
    fn parse(line: &str, said: &Said) -> Result<Self> {
        let mut words = line.split(' ');
        if words.next() != Some(MAGIC) {
            return Err(Error::input("a stream that is no YUV4MPEG2").help(WANTED));
        }
        let (mut size, mut rate_hz, mut kind, mut range) = ([0, 0], None, "420jpeg", None);
        for word in words.filter(|word| !word.is_empty()) {
            let mut letters = word.chars();
            let (key, value) = (letters.next().unwrap_or(' '), letters.as_str());
            match (key, value) {
                ('W', _) => size[0] = value.parse().unwrap_or(0),
                ('H', _) => size[1] = value.parse().unwrap_or(0),
                ('F', _) => rate_hz = rate(value)?,
                ('C', _) => kind = value,
                ('X', "COLORRANGE=FULL") => range = Some(true),
                ('X', "COLORRANGE=LIMITED") => range = Some(false),
                ('I', "p" | "?") | ('A', "1:1" | "0:0") | ('X', _) => {}
                ('I', _) => {
                    return Err(Error::unsupported(format!("interlaced video (I{value})"))
                        .help("let ffmpeg make whole frames of it: -vf yadif"));
                }
                ('A', _) => {
                    return Err(Error::unsupported(format!("pixels of {value}, not square"))
                        .help("let ffmpeg make them square: -vf scale=iw*sar:ih,setsar=1"));
                }
                _ => return Err(Error::input(format!("{word:?} in the header of video"))),
            }
        }
        let [width, height] = size;
        rgb::picture::check_pixels(size)?;
        let ((chroma, own_siting, alpha), bits) = samples(kind)?;
        let usual = MATRICES[usize::from(height >= LINES_OF_HD)];
        let layout = Layout {
            width,
            height,
            bits,
            chroma,
            alpha,
            full: said.full.or(range).unwrap_or(false),
            matrix: said.matrix.unwrap_or(usual),
            siting: said.siting.unwrap_or(own_siting),
        };
        let mut notes = vec![assumed(&layout, said, range)];
        if alpha {
            notes.push("its opacity is not used".into());
        }
        notes.retain(|note| !note.is_empty());
        Ok(Self { layout, rate_hz, notes })
    }
}

/// What is assumed of a stream that does not say it.
fn assumed(layout: &Layout, said: &Said, range: Option<bool>) -> String {
    let mut assumed = Vec::new();
    if layout.chroma.is_some() && said.matrix.is_none() {
        assumed.push(format!("{} by its {} lines (matrix=)", layout.matrix.name, layout.height));
    }
    if said.full.or(range).is_none() {
        assumed.push("a limited range (range=)".into());
    }
    let subsampled = layout.chroma.is_some_and(|steps| steps != [1, 1]);
    if subsampled && said.siting.is_none() {
        assumed
            .push(format!("chroma sited {}, as such samples are (siting=)", layout.siting.name));
    }
    if assumed.is_empty() {
        return String::new();
    }
    format!(
        "taken of the video, unless the option in brackets says otherwise: {}",
        assumed.join("; ")
    )
}

/// Frames per second of `30000:1001`; none of `0:0`.
fn rate(text: &str) -> Result<Option<f64>> {
    let parts = text.split_once(':').and_then(|(n, d)| Some((n.parse().ok()?, d.parse().ok()?)));
    match parts {
        Some((0u32, 0u32)) => Ok(None),
        Some((n, d)) if n > 0 && d > 0 => Ok(Some(f64::from(n) / f64::from(d))),
        _ => Err(Error::input(format!("a frame rate of {text:?} in the header of video"))),
    }
}

impl SceneSequence for Video {
    fn name(&self) -> &str {
        &self.name
    }

    fn is_timed(&self) -> bool {
        self.header.rate_hz.is_some()
    }

    fn next_frame(&mut self) -> Result<Option<SceneFrame>> {
        let number = self.next;
        let place = || place_of(number, &self.name);
        let Some(line) = line(&mut *self.source).map_err(|e| e.at(place()))? else {
            return Ok(None);
        };
        // Parameters of a frame repeat those of interlacing, which was checked.
        if line.split(' ').next() != Some(FRAME) {
            return Err(Error::input(format!("{line:?} where a frame begins"))
                .at(place())
                .help("the stream is damaged, or frames before have another size than it says"));
        }
        let layout = self.header.layout;
        let wanted = layout.bytes().unwrap_or(u64::MAX);
        let bytes = read_up_to(&mut *self.source, wanted).map_err(|e| broken(&e).at(place()))?;
        if (bytes.len() as u64) < wanted {
            return Err(Error::input(format!(
                "the stream ends within a frame: {} of {wanted} bytes came",
                bytes.len()
            ))
            .at(place())
            .help("its writer was stopped, or the size in its header is wrong"));
        }
        self.next += 1;
        let options = self.options.clone();
        let open = move || rgb::of_picture(layout.picture(&bytes), &options);
        let times = times(number, self.header.rate_hz);
        Ok(Some(SceneFrame::new(number, times, place_of(number, &self.name), open)))
    }

    fn rewind(&mut self) -> Result<()> {
        let Some(path) = &self.file else {
            return Err(camrig_scene::sequence::no_rewind(&self.name));
        };
        self.source = opened(path)?;
        line(&mut *self.source)?;
        self.next = 0;
        Ok(())
    }

    fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

fn place_of(number: u64, name: &str) -> String {
    format!("frame {number} of {name}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;
    use std::io::Cursor;

    fn video(bytes: &[u8], options: &str) -> Result<Video> {
        Video::new("it", Box::new(Cursor::new(bytes.to_vec())), options, None)
    }

    fn said(bytes: &[u8], options: &str) -> String {
        video(bytes, options).err().unwrap().to_string()
    }

    #[test]
    fn frames_have_their_samples_and_times() {
        let mut bytes = b"YUV4MPEG2 W2 H1 F25:2 Ip A1:1 C444 XYSCSS=444\n".to_vec();
        for code in [235u8, 16] {
            bytes.extend(b"FRAME Ixyz\n");
            bytes.extend([code, code, 128, 128, 128, 128]);
        }
        let mut video = video(&bytes, "").unwrap();
        let notes = video.notes().join("\n");
        assert!(notes.contains("bt601 by its 1 lines") && notes.contains("limited"), "{notes}");
        for (number, reflectance) in [(0, 1.0), (1, 0.0)] {
            let frame = video.next_frame().unwrap().unwrap();
            assert_eq!((frame.number, frame.start_s), (number, number as f64 / 12.5));
            assert_eq!(frame.end_s, Some((number + 1) as f64 / 12.5));
            assert_eq!(frame.name, format!("frame {number} of it"));
            let cube = frame.open().unwrap();
            let plane = cube.band(15).unwrap();
            assert!(plane.data.iter().all(|v| (v - reflectance).abs() < 1e-4), "{plane:?}");
            assert!(cube.notes().join("").contains("sRGB is assumed"));
        }
        assert!(video.next_frame().unwrap().is_none());
        assert!(video.rewind().is_err());
    }

    #[test]
    fn what_is_stated_is_not_assumed() {
        let notes = |header: &str, options: &str| {
            video(format!("YUV4MPEG2 W8 H720 {header}\n").as_bytes(), options).unwrap().notes()
        };
        let all = notes("C420p10", "").join("");
        assert!(
            all.contains("bt709") && all.contains("limited") && all.contains("center"),
            "{all}"
        );
        let none =
            notes("C420p10 XCOLORRANGE=FULL", "matrix=bt2020,siting=topleft,primaries=rec2020");
        assert!(none.is_empty(), "{none:?}");
        assert!(notes("Cmono16 XCOLORRANGE=LIMITED", "").is_empty());
        assert!(notes("C422", "range=full").join("").contains("sited left"));
    }

    #[test]
    fn all_kinds_of_samples_have_their_sizes() {
        for (kind, bytes) in [
            ("420", 15 + 2 * 6),
            ("420mpeg2", 15 + 2 * 6),
            ("411", 15 + 2 * 6),
            ("422", 15 + 2 * 9),
            ("444", 45),
            ("444alpha", 60),
            ("mono", 15),
            ("mono9", 30),
            ("420p10", 2 * (15 + 2 * 6)),
            ("422p12", 2 * (15 + 2 * 9)),
            ("444p16", 90),
        ] {
            let head = format!("YUV4MPEG2 W5 H3 C{kind}\nFRAME\n");
            let whole = [head.as_bytes(), &vec![128; bytes]].concat();
            let frame = video(&whole, "").unwrap().next_frame().unwrap().unwrap();
            assert_eq!(frame.open().unwrap().size(), (5, 3), "{kind}");
            let cut = video(&whole[..whole.len() - 1], "").unwrap().next_frame();
            let cut = cut.err().unwrap().to_string();
            let words = format!("{} of {bytes} bytes came\n  where: frame 0 of it", bytes - 1);
            assert!(cut.contains(&words), "{cut}");
        }
    }

    #[test]
    fn what_is_not_read_is_refused_with_what_to_do() {
        for (header, words) in [
            ("It", "yadif"),
            ("A4:3", "setsar"),
            ("C410", "-pix_fmt"),
            ("C420p17", "-pix_fmt"),
            ("C444alphap10", "-pix_fmt"),
            ("F1:0", "frame rate"),
            ("F30", "frame rate"),
            ("Q", "\"Q\""),
            ("W0", "0 x 4 pixels"),
            ("W100000 H100000", "at most"),
            ("W99999999999999999999", "0 x 4 pixels"),
        ] {
            let text = said(format!("YUV4MPEG2 W4 H4 {header}\n").as_bytes(), "");
            assert!(text.contains(words), "{header}: {text}");
        }
        assert!(said(b"", "").contains("an empty stream"));
        assert!(said(b"\x89PNG\r\n", "").contains("yuv4mpegpipe"));
        assert!(said(&[b'Y'; 10_000], "").contains("yuv4mpegpipe"));
        assert!(said(b"YUV4MPEG2 W4 H4", "").contains("within a line"));
        let head = b"YUV4MPEG2 W4 H4\n";
        for (option, words) in [
            ("matrix=ntsc", "bt601, bt709 or bt2020"),
            ("range=tv", "full or limited"),
            ("siting=dv", "topleft"),
            ("scale=x,foo=1", "keys of a picture"),
        ] {
            assert!(said(head, option).contains(words), "{option}");
        }
        let damaged = video(b"YUV4MPEG2 W1 H1 Cmono\nFRAMES\n1", "").unwrap().next_frame();
        assert!(damaged.err().unwrap().to_string().contains("frame 0 of it"));
    }
}

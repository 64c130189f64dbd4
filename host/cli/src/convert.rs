//! `camrig convert`: raw frames from one file format to another, sample for sample.

use camrig_base::Cfa;
use camrig_base::output;
use camrig_base::{Dn, Error, Result};
use camrig_formats::{self as formats, Facts, Format, Frames, PixelFormat, csi2, png, preview};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Convert raw frames between file formats without changing a sample.
///
/// The name determines the format: .dng .tiff .npy .pgm .png (16-bit grey) .fits .csi2 (MIPI CSI-2
/// packets) or .raw, headerless pixels in the V4L2 or GenICam format given in the name. Input is
/// recognised by its content, even if gzipped, except for headerless pixels.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig convert frame.dng frame.npy
  camrig convert frame.dng frame_2048x1536_SGRBG10P.raw --hint
  camrig convert stack.npy stack.csi2 --bits 10
  camrig convert frame_640x480_SRGGB12P.raw frame.dng --black 64
  camrig convert captured.csi2 captured.npy --damaged
  camrig convert frame.dng - --to SGRBG10 | ffplay -f rawvideo -pixel_format bayer_grbg16le \\
      -video_size 2048x1536 -vf format=rgb48le,lutrgb=r=val*64:g=val*64:b=val*64 -
  camrig convert - frame.dng --from SGRBG10 --width 2048 --height 1536 --black 42 < pixels")]
pub struct Args {
    /// Input file, or - for standard input
    input: PathBuf,
    /// Output file, or - for standard output
    output: PathBuf,
    /// Output format, if the name does not determine it: dng, tiff, npy, pgm, png, fits, csi2, or
    /// the V4L2 name of headerless pixels
    #[arg(long, value_name = "FORMAT")]
    to: Option<String>,
    /// V4L2 name of headerless input, if not in the file name: SRGGB10P, SGRBG12, Y16, ...
    #[arg(long, value_name = "NAME")]
    from: Option<String>,
    /// Columns of headerless input
    #[arg(long)]
    width: Option<usize>,
    /// Rows of headerless input
    #[arg(long)]
    height: Option<usize>,
    /// Row stride of headerless input, bytes; of headerless output where the input is not
    /// [default: the length of a row]
    #[arg(long, value_name = "BYTES")]
    stride: Option<usize>,
    /// Bits per sample, if missing or wrong in the file
    #[arg(long, value_name = "N")]
    bits: Option<u32>,
    /// Colour filter pattern, if missing or wrong in the file: RGGB, RCCC, mono, ...
    #[arg(long, value_name = "PATTERN")]
    cfa: Option<String>,
    /// Black level, if missing or wrong in the file
    #[arg(long, value_name = "DN")]
    black: Option<f64>,
    /// White level (saturation), if missing or wrong in the file
    #[arg(long, value_name = "DN")]
    white: Option<u16>,
    /// Convert only this frame of a stack, counted from 0
    #[arg(long, value_name = "N")]
    frame: Option<usize>,
    /// Write a viewable picture (8-bit sRGB PNG) instead of raw samples
    #[arg(long)]
    preview: bool,
    /// CSI-2 output: put every line between Line Start and Line End packets
    #[arg(long)]
    line_packets: bool,
    /// CSI-2 output: begin every frame with an embedded data line (CCS frame counter)
    #[arg(long)]
    embedded: bool,
    /// Virtual channel, 0 to 3: of CSI-2 input, the one to convert [default: its only one]; of
    /// CSI-2 output where the input is of another format [default: 0]
    #[arg(long, value_name = "VC")]
    virtual_channel: Option<u8>,
    /// CSI-2 input: convert it although packets are damaged or missing, and say which; lines that
    /// are lost are zero
    #[arg(long)]
    damaged: bool,
    /// Print commands that read headerless output with ffmpeg, GStreamer and V4L2
    #[arg(long)]
    hint: bool,
    /// Replace existing output
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let bytes = formats::read_bytes(&args.input)?;
    if args.damaged && !is_packets(&bytes) {
        return Err(Error::input("--damaged of input that is no CSI-2 stream")
            .at(args.input.display())
            .help("leave it out"));
    }
    if let Some(frames) = wide_frames(args, &bytes)? {
        return convert_wide(args, frames);
    }
    let mut frames = read(args, &bytes)?;
    frames.facts.notes.iter().for_each(|note| eprintln!("note: {note}"));
    if let Some(index) = args.frame {
        frames.planes = vec![frame_of(frames.planes, index)?];
    }
    if args.preview {
        let raw = frames.raw(0)?;
        let info = frames.facts.dng.clone().unwrap_or_default();
        let (picture, factor) = preview::bright(&raw, &info);
        eprintln!("note: {}", preview::brightness_words(factor));
        output::write_file(&args.output, args.force, &png::encode_rgb(&picture)?)?;
        return Ok(ExitCode::SUCCESS);
    }
    let format = output_format(args)?;
    let of_output = args.stride.filter(|_| !is_headerless_input(args));
    if of_output.is_some() && !matches!(format, Format::Raw(_)) {
        return Err(Error::input("--stride of files that have a header")
            .help("it belongs to headerless pixels, as input or output"));
    }
    let encoded = match &format {
        Format::Raw(pixels) => pixels.encode(&frames, of_output),
        Format::Csi2 => {
            let options = csi2_options(args, frames.planes.len(), frames.facts.bits, &bytes);
            csi2::encode_with(&frames, &options)
        }
        other => other.encode(&frames),
    }
    .map_err(|e| e.at(args.input.display()))?;
    output::write_file(&args.output, args.force, &encoded)?;
    format.leaves_out(&frames.facts).iter().for_each(|note| eprintln!("note: {note}"));
    dark_picture(&format, &frames.facts).iter().for_each(|note| eprintln!("note: {note}"));
    if args.hint {
        hint(&args.output, &format, &frames);
    }
    Ok(ExitCode::SUCCESS)
}

/// A note for raw samples in a 16-bit picture format: viewers show them without scaling, and so
/// dark if they use a small part of the range.
fn dark_picture(format: &Format, facts: &Facts) -> Option<String> {
    let bits = facts.bits.unwrap_or(u16::BITS);
    let of_16_bits = match format {
        Format::Tiff => true,
        Format::Png => bits > u8::BITS,
        _ => false,
    };
    let white = facts.white_level_dn.unwrap_or(((1u32 << bits.min(u16::BITS)) - 1) as u16);
    (of_16_bits && white < u16::MAX / 2).then(|| {
        format!(
            "raw samples are stored unscaled, up to {white} of {}: picture viewers show them dark \
             and without colours (--preview writes a viewable picture)",
            u16::MAX
        )
    })
}

fn is_headerless_input(args: &Args) -> bool {
    args.from.is_some() || PixelFormat::is_headerless(&args.input)
}

/// The frames of input of more than 16 bits.
fn wide_frames(args: &Args, bytes: &[u8]) -> Result<Option<Frames<u32>>> {
    if is_headerless_input(args) {
        return Ok(None);
    }
    let at = |e: Error| e.at(args.input.display());
    match is_packets(bytes) {
        false => formats::wide::decode(bytes).map_err(at),
        true => csi2::is_wide(bytes).then(|| packets(args, bytes).map_err(at)).transpose(),
    }
}

/// The frames of a stream of packets.
fn packets<S: Dn>(args: &Args, bytes: &[u8]) -> Result<Frames<S>> {
    let stream = match args.damaged {
        true => csi2::decode_damaged(bytes)?,
        false => csi2::decode_stream(bytes)
            .map_err(|e| e.help("--damaged converts what is there, with what is lost as zero"))?,
    };
    stream.faults.iter().for_each(|fault| eprintln!("warning: {fault}"));
    match args.virtual_channel {
        Some(channel) => stream.channel(channel),
        None => stream.only(),
    }
}

/// Converts frames of more than 16 bits.
fn convert_wide(args: &Args, mut frames: Frames<u32>) -> Result<ExitCode> {
    if args.preview || args.white.is_some() {
        return Err(Error::unsupported("a picture or another white level of more than 16 bits")
            .help("convert samples alone, or simulate with output = \"companded\""));
    }
    if let Some(index) = args.frame {
        frames.planes = vec![frame_of(frames.planes, index)?];
    }
    let facts = &mut frames.facts;
    facts.bits = args.bits.or(facts.bits);
    facts.black_level_dn = args.black.or(facts.black_level_dn);
    if let Some(cfa) = &args.cfa {
        facts.cfa = Some(Cfa::parse(cfa).map_err(|e| e.at("--cfa"))?);
    }
    let bytes = formats::wide::encode(&output_format(args)?, &frames);
    output::write_file(&args.output, args.force, &bytes.map_err(|e| e.at(args.input.display()))?)?;
    Ok(ExitCode::SUCCESS)
}

fn is_packets(bytes: &[u8]) -> bool {
    Format::sniff(bytes) == Some(Format::Csi2)
}

/// A frame of a stack.
fn frame_of<T>(mut planes: Vec<T>, index: usize) -> Result<T> {
    if index < planes.len() {
        return Ok(planes.swap_remove(index));
    }
    let help = format!("the file has {} frame(s), counted from 0", planes.len());
    Err(Error::input(format!("--frame {index}")).help(help))
}

fn read(args: &Args, bytes: &[u8]) -> Result<Frames> {
    let frames = match () {
        () if is_headerless_input(args) => headerless(args, bytes),
        () if is_packets(bytes) => packets(args, bytes),
        () => formats::decode(bytes),
    };
    let mut frames = frames.map_err(|e| e.at(args.input.display()))?;
    let facts = &mut frames.facts;
    if let (Some(bits), Some(stored @ ..=8)) = (args.bits, facts.bits)
        && bits > stored
    {
        return Err(Error::disagreement(format!("--bits {bits} of samples of {stored} bits"))
            .at(args.input.display())
            .help(
                "where two bytes are a sample, as in Picamera2's capture_array(\"raw\"), save \
                 words: array.view(numpy.uint16)",
            ));
    }
    facts.bits = args.bits.or(facts.bits);
    facts.black_level_dn = args.black.or(facts.black_level_dn);
    facts.white_level_dn = args.white.or(facts.white_level_dn);
    if let Some(cfa) = &args.cfa {
        facts.cfa = Some(Cfa::parse(cfa).map_err(|e| e.at("--cfa"))?);
    }
    if args.black.is_some_and(|b| !b.is_finite() || b < 0.0) {
        return Err(Error::input("--black").help("a number of DN, 0 or more"));
    }
    if let (Some(_), Some(info)) = (args.black, &mut facts.dng) {
        info.black_levels_dn.clear(); // one level for all instead
    }
    Ok(frames)
}

fn headerless(args: &Args, bytes: &[u8]) -> Result<Frames> {
    let named = PixelFormat::from_file_name(&args.input);
    let size = named.as_ref().ok().and_then(|(_, size)| *size);
    let pixels = match &args.from {
        Some(name) => PixelFormat::parse(name).map_err(|e| e.at("--from"))?,
        None => named?.0,
    };
    let width = args.width.or(size.map(|s| s.0));
    let height = args.height.or(size.map(|s| s.1));
    match (width, height) {
        (Some(width), Some(height)) => pixels.decode(bytes, width, height, args.stride),
        _ => Err(Error::input("headerless pixels of unknown size")
            .help("give --width and --height, or name the file like NAME_640x480_SGRBG10P.raw")),
    }
}

fn output_format(args: &Args) -> Result<Format> {
    match &args.to {
        Some(name) => Format::parse(name).map_err(|e| e.at("--to")),
        None if args.output.as_os_str() == "-" => {
            Err(Error::input("standard output has no name that determines the format")
                .help("give --to, for instance --to npy"))
        }
        None => Format::from_path(&args.output),
    }
}

fn csi2_options(args: &Args, count: usize, bits: Option<u32>, input: &[u8]) -> csi2::Options {
    let bits = bits.unwrap_or(u16::BITS);
    let line = |frame: usize| {
        let mut line = csi2::Embedded::default();
        line.put(csi2::address::FRAME_COUNT, &[(frame % 255) as u8]);
        vec![line.line(bits)]
    };
    csi2::Options {
        virtual_channel: args.virtual_channel.filter(|_| !is_packets(input)).unwrap_or(0),
        line_packets: args.line_packets,
        embedded: if args.embedded { (0..count).map(line).collect() } else { vec![] },
        ..csi2::Options::default()
    }
}

/// Hints go to standard error: standard output may carry the pixels.
fn hint(path: &Path, format: &Format, frames: &Frames) {
    match format {
        Format::Raw(pixels) => {
            for line in pixels.hints(path, frames.width(), frames.height()) {
                eprintln!("{line}");
            }
        }
        _ => eprintln!("hints are for headerless pixels: name the output like x_SGRBG10.raw"),
    }
}

//! DNG reader: colour-filter-array and linear raw DNGs, in strips or tiles, 8 to 16 bits per
//! sample, packed, in words, or as lossless JPEG.
//!
//! Of several raw images one is read (`choose`), and a note names the others.
//!
//! The linearization table is applied to the samples, and the frame is cropped to the active area,
//! to which pattern and black levels refer. Row and column black-level deltas
//! count by their means. Bad pixels of OpcodeList1, whose places are those of the stored image, go
//! with the crop; opcodes that are not kept are named in a note.

use super::cfa_codes::{color_code, color_letter};
use super::dng_info::{CARRIED, ColorMatrix, DngInfo};
use super::ifd::{Ifd, Tiff};
use super::opcodes::Opcode;
use super::{Facts, Frames, Taken, full_scale, narrow, opcodes, tiff_samples};
use camrig_base::{Cfa, Error, Plane, Result};
use std::cmp::Reverse;

/// PhotometricInterpretation of a colour filter array.
const CFA: u64 = 32803;
/// PhotometricInterpretation of linear raw samples without a colour filter array.
const LINEAR_RAW: u64 = 34892;
/// Directories that a file may have: the raw image and a few previews are usual; the limit bounds
/// the work that a damaged file can ask for.
const MAX_DIRECTORIES: usize = 64;

/// Reads DNG bytes.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let file = Tiff::open(bytes)?;
    let mut notes = Vec::new();
    let images = directories(&file, &mut notes)?;
    let (main, raw) = (&images[0], choose(&images, &mut notes)?);
    let stored = tiff_samples::read(&file, raw)?;
    let active = active_area(raw, [stored.height, stored.width])?;
    let plane = linear(stored, raw)?;
    let plane = active.map(|area| crop(&plane, area)).unwrap_or(plane);
    // The tags decide. Camrig's own note adds the bits, which a white level below full scale does
    // not tell, and the letters of filters that have no code of their own.
    let mut note = <Facts>::default();
    note.merge_note(&raw.text(270).unwrap_or_default());
    let cfa = pattern(raw, note.cfa)?;
    let mut black = black_levels(raw, cfa.width, cfa.height)?;
    let pattern = [cfa.width, cfa.height];
    add_deltas(&mut black, raw, pattern, [plane.width, plane.height], &mut notes)?;
    not_negative(&black)?;
    let largest = plane.data.iter().copied().max().unwrap_or(0);
    let white = white_level(raw, largest, &mut notes)?;
    // Noise and highlights reach above the level at which a sensor counts as saturated.
    let largest = largest.max(white);
    let mut facts = Facts {
        bits: note.bits.or(Some((u16::BITS - largest.leading_zeros()).max(1))),
        cfa: Some(cfa),
        black_level_dn: Some(black.iter().sum::<f64>() / black.len() as f64),
        white_level_dn: Some(white),
        ..Facts::default()
    };
    notes.extend(tiff_samples::orientation(main.uint(274).or(raw.uint(274)).unwrap_or(1)));
    let exif = main.uint(34665).and_then(|offset| file.ifd(offset as usize).ok());
    // TIFF/EP has the fields of Exif in the main directory, where many small writers put them.
    let taken_from: Vec<&Ifd> = exif.iter().chain([main, raw]).collect();
    facts.taken = Taken::of_directories(&taken_from);
    facts.taken.noted = true;
    let mut info = info(main, raw, &taken_from);
    [info.opcode_list1, info.opcode_list2] = corrections(raw, active, &mut notes)?;
    if black.iter().any(|b| *b != black[0]) {
        info.black_levels_dn = black;
    }
    facts.dng = Some(info);
    facts.notes = notes;
    Ok(Frames { planes: vec![plane], facts })
}

/// The directories of the file: the chain of main ones, each followed by its SubIFDs.
fn directories<'a>(file: &Tiff<'a>, notes: &mut Vec<String>) -> Result<Vec<Ifd<'a>>> {
    let mut images = Vec::new();
    let (mut place, mut seen) = (Some(file.first()?), Vec::new());
    while let Some(offset) = place {
        let read = if seen.contains(&offset) {
            Err(Error::input("a chain of directories that comes back to its beginning"))
        } else {
            file.ifd(offset)
        };
        let main = match read {
            Ok(main) => main,
            Err(error) if images.is_empty() => return Err(error),
            // Some writers leave no sensible number behind their last directory.
            Err(error) => {
                notes.push(format!(
                    "what follows directory {} is not read: {}",
                    seen.len(),
                    error.what()
                ));
                break;
            }
        };
        seen.push(offset);
        // A file cut off right here has lost nothing but the mark of its end.
        place = file.next(&main).unwrap_or(None);
        let inner = main.uints(330).unwrap_or_default();
        images.push(main);
        for offset in inner.iter().take(MAX_DIRECTORIES) {
            images.push(file.ifd(*offset as usize)?);
        }
        if inner.len() > MAX_DIRECTORIES || images.len() > MAX_DIRECTORIES {
            return Err(Error::limit(format!("a DNG of more than {MAX_DIRECTORIES} directories"))
                .help("is it damaged?"));
        }
    }
    Ok(images)
}

/// The raw image: one that calls itself the main image (NewSubFileType 0) before others, then the
/// one with the most pixels, then the first. A note names the others.
fn choose<'i, 'a>(images: &'i [Ifd<'a>], notes: &mut Vec<String>) -> Result<&'i Ifd<'a>> {
    let sides = |d: &Ifd| [256, 257].map(|tag| d.uint(tag).unwrap_or(0));
    let kind = |d: &Ifd| d.uint(254).unwrap_or(0);
    let raw = || images.iter().filter(|d| matches!(d.uint(262), Some(CFA | LINEAR_RAW)));
    let rank = |d: &&Ifd| (kind(d) != 0, Reverse(sides(d)[0].saturating_mul(sides(d)[1])));
    let chosen = raw().min_by_key(rank).ok_or_else(|| {
        Error::input("a DNG without a raw image").help("is it a JPEG preview only?")
    })?;
    let (mut read, mut others) = (String::new(), Vec::new());
    for (number, image) in (1..).zip(raw()) {
        let ([width, height], kind) = (sides(image), kind(image));
        let name = format!("number {number} ({width} x {height}, NewSubFileType {kind})");
        if std::ptr::eq(image, chosen) {
            read = name;
        } else {
            others.push(name);
        }
    }
    if !others.is_empty() {
        notes.push(format!(
            "of the file's {} raw images {read} is read, not {}",
            others.len() + 1,
            others.join(", ")
        ));
    }
    Ok(chosen)
}

/// The numbers of a field, `None` where the file lacks it.
fn numbers(raw: &Ifd, tag: u16, name: &str) -> Result<Option<Vec<f64>>> {
    if raw.bytes(tag).is_none() {
        return Ok(None);
    }
    let values = raw.floats(tag).filter(|v| !v.is_empty()).ok_or_else(|| {
        Error::input("values that are no finite numbers")
            .at(format!("{name} (tag {tag})"))
            .help("give whole numbers or fractions whose denominator is not 0")
    })?;
    Ok(Some(values))
}

/// The white level; by the DNG specification full scale where the file lacks it, which a note says
/// where samples go up to a `largest` above it, or the linearization table does.
fn white_level(raw: &Ifd, largest: u16, notes: &mut Vec<String>) -> Result<u16> {
    let Some(levels) = numbers(raw, 50717, "WhiteLevel")? else {
        let bits = raw.uint(258).unwrap_or(16) as u32;
        let white = full_scale(bits);
        let table = numbers(raw, 50712, "LinearizationTable")?.unwrap_or_default();
        let most = table.into_iter().fold(f64::from(largest), f64::max);
        if most > f64::from(white) {
            notes.push(format!(
                "the file has no white level: {white} is taken, full scale of its {bits} bits, \
                 though its values go up to {most}"
            ));
        }
        return Ok(white);
    };
    let white = levels[0];
    if levels.iter().any(|level| *level != white) {
        notes.push(format!("of the file's white levels {levels:?} the first is taken"));
    }
    if white > f64::from(u16::MAX) {
        notes.push(format!(
            "the file's white level {white} is above what 16 bits hold: {} is taken",
            u16::MAX
        ));
    }
    narrow::float(white.min(f64::from(u16::MAX))).map_err(|e| e.at("WhiteLevel (tag 50717)"))
}

/// Applies the linearization table; indices beyond its end take the last entry.
fn linear(mut plane: Plane<u16>, raw: &Ifd) -> Result<Plane<u16>> {
    if let Some(table) = numbers(raw, 50712, "LinearizationTable")? {
        for sample in &mut plane.data {
            let value = table[usize::from(*sample).min(table.len() - 1)];
            *sample = narrow::float(value).map_err(|e| e.at("LinearizationTable (tag 50712)"))?;
        }
    }
    Ok(plane)
}

/// Top, left, bottom and right of the active area in an image of a height and a width; `None`
/// where it is the whole image.
fn active_area(raw: &Ifd, [height, width]: [usize; 2]) -> Result<Option<[usize; 4]>> {
    let Some(active) = numbers(raw, 50829, "ActiveArea")? else { return Ok(None) };
    let sides: Vec<usize> = active.iter().map(|&v| v as usize).collect();
    match sides[..] {
        [top, left, bottom, right]
            if top < bottom && left < right && bottom <= height && right <= width =>
        {
            let area = [top, left, bottom, right];
            Ok((area != [0, 0, height, width]).then_some(area))
        }
        _ => Err(Error::input(format!("active area {sides:?}"))
            .help("it is top, left, bottom, right within the image")),
    }
}

fn crop(plane: &Plane<u16>, [top, left, bottom, right]: [usize; 4]) -> Plane<u16> {
    Plane::from_fn(right - left, bottom - top, |x, y| plane.at(left + x, top + y))
}

/// The opcodes of lists 1 and 2 that are kept; a note of the others, those of list 3 among them.
/// Places of list 1 are those of the stored image, which the active area crops; list 2 comes after
/// the crop.
fn corrections(
    raw: &Ifd,
    active: Option<[usize; 4]>,
    notes: &mut Vec<String>,
) -> Result<[Vec<Opcode>; 2]> {
    let mut others = Vec::new();
    let mut list = |tag: u16, name: &str| {
        let mut skipped = Vec::new();
        let read = raw.bytes(tag).map(|bytes| opcodes::decode(bytes, &mut skipped));
        others.extend(skipped.into_iter().map(|what| format!("{what} of {name}")));
        read.unwrap_or(Ok(Vec::new()))
    };
    let (mut first, second) = (list(51008, "OpcodeList1")?, list(51009, "OpcodeList2")?);
    if let Some(area) = active.map(|area| area.map(|side| side as u32)) {
        if first.iter().any(|opcode| matches!(opcode, Opcode::GainMap(_))) {
            others.push("GainMap of OpcodeList1 (on the image before its crop)".into());
        }
        first = first.into_iter().filter_map(|opcode| opcode.cropped(area)).collect();
    }
    if let Some(bytes) = raw.bytes(51022) {
        let names = opcodes::names(bytes).unwrap_or_else(|_| vec!["a damaged list".into()]);
        others.extend(names.into_iter().map(|what| format!("{what} of OpcodeList3")));
    }
    if !others.is_empty() {
        notes.push(format!(
            "corrections that the file asks for are neither applied nor kept: {}",
            others.join(", ")
        ));
    }
    Ok([first, second])
}

/// The pattern of the tags; that of camrig's note where both have the same codes.
fn pattern(raw: &Ifd, noted: Option<Cfa>) -> Result<Cfa> {
    if raw.uint(50711).is_some_and(|layout| layout > 1) {
        return Err(Error::unsupported("a DNG with a staggered colour filter array (CFALayout)")
            .help("rows and columns of a rectangular array are read"));
    }
    if raw.uint(262) == Some(LINEAR_RAW) {
        return Cfa::parse("mono");
    }
    let codes = raw.bytes(33422).unwrap_or(&[]);
    let (height, width) = match raw.uints(33421).as_deref() {
        Some([h, w]) => (*h as usize, *w as usize),
        _ => (2, 2),
    };
    let letters: Option<String> = codes.iter().map(|&c| color_letter(c)).collect();
    match letters {
        Some(letters) if width > 0 && width.checked_mul(height) == Some(letters.len()) => {
            let letters: Vec<char> = letters.chars().collect();
            let rows: Vec<String> = letters.chunks(width).map(|r| r.iter().collect()).collect();
            // One row of four would read as two rows of two.
            let rows = if (width, height) == (4, 1) { [&rows[..], &rows].concat() } else { rows };
            let tagged = Cfa::parse(&rows.join("/"))?;
            let same = |n: &Cfa| {
                (n.width, n.height) == (width, height)
                    && n.letters.iter().zip(codes).all(|(&l, &c)| color_code(n, l) == c)
            };
            Ok(noted.filter(same).unwrap_or(tagged))
        }
        _ => {
            Err(Error::unsupported(format!("colour filter pattern {codes:?}, {height} x {width}"))
                .help("codes are 0 to 6, one per cell"))
        }
    }
}

/// Black level of each cell of the pattern; the DNG's own repeat may be smaller.
fn black_levels(raw: &Ifd, width: usize, height: usize) -> Result<Vec<f64>> {
    let levels = numbers(raw, 50714, "BlackLevel")?.unwrap_or_else(|| vec![0.0]);
    let (rows, columns) = match raw.uints(50713).as_deref() {
        Some([r, c]) => (*r as usize, *c as usize),
        _ => (1, 1),
    };
    if levels.is_empty() || rows.checked_mul(columns) != Some(levels.len()) {
        return Err(Error::unsupported(format!(
            "{} black levels for {rows} x {columns}",
            levels.len()
        )));
    }
    let at = |y: usize, x: usize| levels[y % rows * columns + x % columns];
    // A cell of the pattern meets all levels that lie whole common divisors apart.
    let (down, across) = (common_divisor(rows, height), common_divisor(columns, width));
    if (0..levels.len()).any(|i| levels[i] != at(i / columns % down, i % columns % across)) {
        return Err(Error::unsupported(format!(
            "black levels of {rows} x {columns} pixels that differ within the cells of a pattern \
             of {height} x {width}"
        ))
        .at("BlackLevel (tag 50714), BlackLevelRepeatDim (tag 50713)")
        .help("give one black level, or one for each cell of the colour filter pattern"));
    }
    Ok((0..width * height).map(|i| at(i / width, i % width)).collect())
}

/// Adds to the black level of each cell of the pattern the mean of the deltas of its columns and of
/// its rows (DNG 1.4: BlackLevel[y][x] + BlackLevelDeltaH[x] + BlackLevelDeltaV[y], one for each
/// column and row of the active area). A note says where deltas within a cell differ, as samples are
/// not changed.
fn add_deltas(
    black: &mut [f64],
    raw: &Ifd,
    [width, height]: [usize; 2],
    [columns, rows]: [usize; 2],
    notes: &mut Vec<String>,
) -> Result<()> {
    let axes = [
        (50715, "BlackLevelDeltaH", "column", columns, width, 0),
        (50716, "BlackLevelDeltaV", "row", rows, height, 1),
    ];
    for (tag, name, line, lines, period, axis) in axes {
        let deltas = numbers(raw, tag, name)?.unwrap_or_default();
        if deltas.is_empty() {
            continue;
        }
        if deltas.len() != lines {
            return Err(Error::input(format!("{} deltas for {lines} {line}s", deltas.len()))
                .at(format!("{name} (tag {tag})"))
                .help(format!("DNG has one for each {line} of the active area, or none at all")));
        }
        let mean = |phase: usize| {
            let own = deltas.iter().skip(phase % lines).step_by(period);
            own.clone().sum::<f64>() / own.count() as f64
        };
        let means: Vec<f64> = (0..period).map(mean).collect();
        for (i, level) in black.iter_mut().enumerate() {
            // Fractions of whole numbers: no more digits than they state.
            *level = ((*level + means[[i % width, i / width][axis]]) * 1e9).round() / 1e9;
        }
        let residual = (0..).zip(&deltas).map(|(i, d)| (d - means[i % period]).abs());
        let largest = residual.fold(0.0, f64::max);
        if largest > 0.0 {
            notes.push(format!(
                "the file's black level differs from {line} to {line} by up to {largest} DN from \
                 its mean ({name}): the mean is taken, the samples are as stored"
            ));
        }
    }
    Ok(())
}

fn not_negative(black: &[f64]) -> Result<()> {
    if black.iter().any(|level| *level < 0.0) {
        return Err(Error::input(format!("black levels {black:?}"))
            .at("BlackLevel (tag 50714) with its deltas (tags 50715, 50716)")
            .help("they are numbers of DN, 0 or more"));
    }
    Ok(())
}

fn common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

fn info(main: &Ifd, raw: &Ifd, taken_from: &[&Ifd]) -> DngInfo {
    let matrix = |tag: u16| -> Option<[[f64; 3]; 3]> {
        let v: [f64; 9] = main.floats(tag)?.try_into().ok()?;
        Some([[v[0], v[1], v[2]], [v[3], v[4], v[5]], [v[6], v[7], v[8]]])
    };
    let color_matrices =
        [(50721, 50778), (50722, 50779)].into_iter().filter_map(|(tag, light)| {
            let illuminant = main.uint(light).and_then(|v| u16::try_from(v).ok()).unwrap_or(0);
            Some(ColorMatrix { illuminant, camera_from_xyz: matrix(tag)? })
        });
    let carried = CARRIED.into_iter().filter_map(|tag| Some((tag, main.floats(tag)?)));
    let exif_value = |tag: u16| taken_from.iter().find_map(|d| d.floats(tag)?.first().copied());
    let noise = raw.floats(51041).or_else(|| main.floats(51041)).unwrap_or_default();
    DngInfo {
        make: main.text(271).unwrap_or_default(),
        model: main.text(272).unwrap_or_default(),
        description: main.text(270).unwrap_or_default(),
        datetime: main.text(306),
        exposure_s: exif_value(33434),
        iso: exif_value(34855).map(|v| v as u32),
        f_number: exif_value(33437),
        focal_length_mm: exif_value(37386),
        pitch_um: None,
        color_matrices: color_matrices.collect(),
        as_shot_neutral: main.floats(50728).and_then(|v| v.try_into().ok()),
        noise_profile: noise.chunks_exact(2).map(|p| (p[0], p[1])).collect(),
        linearization: Vec::new(), // the samples are linear now
        black_levels_dn: Vec::new(),
        carried: carried.collect(),
        opcode_list1: Vec::new(),
        opcode_list2: Vec::new(),
    }
}

//! Camera files of three HDR sensors: the cameras of `golden/hdr`, without fixed patterns.

use std::fmt::Write as _;

/// Names of the cameras: two gains of one charge; three exposures, 16:1 each; two photodiodes
/// with four captures.
pub const CAMERAS: [&str; 3] = ["dcg2", "dol3", "split4"];

struct Photodiode {
    name: &'static str,
    ratio: f64,
    full_well_e: f64,
    dark_e_per_s: f64,
}

struct Capture {
    name: &'static str,
    photodiode: &'static str,
    window: u8,
    start_us: f64,
    exposure_ratio: f64,
    dn_per_e: f64,
    read_e: f64,
    gain: u32,
}

struct Kind {
    photodiodes: Vec<Photodiode>,
    captures: Vec<Capture>,
    black_dn: u16,
    linear_bits: u8,
    pedestal_dn: u32,
    subtract_dn: u32,
    code_pedestal_dn: u32,
    knees: &'static str,
}

fn capture(
    name: &'static str,
    (photodiode, window, start_us, exposure_ratio): (&'static str, u8, f64, f64),
    (dn_per_e, read_e, gain): (f64, f64, u32),
) -> Capture {
    Capture { name, photodiode, window, start_us, exposure_ratio, dn_per_e, read_e, gain }
}

fn kind(name: &str) -> Kind {
    let photodiode = |name, ratio, full_well_e, dark_e_per_s| Photodiode {
        name,
        ratio,
        full_well_e,
        dark_e_per_s,
    };
    match name {
        "dcg2" => Kind {
            photodiodes: vec![photodiode("main", 1.0, 40_000.0, 20.0)],
            captures: vec![
                capture("hcg", ("main", 0, 0.0, 1.0), (1.5, 1.2, 1)),
                capture("lcg", ("main", 0, 0.0, 1.0), (0.09375, 8.0, 16)),
            ],
            black_dn: 50,
            linear_bits: 16,
            pedestal_dn: 3200,
            subtract_dn: 3200,
            code_pedestal_dn: 200,
            knees: "[500, 500], [11500, 671.875], [65536, 4049.125]",
        },
        "dol3" => Kind {
            photodiodes: vec![photodiode("main", 1.0, 12_000.0, 50.0)],
            captures: vec![
                capture("long", ("main", 0, 0.0, 1.0), (0.32, 2.5, 1)),
                capture("middle", ("main", 1, 20_000.0, 0.0625), (0.32, 2.5, 16)),
                capture("short", ("main", 2, 22_000.0, 0.003_906_25), (0.32, 2.5, 256)),
            ],
            black_dn: 168,
            linear_bits: 20,
            pedestal_dn: 168,
            subtract_dn: 0,
            code_pedestal_dn: 0,
            knees: "[2048, 512], [16384, 1408], [65536, 2176], [1048576, 4096]",
        },
        _ => Kind {
            photodiodes: vec![
                photodiode("large", 1.0, 22_000.0, 25.0),
                photodiode("small", 3.0 / 128.0, 7900.0, 4.0),
            ],
            captures: vec![
                capture("hcg", ("large", 0, 0.0, 1.0), (0.75, 0.9, 1)),
                capture("lcg", ("large", 0, 0.0, 1.0), (0.1875, 3.0, 4)),
                capture("small", ("small", 1, 0.0, 1.0), (0.5, 1.5, 64)),
                capture(
                    "very-short",
                    ("large", 2, 20_000.0, 11e-6 / 11.264e-3),
                    (0.1875, 3.0, 4096),
                ),
            ],
            black_dn: 64,
            linear_bits: 24,
            pedestal_dn: 64,
            subtract_dn: 0,
            code_pedestal_dn: 0,
            knees: "[640, 640], [1024, 832], [2048, 1088], [4096, 1344], [8192, 1600], \
                    [16384, 1856], [32768, 2112], [65536, 2368], [131072, 2624], [262144, 2880], \
                    [2097152, 3328], [4194304, 3584], [8388608, 3840], [16777216, 4096]",
        },
    }
}

/// Exposure of the first capture of one of [`CAMERAS`], s.
#[must_use]
pub fn exposure_s(name: &str) -> f64 {
    match name {
        "dcg2" => 0.02,
        "dol3" => 0.016,
        _ => 0.011_264,
    }
}

/// The camera file of one of [`CAMERAS`] with a monochrome sensor of this size, a quantum
/// efficiency of 1 and output `companded`, `linear` or `captures`.
#[must_use]
pub fn camera(name: &str, [width, height]: [u32; 2], output: &str) -> String {
    let kind = kind(name);
    let mut text = format!(
        "name = {name:?}\n[lens]\nkind = \"diffraction-limited\"\nf_number = 2.0\n\
         focal_length_mm = 6.0\nrelative_illumination = \"none\"\n[sensor]\nwidth = {width}\n\
         height = {height}\npitch_um = 3.0\nfill_factor = 1.0\ncfa = \"mono\"\nqe = 1.0\n\
         full_well_e = 10000\nbits = 12\nblack_level_dn = 64\n\
         [sensor.noise]\nread_e = 2.0\ndark_current_e_per_s = 20.0\nprnu = 0.0\n\
         [sensor.hdr]\noutput = {output:?}\nrow_time_us = 11.0\n"
    );
    for Photodiode { name, ratio, full_well_e, dark_e_per_s } in &kind.photodiodes {
        write!(
            text,
            "[[sensor.hdr.photodiode]]\nname = {name:?}\nresponse_ratio = {ratio}\n\
             full_well_e = {full_well_e}\noverflow_e = 0\ndark_current_e_per_s = {dark_e_per_s}\n\
             dsnu_e_per_s = 0\nprnu = 0\noptical_leak = 0\noverflow_leak = 0\n"
        )
        .unwrap();
    }
    for (channel, c) in kind.captures.iter().enumerate() {
        write!(
            text,
            "[[sensor.hdr.capture]]\nname = {:?}\nphotodiode = {:?}\nwindow = {}\n\
             start_us = {}\nexposure_ratio = {}\ngain_ratio = 1.0\nfull_scale_e = {}\nbits = 12\n\
             black_level_dn = {}\nread_e = {}\nread_e_post = 0\nrow_fpn_e = 0\noverflow = false\n\
             virtual_channel = {channel}\n",
            c.name,
            c.photodiode,
            c.window,
            c.start_us,
            c.exposure_ratio,
            4095.0 / c.dn_per_e,
            kind.black_dn,
            c.read_e,
        )
        .unwrap();
    }
    let gains: Vec<u32> = kind.captures.iter().map(|c| c.gain).collect();
    write!(
        text,
        "[sensor.hdr.merge]\nlinear_bits = {}\npedestal_dn = {}\ngains = {gains:?}\n\
         flicker_capture = \"none\"\nflicker_margin_dn = 0\n",
        kind.linear_bits, kind.pedestal_dn
    )
    .unwrap();
    for pair in kind.captures.windows(2) {
        write!(
            text,
            "[[sensor.hdr.merge.step]]\nto = {:?}\ndecide = {:?}\nlow_dn = 3000\nhigh_dn = 3600\n",
            pair[1].name, pair[0].name
        )
        .unwrap();
    }
    write!(
        text,
        "[sensor.hdr.companding]\nbits = 12\nsubtract_dn = {}\npedestal_dn = {}\n\
         rounding = \"floor\"\nknees = [{}]\n",
        kind.subtract_dn, kind.code_pedestal_dn, kind.knees
    )
    .unwrap();
    text
}

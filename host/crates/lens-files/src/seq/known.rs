//! Commands of CODE V that are passed over because they do not change the image, and those that
//! are refused with a word about what they are. A command in neither list that the reader does not
//! know is refused too.

/// Commands without effect on the image: the design's bookkeeping.
const HARMLESS: &[&[&str]] = &[SET, WEIGHTS, COUPLINGS, TOLERANCES, MANUFACTURE];
/// The lens as a data set: start, end, remarks, names, listings, drawings and their colours.
const SET: &[&str] =
    &["LEN", "INI", "GO", "COM", "UID", "SAV", "OUT", "SLB", "LIS", "VIE", "DRA", "CLS", "DOR"];
/// Weights of fields in merit functions.
const WEIGHTS: &[&str] = &["WTF", "WTX", "WTY"];
/// What an optimisation varies and couples.
const COUPLINGS: &[&str] = &[
    "CCY", "CCX", "THC", "GLC", "KC", "KYC", "KXC", "AC", "BC", "CC", "DC", "EC", "FC", "GC",
    "HC", "IC", "JC", "SCC", "HCC", "XDC", "YDC", "ZDC", "ADC", "BDC", "CDC", "RDC", "CUC",
];
/// Tolerances and how a drawing states them.
const TOLERANCES: &[&str] = &[
    "DLR", "DLT", "DLN", "DLV", "DLF", "DLX", "DLY", "DLZ", "DLA", "DLB", "DLG", "DLS", "DLM",
    "CYD", "CYN", "IRR", "TIX", "TIY", "TIR", "TRX", "TRY", "TRR", "BTX", "BTY", "BTI", "BTR",
    "DIS", "DSX", "DSY", "DSR", "ROL", "STI", "HOM", "DER", "CUM", "CUF", "PFR", "PTP", "POR",
];
/// Drawings, heat and manufacture; of mirrors the thickness of the glass behind them (`THM`).
const MANUFACTURE: &[&str] = &["CA", "DDM", "RAT", "CIN", "SPT", "MFL", "TCE", "STP", "THM"];

/// Commands and words that solve for a value, or take it from another surface, whose result stands
/// in the file already: the paraxial image (PIM); the length of a part (OAL); angle (U), incidence
/// (I) or height (H) of the marginal (M) or chief ray (C) in y or x; pickups.
const SOLVES: &[&str] = &[
    "PIM", "OAL", "UMY", "UMX", "UCY", "UCX", "IMY", "IMX", "ICY", "ICX", "HMY", "HMX", "HCY",
    "HCX", "PIK", "PIC",
];

/// Commands of surfaces and systems that are not sequential, or that bend light by other means than
/// the known surfaces, with what they are.
const REFUSED: &[(&str, &str)] = &[
    ("AFC", "an afocal system"),
    ("AFI", "an afocal system"),
    ("AFO", "an afocal system"),
    ("AFOC", "an afocal system"),
    ("TEL", "a lens that is telecentric on the object's side"),
    ("YTO", "a toroid"),
    ("XTO", "a toroid"),
    ("TOR", "a toroid"),
    ("HOE", "a hologram"),
    ("HCO", "a hologram"),
    ("HOR", "a hologram"),
    ("HWL", "a hologram"),
    ("HCT", "a hologram"),
    ("DIF", "a diffractive surface"),
    ("GRT", "a grating"),
    ("GRO", "a grating"),
    ("GRS", "a grating"),
    ("GRI", "a medium whose index varies"),
    ("GRN", "a medium whose index varies"),
    ("RET", "a tilt or decentre"),
    ("GLB", "a tilt or decentre"),
    ("ARO", "a turned aperture"),
    ("NSS", "a non-sequential part"),
    ("PUX", "a pupil of uneven brightness"),
    ("PUY", "a pupil of uneven brightness"),
    ("PUI", "a pupil of uneven brightness"),
    ("FRE", "a Fresnel surface"),
    ("MOD", "a lens module"),
];

/// What the list says about a command.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Known {
    /// It does not change the image.
    Harmless,
    /// It solves for a value that the file gives.
    Solve,
    /// It cannot be traced: what it is.
    Refused(&'static str),
    /// Nothing is known of it.
    Unknown,
}

/// Looks a command up.
pub(super) fn known(keyword: &str) -> Known {
    if HARMLESS.iter().any(|group| group.contains(&keyword)) {
        return Known::Harmless;
    }
    if SOLVES.contains(&keyword) {
        return Known::Solve;
    }
    match REFUSED.iter().find(|(name, _)| *name == keyword) {
        Some((_, what)) => Known::Refused(what),
        None => Known::Unknown,
    }
}

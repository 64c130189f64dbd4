//! The code at which samples saturate, where it is not the largest of its bits: samples of a bright
//! stack pile up at the highest code that occurs, more than at any code near below it, or, where
//! noise and patterns follow what clips, lie about a level without the noise of their light.

use super::finding::{Done, Finding, Kind, names};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_captures::{CaptureSet, Role};

/// Least share of a stack's samples at the highest code that is a pile; saturated maps and noise
/// are judged by no smaller shares.
const MIN_SHARE: f64 = 1e-3;
/// Ratio of the number of samples at the highest code to that at the next lower code in use from
/// which they are a pile. A distribution that is not clipped falls towards its end, and codes that
/// stand for several differ in width by a factor of 2 from one to the next. Chosen.
const PILE: u64 = 3;
/// Codes in use below the highest in other flats: with fewer, one code may be a whole stack.
const MIN_CODES: usize = 11;

/// Shot noise of a level, over that of photon transfer, below which it is saturated; and above which
/// every darker level must have its own. Chosen: saturation leaves none, while codes behind a curve
/// lose theirs over several levels.
const LOST: f64 = 0.1;
const KEPT: f64 = 0.5;
/// Darker levels whose shot noise is above the noise in the dark.
const MIN_DARKER: usize = 3;
/// Share of a saturated stack's samples that lies below the code from which on samples are
/// saturated: defective pixels do not decide.
const TAIL: f64 = 0.01;

/// The code from which on samples are saturated, and how they show it, in words.
pub struct Top {
    pub dn: u16,
    shown: String,
}

/// The code where samples pile up below the white level of the manifest.
pub fn piled(set: &CaptureSet, scans: &[Scan]) -> Option<Top> {
    let highest = |s: &Scan| s.codes.iter().rposition(|&n| n > 0);
    let top = scans.iter().filter_map(highest).max()?;
    if top >= usize::from(set.sensor.white_level_dn) {
        return None;
    }
    let flats = || scans.iter().filter(|s| set.captures[s.capture].role == Role::Flat);
    let other = |s: &&Scan| s.codes[top] == 0;
    let used = |s: &Scan| s.codes.iter().filter(|&&n| n > 0).count() >= MIN_CODES;
    let found = flats().any(|s| piles_up(s, top)) && flats().filter(other).any(used);
    found.then(|| Top { dn: top as u16, shown: "and none is larger".into() })
}

fn piles_up(scan: &Scan, top: usize) -> bool {
    let all: u64 = scan.codes.iter().sum();
    let next = scan.codes[..top].iter().rfind(|&&n| n > 0).copied().unwrap_or(0);
    let count = scan.codes[top];
    count as f64 > MIN_SHARE * all as f64 && count > PILE * next
}

/// The lower end of the brightest stack, where it is the one that has lost its shot noise: its
/// charge or voltage no longer follows the light, and what varies was added behind.
pub fn smeared(set: &CaptureSet, scans: &[Scan], transfer: &Transfer) -> Option<Top> {
    let capture = |i: usize| &set.captures[scans[i].capture];
    let flats = (0..scans.len()).filter(|&i| capture(i).role == Role::Flat);
    let level = |i: usize| transfer.points[i].level_dn;
    let brightest = flats.clone().max_by(|&a, &b| level(a).total_cmp(&level(b)))?;
    let gain = capture(brightest).analog_gain;
    let of_gain = |i: &usize| capture(*i).analog_gain == gain;
    let variance = |i: usize| transfer.points[i].variance_dn2;
    let in_the_dark = (0..scans.len()).filter(of_gain).map(variance).fold(f64::NAN, f64::min);
    let shot = |i: usize| transfer.gain(gain) * (level(i) - transfer.black);
    let kept = |i: usize| (variance(i) - in_the_dark) / shot(i);
    let darker: Vec<usize> =
        flats.filter(of_gain).filter(|&i| i != brightest && shot(i) > in_the_dark).collect();
    let found = kept(brightest) < LOST
        && darker.len() >= MIN_DARKER
        && darker.iter().all(|&i| kept(i) > KEPT);
    let dn = scans[brightest].quantile(TAIL);
    (found && dn < set.sensor.white_level_dn).then(|| Top {
        dn,
        shown: format!(
            "or more, with {:.2} times the shot noise of such a level",
            kept(brightest).max(0.0)
        ),
    })
}

/// The finding about it.
pub fn finding(set: &CaptureSet, scans: &[Scan], top: &Top) -> Finding {
    let Top { dn, shown } = top;
    let reach: Vec<&Scan> = scans.iter().filter(|s| s.saturated(*dn) > MIN_SHARE).collect();
    let ids: Vec<&str> = reach.iter().map(|s| set.captures[s.capture].id.as_str()).collect();
    let count: u64 = reach.iter().flat_map(|s| &s.codes[usize::from(*dn)..]).sum();
    Finding::new(Kind::TopCode, names(&ids), Done::Corrected)
        .with_count(count as usize)
        .with_amount(f64::from(*dn), 0.0, "DN")
        .with_description(format!(
            "{count} samples are {dn} DN {shown}, although the white level is {} DN: they are \
             read as saturated. Set white_level_dn = {dn} in captures.toml",
            set.sensor.white_level_dn
        ))
}

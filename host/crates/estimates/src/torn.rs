//! Torn frames: rows from some row on that were read out of another frame or exposure.
//!
//! The difference of two frames of a stack has a step in its row means where one of them is torn.
//! Which of the two it is, the other stacks tell: the charge of a whole frame lies on the line over
//! exposure that they make.

use super::robust::{clipped_mean, mad_sd, median};
use super::stack::Stack;
use rayon::prelude::*;

/// A torn frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Torn {
    /// The stack.
    pub stack: String,
    /// Number of the frame in its stack, from 0.
    pub frame: usize,
    /// The first row of the other exposure; 0 of a frame that is of another exposure as a whole.
    pub row: usize,
    /// Height of the step, DN.
    pub step_dn: f64,
    /// Height of the step over its standard error.
    pub deviation: f64,
}

/// Deviation from which a step is one: some 1e5 pairs and rows are tried, and row means of sensors
/// have tails.
const MIN_DEVIATION: f64 = 8.0;
/// Part of the whole frames that must show the tear, and within how many rows: levels that walk
/// from row to row have steps elsewhere beside each other frame.
const MIN_AGREEING: f64 = 0.9;
const SAME_ROW: usize = 2;
/// Least step between the rows beside a tear over that between all rows on both sides. Chosen: at
/// the least deviation it scatters by 0.3 about 1.
const MIN_BESIDE: f64 = 0.5;
/// Least scatter of row means that is believed, DN.
const MIN_ROW_SD: f64 = 1e-3;
/// Frames and rows without which there is nothing to compare, rows that a step keeps from the
/// upper and lower edge.
const MIN_FRAMES: usize = 3;
const MIN_ROWS: usize = 24;
const MARGIN: usize = 6;
/// Frames before and after, around the ends of the stack, that each frame is compared with.
const PARTNERS: usize = 7;
/// Gap between two groups of frames in standard deviations within the groups, and in DN, from which
/// they are of different exposures.
const MIN_GAP_SD: f64 = 12.0;
const MIN_GAP_DN: f64 = 1.0;

/// The largest step over the rows of a frame's difference from another.
#[derive(Clone, Copy)]
struct Step {
    row: usize,
    height: f64,
    deviation: f64,
    /// Between the rows beside it.
    beside: f64,
}

impl Step {
    /// Whether both are at the same row, and this one between the rows beside it.
    fn agrees_with(&self, other: Self) -> bool {
        self.row.abs_diff(other.row) <= SAME_ROW && self.beside / self.height > MIN_BESIDE
    }
}

/// The torn frames of dark stacks, which are sorted by exposure.
pub fn find(darks: &[&Stack]) -> Vec<Torn> {
    let levels: Vec<f64> = darks.par_iter().map(|s| median(frame_levels(s))).collect();
    let stacks = darks.par_iter().enumerate();
    let found = stacks.map(|(i, stack)| in_stack(stack, expected_level(darks, &levels, i)));
    found.flatten_iter().collect()
}

/// For which frames and rows of a stack the stated exposure holds.
pub(crate) fn holds<'a>(
    torn: &'a [Torn],
    stack: &'a Stack,
) -> impl Fn(usize, usize) -> bool + Copy + 'a {
    move |frame, row| {
        !torn.iter().any(|t| t.stack == stack.id && t.frame == frame && row + 1 >= t.row)
    }
}

/// The clipped mean of each frame, DN.
fn frame_levels(stack: &Stack) -> Vec<f64> {
    (0..stack.frames.len()).map(|i| clipped_mean(stack.values(i), 4.0).value).collect()
}

/// The level of stack `i` by a line over exposure through the others (Theil 1950); none where fewer
/// than two others are exposed.
fn expected_level(darks: &[&Stack], levels: &[f64], i: usize) -> Option<f64> {
    let of = |k: usize| (darks[k].exposure_s, levels[k]);
    let others: Vec<(f64, f64)> =
        (0..darks.len()).filter(|k| *k != i).map(of).filter(|o| o.0 > 0.0).collect();
    let mut slopes = Vec::new();
    for (k, a) in others.iter().enumerate() {
        let earlier = others[..k].iter().filter(|b| b.0 != a.0);
        slopes.extend(earlier.map(|b| (a.1 - b.1) / (a.0 - b.0)));
    }
    if slopes.is_empty() || darks[i].exposure_s <= 0.0 {
        return None;
    }
    let slope = median(slopes);
    let offset = median(others.iter().map(|o| o.1 - slope * o.0).collect());
    Some(offset + slope * darks[i].exposure_s)
}

fn in_stack(stack: &Stack, expected: Option<f64>) -> Vec<Torn> {
    let (frames, height) = (stack.frames.len(), stack.size().1);
    if frames < MIN_FRAMES || height < MIN_ROWS {
        return Vec::new();
    }
    let near = |i: usize, j: usize| (j - i).min(frames - (j - i)) <= PARTNERS;
    let pairs: Vec<(usize, usize)> = (0..frames)
        .flat_map(|i| (i + 1..frames).filter(move |j| near(i, *j)).map(move |j| (i, j)))
        .collect();
    let steps: Vec<Step> = pairs.par_iter().map(|&(i, j)| step(stack, i, j)).collect();
    let largest = |of: &mut dyn Iterator<Item = Step>| {
        of.max_by(|a, b| a.deviation.abs().total_cmp(&b.deviation.abs()))
    };
    let Some(most) = largest(&mut steps.iter().copied()) else { return Vec::new() };
    if most.deviation.abs() < MIN_DEVIATION {
        return whole_frames(stack, expected);
    }
    let below: Vec<f64> = (0..frames).map(|i| level(stack, i, most.row..height)).collect();
    let above = (0..frames).map(|i| level(stack, i, 0..most.row)).sum::<f64>() / frames as f64;
    let (group, other) = halves(&below);
    let is_torn = departs(&below, &group, above) > departs(&below, &other, above);
    let (torn, whole) = if is_torn { (group, other) } else { (other, group) };
    let against_whole = |i: usize| {
        let pairs = pairs.iter().zip(&steps);
        let own = pairs.filter(|((a, b), _)| {
            (*a == i && whole.contains(b)) || (*b == i && whole.contains(a))
        });
        let own: Vec<Step> = own.map(|(_, s)| *s).collect();
        let most = largest(&mut own.iter().copied())?;
        let agreeing = own.iter().filter(|s| s.agrees_with(most)).count();
        let agree = agreeing as f64 >= MIN_AGREEING * own.len() as f64;
        (most.deviation.abs() > MIN_DEVIATION && agree).then_some(most)
    };
    let found = torn.iter().filter_map(|&i| Some((i, against_whole(i)?)));
    found
        .map(|(frame, step)| Torn {
            stack: stack.id.clone(),
            frame,
            row: step.row,
            step_dn: step.height.abs(),
            deviation: step.deviation.abs(),
        })
        .collect()
}

/// The largest step over rows of the difference of two frames.
fn step(stack: &Stack, i: usize, j: usize) -> Step {
    let (width, height) = stack.size();
    let pairs = stack.frames[i].data.iter().zip(&stack.frames[j].data);
    let difference: Vec<f64> = pairs.map(|(a, b)| f64::from(*a) - f64::from(*b)).collect();
    // Row means clipped about the row's median: a median of whole numbers jumps.
    let first = width * (height / 8).max(8).min(height);
    let reach = 4.0 * mad_sd(&difference[..first]).max(1.0);
    let rows: Vec<f64> = difference
        .chunks(width)
        .map(|row| {
            let centre = median(row.to_vec());
            row.iter().map(|v| v.clamp(centre - reach, centre + reach)).sum::<f64>() / width as f64
        })
        .collect();
    // The scatter of rows from their neighbours, which a step does not widen.
    let between: Vec<f64> = rows.windows(2).map(|w| w[1] - w[0]).collect();
    let robust = mad_sd(&between);
    let plain = (between.iter().map(|d| d * d).sum::<f64>() / between.len() as f64).sqrt();
    let has_tail = between.iter().any(|d| d.abs() > 6.0 * robust);
    let sd = robust.max(if has_tail { 0.0 } else { 0.5 * plain }) / std::f64::consts::SQRT_2;
    let sd = sd.max(MIN_ROW_SD);
    let total: f64 = rows.iter().sum();
    let mut above: f64 = rows[..MARGIN - 1].iter().sum();
    let steps = (MARGIN..height - MARGIN).map(|row| {
        above += rows[row - 1];
        let (n, m) = (row as f64, (height - row) as f64);
        let height = (total - above) / m - above / n;
        let deviation = height / (sd * (1.0 / n + 1.0 / m).sqrt());
        let mean = |rows: &[f64]| rows.iter().sum::<f64>() / rows.len() as f64;
        let beside = mean(&rows[row + 1..row + MARGIN]) - mean(&rows[row + 1 - MARGIN..row]);
        Step { row, height, deviation, beside }
    });
    steps.max_by(|a, b| a.deviation.abs().total_cmp(&b.deviation.abs())).expect("rows")
}

/// The clipped mean of rows of a frame, DN.
fn level(stack: &Stack, frame: usize, rows: std::ops::Range<usize>) -> f64 {
    let width = stack.size().0;
    let samples = &stack.frames[frame].data[rows.start * width..rows.end * width];
    clipped_mean(samples.iter().map(|v| f64::from(*v)).collect(), 4.0).value
}

/// Frames above and below the middle between the highest and the lowest level.
fn halves(levels: &[f64]) -> (Vec<usize>, Vec<usize>) {
    let high = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let low = levels.iter().copied().fold(f64::INFINITY, f64::min);
    (0..levels.len()).partition(|i| levels[*i] > 0.5 * (high + low))
}

/// How far the mean level of a group is from `other`.
fn departs(levels: &[f64], group: &[usize], other: f64) -> f64 {
    (group.iter().map(|i| levels[*i]).sum::<f64>() / group.len() as f64 - other).abs()
}

/// Frames that are of another exposure as a whole: two groups of levels, one of which lies on the
/// line over exposure.
fn whole_frames(stack: &Stack, expected: Option<f64>) -> Vec<Torn> {
    let Some(expected) = expected else { return Vec::new() };
    let levels = frame_levels(stack);
    let mut order: Vec<usize> = (0..levels.len()).collect();
    order.sort_by(|a, b| levels[*a].total_cmp(&levels[*b]));
    let gap_after = |k: &usize| levels[order[k + 1]] - levels[order[*k]];
    let cut = (0..order.len() - 1)
        .max_by(|a, b| gap_after(a).total_cmp(&gap_after(b)))
        .expect("three frames or more");
    let gap = gap_after(&cut);
    let (low, high) = order.split_at(cut + 1);
    let squares = |group: &[usize]| {
        let mean = group.iter().map(|i| levels[*i]).sum::<f64>() / group.len() as f64;
        group.iter().map(|i| (levels[*i] - mean).powi(2)).sum::<f64>()
    };
    let free = (levels.len() as f64 - 2.0).max(1.0);
    /// Least scatter of levels that is believed, DN: two frames may agree by chance.
    const MIN_SD: f64 = 0.02;
    let sd = ((squares(low) + squares(high)) / free).sqrt().max(MIN_SD);
    let (off_low, off_high) = (departs(&levels, low, expected), departs(&levels, high, expected));
    let decided = off_low.max(off_high) > 3.0 * off_low.min(off_high);
    if gap <= (MIN_GAP_SD * sd).max(MIN_GAP_DN) || !decided {
        return Vec::new();
    }
    let mut other = if off_low > off_high { low.to_vec() } else { high.to_vec() };
    other.sort_unstable();
    let torn =
        |frame| Torn { stack: stack.id.clone(), frame, row: 0, step_dn: gap, deviation: gap / sd };
    other.into_iter().map(torn).collect()
}

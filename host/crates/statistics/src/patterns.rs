//! The statistics of a map.

use super::collect::{Collected, cube_root_sd};
use super::lines::{PERIODS, aperiodic_dof};
use super::maps::{Map, MapKind};
use super::spatial::{BLOCK, CORNER_SHARE, HALF_WAVES, LATTICE, Spatial};
use super::statistic::{Scale, What};
use camrig_base::tails;
use std::f64::consts::FRAC_PI_2;

/// The largest bin of a line's power is divided by this, because the median that it is compared
/// with scatters too: that of 100 exponential bins by a tenth of their mean.
const MEDIAN_SCATTER: f64 = 1.1;

/// Standard deviations of skewness and kurtosis by octiles, times √n, of n normal variates: from
/// the asymptotic covariance of quantiles, min(p, q)(1 − max(p, q))/(n f_p f_q).
const OCTILE_SKEWNESS_SD: f64 = 1.073;
const MOORS_KURTOSIS_SD: f64 = 1.776;

/// The statistics of a map; without smooth structure where the light may be uneven.
pub(super) fn statistics(map: &Map, out: &mut Collected) {
    let s: &Spatial = &map.spatial;
    let (w, h) = (s.columns.means.len() as f64, s.rows.means.len() as f64);
    let n = w * h;
    let v = s.pixel_variance;
    if map.even {
        let rows = (s.rows.variance / h).max(v / n);
        let columns = (s.columns.variance / w).max(v / n);
        let scatter = [columns, rows, columns, rows, v / n];
        for (i, (k, variance)) in s.slopes.iter().zip(scatter).enumerate() {
            out.add(What::Slope(i as u8), *k, (variance + v / n).sqrt(), Scale::Linear);
        }
        let blocks = n / (BLOCK * BLOCK) as f64;
        let cosines = ((HALF_WAVES + 1) * (HALF_WAVES + 1)) as f64;
        out.add(What::MapBlocks, s.blocks, cube_root_sd(s.blocks, blocks), Scale::CubeRoot);
        // Of fewer blocks the cosines leave nothing.
        if blocks > cosines {
            let sd = cube_root_sd(s.fine_blocks, blocks - cosines);
            out.add(What::FineBlocks, s.fine_blocks, sd, Scale::CubeRoot);
        }
        let share = CORNER_SHARE as f64;
        for (i, c) in s.corners.iter().enumerate() {
            let var = v * (share * share) / n
                + s.rows.variance * share / h
                + s.columns.variance * share / w;
            out.add(What::Corner(i as u8), *c, var.sqrt(), Scale::Linear);
        }
    }
    let rows = cube_root_sd(s.rows.variance, aperiodic_dof(h));
    out.add(What::RowPattern, s.rows.variance, rows, Scale::CubeRoot);
    let columns = cube_root_sd(s.columns.variance, aperiodic_dof(w));
    out.add(What::ColumnPattern, s.columns.variance, columns, Scale::CubeRoot);
    // A bin of a single line's power is exponentially distributed: P(> r) = e^−r.
    let line = |r: f64, bins: f64| tails::largest(tails::normal_quantile(-r), bins as usize);
    out.add(What::RowPatternPeak, line(s.rows.peak / MEDIAN_SCATTER, h / 2.0), 1.0, Scale::Linear);
    out.add(
        What::ColumnPatternPeak,
        line(s.columns.peak / MEDIAN_SCATTER, w / 2.0),
        1.0,
        Scale::Linear,
    );
    // Period 2 is covered by the signed contrast of every other line, below.
    for (i, p) in PERIODS.iter().enumerate().skip(1) {
        let sd = (2.0 / (9.0 * (*p as f64 - 1.0))).sqrt();
        out.add(What::ColumnPeriod(i as u8), s.columns.periods[i], sd, Scale::CubeRoot);
        out.add(What::RowPeriod(i as u8), s.rows.periods[i], sd, Scale::CubeRoot);
    }
    out.add(What::PixelPattern, v, (2.0 / n).sqrt(), Scale::Log);
    out.add(What::Tails, s.whole_variance / v, (2.0 / n).sqrt(), Scale::Log);
    out.add(What::High, s.high, 1.0, Scale::Count);
    out.add(What::Low, s.low, 1.0, Scale::Count);
    out.add(What::Skewness, s.skewness, OCTILE_SKEWNESS_SD / n.sqrt(), Scale::Linear);
    out.add(What::Kurtosis, s.kurtosis, MOORS_KURTOSIS_SD / n.sqrt(), Scale::Linear);
    for (i, c) in s.correlation.iter().enumerate() {
        out.add(What::MapCovariance(i as u8), *c, 1.0 / n.sqrt(), Scale::Linear);
    }
    // Each contrast is of two means of half the lines or pixels; a line's variance includes its
    // pixels'.
    let [rows, columns, checkerboard] = s.phases;
    out.add(What::EveryOtherRow, rows, (4.0 * s.rows.variance / h).sqrt(), Scale::Linear);
    out.add(What::EveryOtherColumn, columns, (4.0 * s.columns.variance / w).sqrt(), Scale::Linear);
    out.add(What::Checkerboard, checkerboard, (4.0 * v / n).sqrt(), Scale::Linear);
    out.add(What::Lattice, tails::largest(s.lattice, 2 * LATTICE * LATTICE), 1.0, Scale::Linear);
    if map.kind == MapKind::DarkCurrent {
        // The median of normal variates has π/2 times the variance of their mean.
        let variance = FRAC_PI_2 * v / n + s.rows.variance / h + s.columns.variance / w;
        out.add(What::Median, map.median, variance.sqrt(), Scale::Linear);
    }
    if let Some(image) = map.after_image {
        out.add(What::AfterImage, image.share, image.sd, Scale::Linear);
    }
}

//! Statistics of a map.

use super::collect::{Collected, spread_of_squares};
use super::maps::{Map, MapKind};
use super::spatial::{BLOCK, CORNER_SHARE, HALF_WAVES, LATTICE, PERIODS, Spatial, aperiodic};
use super::statistic::{Scale, What};
use crate::numerics::tails;
use camrig_base::median::median;
use std::f64::consts::FRAC_PI_2;

/// The largest bin of a line's power is divided by this, because the median that it is compared
/// with scatters too: that of 100 exponential bins by a tenth of their mean.
const MEDIAN_SCATTER: f64 = 1.1;

/// The statistics of a map. Smooth structure is left out where the light may be uneven.
pub(super) fn statistics(map: &Map, out: &mut Collected) {
    let s: &Spatial = &map.spatial;
    let (w, h) = (s.columns.len() as f64, s.rows.len() as f64);
    let n = w * h;
    let v = s.pixel_variance;
    if map.even {
        let rows = (s.row_variance / h).max(v / n);
        let columns = (s.column_variance / w).max(v / n);
        let scatter = [columns, rows, columns, rows, v / n];
        for (i, (k, variance)) in s.slopes.iter().zip(scatter).enumerate() {
            out.add(What::Slope(i as u8), *k, (variance + v / n).sqrt(), Scale::Linear);
        }
        let blocks = n / (BLOCK * BLOCK) as f64;
        let cosines = ((HALF_WAVES + 1) * (HALF_WAVES + 1)) as f64;
        let fine = (blocks - cosines).max(1.0);
        out.add(What::MapBlocks, s.blocks, spread_of_squares(s.blocks, blocks), Scale::CubeRoot);
        let sd = spread_of_squares(s.fine_blocks, fine);
        out.add(What::FineBlocks, s.fine_blocks, sd, Scale::CubeRoot);
        let share = CORNER_SHARE as f64;
        for (i, c) in s.corners.iter().enumerate() {
            let var = v * (share * share) / n
                + s.row_variance * share / h
                + s.column_variance * share / w;
            out.add(What::Corner(i as u8), *c, var.sqrt(), Scale::Linear);
        }
    }
    let rows = spread_of_squares(s.row_variance, aperiodic(h));
    out.add(What::RowPattern, s.row_variance, rows, Scale::CubeRoot);
    let columns = spread_of_squares(s.column_variance, aperiodic(w));
    out.add(What::ColumnPattern, s.column_variance, columns, Scale::CubeRoot);
    // A bin of a single line's power is exponential: P(> r) = e^−r.
    let line = |r: f64, bins: f64| tails::largest(tails::normal_quantile(-r), bins as usize);
    out.add(What::RowPatternPeak, line(s.row_peak / MEDIAN_SCATTER, h / 2.0), 1.0, Scale::Linear);
    out.add(
        What::ColumnPatternPeak,
        line(s.column_peak / MEDIAN_SCATTER, w / 2.0),
        1.0,
        Scale::Linear,
    );
    // Period 2 is the signed contrast of every other line, below.
    for (i, p) in PERIODS.iter().enumerate().skip(1) {
        let sd = (2.0 / (9.0 * (*p as f64 - 1.0))).sqrt();
        out.add(What::ColumnPeriod(i as u8), s.column_periods[i], sd, Scale::CubeRoot);
        out.add(What::RowPeriod(i as u8), s.row_periods[i], sd, Scale::CubeRoot);
    }
    out.add(What::PixelPattern, v, (2.0 / n).sqrt(), Scale::Log);
    out.add(What::Tails, s.whole_variance / v, (2.0 / n).sqrt(), Scale::Log);
    out.add(What::High, s.high, 1.0, Scale::Count);
    out.add(What::Low, s.low, 1.0, Scale::Count);
    out.add(What::Skewness, s.skewness, (6.0 / n).sqrt(), Scale::Linear);
    out.add(What::Kurtosis, s.kurtosis, (24.0 / n).sqrt(), Scale::Linear);
    for (i, c) in s.correlation.iter().enumerate() {
        out.add(What::MapCovariance(i as u8), *c, 1.0 / n.sqrt(), Scale::Linear);
    }
    // Two means of half the lines, or pixels, each; a line's variance holds its pixels'.
    let [rows, columns, checkerboard] = s.phases;
    out.add(What::EveryOtherRow, rows, (4.0 * s.row_variance / h).sqrt(), Scale::Linear);
    out.add(What::EveryOtherColumn, columns, (4.0 * s.column_variance / w).sqrt(), Scale::Linear);
    out.add(What::Checkerboard, checkerboard, (4.0 * v / n).sqrt(), Scale::Linear);
    out.add(What::Lattice, tails::largest(s.lattice, 2 * LATTICE * LATTICE), 1.0, Scale::Linear);
    if map.kind == MapKind::DarkCurrent {
        let middle = f64::from(median(&mut map.plane.data.clone(), f32::total_cmp));
        // A median of normal values has π/2 of their mean's variance.
        let variance = FRAC_PI_2 * v / n + s.row_variance / h + s.column_variance / w;
        out.add(What::Middle, middle, variance.sqrt(), Scale::Linear);
    }
    if let Some((slope, sd)) = map.after_image {
        out.add(What::AfterImage, slope, sd, Scale::Linear);
    }
}

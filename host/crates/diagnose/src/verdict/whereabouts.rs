//! Place on the sensor and frequency of a deviation.

use crate::measured::Measured;
use crate::numerics::spectrum::{Background, Spectrum};
use crate::statistics::maps::MapKind;
use crate::statistics::statistic::{Key, Place, What};
use camrig_base::median::median;

/// Tiles along each side of the sensor, of which the most deviating one is named.
const TILES: usize = 8;
/// Standard deviations of the noise of blocks from which noise is reported as regional.
const REGIONAL: f64 = 5.0;

/// Words for the frequency of a line, or the region where noise or structure is most; none for
/// other statistics.
pub fn whereabouts(measured: &Measured, key: Key) -> Option<String> {
    match key {
        (Place::Stack(i), what) => {
            let t = measured.fit.stacks.get(i)?;
            match what {
                What::PlanePeak => plane(t.power.as_deref()?, t.width, t.height),
                What::RowPeak => line(&t.row_power, t.height, "row"),
                What::ColumnPeak => line(&t.column_power, t.width, "column"),
                What::Variance(_) | What::Spread | What::NoiseBlocks | What::NoiseSlope(_) => {
                    let blocks = measured.fit.values.get(&(Place::Stack(i), What::NoiseBlocks))?;
                    // White noise gives 1.
                    let z = (blocks.scale.of(blocks.value) - 1.0) / blocks.sd;
                    let most = stands_out(&t.pixel_variance, t.width, t.height)?;
                    (z > REGIONAL).then(|| {
                        most.words(&format!("{:.3} times the variance", most.tile / most.middle))
                    })
                }
                _ => None,
            }
        }
        (Place::Map(kind), what) => {
            let map = measured.fit.maps.iter().find(|m| m.kind == kind)?;
            let (w, h) = (map.plane.width, map.plane.height);
            match what {
                What::RowPatternPeak => line(&Spectrum::of(&map.spatial.rows.means), h, "row"),
                What::ColumnPatternPeak => {
                    line(&Spectrum::of(&map.spatial.columns.means), w, "column")
                }
                What::MapBlocks | What::FineBlocks => {
                    let most = stands_out(&map.plane.data, w, h)?;
                    let off = most.tile - most.middle;
                    let size = match kind {
                        MapKind::Gain | MapKind::Curvature => format!("{:+.3} %", 100.0 * off),
                        MapKind::DarkCurrent => format!("{off:+.3} e⁻/s"),
                        MapKind::Offset | MapKind::AfterLight => format!("{off:+.3} DN"),
                    };
                    Some(most.words(&size))
                }
                _ => None,
            }
        }
        _ => None,
    }
}

/// The highest bin of a power over two frequencies, laid out as by
/// [`Spectrum2`](crate::numerics::spectrum::Spectrum2).
fn plane(power: &[f32], w: usize, h: usize) -> Option<String> {
    let (at, _) = Background::of(power, w).highest(power);
    let (l, k) = (at / (w / 2 + 1), at % (w / 2 + 1));
    let (fx, fy) = (k as f64 / w as f64, l as f64 / h as f64);
    let fy = if fy > 0.5 { fy - 1.0 } else { fy };
    let period = |f: f64| if f == 0.0 { "no".into() } else { format!("{:.3}", 1.0 / f.abs()) };
    let (columns, rows) = (period(fx), period(fy));
    Some(format!(
        "strongest at {fx:.4} cycles per column and {fy:.4} per row (period {columns} columns, \
         {rows} rows)"
    ))
}

/// The highest bin of the power of `n` lines.
fn line(power: &[f64], n: usize, of: &str) -> Option<String> {
    let at = (0..power.len()).max_by(|&a, &b| power[a].total_cmp(&power[b]))?;
    let f = (at + 1) as f64 / n as f64;
    Some(format!("strongest at {f:.4} cycles per {of} (period {:.3} {of}s)", 1.0 / f))
}

/// The tile of a plane whose median is furthest from that of all tiles.
struct Most {
    columns: (usize, usize),
    rows: (usize, usize),
    tile: f64,
    middle: f64,
}

impl Most {
    fn words(&self, size: &str) -> String {
        let ((x0, x1), (y0, y1)) = (self.columns, self.rows);
        format!(
            "most in the region of columns {x0} to {x1} and rows {y0} to {y1}: {size} against the \
             middle region"
        )
    }
}

fn stands_out(values: &[f32], w: usize, h: usize) -> Option<Most> {
    let side = |i: usize, n: usize| i * n / TILES..(i + 1) * n / TILES;
    let mut tiles = Vec::with_capacity(TILES * TILES);
    for j in 0..TILES {
        for i in 0..TILES {
            let rows = side(j, h).flat_map(|y| &values[y * w..][side(i, w)]);
            let mut tile: Vec<f32> = rows.copied().collect();
            if tile.is_empty() {
                return None;
            }
            let middle = median(&mut tile, f32::total_cmp);
            tiles.push((f64::from(middle), side(i, w), side(j, h)));
        }
    }
    let mut medians: Vec<f64> = tiles.iter().map(|t| t.0).collect();
    let middle = median(&mut medians, f64::total_cmp);
    let off = |t: &f64| (t - middle).abs();
    let (tile, columns, rows) =
        tiles.into_iter().max_by(|a, b| off(&a.0).total_cmp(&off(&b.0)))?;
    Some(Most {
        columns: (columns.start, columns.end - 1),
        rows: (rows.start, rows.end - 1),
        tile,
        middle,
    })
}

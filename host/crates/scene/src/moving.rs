//! A scene that moves as a whole while the sensor reads a frame.
//!
//! Row v of the frame sees the scene at one moment, displaced by velocity times time, or over its
//! exposure, as a sum of N displaced scenes with weights: [`moments`]. Displacement is constant
//! over a row of cells. Content from beyond the scene's edge is what the scene itself gives there.
//! The lens's blur brings light from row to row after that: it is the light of those rows' times.

use super::{Components, Grid, Quantity, Scene, White};
use camrig_base::{Bands, Plane, Result};
use camrig_light::Lamps;
use camrig_light::colour::mixture::Mixer;
use std::sync::Arc;

/// When a row sees the scene: times and their weights.
pub type Moments = Vec<(f64, f64)>;

/// A scene displaced by `velocity` times time.
pub struct Moving {
    /// The scene at time 0.
    pub scene: Arc<dyn Scene>,
    /// To the right and down, sensor widths per unit of time.
    pub velocity: [f64; 2],
    /// Height of the frame, sensor widths.
    pub height: f64,
    /// Whether rows see it at times of their own.
    pub by_row: bool,
    /// When the rows at a place between the upper (0) and the lower edge (1) see it.
    pub moments: Arc<dyn Fn(f64) -> Moments + Send + Sync>,
}

/// Most that the midpoints of N parts of an exposure may misplace of the contrast of an edge:
/// min(v T/(4 N²), 1/N) at v T pixels of motion. A trade: below the noise of a pixel at full well.
const BLUR_ERROR: f64 = 0.01;

/// Moments for an exposure from `open` to `close`, s, in which the scene moves by `pixels`: parts
/// of equal length, each where the mean of its light is. How much light of lamps there is in all is
/// left to who exposes: the weights add up to 1.
#[must_use]
pub fn moments([open, close]: [f64; 2], pixels: f64, lamps: &Lamps) -> Moments {
    let parts = (pixels / (4.0 * BLUR_ERROR)).sqrt().min(1.0 / BLUR_ERROR);
    let parts = parts.ceil().max(1.0) as u32;
    let part = (close - open) / f64::from(parts);
    let moment = |i: u32| {
        let begin = open + f64::from(i) * part;
        let [light, first] = lamps.moments(begin, part);
        (light > 0.0).then(|| (begin + first / light, light))
    };
    let mut moments: Moments = (0..parts).filter_map(moment).collect();
    let all: f64 = moments.iter().map(|(_, light)| light).sum();
    moments.iter_mut().for_each(|(_, light)| *light /= all);
    if moments.is_empty() { vec![(0.5 * (open + close), 1.0)] } else { moments }
}

impl Moving {
    /// The scene as the rows at a place see it.
    fn seen(&self, band: usize, grid: Grid, place: f64) -> Result<Plane<f32>> {
        let at = |time: f64| Grid {
            left: grid.left - self.velocity[0] * time,
            top: grid.top - self.velocity[1] * time,
            ..grid
        };
        let moments = (self.moments)(place);
        if let [(time, 1.0)] = moments[..] {
            return self.scene.plane(band, &at(time));
        }
        let mut sum = Plane::from_fn(grid.width, grid.height, |_, _| 0.0);
        for (time, weight) in moments {
            let plane = self.scene.plane(band, &at(time))?;
            sum.data.iter_mut().zip(plane.data).for_each(|(s, v)| *s += weight as f32 * v);
        }
        Ok(sum)
    }
}

impl Scene for Moving {
    fn bands(&self) -> Bands {
        self.scene.bands()
    }

    fn quantity(&self) -> Quantity {
        self.scene.quantity()
    }

    fn aspect(&self) -> Option<f64> {
        self.scene.aspect()
    }

    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        if !self.by_row {
            return self.seen(band, *grid, 0.5);
        }
        let mut plane = Plane { width: grid.width, height: 0, data: Vec::new() };
        for row in 0..grid.height {
            let top = grid.top + row as f64 * grid.cell;
            let middle = top + 0.5 * grid.cell;
            // Blur brings light from rows outside the frame into it: they move with the nearest
            // row inside.
            let place = (middle / self.height + 0.5).clamp(0.0, 1.0);
            let strip = Grid { height: 1, top, ..*grid };
            plane.data.extend(self.seen(band, strip, place)?.data);
            plane.height += 1;
        }
        Ok(plane)
    }

    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        let moving = |scene| {
            let Self { velocity, height, by_row, .. } = *self;
            Self { scene, velocity, height, by_row, moments: Arc::clone(&self.moments) }
        };
        Ok(self.scene.components(mixer)?.map(|components| components.seen(moving)))
    }

    fn white(&self) -> Option<&White> {
        self.scene.white()
    }

    fn notes(&self) -> Vec<String> {
        self.scene.notes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::open;

    const GRID: Grid = Grid { width: 64, height: 48, left: -0.5, top: -0.375, cell: 1.0 / 64.0 };

    fn moved(velocity: [f64; 2], start: f64, rolling: f64) -> Plane<f32> {
        let scene = Arc::from(open("checkerboard").unwrap().unwrap());
        let moments = Arc::new(move |place: f64| vec![(start + rolling * place, 1.0)]);
        let moving = Moving { scene, velocity, height: 0.75, by_row: rolling != 0.0, moments };
        moving.plane(10, &GRID).unwrap()
    }

    /// A displacement by whole cells is a shift of the plane.
    #[test]
    fn translation_shifts_by_what_it_says() {
        let still = moved([0.0; 2], 0.0, 0.0);
        let right = moved([2.0 / 64.0, 1.0 / 64.0], 2.0, 0.0);
        for y in 2..48 {
            for x in 4..64 {
                assert!((right.at(x, y) - still.at(x - 4, y - 2)).abs() < 1e-5, "{x} {y}");
            }
        }
    }

    /// Row y of a rolling shutter is what a global one sees at the time the row is read.
    #[test]
    fn rolling_rows_are_global_rows_of_their_time() {
        let rolling = moved([0.1, 0.0], 1.0, 0.8);
        for y in [0, 20, 47] {
            let time = 1.0 + 0.8 * (y as f64 + 0.5) / 48.0;
            let global = moved([0.1, 0.0], time, 0.0);
            for x in 0..64 {
                assert!((rolling.at(x, y) - global.at(x, y)).abs() < 1e-5, "{x} {y}");
            }
        }
    }

    /// A bar of 6 pixels moves by v T while the rows' shutter is open: the mean of box pixels is
    /// the closed form of golden/light/bar_*.csv within the bound of the number of parts.
    #[test]
    fn a_moving_bar_is_blurred_by_v_t() {
        struct Bar(f64, f64);
        impl Scene for Bar {
            fn bands(&self) -> Bands {
                Bands { start_nm: 550.0, step_nm: 10.0, count: 1 }
            }
            fn quantity(&self) -> Quantity {
                Quantity::Reflectance
            }
            fn aspect(&self) -> Option<f64> {
                None
            }
            fn plane(&self, _: usize, grid: &Grid) -> Result<Plane<f32>> {
                Ok(Plane::from_fn(grid.width, grid.height, |x, _| {
                    let left = grid.left + x as f64 * grid.cell;
                    let covered = (left + grid.cell).min(self.1) - left.max(self.0);
                    (covered / grid.cell).max(0.0) as f32
                }))
            }
        }
        for (name, x0, width, v, t0, exposure) in [
            ("rest", 10.25, 6.0, 0.0, 0.0, 0.01),
            ("slow", 10.25, 6.0, 150.0, 0.0, 0.01),
            ("blur_longer_than_bar", 10.25, 6.0, 1200.0, 0.0, 0.01),
            ("left", 30.5, 6.0, -800.0, 0.002, 0.01),
            ("fast", 4.0, 2.0, 6000.0, 0.0, 0.005),
        ] {
            let Some(file) = camrig_testing::shared(&format!("golden/light/bar_{name}.csv"))
            else {
                return;
            };
            let window = [t0, t0 + exposure];
            let pixels = f64::abs(v) * exposure;
            let moving = Moving {
                scene: Arc::new(Bar(x0, x0 + width)),
                velocity: [v, 0.0],
                height: 1.0,
                by_row: false,
                moments: Arc::new(move |_| moments(window, pixels, &Lamps::default())),
            };
            let grid = Grid { width: 48, height: 1, left: 0.0, top: 0.0, cell: 1.0 };
            let plane = moving.plane(0, &grid).unwrap();
            let text = std::fs::read_to_string(file).unwrap();
            let exact = text.lines().skip(1).map(|line| {
                line.split(',').nth(1).and_then(|mean| mean.parse::<f64>().ok()).unwrap()
            });
            // Two edges.
            let bound = 2.0 * BLUR_ERROR + 1e-6;
            let mut sums = [0.0; 2];
            for (mean, exact) in plane.data.iter().zip(exact) {
                assert!((f64::from(*mean) - exact).abs() < bound, "{name}: {mean}, {exact}");
                sums[0] += f64::from(*mean);
                sums[1] += exact;
            }
            assert!((sums[0] - sums[1]).abs() < 1e-4, "{name}: light is kept: {sums:?}");
        }
    }
}

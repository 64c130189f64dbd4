//! Spectral irradiance for tests, and mean photo-electrons from it in f64.

use camrig_sensor_core::arith::{Arith, BLOCK, Block};
use camrig_sensor_core::collect::{Collector, Sums};
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::crosstalk::Crosstalk;
use camrig_sensor_core::pipeline::MeanRows;
use camrig_sensor_core::spectral::{BandRow, GROUP, decode, encode, groups};

/// One band of a row, encoded, and what it means.
pub struct Band {
    pub exponents: Vec<i8>,
    pub mantissas: Vec<u16>,
    pub values: Vec<f32>,
}

impl Band {
    pub fn new(mut values: Vec<f32>) -> Self {
        let (mut exponents, mut mantissas) =
            (vec![0; groups(values.len())], vec![0; values.len()]);
        encode(&values, &mut exponents, &mut mantissas);
        decode(BandRow { exponents: &exponents, mantissas: &mantissas }, &mut values);
        Self { exponents, mantissas, values }
    }
}

/// Crosstalk factors.
pub struct Table {
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    pub nm: Vec<f32>,
    pub factors: Vec<f32>,
}

impl Table {
    /// Bilinear in position, linear in wavelength, in f64.
    fn at(&self, channel: usize, nm: f64, u: f64, v: f64) -> f64 {
        let place = |nodes: &[f32], p: f64| {
            let k = nodes.iter().rposition(|&n| f64::from(n) <= p).unwrap_or(0);
            let k = k.min(nodes.len().saturating_sub(2));
            let Some(&next) = nodes.get(k + 1) else { return (0, 0.0) };
            let (a, b) = (f64::from(nodes[k]), f64::from(next));
            (k, ((p - a) / (b - a)).clamp(0.0, 1.0))
        };
        let (w, tw) = place(&self.nm, nm);
        let (r, tr) = place(&self.y, v);
        let (c, tc) = place(&self.x, u);
        let mut sum = 0.0;
        for (dw, fw) in [(0, 1.0 - tw), (1, tw)] {
            for (dr, fr) in [(0, 1.0 - tr), (1, tr)] {
                for (dc, fc) in [(0, 1.0 - tc), (1, tc)] {
                    if fw * fr * fc > 0.0 {
                        let plane = channel * self.nm.len() + w + dw;
                        let i = (plane * self.y.len() + r + dr) * self.x.len() + c + dc;
                        sum += fw * fr * fc * f64::from(self.factors[i]);
                    }
                }
            }
        }
        sum
    }

    fn as_core(&self) -> Crosstalk<'_> {
        Crosstalk { x: &self.x, y: &self.y, wavelength_nm: &self.nm, factors: &self.factors }
    }
}

/// µ = t Σ E R F for each pixel, in f64; `cube[row][band]`.
pub fn mean_electrons(
    config: &SensorConfig,
    settings: &FrameSettings,
    table: Option<&Table>,
    cube: &[Vec<Band>],
) -> Vec<f64> {
    let (width, height) = (config.width as usize, config.height as usize);
    let bands = usize::from(config.bands);
    (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let channel = config.pattern.channel(x, y);
            let u = (x as f64 + 0.5) / width as f64 * 2.0 - 1.0;
            let v = (y as f64 + 0.5) / height as f64 * 2.0 - 1.0;
            let parts = cube[y].iter().enumerate().map(|(b, band)| {
                let response = f64::from(config.response[channel * bands + b]);
                let nm = f64::from(config.first_band_nm + b as f32 * config.band_step_nm);
                let factor = table.map_or(1.0, |t| t.at(channel, nm, u, v));
                f64::from(settings.exposure_s) * f64::from(band.values[x]) * response * factor
            });
            parts.sum()
        })
        .collect()
}

/// Mean photo-electrons as the sensor model collects them.
pub struct Collected<'a, A: Arith> {
    collector: Collector<'a, A>,
    cube: &'a [Vec<Band>],
    sums: Vec<Sums<A::Sum>>,
}

impl<'a, A: Arith> Collected<'a, A> {
    pub fn new(
        config: &'a SensorConfig,
        settings: &FrameSettings,
        table: Option<&'a Table>,
        cube: &'a [Vec<Band>],
    ) -> Self {
        let collector = Collector::new(config, settings, table.map(Table::as_core)).unwrap();
        let sums = vec![[A::Sum::default(); GROUP]; groups(config.width as usize)];
        Self { collector, cube, sums }
    }
}

impl<A: Arith> MeanRows<A> for Collected<'_, A> {
    fn mean_row(&mut self, y: u32, out: &mut [Block<A::Signal>]) {
        self.sums.fill([A::Sum::default(); GROUP]);
        for (b, band) in self.cube[y as usize].iter().enumerate() {
            let row = BandRow { exponents: &band.exponents, mantissas: &band.mantissas };
            self.collector.add_band(y, b, row, &mut self.sums);
        }
        out.fill([A::Signal::default(); BLOCK]);
        for (out, sum) in out.as_flattened_mut().iter_mut().zip(self.sums.as_flattened()) {
            *out = A::collected(*sum);
        }
    }
}

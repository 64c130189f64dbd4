//! Rows of the sensor, compiled for the vector instructions of this machine.
//!
//! A pipeline inlines every effect of the catalogue, which is much code: it is made here once for
//! each arithmetic, and takes its light from whoever has some.

use super::irradiance::Chunk;
use camrig_base::{Error, Result};
use camrig_firmware_sim::running::RowFn;
use camrig_sensor_core::arith::{Arith, BLOCK, Block, Fixed, Float, blocks};
use camrig_sensor_core::collect::{Collector, Sums};
use camrig_sensor_core::config::{ConfigError, FrameSettings, SensorConfig};
use camrig_sensor_core::crosstalk::Crosstalk;
use camrig_sensor_core::pipeline::{MeanRows, Pipeline, memory_blocks};
use camrig_sensor_core::spectral::{GROUP, groups};
use camrig_vector::vectorised;

/// Mean photo-electrons of a row from its bands.
type CollectFn<A> =
    fn(&mut BandSums<'_, A>, &[Chunk<'_>], u32, &mut [Block<<A as Arith>::Signal>]);

/// An arithmetic whose row functions are compiled here.
pub trait Vector: Arith {
    /// Of a pipeline.
    const ROW: RowFn<Self>;
    /// Of a cube.
    const COLLECT: CollectFn<Self>;
}

macro_rules! vector {
    ($arith:ty, $row:ident, $collect:ident) => {
        #[vectorised]
        fn $row(
            pipeline: &mut Pipeline<'_, $arith>,
            row: u32,
            source: &mut dyn MeanRows<$arith>,
            out: &mut [u16],
        ) {
            pipeline.row(row, source, out);
        }

        #[vectorised]
        fn $collect(
            sums: &mut BandSums<'_, $arith>,
            bands: &[Chunk<'_>],
            y: u32,
            out: &mut [Block<<$arith as Arith>::Signal>],
        ) {
            sums.collect(bands, y, out);
        }

        impl Vector for $arith {
            const ROW: RowFn<Self> = $row;
            const COLLECT: CollectFn<Self> = $collect;
        }
    };
}

vector!(Float, row_float, collect_float);
vector!(Fixed, row_fixed, collect_fixed);

/// Adds up the bands of rows.
pub struct BandSums<'a, A: Arith> {
    collector: Collector<'a, A>,
    width: usize,
    sums: Vec<Sums<A::Sum>>,
}

impl<'a, A: Vector> BandSums<'a, A> {
    /// For one frame.
    ///
    /// # Errors
    /// A configuration or settings that the sensor refuses.
    pub fn new(
        config: &'a SensorConfig,
        settings: &FrameSettings,
        crosstalk: Option<Crosstalk<'a>>,
    ) -> Result<Self> {
        let width = config.width as usize;
        Ok(Self {
            collector: Collector::new(config, settings, crosstalk).map_err(refused)?,
            width,
            sums: vec![[A::Sum::default(); GROUP]; groups(width)],
        })
    }

    #[inline(always)]
    fn collect(&mut self, bands: &[Chunk<'_>], y: u32, out: &mut [Block<A::Signal>]) {
        self.sums.fill([A::Sum::default(); GROUP]);
        for (band, rows) in bands.iter().enumerate() {
            let row = rows.row(self.width, y as usize);
            self.collector.add_band(y, band, row, &mut self.sums);
        }
        let mut groups = self.sums.iter();
        for block in out.iter_mut().take(blocks(self.width)) {
            for half in block.chunks_mut(GROUP) {
                let sums = groups.next().copied().unwrap_or([A::Sum::default(); GROUP]);
                half.iter_mut().zip(sums).for_each(|(v, s)| *v = A::collected(s));
            }
        }
    }
}

/// Computes the rows from `first` on that fill `out`.
///
/// # Errors
/// A configuration or settings that the sensor refuses.
pub fn rows<A: Vector>(
    config: &SensorConfig,
    settings: &FrameSettings,
    source: &mut dyn MeanRows<A>,
    first: usize,
    out: &mut [u16],
) -> Result<()> {
    let mut memory = vec![[A::Signal::default(); BLOCK]; memory_blocks(config)];
    let mut pipeline = Pipeline::<A>::new(config, settings, &mut memory).map_err(refused)?;
    for (y, out) in (first..).zip(out.chunks_mut(config.width as usize)) {
        A::ROW(&mut pipeline, y as u32, source, out);
    }
    Ok(())
}

/// What the sensor model objects to, in words.
pub fn refused(e: ConfigError) -> Error {
    match e {
        ConfigError::Settings => Error::input("exposure, gain or temperature is out of range")
            .help("exposure and gain are positive numbers"),
        e => Error::input(format!("the sensor model refuses this configuration: {e}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_sensor_core::effects::charge_coupling::ChargeCoupling;
    use camrig_sensor_core::effects::{Effect, prnu::Prnu, read_noise::ReadNoise};
    use camrig_sensor_core::effects::{row_offset_fpn::RowOffsetFpn, shot_noise::ShotNoise};

    /// A monochrome 12-bit sensor with effects of every domain, one of which reads its neighbours.
    fn sensor(width: u32, height: u32) -> SensorConfig {
        let effects: [Effect; 5] = [
            ShotNoise {}.into(),
            Prnu { sigma: 0.008 }.into(),
            ChargeCoupling { side: 0.01, vertical: 0.02, diagonal: 0.001 }.into(),
            RowOffsetFpn::from_values(&[0.8]).into(),
            ReadNoise { read_e: 3.0, read_e_post: 1.0 }.into(),
        ];
        let mut config = SensorConfig::new(width, height);
        config.response = [1e6].into_iter().collect();
        config.seed = 1;
        config.effects = effects.into_iter().collect();
        config
    }

    /// Rows by the functions for this machine's vector units and by those of the build's target.
    fn by_both<A: Vector>(
        config: &SensorConfig,
        light: impl Fn(f32) -> A::Signal,
    ) -> [Vec<u16>; 2] {
        let settings = FrameSettings::new(0.02).with_frame(3);
        let mut ramp = |_: u32, out: &mut [Block<A::Signal>]| {
            let pixels = out.as_flattened_mut().iter_mut().enumerate();
            pixels.for_each(|(x, mean)| *mean = light(1.0 + 8000.0 * x as f32 / 1000.0));
        };
        let width = config.width as usize;
        let mut vector = vec![0; width * config.height as usize];
        let mut plain = vector.clone();
        rows::<A>(config, &settings, &mut ramp, 0, &mut vector).unwrap();
        let mut memory = vec![[A::Signal::default(); BLOCK]; memory_blocks(config)];
        let mut pipeline = Pipeline::<A>::new(config, &settings, &mut memory).unwrap();
        for (y, out) in (0..).zip(plain.chunks_mut(width)) {
            pipeline.row(y, &mut ramp, out);
        }
        [vector, plain]
    }

    #[test]
    fn every_instruction_set_gives_the_same_bytes() {
        for (width, height) in [(1000, 20), (64, 5), (33, 3)] {
            let config = sensor(width, height);
            let [vector, plain] = by_both::<Float>(&config, |e| e);
            assert_eq!(vector, plain, "f32, {width} x {height}");
            assert!(plain.iter().any(|&dn| dn > 100));
            let [vector, plain] = by_both::<Fixed>(&config, <Fixed as Arith>::signal);
            assert_eq!(vector, plain, "fixed point, {width} x {height}");
            assert!(plain.iter().any(|&dn| dn > 100));
        }
    }
}

//! The row loop of `camrig-sensor-core` alone. It is never run: `ci/tier-firmware` shows that the
//! linked program contains no panics, and `sizes` measures the code of each effect with it.

#![no_std]
#![no_main]

#[cfg(feature = "fixed")]
use camrig_sensor_core::arith::Fixed as Arithmetic;
#[cfg(feature = "float")]
use camrig_sensor_core::arith::Float as Arithmetic;
use camrig_sensor_core::arith::{Arith, Block};
use camrig_sensor_core::collect::{Collector, Sums};
use camrig_sensor_core::pipeline::Pipeline;
use camrig_sensor_core::spectral::BandRow;
use core::hint::black_box;
use cortex_m as _;

type Signal = <Arithmetic as Arith>::Signal;
type Sum = <Arithmetic as Arith>::Sum;
type Row<'a> = &'a mut [Block<Signal>];

/// Adds bands and computes rows of any size with any effects: the compiler knows nothing about the
/// arguments.
#[unsafe(no_mangle)]
#[inline(never)]
fn row_loop(
    collector: &mut Collector<'_, Arithmetic>,
    pipeline: &mut Pipeline<'_, Arithmetic>,
    band: BandRow<'_>,
    sums: &mut [Sums<Sum>],
    out: &mut [u16],
) {
    collector.add_band(black_box(0), black_box(0), band, sums);
    let mut source = |_: u32, out: Row<'_>| {
        for (mean, sum) in out.as_flattened_mut().iter_mut().zip(sums.as_flattened()) {
            *mean = Arithmetic::collected(*sum);
        }
    };
    pipeline.row(black_box(0), &mut source, out);
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let loops: fn(_, _, BandRow<'_>, _, _) = row_loop;
    black_box(loops as *const ());
    loop {}
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

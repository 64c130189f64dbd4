//! Ten frames from a rig, compared bit for bit with those of this process.
//!
//! `cargo run --release -p camrig --example rig_client -- tcp://127.0.0.1:7420`; without an
//! address the emulator in this process is the rig.

use camrig::exposure::CubeHeader;
use camrig::prelude::*;
use camrig::scene::Bands;

fn main() -> Result<()> {
    let address = std::env::args().nth(1).unwrap_or_else(|| "emulator:".into());
    let camera = Camera::load("mt9v024")?.with_size(320, 240)?;

    // Even irradiance of 10 µW m⁻² nm⁻¹ in three bands; `examples/simulate.rs` makes that of a
    // scene.
    let header = CubeHeader::new(
        (320, 240),
        &Bands { start_nm: 450.0, step_nm: 100.0, count: 3 },
        "even light",
    );
    let cube = IrradianceCube::uniform(header, &[1e-5; 3])?;
    let sensor = SimulatedSensor::new(&camera, &cube.header)?;

    let mut rig = Rig::open(&address)?;
    println!("{}: {}", address, rig.device().firmware);
    rig.set_camera(&sensor)?;
    for number in 0..10 {
        let request = FrameRequest::new(camera.settings(number, 0.010, None));
        let frame = rig.frame(&cube, &sensor, &request)?.to_raw(&sensor)?;
        let here = sensor.frame(&cube, &request.settings)?;
        if frame != here {
            return Err(Error::disagreement(format!(
                "frame {number} differs from this process's"
            )));
        }
        let channel = &frame.channel_means()[0];
        println!(
            "frame {number}: mean of {} {:.2} DN, the same bytes as here",
            channel.name, channel.mean_dn
        );
    }
    Ok(())
}

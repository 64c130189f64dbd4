//! The capabilities that a rig reports are true, and a camera that it cannot compute is refused.

use camrig_firmware_sim::camera::Capture;
use camrig_firmware_sim::{CaptureMemory, Memory, Rig, RowMemory, camera};
use camrig_rig_link::device::Model;
use camrig_rig_link::message::Refusal;
use camrig_sensor_core::arith::BLOCK;
use camrig_sensor_core::config::SensorConfig;
use camrig_sensor_core::crosstalk::Crosstalk;
use camrig_sensor_core::effects::{Effect, full_well, prnu, read_noise, shot_noise};
use camrig_sensor_core::hdr::{Companding, Curve, Hand, Level, MAX_CAPTURES, Merge, Output};
use camrig_sensor_core::hdr::{Ratios, Readout, Rounding};

const WIDTH: usize = 64;

/// Runs a test with a rig for rows of 64 pixels.
fn with_rig<T>(test: impl FnOnce(&mut Rig<'_>) -> T) -> T {
    with_captures(1, test)
}

/// The same with memory for so many captures.
fn with_captures<T>(captures: usize, test: impl FnOnce(&mut Rig<'_>) -> T) -> T {
    let mut more = [const { CaptureMemory::EMPTY }; MAX_CAPTURES - 1];
    let mut float = ([[0.0; BLOCK]; 7], [[0.0; 16]; 4]);
    let mut fixed = ([[Default::default(); BLOCK]; 7], [[Default::default(); 16]; 4]);
    let (mut mantissas, mut exponents, mut crosstalk) = ([0; WIDTH], [0; 4], [0.0; 16]);
    test(&mut Rig::new(
        "test",
        Memory::new(&mut mantissas, &mut exponents, &mut crosstalk, 8)
            .with_float(RowMemory { rows: &mut float.0, sums: &mut float.1 })
            .with_fixed(RowMemory { rows: &mut fixed.0, sums: &mut fixed.1 })
            .with_captures(&mut more[..captures - 1]),
    ))
}

fn sensor(effects: &[Effect]) -> SensorConfig {
    let mut config = SensorConfig::new(WIDTH as u32, 2);
    config.response = [1e6].into_iter().collect();
    config.seed = 1;
    config.effects = effects.iter().copied().collect();
    config
}

/// What a rig answers to a camera.
fn sent(config: &SensorConfig) -> Result<(), Refusal> {
    let mut bytes = [0; 1024];
    let n = camera::encode(config, None, &mut bytes).expect("it fits");
    with_rig(|rig| {
        rig.camera_piece(0, &bytes[..n])?;
        rig.camera_end()
    })
}

#[test]
fn capabilities_tell_each_effect_that_is_compiled_in() {
    let effects = with_rig(|rig| rig.capabilities()).effects;
    assert!(effects.iter().eq(Effect::CATALOGUE.iter().map(|entry| entry.id)), "{effects:?}");
}

#[test]
fn capabilities_are_the_memory() {
    let c = with_rig(|rig| rig.capabilities());
    assert_eq!((c.max_width, c.max_bands, c.arithmetics, c.codecs), (64, 8, 0b11, 0b1000_0011));
    let rows = 2 * (7 * BLOCK * 4) + 4 * 16 * (4 + 8);
    assert_eq!(c.memory_bytes as usize, rows + 64 * 2 + 4);
}

#[test]
fn a_camera_of_every_effect_alone_is_taken() {
    // Others have a table: below.
    let tabled = ["empirical", "gain-table"];
    for entry in Effect::CATALOGUE.iter().filter(|e| !tabled.contains(&e.kind)) {
        let values: Vec<f32> = entry.parameters.iter().map(|p| p.min).collect();
        let effect = Effect::new(entry.id, &values).expect(entry.kind);
        // Traps are charge of all pixels, for which a rig has no memory.
        let expected = match entry.kind {
            "persistence" => Err(Refusal::Effects),
            _ => Ok(()),
        };
        assert_eq!(sent(&sensor(&[effect])), expected, "{}", entry.kind);
    }
}

/// The table of an empirical effect follows the crosstalk table, in pieces of any size.
#[test]
fn the_table_of_an_empirical_effect_comes_with_the_camera() {
    let entry = Effect::CATALOGUE.iter().find(|e| e.kind == "empirical").expect("it is there");
    // An offset, a seam, 2 e⁻ from column 20 on.
    let values = [0.0, 4.0, 2.0, 0.0, 1.0, 7.0, 25.0, 0.0];
    let mut config = sensor(&[Effect::new(entry.id, &values).expect("in range")]);
    config.table.extend_from_slice(&[3.0, 20.0, 0.0, 1.0]).expect("it fits");
    let crosstalk = Crosstalk { x: &[0.0], y: &[0.0], wavelength_nm: &[550.0], factors: &[1.0] };
    for crosstalk in [None, Some(crosstalk)] {
        let mut bytes = [0; 1024];
        let n = camera::encode(&config, crosstalk, &mut bytes).expect("it fits");
        with_rig(|rig| {
            for (i, piece) in bytes[..n].chunks(7).enumerate() {
                rig.camera_piece(7 * i as u32, piece).expect("it is taken");
            }
            assert_eq!(rig.camera_end(), Ok(()));
            // Without its last word it is no table of a seam.
            rig.camera_piece(0, &bytes[..n - 4]).expect("it is taken");
            assert_eq!(rig.camera_end(), Err(Refusal::BadCamera));
        });
    }
    config.table.clear();
    assert_eq!(sent(&config), Err(Refusal::BadCamera));
}

#[test]
fn a_chain_out_of_order_or_out_of_range_is_refused() {
    let (shot, well): (Effect, Effect) = (
        shot_noise::ShotNoise {}.into(),
        full_well::FullWell { full_well_e: 1e4, knee: 0.0 }.into(),
    );
    assert_eq!(sent(&sensor(&[shot, well])), Ok(()));
    assert_eq!(sent(&sensor(&[well, shot])), Err(Refusal::BadCamera));
    for bad in [
        prnu::Prnu { sigma: f32::NAN }.into(),
        read_noise::ReadNoise { read_e: -1.0, read_e_post: 0.0 }.into(),
    ] {
        assert_eq!(sent(&sensor(&[bad])), Err(Refusal::BadCamera), "{bad:?}");
    }
}

/// The number of an effect that this firmware does not have, as an effect without parameters.
#[test]
fn an_effect_that_is_not_compiled_in_is_refused() {
    let config = sensor(&[shot_noise::ShotNoise {}.into()]);
    let mut bytes = [0; 1024];
    let n = camera::encode(&config, None, &mut bytes).expect("it fits");
    // The chain is the configuration's end: its length 1, the number 1, and no values.
    assert_eq!(bytes[n - 3..n], [1, 1, 0]);
    bytes[n - 2] = 63;
    with_rig(|rig| {
        assert_eq!(rig.camera_piece(0, &bytes[..n]), Ok(()));
        assert_eq!(rig.camera_end(), Err(Refusal::BadCamera));
    });
}

/// The bytes of an earlier camera stay in memory, and must not complete a later one.
#[test]
fn a_camera_that_is_cut_short_is_refused() {
    let mut bytes = [0; 1024];
    let n = camera::encode(&sensor(&[]), None, &mut bytes).expect("it fits");
    for cut in [0, 3, 8, n - 10, n - 1] {
        let answer = with_rig(|rig| {
            rig.camera_piece(0, &bytes[..n])?;
            rig.camera_end()?;
            rig.camera_piece(0, &bytes[..cut])?;
            rig.camera_end()
        });
        assert_eq!(answer, Err(Refusal::BadCamera), "{cut} of {n} bytes");
    }
}

/// A camera of so many captures, of rows of 64 pixels over their number.
fn several(captures: usize, change: impl Fn(usize, &mut SensorConfig)) -> Vec<u8> {
    let level = Level { black_dn: 64, gain: 256 };
    let hand = Hand { decide: 0, low_dn: 3000, high_dn: 3600 };
    let (levels, hands) = (vec![level; captures], vec![hand; captures - 1]);
    let curve = Curve::new(&[(1 << 20, 4096.0)], Rounding::Floor).expect("a curve");
    let readout = Readout {
        ratios: (0..captures).map(|_| Ratios { exposure: 1.0, gain: 1.0 }).collect(),
        merge: Merge::new(&levels, &hands, 20, 64).expect("a merge"),
        output: Output::Companded(Companding { curve, bits: 12, subtract_dn: 0, pedestal_dn: 0 }),
    };
    let configs: Vec<SensorConfig> = (0..captures)
        .map(|i| {
            let mut config = sensor(&[shot_noise::ShotNoise {}.into()]);
            config.width = (WIDTH / captures / 16 * 16) as u32;
            change(i, &mut config);
            config
        })
        .collect();
    let parts = configs.iter().map(|config| Capture { config, crosstalk: None });
    let mut bytes = vec![0; 8192];
    let n = camera::encode_captures(&readout, parts, &mut bytes).expect("it fits");
    bytes.truncate(n);
    bytes
}

/// What a rig with memory for so many captures answers to a camera.
fn taken(memory: usize, bytes: &[u8]) -> Result<(), Refusal> {
    with_captures(memory, |rig| {
        for (i, piece) in bytes.chunks(7).enumerate() {
            rig.camera_piece(7 * i as u32, piece)?;
        }
        rig.camera_end()
    })
}

#[test]
fn captures_are_taken_as_far_as_there_is_memory() {
    for captures in 2..=MAX_CAPTURES {
        let camera = several(captures, |_, _| {});
        for memory in 1..=MAX_CAPTURES {
            let expected = match memory {
                _ if memory >= captures => Ok(()),
                _ => Err(Refusal::Captures { max: memory as u8 }),
            };
            assert_eq!(taken(memory, &camera), expected, "{captures} captures, {memory}");
        }
    }
    let codecs = |captures| with_captures(captures, |rig| rig.capabilities().codecs);
    assert_eq!([1, 2].map(codecs), [0b1000_0011, 0b1100_0011]);
}

/// Captures share the memory of rows: four of them have a quarter of it.
#[test]
fn captures_of_long_rows_are_refused() {
    let wide = several(4, |_, config| config.width = 17);
    assert_eq!(taken(4, &wide), Err(Refusal::TooWide { max: 16 }));
}

#[test]
fn captures_that_do_not_fit_together_are_refused() {
    let odd = several(2, |i, config| config.height = 2 + i as u32);
    assert_eq!(taken(2, &odd), Err(Refusal::BadCamera));
    let whole = several(3, |_, _| {});
    let readout = usize::from(u16::from_le_bytes([whole[2], whole[3]]));
    let without_last = whole.len() - (whole.len() - 4 - readout) / 3;
    // A byte that belongs to the readout and that nothing reads.
    let mut longer = whole.clone();
    longer.insert(4 + readout, 0);
    longer[2..4].copy_from_slice(&(readout as u16 + 1).to_le_bytes());
    assert_eq!(taken(3, &longer), Err(Refusal::BadCamera));
    for cut in [2, 4, 20, without_last - 1, without_last, without_last + 4, whole.len() - 1] {
        assert_eq!(taken(3, &whole[..cut]), Err(Refusal::BadCamera), "{cut} bytes");
    }
}

use super::*;
use crate::Law;
use embedded_hal_02::blocking::i2c as old;

fn sensor(profile: &str) -> Sensor {
    Sensor::new(Profile::builtin(profile).unwrap())
}

/// Writes registers of a sensor at its usual address.
fn write(sensor: &mut Sensor, bytes: &[u8]) {
    let address = sensor.profile().i2c[0];
    sensor.write(address, bytes).unwrap();
}

#[test]
fn every_mode_has_the_frame_rate_and_size_that_it_names() {
    for name in Profile::names() {
        let profile = Profile::builtin(name).unwrap();
        assert!(!profile.mode.is_empty() && !profile.sources.is_empty(), "{name}");
        for mode in profile.mode.clone() {
            let mut sensor = Sensor::new(profile.clone());
            for (address, value) in profile.mode_registers(&mode).unwrap() {
                sensor.set(address, value);
            }
            // The frame that begins when it leaves standby, with the registers as they are.
            let frame = sensor.frame();
            assert!((frame.frame_s * mode.fps - 1.0).abs() < 1e-3, "{name}: {mode:?} {frame:?}");
            let size = frame.size.unwrap_or((mode.width, mode.height));
            assert_eq!(size, (mode.width, mode.height), "{name}");
        }
    }
}

#[test]
fn writes_act_after_the_delays_of_the_sensor() {
    // IMX477: exposure and gain after 2 frames, frame length after 3.
    let mut s = sensor("imx477");
    assert_eq!(s.next_frame(), None, "it stands by");
    write(&mut s, &[0x01, 0x00, 1]);
    let line_s = 24_000.0 / 840e6;
    let seen = |s: &mut Sensor| {
        let frame = s.next_frame().unwrap();
        let lines = |seconds: f64| (seconds / line_s).round() as u32;
        (lines(frame.exposure_s), frame.analog_gain, lines(frame.frame_s))
    };
    assert_eq!(seen(&mut s), (1000, 1.0, 3500));
    write(&mut s, &[0x02, 0x02, 0x07, 0xD0, 0x02, 0x00]); // 2000 lines, gain 2
    write(&mut s, &[0x03, 0x40, 0x10, 0x00]); // 4096 lines
    assert_eq!(seen(&mut s), (1000, 1.0, 3500));
    assert_eq!(seen(&mut s), (2000, 2.0, 3500));
    assert_eq!(seen(&mut s), (2000, 2.0, 4096));
    // Under hold nothing acts; then all together.
    write(&mut s, &[0x01, 0x04, 1]);
    write(&mut s, &[0x02, 0x02, 0x00, 0x64]);
    assert_eq!([seen(&mut s).0, seen(&mut s).0, seen(&mut s).0], [2000; 3]);
    write(&mut s, &[0x01, 0x04, 0]);
    assert_eq!([seen(&mut s).0, seen(&mut s).0], [2000, 100]);
    // In standby what is written acts with the first frame.
    write(&mut s, &[0x01, 0x00, 0]);
    write(&mut s, &[0x02, 0x02, 0x00, 0x32]);
    write(&mut s, &[0x01, 0x00, 1]);
    assert_eq!(seen(&mut s).0, 50);
    // Exposures end 22 lines before the frame; the shift doubles both.
    write(&mut s, &[0x01, 0x03, 1]);
    write(&mut s, &[0x02, 0x02, 0xFF, 0xFF]);
    write(&mut s, &[0x31, 0x00, 1]);
    write(&mut s, &[0x01, 0x00, 1]);
    assert_eq!(s.next_frame().unwrap().exposure_s, 2.0 * 3478.0 * 24_000.0 / 840e6);
}

/// By hand from the laws of the data sheets.
#[test]
fn exposures_are_in_the_units_of_each_sensor() {
    for (profile, writes, exposure_s) in [
        // 0x1AF0 sixteenths of lines of 2844 clocks at 87.5 MHz.
        ("ov5647", &[&[0x35, 0x00, 0, 0x1A, 0xF0][..]][..], 431.0 * 2844.0 / 87.5e6),
        // 1000 lines make the frame longer than 525.
        ("mt9v034", &[&[0x0B, 0x03, 0xE8][..]], 1000.0 * 846.0 / 26.6e6),
        // 2 lines and 100 clocks.
        ("ar0144", &[&[0x30, 0x12, 0, 2, 0, 100][..]], (2.0 * 1488.0 + 100.0) / 74.25e6),
        // 10 lines of 612 clocks at 90 MHz.
        ("ar0234", &[&[0x30, 0x12, 0, 10][..]], 10.0 * 612.0 / 90e6),
        // 6, 8 and 2 bits: 4, 1 and 2; the clock halved.
        ("ov7670", &[&[0x07, 0][..], &[0x10, 4], &[0x04, 2], &[0x11, 0x81]], 18.0 * 784.0 / 6e6),
    ] {
        let mut s = sensor(profile);
        for bytes in writes {
            write(&mut s, bytes);
        }
        let found = s.frame().exposure_s;
        assert!((found / exposure_s - 1.0).abs() < 1e-12, "{profile}: {found} {exposure_s}");
    }
}

#[test]
fn what_a_sensor_has_beside_exposure_is_in_its_frames() {
    let mut s = sensor("ov7670");
    assert!(s.next_frame().unwrap().is_automatic, "its own control is on at power-on");
    write(&mut s, &[0x13, 0x80]);
    write(&mut s, &[0x1E, 0x37]);
    write(&mut s, &[0x71, 0xB5]);
    let frame = s.next_frame().unwrap();
    assert!(!frame.is_automatic && frame.is_mirrored && frame.is_flipped);
    assert_eq!(frame.test_pattern.as_deref(), Some("shifting-one"));
    write(&mut s, &[0x12, 0x80]);
    assert_eq!((s.register(0x13), s.register(0x12)), (0x8F, 0), "as at power-on");
    write(&mut s, &[0x09, 0x10]);
    assert_eq!(s.next_frame(), None, "it sleeps");
    let mut s = sensor("imx219");
    write(&mut s, &[0x06, 0x00, 0, 2]);
    write(&mut s, &[0x01, 0x58, 0x02, 0x80]);
    write(&mut s, &[0x01, 0x00, 1]);
    let frame = s.next_frame().unwrap();
    assert_eq!((frame.digital_gain, frame.test_pattern.as_deref()), (2.5, Some("bars")));
}

#[test]
fn a_bus_has_one_sensor_and_its_faults() {
    let mut s = sensor("imx219").at(0x37);
    assert_eq!(s.write(0x10, &[0]), Err(Nack::Address));
    assert!(s.write(0x37, &[0x01, 0x00]).is_ok());
    s.refuse(2);
    for expected in [Err(Nack::Data), Err(Nack::Data), Ok(())] {
        assert_eq!(s.write(0x37, &[0x01, 0x00, 1]), expected);
    }
    // Reads go on at the pointer; identities cannot be written; writes in pieces are one.
    s.write(0x37, &[0x00, 0x00, 9, 9]).unwrap();
    let (mut first, mut second) = ([0], [0]);
    s.transaction(
        0x37,
        &mut [
            Operation::Write(&[0x00]),
            Operation::Write(&[0x00]),
            Operation::Read(&mut first),
            Operation::Read(&mut second),
        ],
    )
    .unwrap();
    assert_eq!((first, second), ([0x02], [0x19]));
}

/// The descriptions that Linux' ccs driver reads, against the map's own laws.
#[test]
fn the_ccs_sensor_describes_itself() {
    let s = sensor("ccs");
    let word = |at: u16| u32::from(s.register(at)) << 8 | u32::from(s.register(at + 1));
    let profile = s.profile();
    assert_eq!(profile.analog_gain.codes, [0x84, 0x86].map(word));
    let Law::Ratio { m0, c0, m1, c1 } = profile.analog_gain.law else { panic!("a ratio") };
    assert_eq!([m0, c0, m1, c1], [0x8C, 0x8E, 0x90, 0x92].map(|at| word(at) as i32));
    assert_eq!(profile.digital_gain.as_ref().unwrap().codes, [0x1084, 0x1086].map(word));
    assert_eq!(profile.exposure.min, word(0x1004));
    assert_eq!(profile.exposure.margin, word(0x1006));
    assert_eq!(profile.timing.frame_length.min, word(0x1140));
    assert_eq!(profile.timing.line_length.min, word(0x1144));
    let [width, height] = [word(0x118C), word(0x118E)];
    assert_eq!((word(0x1184) + 1, word(0x1186) + 1), (width, height));
    assert_eq!((word(0x034C), word(0x034E)), (width, height));
    // Visible pixels, an embedded line, visible lines.
    assert_eq!([word(0x42), word(0x44), word(0x46)], [0x5000 | width, 0x1001, 0x5000 | height]);
    assert_eq!(word(0x0112), word(0xC2), "the data format in use is the one it has");
}

/// Drivers of embedded-hal 0.2 on the same sensor.
struct Old<'a>(&'a mut Sensor);

impl old::Write for Old<'_> {
    type Error = Nack;
    fn write(&mut self, address: u8, bytes: &[u8]) -> Result<(), Nack> {
        I2c::write(self.0, address, bytes)
    }
}

impl old::Read for Old<'_> {
    type Error = Nack;
    fn read(&mut self, address: u8, bytes: &mut [u8]) -> Result<(), Nack> {
        I2c::read(self.0, address, bytes)
    }
}

impl old::WriteRead for Old<'_> {
    type Error = Nack;
    fn write_read(&mut self, address: u8, out: &[u8], bytes: &mut [u8]) -> Result<(), Nack> {
        I2c::write_read(self.0, address, out, bytes)
    }
}

/// Words written whole, as Linux does, and byte by byte are the same.
#[test]
fn words_go_byte_by_byte_too_and_a_lock_keeps_them() {
    let mut s = sensor("mt9v034");
    write(&mut s, &[0x0B, 0x01]);
    assert_eq!(s.register(0x0B), 480, "waits for its low byte");
    write(&mut s, &[0xF0, 0x23]);
    assert_eq!(s.register(0x0B), 0x0123);
    let (mut high, mut low, mut word) = ([0], [0], [0; 2]);
    s.write_read(0x48, &[0x00], &mut high).unwrap();
    s.write_read(0x48, &[0xF0], &mut low).unwrap();
    s.write_read(0x48, &[0x00], &mut word).unwrap();
    assert_eq!((high, low, word), ([0x13], [0x24], [0x13, 0x24]));
    write(&mut s, &[0xFE, 0xDE, 0xAD]);
    write(&mut s, &[0x0B, 0x00, 0x10]);
    assert_eq!(s.register(0x0B), 0x0123, "locked");
    write(&mut s, &[0xFE, 0xBE, 0xEF]);
    write(&mut s, &[0x0B, 0x00, 0x10]);
    assert_eq!(s.register(0x0B), 0x0010);
}

/// A published driver (mt9v034-i2c): it finds the sensor, and its set-up leaves frames of the
/// sensor's own size with an exposure that its own control sets.
#[test]
fn the_published_mt9v034_driver_sets_it_up() {
    let mut s = sensor("mt9v034");
    let mut driver = mt9v034_i2c::Mt9v034::new(Old(&mut s), 0x48);
    assert_eq!(driver.read_reg_u16(0).ok(), Some(0x1324));
    assert!(driver.setup().is_ok());
    assert!(s.is_streaming());
    let frame = s.next_frame().unwrap();
    assert!(frame.exposure_s > 0.0 && frame.frame_s >= frame.exposure_s, "{frame:?}");
}

/// A map with an identity alone, for drivers of sensors without a profile.
fn bare(id: &str, address_bits: u32, streams: &str, i2c: u8) -> Sensor {
    let text = format!(
        "format = 'sensor-profile/1'\nname = 'bare'\nsources = []\ni2c = [{i2c}]\n\
         address_bits = {address_bits}\nregister_bits = 8\n\
         timing = {{ pixel_clock_hz = 1e6, line_length = {{ plus = 1 }}, \
         frame_length = {{ plus = 1 }}, frame_length_delay = 1 }}\n\
         exposure = {{ field = '0x10', delay = 1 }}\n\
         analog_gain = {{ field = '0x00', law.doublings = {{}}, codes = [0, 255], delay = 1 }}\n\
         state = {{ streams = '{streams}' }}\nidentity = {{ {id} }}\nreset = {{}}\n"
    );
    Sensor::new(Profile::parse(&text).unwrap())
}

/// Published drivers of embedded-hal 1 (rusty_esp_image-core).
#[test]
fn the_published_drivers_of_ov3660_and_ov2640_run() {
    use rusty_esp_image_core::driver::{Ov2640, Ov3660};
    use rusty_esp_image_core::sensor::{FrameSize, Mode};
    let mode = Mode::jpeg(FrameSize::Vga).unwrap();
    let mut waited_ms = 0u32;
    let mut delay = |ms: u16| waited_ms += u32::from(ms);
    let mut s = bare("0x300A = [0x36, 0x60]", 16, "0x3008[6] = 0", 0x3C);
    let mut driver = Ov3660::new(&mut s, 20_000_000);
    assert!(driver.probe().unwrap());
    driver.reset(&mut delay).unwrap();
    driver.configure(&mode).unwrap();
    assert!(s.is_streaming(), "0x3008 = {:#x}", s.register(0x3008));
    assert_eq!((s.register(0x3808), s.register(0x3809)), (0x02, 0x80), "640 columns");
    let mut s = bare("0x0A = [0x26, 0x42]", 8, "0x09[4] = 0", 0x30);
    let mut driver = Ov2640::new(&mut s);
    assert!(driver.probe().unwrap());
    driver.reset(&mut delay).unwrap();
    driver.configure(&mode, &mut delay).unwrap();
    assert!(waited_ms > 0);
}

use super::*;
use crate::gvcp::{self, code};
use crate::gvsp;
use crate::pixel::Pattern;

const HOST: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 1), 5000);
const OTHER: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 2), 5000);

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn device() -> Device {
    let timing = Timing { exposure_lines: 1000, frame_lines: 2000, gain_code: 256 };
    let sensor = Sensor {
        model: "card".into(),
        serial: "42".into(),
        width: 66,
        height: 48,
        pattern: Pattern::BayerRg,
        bits: 10,
        line_ns: 10_000,
        min_frame_lines: 48,
        timing,
    };
    Device::new(sensor, Ipv4Addr::LOCALHOST, 1234)
}

/// Status and payload of a command's answer.
fn ask(
    device: &mut Device,
    now: Duration,
    from: SocketAddrV4,
    code: u16,
    payload: &[u8],
) -> (u16, Vec<u8>) {
    let answer = device.receive(now, from, &gvcp::request(code, 7, false, payload)).unwrap();
    let (status, id, payload) = gvcp::parse_acknowledgement(&answer).unwrap();
    assert_eq!(id, 7);
    (status, payload.to_vec())
}

fn write(device: &mut Device, from: SocketAddrV4, address: u32, value: u32) -> u16 {
    let payload = [address, value].map(u32::to_be_bytes);
    ask(device, ms(0), from, code::WRITE_REGISTERS, payload.as_flattened()).0
}

fn write_float(device: &mut Device, address: u32, value: f64) -> u16 {
    let payload = [&address.to_be_bytes()[..], &value.to_be_bytes()].concat();
    ask(device, ms(0), HOST, code::WRITE_MEMORY, &payload).0
}

/// A device that `HOST` controls and that streams.
fn streaming() -> Device {
    let mut device = device();
    for (address, value) in [
        (bootstrap::CONTROL, 2),
        (bootstrap::DESTINATION, (*HOST.ip()).into()),
        (bootstrap::HOST_PORT, 6000),
        (feature::ACQUISITION, 1),
    ] {
        assert_eq!(write(&mut device, HOST, address, value), 0);
    }
    device
}

fn image(order: &Order) -> Taken {
    Taken::Image(vec![1; order.image_bytes], 9)
}

#[test]
fn applications_find_it_and_read_its_xml() {
    let mut device = device();
    let (status, found) = ask(&mut device, ms(0), OTHER, code::DISCOVERY, &[]);
    assert_eq!((status, found.len()), (0, 0xF8));
    assert_eq!(found[..8], [0, 2, 0, 0, 0x80, 0, 0, 1]);
    assert_eq!(found[0x24..0x28], [127, 0, 0, 1]);
    assert_eq!((&found[0x48..0x4E], &found[0xD8..0xDB]), (&b"camrig"[..], &b"42\0"[..]));
    let read = |device: &mut Device, address: u32, count: u32| {
        let payload = [address, count].map(u32::to_be_bytes);
        ask(device, ms(0), OTHER, code::READ_MEMORY, payload.as_flattened())
    };
    let (_, url) = read(&mut device, bootstrap::XML_URL, 512);
    let url = String::from_utf8(url[4..].to_vec()).unwrap();
    let bytes = u32::from_str_radix(url.trim_end_matches('\0').rsplit(';').next().unwrap(), 16);
    let mut xml = Vec::new();
    while xml.len() < bytes.clone().unwrap() as usize {
        let (status, piece) = read(&mut device, feature::XML + xml.len() as u32, 4);
        assert_eq!(status, 0);
        xml.extend(&piece[4..]);
    }
    let xml = String::from_utf8(xml).unwrap();
    assert!(xml.trim_end_matches('\0').ends_with("</RegisterDescription>\n"), "{xml}");
    assert!(xml.contains("<EnumEntry Name=\"BayerRG10\" NameSpace=\"Standard\"><Value>17825805<"));
    assert_eq!(read(&mut device, 0, 540).0, Status::InvalidParameter as u16);
    assert_eq!(ask(&mut device, ms(0), HOST, 0x00C0, &[]).0, Status::NotImplemented as u16);
}

#[test]
fn one_application_controls_and_others_read() {
    let mut device = device();
    let denied = Status::AccessDenied as u16;
    assert_eq!(write(&mut device, HOST, feature::TEST_PATTERN, 2), denied, "without control");
    assert_eq!(write(&mut device, HOST, bootstrap::CONTROL, 2), 0);
    for (address, value) in [(bootstrap::CONTROL, 2), (bootstrap::CONTROL, 0), (0xD00, 1)] {
        assert_eq!(write(&mut device, OTHER, address, value), denied, "{address:#x}");
    }
    let registers = bootstrap::CONTROL.to_be_bytes();
    let (status, control) = ask(&mut device, ms(0), OTHER, code::READ_REGISTERS, &registers);
    assert_eq!((status, &*control), (0, &[0, 0, 0, 2][..]));
    assert_eq!(write(&mut device, HOST, bootstrap::CONTROL, 0), 0);
    assert_eq!(write(&mut device, OTHER, bootstrap::CONTROL, 2), 0);
}

#[test]
fn a_host_that_is_silent_loses_control_and_its_stream() {
    let mut device = streaming();
    let order = device.order(ms(0)).unwrap();
    device.deliver(image(&order));
    let registers = bootstrap::CONTROL.to_be_bytes();
    ask(&mut device, ms(2000), HOST, code::READ_REGISTERS, &registers);
    let mut out = Vec::new();
    assert!(matches!(device.next(ms(5000), &mut out), Next::Packet { .. }), "within 3 s");
    assert_eq!(device.next(ms(5001), &mut out), Next::Wait(None));
    assert_eq!(device.order(ms(5001)), None);
    let (_, control) = ask(&mut device, ms(5001), OTHER, code::READ_REGISTERS, &registers);
    assert_eq!(*control, [0; 4]);
    assert_eq!(write(&mut device, OTHER, bootstrap::CONTROL, 2), 0);
}

#[test]
fn frames_are_ordered_by_their_rate_and_sent() {
    let mut device = streaming();
    let order = device.order(ms(0)).unwrap();
    assert_eq!((order.frame, order.after_standby, &*order.pixel_format), (0, true, "BayerRG10"));
    assert_eq!((order.region.width, order.region.height), (64, 48));
    assert_eq!(order.image_bytes, 64 * 48 * 2);
    assert_eq!(device.order(ms(100)), None, "one at a time");
    device.deliver(image(&order));
    assert_eq!((device.order(ms(19)), device.next_order()), (None, Some(ms(20))));
    let second = device.order(ms(20)).unwrap();
    assert_eq!((second.frame, second.after_standby), (1, false));
    device.deliver(Taken::Dropped(9));
    assert_eq!(device.order(ms(40)).unwrap().frame, 2);
    device.deliver(image(&order));
    assert_eq!(device.order(ms(60)), None, "two blocks wait");
    let (mut out, mut blocks) = (Vec::new(), Vec::new());
    while let Next::Packet { to, ends_block } = device.next(ms(60), &mut out) {
        assert_eq!(to, SocketAddrV4::new(*HOST.ip(), 6000));
        blocks.extend(ends_block.then(|| gvsp::parse(&out).unwrap().block));
    }
    assert_eq!(blocks, [1, 3], "the dropped frame is a gap");
    assert!(device.order(ms(60)).is_some());
}

#[test]
fn settings_are_what_the_sensor_can_do() {
    let mut device = streaming();
    let read = |device: &Device, address| device.memory.float(address);
    assert_eq!(write_float(&mut device, feature::EXPOSURE_US, 1234.0), 0);
    assert_eq!(read(&device, feature::EXPOSURE_US), 1230.0, "whole lines");
    assert_eq!(write_float(&mut device, feature::GAIN_DB, 6.0), 0);
    // 10^(6/20) = 1.99526: code 511.
    assert_eq!(device.order(ms(0)).unwrap().timing.gain_code, 511);
    assert_eq!(read(&device, feature::GAIN_DB), 20.0 * libm::log10(511.0 / 256.0));
    assert_eq!(write_float(&mut device, feature::FRAME_RATE, 30.0), 0);
    assert_eq!(read(&device, feature::FRAME_RATE), 1e6 / 33_330.0);
    assert_eq!(write_float(&mut device, feature::EXPOSURE_US, 50_000.0), 0);
    assert_eq!(read(&device, feature::FRAME_RATE), 20.0, "of a longer exposure");
    let refused = Status::InvalidParameter as u16;
    for (address, value) in [
        (feature::EXPOSURE_US, 4.9),
        (feature::EXPOSURE_US, f64::NAN),
        (feature::GAIN_DB, 49.0),
        (feature::FRAME_RATE, 2200.0),
        (feature::PACKET_LOSS, 101.0),
    ] {
        assert_eq!(write_float(&mut device, address, value), refused, "{value}");
    }
}

#[test]
fn the_region_stays_inside_the_sensor_and_still_while_streaming() {
    let mut device = device();
    assert_eq!(write(&mut device, HOST, bootstrap::CONTROL, 2), 0);
    let refused = Status::InvalidParameter as u16;
    for (address, value, status) in [
        (feature::WIDTH, 66, refused),
        (feature::OFFSET_X, 2, 0),
        (feature::OFFSET_X, 4, refused),
        (feature::WIDTH, 32, 0),
        (feature::OFFSET_X, 34, 0),
        (feature::OFFSET_Y, 1, refused),
        (feature::PIXEL_FORMAT, 0x010A_0058, 0),
        (feature::PIXEL_FORMAT, 0x0108_0001, refused),
    ] {
        assert_eq!(write(&mut device, HOST, address, value), status, "{address:#x} {value}");
    }
    assert_eq!(device.memory.word(feature::PAYLOAD_BYTES), 32 * 48 * 10 / 8);
    assert_eq!(write(&mut device, HOST, feature::ACQUISITION, 1), 0);
    assert_eq!(write(&mut device, HOST, feature::WIDTH, 16), Status::AccessDenied as u16);
}

#[test]
fn a_trigger_begins_a_frame_after_standby() {
    let mut device = streaming();
    assert_eq!(write(&mut device, HOST, feature::TRIGGER_MODE, 1), 0);
    assert_eq!((device.order(ms(500)), device.next_order()), (None, None));
    for frame in 0..2 {
        assert_eq!(write(&mut device, HOST, feature::TRIGGER_SOFTWARE, 1), 0);
        let order = device.order(ms(500)).unwrap();
        assert_eq!((order.frame, order.after_standby), (frame, true));
        device.deliver(Taken::Dropped(0));
        assert_eq!(device.order(ms(900)), None);
    }
}

#[test]
fn an_acquisition_ends_by_its_number_of_frames_by_stop_or_with_the_scene() {
    let mut device = streaming();
    assert_eq!(write(&mut device, HOST, feature::ACQUISITION, 0), 0);
    assert_eq!(write(&mut device, HOST, feature::ACQUISITION_MODE, 1), 0);
    assert_eq!(write(&mut device, HOST, feature::ACQUISITION, 1), 0);
    let order = device.order(ms(0)).unwrap();
    device.deliver(image(&order));
    assert_eq!((device.order(ms(900)), device.memory.word(feature::ACQUISITION)), (None, 0));
    assert_eq!(write(&mut device, HOST, feature::ACQUISITION_MODE, 0), 0);
    assert_eq!(write(&mut device, HOST, feature::ACQUISITION, 1), 0);
    let order = device.order(ms(900)).unwrap();
    assert!(order.after_standby, "the first of another acquisition");
    assert_eq!(write(&mut device, HOST, feature::ACQUISITION, 0), 0);
    device.deliver(image(&order));
    let mut out = Vec::new();
    assert_eq!(device.next(ms(900), &mut out), Next::Wait(None), "no longer wanted");
    assert_eq!(write(&mut device, HOST, feature::ACQUISITION, 1), 0);
    assert!(device.order(ms(900)).is_some());
    device.deliver(Taken::End);
    assert_eq!((device.order(ms(990)), device.memory.word(feature::ACQUISITION)), (None, 0));
}

#[test]
fn faults_and_packet_sizes_act_as_written_by_either_command() {
    let mut device = streaming();
    assert_eq!(write(&mut device, HOST, feature::FAULT_ARGUMENT, 7), 0);
    assert_eq!(write(&mut device, HOST, feature::FAULT, 2), 0);
    let order = device.order(ms(0)).unwrap();
    assert_eq!((order.fault, order.fault_argument), (2, 7));
    device.deliver(Taken::Dropped(0));
    assert_eq!(device.order(ms(20)).unwrap().fault, 0, "once");
    let fire = [&bootstrap::PACKET_SIZE.to_be_bytes()[..], &[0x80, 0, 0x10, 0]].concat();
    assert_eq!(ask(&mut device, ms(0), HOST, code::WRITE_MEMORY, &fire).0, 0);
    let mut out = Vec::new();
    assert!(matches!(device.next(ms(20), &mut out), Next::Packet { ends_block: false, .. }));
    assert_eq!(out.len(), 0x1000 - 28);
    assert_eq!(device.memory.word(bootstrap::PACKET_SIZE), 0x1000);
    assert_eq!(write(&mut device, HOST, 0xD04, 100), Status::InvalidParameter as u16);
    assert_eq!(write(&mut device, HOST, 0, 100), Status::WriteProtect as u16);
    assert_eq!(write(&mut device, HOST, 0xF000_0000, 1), Status::InvalidAddress as u16);
}

#[test]
fn what_waits_is_not_sent_to_another_receiver() {
    let mut device = streaming();
    let order = device.order(ms(0)).unwrap();
    device.deliver(image(&order));
    let mut out = Vec::new();
    assert!(matches!(device.next(ms(0), &mut out), Next::Packet { .. }));
    assert_eq!(write(&mut device, HOST, bootstrap::PACKET_SIZE, FIRE_TEST | 1500), 0);
    assert_eq!(write(&mut device, HOST, bootstrap::HOST_PORT, 6001), 0);
    assert_eq!(device.next(ms(1), &mut out), Next::Wait(None));
}

#[test]
fn exclusive_control_keeps_others_from_reading_but_not_from_finding_the_device() {
    let mut d = device();
    let denied = Status::AccessDenied as u16;
    let read = |d: &mut Device, from| {
        ask(d, ms(0), from, code::READ_REGISTERS, &bootstrap::CONTROL.to_be_bytes()).0
    };
    for (control, expected) in [(2, 0), (1, denied), (3, denied), (0, 0)] {
        assert_eq!(write(&mut d, HOST, bootstrap::CONTROL, control), 0);
        assert_eq!((read(&mut d, HOST), read(&mut d, OTHER)), (0, expected), "{control}");
        assert_eq!(ask(&mut d, ms(0), OTHER, code::DISCOVERY, &[]).1.len(), DISCOVERY_BYTES);
    }
}

#[test]
fn a_user_name_is_written_whole_or_in_parts() {
    let mut d = device();
    write(&mut d, HOST, bootstrap::CONTROL, 2);
    let name = bootstrap::USER_NAME;
    let mut put = |at: u32, text: &[u8]| {
        ask(&mut d, ms(0), HOST, code::WRITE_MEMORY, &[&at.to_be_bytes(), text].concat()).0
    };
    assert_eq!(put(name, b"left eye of rig\0"), 0);
    assert_eq!((put(name, b"nose"), put(name + 8, b" is ours")), (0, 0));
    assert_eq!(put(name + 8, b"is too long for it"), Status::BadAlignment as u16);
    assert_eq!(put(name + 8, b"beyond the end  "), Status::WriteProtect as u16);
    assert_eq!(d.memory.read(name, 16), Ok(&b"nose eyebeyond t"[..]));
}

/// GenApi asks a register that can be read whether a command is done.
#[test]
fn commands_cannot_be_read_back() {
    let xml = features::xml(&device().sensor, &device().formats);
    for command in ["AcquisitionStart", "AcquisitionStop", "TriggerSoftware"] {
        let register = xml.split_once(&format!("Name=\"{command}Register\"")).unwrap().1;
        let access = register.split_once("<AccessMode>").unwrap().1;
        assert!(access.starts_with("WO"), "{command}");
    }
}

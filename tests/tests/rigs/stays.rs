//! Raw rows that leave by the rig's own interface: the frames of this process, and receipts.

use crate::common::{self, BANDS, HEIGHT, WIDTH};
use camrig::rig::transport::{ByteLink, MAX_PACKET};
use camrig::rig::{FrameRequest, Rig, Url};
use camrig_firmware_sim::{Buffers, Memory, RowMemory, serve};
use camrig_rig_link::device::{Device, RowSink};
use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::Limits;
use camrig_rig_link::message::FrameStart;
use camrig_rig_link::packing::{Packing, unpack_row};
use camrig_rig_link::wire::crc32c;
use camrig_sensor_core::arith::{BLOCK, blocks};
use camrig_sensor_core::spectral::groups;
use camrig_tests::Pipe;
use std::os::unix::net::UnixStream;
use std::sync::mpsc;

/// A board's camera interface of 16 bits.
struct Interface(mpsc::Sender<(u16, Vec<u8>)>);

impl RowSink for Interface {
    fn raw_bits(&self) -> u8 {
        16
    }

    fn begin(&mut self, _: &FrameStart, row_bytes: u16) {
        assert_eq!(usize::from(row_bytes), 2 * WIDTH);
    }

    fn row(&mut self, row: u16, packed: &[u8]) {
        self.0.send((row, packed.to_vec())).unwrap();
    }
}

/// A rig of one row at a time, with an interface.
fn board(mut link: Pipe, mut interface: Interface) {
    let mut float =
        (vec![[0.0; BLOCK]; 7 * blocks(WIDTH)], vec![Default::default(); groups(WIDTH)]);
    let (mut mantissas, mut exponents) = (vec![0; WIDTH], vec![0; groups(WIDTH)]);
    let mut crosstalk = vec![0.0; 10_000];
    let memory = Memory::new(&mut mantissas, &mut exponents, &mut crosstalk, 31)
        .with_float(RowMemory { rows: &mut float.0, sums: &mut float.1 });
    let mut rig = camrig_firmware_sim::Rig::new("board", memory);
    rig.set_sink(&mut interface);
    let mut device = Box::new(Device::<{ 2 * WIDTH }>::new(MAX_PACKET as u16, 16));
    let buffer = || vec![0; Framing::Length.max_encoded(MAX_PACKET)];
    let (mut input, mut packet, mut answer, mut framed) = (buffer(), buffer(), buffer(), buffer());
    let buffers = Buffers {
        input: &mut input,
        packet: &mut packet,
        answer: &mut answer[..MAX_PACKET],
        framed: &mut framed,
    };
    serve(&mut *device, &mut rig, &mut link, Framing::Length, buffers).unwrap();
}

#[test]
fn rows_that_stay_with_the_rig_are_those_of_the_host() {
    let (near, far) = UnixStream::pair().unwrap();
    let (sender, rows) = mpsc::channel();
    std::thread::spawn(move || board(Pipe(far), Interface(sender)));
    let reader = near.try_clone().unwrap();
    let link = ByteLink::new("board".into(), Framing::Length, Limits::default(), near, reader);
    let mut rig = Rig::with_transport(Url::Emulator, Box::new(link)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let camera = common::camera(folder.path(), 0);
    let cube = common::cube(&camera, BANDS);
    let sensor = common::sensor(&camera, &cube);
    rig.set_camera(&sensor).unwrap();
    let settings = camera.settings(3, 0.02, None);
    let request = FrameRequest { rows_stay: true, ..FrameRequest::new(settings) };
    let frame = rig.frame(&cube, &sensor, &request).unwrap();
    let here = sensor.frame(&cube, &settings).unwrap();
    let receipts = frame.receipts.as_ref().unwrap();
    assert_eq!((receipts.len(), frame.packed.len()), (HEIGHT, 0));
    for (y, (receipt, row)) in receipts.iter().zip(here.data.chunks(WIDTH)).enumerate() {
        let (number, packed) = rows.recv().unwrap();
        assert_eq!(usize::from(number), y);
        assert_eq!(*receipt, crc32c(&packed));
        let mut dn = vec![0; WIDTH];
        unpack_row(Packing::of_bits(16).unwrap(), &packed, &mut dn).unwrap();
        assert!(dn == row, "row {y}");
    }
    assert!(frame.to_raw(&sensor).unwrap_err().to_string().contains("raw output"));
    // And without such an interface they do not stay.
    let mut emulator = Rig::open("emulator:").unwrap();
    emulator.set_camera(&sensor).unwrap();
    let said = emulator.frame(&cube, &sensor, &request).unwrap_err().to_string();
    assert!(said.contains("no raw output"), "{said}");
}

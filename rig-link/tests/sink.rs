//! Raw rows that leave by the device's own interface: each once, in order and right, and the host
//! has a receipt of each, whatever the link loses.

#[allow(dead_code, reason = "the link with faults is for other tests")]
mod common;

use camrig_rig_link::device::{Begun, Device, Model, RowSink};
use camrig_rig_link::host::{Event, FrameIo, Host, Limits, Poll};
use camrig_rig_link::message::*;
use camrig_rig_link::registers::{Registers, address};
use camrig_rig_link::wire::crc32c;
use common::*;

/// A board's camera interface.
#[derive(Default)]
struct Interface {
    begun: Vec<(FrameStart, u16)>,
    rows: Vec<(u16, Vec<u8>)>,
}

impl RowSink for Interface {
    fn raw_bits(&self) -> u8 {
        16
    }

    fn begin(&mut self, start: &FrameStart, row_bytes: u16) {
        self.begun.push((*start, row_bytes));
        self.rows.clear();
    }

    fn row(&mut self, row: u16, packed: &[u8]) {
        self.rows.push((row, packed.to_vec()));
    }
}

struct Board {
    toy: Toy,
    interface: Interface,
}

impl Model for Board {
    fn capabilities(&self) -> Capabilities {
        self.toy.capabilities()
    }

    fn camera_piece(&mut self, offset: u32, piece: &[u8]) -> Result<(), Refusal> {
        self.toy.camera_piece(offset, piece)
    }

    fn camera_end(&mut self) -> Result<(), Refusal> {
        self.toy.camera_end()
    }

    fn begin(
        &mut self,
        frame: &FrameBegin,
        exposure: Exposure,
        registers: &Registers,
    ) -> Result<Begun, Refusal> {
        assert_eq!(frame.raw_bits, 16, "the interface's own");
        self.toy.begin(frame, exposure, registers)
    }

    fn units(&mut self, row: u16, first: u16, units: &[u8]) {
        self.toy.units(row, first, units);
    }

    fn raw_row(&mut self, row: u16, out: &mut [u8]) {
        self.toy.raw_row(row, out);
    }

    fn sink(&mut self) -> Option<&mut dyn RowSink> {
        Some(&mut self.interface)
    }
}

/// The host's memory: receipts instead of rows.
struct Receipts {
    frame: Frame,
    receipts: [[u8; RECEIPT_BYTES]; ROWS as usize],
}

impl FrameIo for Receipts {
    fn spectral(&mut self, row: u16, first: u16, out: &mut [u8]) {
        self.frame.spectral(row, first, out);
    }

    fn raw_row(&mut self, row: u16) -> &mut [u8] {
        &mut self.receipts[usize::from(row)]
    }

    fn camera(&mut self, offset: u32, out: &mut [u8]) {
        self.frame.camera(offset, out);
    }
}

/// Host and board, and a link that loses packets by chance.
struct Setup {
    host: Host<[u16; ROWS as usize]>,
    io: Receipts,
    device: Box<Device<RAW_BYTES>>,
    board: Board,
    loss: f64,
    random: Random,
}

impl Setup {
    fn new(seed: u64) -> Self {
        let camera = vec![1, 2, 3];
        let id = camera_id(&camera);
        let mut setup = Self {
            host: Host::new(Limits::default(), [0; ROWS as usize]),
            io: Receipts {
                frame: Frame { frame: 4, camera, raw: Vec::new() },
                receipts: Default::default(),
            },
            device: Box::new(Device::new(600, 32)),
            board: Board { toy: Toy::default(), interface: Interface::default() },
            loss: 0.0,
            random: Random(seed),
        };
        setup.host.connect(7);
        assert_eq!(setup.run(), Event::Connected);
        setup.host.send_camera(id, 3);
        assert_eq!(setup.run(), Event::CameraReady);
        setup
    }

    fn run(&mut self) -> Event {
        let (mut out, mut now) = ([0; 2000], 0);
        for _ in 0..100_000 {
            match self.host.poll(now, &mut self.io, &mut out) {
                Poll::Done(event) => return event,
                Poll::Send(n) if !self.random.chance(self.loss) => {
                    self.device.receive(&out[..n], &mut self.board);
                }
                Poll::Send(_) => {}
                Poll::Wait(until) => now = until,
            }
            while let Some(n) = self.device.transmit(&mut out, &mut self.board) {
                if !self.random.chance(self.loss)
                    && let Some(event) = self.host.receive(now, &out[..n], &mut self.io)
                {
                    return event;
                }
            }
        }
        panic!("no end");
    }

    fn frame(&mut self) -> Event {
        let begin = FrameBegin { raw_bits: 0, ..begin(4) };
        let shape = FrameShape { raw_bytes: RECEIPT_BYTES as u16, ..SHAPE };
        self.host.begin(begin, shape, false);
        self.run()
    }

    fn expected(&self) -> Vec<Vec<u8>> {
        expected_frame(camera_id(&self.io.frame.camera), 4)
    }
}

#[test]
fn rows_leave_once_in_order_and_the_host_has_their_receipts() {
    for seed in 0..40 {
        let mut setup = Setup::new(seed);
        setup.loss = 0.15;
        let Event::FrameDone(start) = setup.frame() else { panic!("seed {seed}: no frame") };
        let expected = setup.expected();
        let interface = &setup.board.interface;
        let begun = interface.begun.last().unwrap();
        assert_eq!(begun.1, RAW_BYTES as u16);
        assert_eq!(begun.0.transfer, start.transfer);
        let rows: Vec<_> = (0..ROWS).zip(expected.clone()).collect();
        assert!(interface.rows == rows, "seed {seed}");
        let receipts: Vec<_> = expected.iter().map(|row| crc32c(row).to_le_bytes()).collect();
        assert_eq!(setup.io.receipts[..], receipts, "seed {seed}");
    }
}

#[test]
fn a_corrupt_row_leaves_corrupt_and_a_dropped_frame_not_at_all() {
    let mut setup = Setup::new(1);
    for (register, value) in [(address::FAULT_ARGUMENT, 3), (address::FAULT, 2)] {
        setup.host.request(ToDevice::RegWrite(register, value));
        assert!(matches!(setup.run(), Event::Answer(_)));
    }
    assert!(matches!(setup.frame(), Event::FrameDone(_)));
    let mut expected = setup.expected();
    expected[3].iter_mut().for_each(|byte| *byte = !*byte);
    assert!(setup.board.interface.rows.iter().map(|(_, row)| row).eq(&expected));
    assert_eq!(setup.io.receipts[3], crc32c(&expected[3]).to_le_bytes());
    setup.host.request(ToDevice::RegWrite(address::FAULT, 1));
    assert!(matches!(setup.run(), Event::Answer(_)));
    assert!(matches!(setup.frame(), Event::FrameDropped(_)));
    assert_eq!(setup.board.interface.begun.last().unwrap().0.fault, Fault::DropFrame);
    assert!(setup.board.interface.rows.is_empty());
}

#[test]
fn a_device_without_an_interface_of_its_own_refuses() {
    let mut bench = Bench::new(camrig_rig_link::framing::Framing::Cobs, Limits::default(), 1);
    assert_eq!(bench.connect(), Event::Connected);
    assert_eq!(bench.send_camera(), Event::CameraReady);
    let begin = FrameBegin { raw_bits: 0, ..begin(1) };
    bench.host.begin(begin, FrameShape { raw_bytes: RECEIPT_BYTES as u16, ..SHAPE }, false);
    assert_eq!(bench.run(None), Some(Event::Refused(Nack::Refused(Refusal::Packing))));
}

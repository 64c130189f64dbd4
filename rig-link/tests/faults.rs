//! Every frame arrives right or is reported as failed, whatever the link does to its bytes.

mod common;

use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::{Event, Limits};
use camrig_rig_link::message::*;
use common::*;

fn limits() -> Limits {
    // Short packets: at a chance of 1 % per byte one of 100 bytes comes through every third time.
    let mut limits = Limits::default();
    limits.packet_bytes = 72;
    limits.credit = 8;
    limits.send_bytes = 120;
    limits.rows_ahead = 1;
    limits.timeout = 100_000;
    limits.idle_steps = 60;
    limits
}

/// Connects with patience: a Hello is as exposed to the faults as anything else.
fn establish(bench: &mut Bench) -> bool {
    bench.connect() == Event::Connected && bench.send_camera() == Event::CameraReady
}

#[test]
fn a_clean_link_needs_no_repairs() {
    for framing in [Framing::Cobs, Framing::Length, Framing::Report(64), Framing::Report(1024)] {
        let mut bench = Bench::new(framing, Limits::default(), 1);
        assert!(establish(&mut bench));
        for frame in 0..20 {
            assert!(matches!(bench.frame(frame, false), Event::FrameDone(_)), "{framing:?}");
            assert!(bench.is_right());
        }
        let s = bench.host.statistics();
        assert_eq!((s.damaged, s.rewinds, s.timeouts, s.torn_rows), (0, 0, 0, 0), "{framing:?}");
        let d = bench.device.statistics();
        assert_eq!((d.damaged, d.gaps, d.rows_in, d.rows_out), (0, 0, 240, 240), "{framing:?}");
    }
}

/// Found by fuzzing: a device that asks to go on at a place which the frame does not have would
/// have the host read beyond its rows.
#[test]
fn an_acknowledgement_from_outside_the_frame_is_no_place_to_go_back_to() {
    use camrig_rig_link::host::Poll;
    use camrig_rig_link::wire::*;
    for (row, unit) in [(ROWS, 1), (ROWS + 1, 0), (3, UNITS as u16), (u16::MAX, u16::MAX)] {
        let mut bench = Bench::new(Framing::Cobs, limits(), 1);
        assert!(establish(&mut bench));
        bench.begin(0, false);
        bench.run(Some(6));
        let mut out = [0; 2000];
        AckBody { transfer: 1, row, unit }.write(&mut out[HEADER_BYTES..]);
        // Numbers that the host takes: its own newest packet, and one that the device has not used
        // yet.
        let ack = bench.host.statistics().sent as u16;
        let header =
            Header { kind: Kind::Ack, flags: GAP, session: bench.session, seq: 1000, ack };
        let n = seal(&mut out, header, AckBody::BYTES);
        assert_eq!(bench.host.receive(bench.now, &out[..n], &mut bench.io), None);
        assert_eq!(bench.host.statistics().rewinds, 0, "{row} {unit}");
        let mut parts = 0;
        for _ in 0..1000 {
            match bench.host.poll(bench.now, &mut bench.io, &mut out) {
                Poll::Send(bytes) => {
                    let packet = Packet::parse(&out[..bytes]).unwrap();
                    if packet.header.kind == Kind::Part {
                        let (part, _) = PartHeader::split(packet.body).unwrap();
                        assert!(part.row < ROWS && usize::from(part.unit) < UNITS, "{part:?}");
                        parts += 1;
                    }
                }
                Poll::Wait(until) => bench.now = until,
                Poll::Done(_) => break,
            }
        }
        assert!(parts > 0);
    }
}

#[test]
fn thousands_of_frames_arrive_right_or_are_reported_as_failed() {
    for (framing, frames) in
        [(Framing::Cobs, 1600u32), (Framing::Report(64), 800), (Framing::Report(1024), 400)]
    {
        let mut bench = Bench::new(framing, limits(), 7);
        let (mut done, mut failed, mut open) = ([0; 4], [0; 4], false);
        for frame in 0..frames {
            // A quarter of the frames each at chances of 0, 1e-4, 1e-3 and 1e-2 per byte.
            let level = bench.random.below(4);
            let p = [0.0, 1e-4, 1e-3, 1e-2][level];
            let per_byte = if framing == Framing::Cobs { p } else { 3.0 * p };
            bench.set_faults(Faults { per_byte, per_write: p, per_burst: 0.0 });
            if !open {
                open = establish(&mut bench);
            }
            let event = if open { bench.frame(frame, false) } else { Event::NoAnswer };
            match event {
                Event::FrameDone(start) => {
                    assert!(bench.is_right(), "frame {frame} is wrong, {framing:?} at {p}");
                    assert_eq!(start.frame, frame);
                    done[level] += 1;
                }
                e => {
                    eprintln!(
                        "{frame} {p} {e:?} open {open} missing {}",
                        bench.host.missing(ROWS).count()
                    );
                    failed[level] += 1;
                    open = false;
                }
            }
        }
        eprintln!(
            "{framing:?}: done {done:?}, reported as failed {failed:?}, {:?}",
            bench.host.statistics()
        );
        // What repair is for: not one frame is lost below 1 % of bytes.
        assert_eq!(failed[..3], [0; 3], "{framing:?}");
        assert!(done[3] > 9 * failed[3], "{framing:?}: {done:?} {failed:?}");
    }
}

/// Bursts, faults in one direction alone, and a stream whose lengths are hit, after which only a
/// new connection helps.
#[test]
fn frames_are_right_or_reported_whatever_the_line_does() {
    let quiet = Faults::default();
    // Chances per byte, or per report.
    for (framing, per_byte, per_burst) in [
        (Framing::Cobs, 3e-3, 1e-4),
        (Framing::Report(64), 3e-2, 5e-3),
        (Framing::Length, 1e-4, 2e-5),
    ] {
        let scattered = Faults { per_byte, ..quiet };
        let bursts = Faults { per_burst, ..quiet };
        for (up, down) in [
            (bursts, bursts),
            (bursts, quiet),
            (quiet, bursts),
            (scattered, quiet),
            (quiet, scattered),
        ] {
            let mut bench = Bench::new(framing, limits(), 11);
            let (mut done, mut failed, mut open) = (0, 0, false);
            for frame in 0..200 {
                (bench.up.faults, bench.down.faults) = (up, down);
                open = open || establish(&mut bench);
                match if open { bench.frame(frame, false) } else { Event::NoAnswer } {
                    Event::FrameDone(start) => {
                        assert!(bench.is_right(), "{framing:?} {up:?} {down:?}: frame {frame}");
                        assert_eq!(start.frame, frame);
                        done += 1;
                    }
                    _ => {
                        bench.disconnect();
                        (failed, open) = (failed + 1, false);
                    }
                }
            }
            let s = bench.host.statistics();
            eprintln!("{framing:?}: {done} done, {failed} reported as failed, {s:?}");
            match framing {
                Framing::Length => assert!(done > 0 && failed > 0, "{done} {failed}"),
                _ => assert_eq!(failed, 0, "{framing:?} {up:?} {down:?}"),
            }
        }
    }
}

#[test]
fn a_frame_goes_on_after_the_cable_was_out() {
    let mut bench = Bench::new(Framing::Cobs, limits(), 3);
    assert!(establish(&mut bench));
    for frame in 0..200 {
        bench.begin(frame, false);
        let packets = bench.random.below(90) as u32;
        if bench.run(Some(packets)).is_some() {
            continue; // Over before the cable came out.
        }
        bench.disconnect();
        let missing = bench.host.missing(ROWS).count();
        let made = bench.device.statistics().rows_out;
        assert!(establish(&mut bench));
        assert!(matches!(bench.frame(frame, true), Event::FrameDone(_)));
        assert!(bench.is_right());
        // Only what was missing is made again, and the halo of each run of missing rows.
        let again = (bench.device.statistics().rows_out - made) as usize;
        assert!(again <= missing + 2, "{again} rows for {missing} missing");
    }
}

#[test]
fn a_host_that_dies_is_replaced_by_another() {
    let mut bench = Bench::new(Framing::Cobs, limits(), 4);
    assert!(establish(&mut bench));
    for frame in 0..200 {
        bench.begin(frame, false);
        let packets = bench.random.below(90) as u32;
        bench.run(Some(packets));
        // The new host knows nothing; bytes of the old one are still in flight.
        bench.host = camrig_rig_link::host::Host::new(limits(), [0; ROWS as usize]);
        assert!(establish(&mut bench));
        assert!(matches!(bench.frame(1000 + frame, false), Event::FrameDone(_)));
        assert!(bench.is_right());
    }
}

#[test]
fn a_device_that_was_switched_off_and_on_says_so() {
    let mut bench = Bench::new(Framing::Cobs, limits(), 5);
    assert!(establish(&mut bench));
    bench.begin(0, false);
    bench.run(Some(20));
    *bench.device = ToyDevice::new(600, 32);
    assert_eq!(bench.run(None), Some(Event::Refused(Nack::NoSession)));
    assert!(establish(&mut bench));
    assert!(matches!(bench.frame(0, true), Event::FrameDone(_)));
    assert!(bench.is_right());
}

#[test]
fn a_device_that_is_gone_is_reported() {
    let mut bench = Bench::new(Framing::Cobs, limits(), 6);
    bench.up.faults.per_byte = 1.0;
    assert_eq!(bench.connect(), Event::NoAnswer);
}

#[test]
fn an_older_device_is_named() {
    let mut bench = Bench::new(Framing::Cobs, limits(), 6);
    bench.device.set_versions(0, 0);
    assert_eq!(bench.connect(), Event::NoCommonVersion { oldest: 0, newest: 0 });
}

#[test]
fn faults_on_request_reach_the_isp_and_not_the_link() {
    use camrig_rig_link::registers::address;
    let mut bench = Bench::new(Framing::Cobs, limits(), 6);
    assert!(establish(&mut bench));
    let write = |bench: &mut Bench, address, value| {
        bench.host.request(ToDevice::RegWrite(address, value));
        assert_eq!(bench.run(None), Some(Event::Answer(ToHost::Register(address, value))));
    };
    write(&mut bench, address::FAULT, 1);
    assert!(matches!(bench.frame(0, false), Event::FrameDropped(_)));
    write(&mut bench, address::FAULT_ARGUMENT, 3);
    write(&mut bench, address::FAULT, 2);
    assert!(matches!(bench.frame(1, false), Event::FrameDone(_)));
    let right = expected_frame(camera_id(&bench.io.camera), 1);
    for (row, (got, right)) in bench.io.raw.iter().zip(&right).enumerate() {
        let inverted: Vec<u8> = right.iter().map(|b| !b).collect();
        assert_eq!(got, if row == 3 { &inverted } else { right });
    }
    write(&mut bench, address::FAULT, 3);
    let Event::FrameDone(a) = bench.frame(2, false) else { panic!() };
    let Event::FrameDone(b) = bench.frame(3, false) else { panic!() };
    assert_eq!((a.counter, b.counter, b.fault), (2, 2, Fault::StuckCounter));
    bench.host.request(ToDevice::RegRead(0x7777));
    assert_eq!(bench.run(None), Some(Event::Refused(Nack::Register(0x7777))));
}

#[test]
fn a_refused_frame_says_why() {
    let mut bench = Bench::new(Framing::Cobs, limits(), 6);
    assert_eq!(bench.connect(), Event::Connected);
    let refused = |refusal| Event::Refused(Nack::Refused(refusal));
    assert_eq!(bench.frame(0, false), refused(Refusal::NoCamera));
    assert_eq!(bench.send_camera(), Event::CameraReady);
    bench.host.begin(FrameBegin { width: 4000, ..begin(0) }, SHAPE, false);
    assert_eq!(bench.run(None), Some(refused(Refusal::TooWide { max: WIDTH as u16 })));
    bench.io.camera = vec![0; 1001];
    assert_eq!(bench.send_camera(), refused(Refusal::CameraTooLong { max: 1000 }));
}

//! Error texts say what is wrong, with its figures, and what to do.

use camrig_rig_link::framing::OutOfStep;
use camrig_rig_link::host::Event;
use camrig_rig_link::message::{Nack, Refusal};
use camrig_rig_link::packing::{Packing, pack_row};
use camrig_rig_link::wire::{Packet, Reject};

#[test]
fn refusals_name_the_limit_and_a_remedy() {
    let refusals = [
        (Refusal::NoCamera, "send one"),
        (Refusal::BadCamera, "Capabilities::effects"),
        (Refusal::CameraTooLong { max: 4321 }, "4321 bytes"),
        (Refusal::Effects, "leave out"),
        (Refusal::TooWide { max: 2048 }, "2048 pixels"),
        (Refusal::TooManyBands { max: 31 }, "31 that the device takes"),
        (Refusal::WrongShape, "camera in force"),
        (Refusal::Arithmetic, "Capabilities::arithmetics"),
        (Refusal::Codec, "Capabilities::codecs"),
        (Refusal::Packing, "8, 10, 12, 14 or 16"),
        (Refusal::Exposure, "positive finite"),
    ];
    let documented = include_str!("../src/message.rs").split("pub use").next().unwrap();
    for (refusal, part) in refusals {
        assert!(documented.contains(&format!("`{}`", refusal.code())), "{}", refusal.code());
        let text = refusal.to_string();
        assert!(text.contains(part), "{text}");
        assert_eq!(Event::Refused(Nack::Refused(refusal)).to_string(), text);
    }
}

#[test]
fn other_errors_say_what_and_where() {
    assert_eq!(
        pack_row(Packing::Raw10, &[0; 5], &mut [0; 9]).unwrap_err().to_string(),
        "the buffer of the packed row has 9 bytes, the row needs 10 (Packing::row_bytes)"
    );
    assert!(Packet::parse(&[]).unwrap_err().to_string().contains("CRC-32C"));
    let unknown = Reject::UnknownKind { kind: 99, session: 7, seq: 1 }.to_string();
    assert!(unknown.contains("packet kind 99 in session 7"), "{unknown}");
    assert!(OutOfStep.to_string().contains("same framing"));
    assert!(Nack::Register(0x7777).to_string().contains("register 0x7777"));
    assert!(Nack::NoTransfer(12).to_string().contains("transfer 12"));
}

#[test]
fn the_end_that_is_too_old_is_named() {
    let said = |oldest, newest| Event::NoCommonVersion { oldest, newest }.to_string();
    assert!(said(0, 0).ends_with("update the device's firmware"), "{}", said(0, 0));
    assert!(said(2, 3).ends_with("update the host"), "{}", said(2, 3));
}

//! `camrig rig view`: a live page of a rig.

use super::arguments::{arithmetic, broken_link, duration, positive};
use super::scene_lights::{NextLight, SceneLights};
use super::simulate::ViewArgs;
use crate::view::{Control, State, Told, View};
use camrig_base::{ErrorKind, Result};
use camrig_render::{self as render, Arithmetic, SimulatedSensor};
use camrig_rig::script::Write;
use camrig_rig::stage::{changing_light, remembering};
use camrig_rig::{FrameRequest, Rig};
use std::io::Write as _;
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// Show a rig's frames live on a page of this machine: picture, histogram, profiles, noise map,
/// sliders
///
/// Prints the address of the page; it goes on until it is interrupted. The page needs the token in
/// that address, and pages of other origins are turned away.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig rig view emulator: --camera mt9v024 --scene colorchecker\n  \
    camrig rig view tcp://127.0.0.1:7420 --camera mt9v024 --scene dots --exposure 5ms --fps 10")]
pub struct Args {
    /// Address of the rig
    url: String,
    #[command(flatten)]
    view: ViewArgs,
    /// Integration time at the start
    #[arg(
        long,
        value_parser = duration,
        allow_hyphen_values = true,
        value_name = "TIME",
        default_value = "10ms"
    )]
    exposure: f64,
    /// Analog gain at the start
    #[arg(long, value_parser = positive, value_name = "G", default_value_t = 1.0)]
    gain: f64,
    /// At most this many frames per second
    #[arg(long, value_parser = positive, value_name = "F", default_value_t = 15.0)]
    fps: f64,
    /// Arithmetic of the rig's sensor stage
    #[arg(long, value_parser = arithmetic(), default_value_t)]
    arith: Arithmetic,
    /// End after this many frames
    #[arg(long, value_name = "N")]
    frames: Option<u32>,
    /// Where the page is served
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:0")]
    listen: String,
    /// Serve the page where other machines reach it: who has its token sees the frames and moves
    /// the sliders, and the token goes over the network unencrypted
    #[arg(long)]
    allow_remote: bool,
}

/// What the page asked since the last frame, the last word of each.
fn asked(controls: &mpsc::Receiver<Control>) -> impl Iterator<Item = Write> {
    let later = |a: Control, b: Control| Control {
        exposure_s: b.exposure_s.or(a.exposure_s),
        analog_gain: b.analog_gain.or(a.analog_gain),
    };
    let Control { exposure_s, analog_gain } = controls.try_iter().fold(Control::default(), later);
    [exposure_s.map(Write::Exposure), analog_gain.map(Write::Gain)].into_iter().flatten()
}

/// Writes what the page asked; what the rig cannot do the page is told, and the stream goes on as
/// it was.
fn apply(writes: impl Iterator<Item = Write>, rig: &mut Rig, state: &Mutex<State>) -> Result<()> {
    let mut refused = Vec::new();
    let mut writes = writes.peekable();
    if writes.peek().is_none() {
        return Ok(());
    }
    for write in writes {
        match write.apply(rig) {
            Ok(()) => {}
            Err(e) if matches!(e.kind(), ErrorKind::Limit | ErrorKind::Input) => {
                refused.push(e.what().to_string());
            }
            Err(e) => return Err(e),
        }
    }
    let refused = (!refused.is_empty()).then(|| refused.join("; "));
    state.lock().unwrap_or_else(PoisonError::into_inner).refused = refused;
    Ok(())
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let opens = "see and drive the rig with this page's token, which the network carries in clear";
    super::rig::remote(&args.listen, args.allow_remote, opens)?;
    let page = View::listen(&args.listen)?;
    let mut rig = Rig::open(&args.url)?;
    rig.on_broken_link(broken_link);
    let camera = args.view.camera.load()?;
    let (mut lights, view) = SceneLights::open(&args.view, &camera, Some(args.fps))?;
    let sensor = SimulatedSensor::new(&camera, &view.cube.header, 1.0)?;
    rig.set_camera(&sensor)?;
    Write::Exposure(args.exposure).apply(&mut rig)?;
    Write::Gain(args.gain).apply(&mut rig)?;

    let settings = camera.settings(0, args.exposure, Some(args.gain));
    let header = &view.cube.header;
    let info = render::frame_info(&camera, &settings, view.light.as_ref(), header, false)?;
    let state = Arc::new(Mutex::new(State::new(info)));
    let (sender, controls) = mpsc::channel();
    // The address is data: scripts wait for it.
    println!("{}", page.url());
    let _ = std::io::stdout().flush();
    page.serve(state.clone(), sender);

    let locked = || state.lock().unwrap_or_else(PoisonError::into_inner);
    if let (false, Some(effect)) = (lights.stand_still(), remembering(&sensor).next()) {
        return Err(changing_light(effect));
    }
    let mut last = Instant::now();
    let mut cube = view.cube;
    let mut taken = 0;
    for number in 0..args.frames.unwrap_or(u32::MAX) {
        let light = if number > 0 { lights.next(number) } else { Ok(NextLight::Same) };
        match light.inspect_err(|error| locked().ended = Some(error.to_string()))? {
            NextLight::Same => {}
            NextLight::Changed(next) => cube = next,
            NextLight::Over => {
                locked().ended = Some("the scene has ended".into());
                break;
            }
        }
        apply(asked(&controls), &mut rig, &state)?;
        let request = FrameRequest {
            settings: camera.settings(number, args.exposure, Some(args.gain)),
            arithmetic: args.arith,
            collapse: false,
            lit_before: number > 0 && lights.stand_still(),
            by_registers: true,
            rows_stay: false,
        };
        let frame = rig.frame(&cube, &sensor, &request).inspect_err(|error| {
            locked().ended = Some(error.to_string());
        })?;
        let due = last + Duration::from_secs_f64(1.0 / args.fps);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let told = Told {
            counter: frame.start.counter,
            exposure_s: f64::from(frame.start.exposure.exposure_s),
            analog_gain: f64::from(frame.start.exposure.analog_gain),
            period_s: last.elapsed().as_secs_f64(),
        };
        last = Instant::now();
        if frame.dropped {
            locked().dropped += 1;
        } else {
            let raw = frame.to_raw(&sensor)?;
            let mut state = locked();
            state.injected = frame.injected();
            state.push(raw, told);
        }
        taken += 1;
    }
    lights.tell_end(taken, args.frames);
    Ok(())
}

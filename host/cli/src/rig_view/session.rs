//! The stream behind the page, which carries out the page's orders between frames.

use super::automatic::Automatic;
use super::beat::Beat;
use super::light::{Lit, Ready, Workshop};
use super::recorder::Recorder;
use super::scene::Scene;
use super::{Args, registers};
use crate::arguments::broken_link;
use crate::notes::Notes;
use crate::rig_frames::KEPT_BYTES;
use crate::rig_stream::pace;
use crate::stop::Stoppable;
use crate::view::{Frame, Order, Register, Shared, State, Status, Timing};
use camrig_base::{Error, ErrorKind, Result};
use camrig_camera::Camera;
use camrig_rig::feed::Feed;
use camrig_rig::remembering::remembering;
use camrig_rig::script::{Write, exposure_cut};
use camrig_rig::{FrameRequest, Rig, RigFrame};
use camrig_rig_link::message::Codec;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

/// Wait before a rig that does not answer is opened again.
const RETRY: Duration = Duration::from_secs(1);
/// Polling interval for the first light of a scene.
const LOOK: Duration = Duration::from_millis(10);

/// The stream and what controls it.
pub struct Session<'a> {
    args: &'a Args,
    camera: &'a Camera,
    shared: &'a Arc<Shared>,
    orders: &'a mpsc::Receiver<Order>,
    stop: &'a Stoppable,
    beat: Beat,
    automatic: Automatic,
    workshop: Workshop,
    recorder: Recorder<'a>,
    start: Instant,
    /// When the newest frame began.
    begun: Option<Instant>,
    /// Frames begun.
    frames: u32,
    /// Whether the previous frame had the same light.
    lit_before: bool,
    /// Its exposure, s.
    exposure_s: Option<f32>,
    /// A changing scene.
    scene: Option<Scene>,
    /// Notes about scenes chosen on the page.
    told: Notes,
}

/// Why a run of frames ends.
enum Next {
    /// There are enough, or a signal asks to stop.
    End,
    /// They continue in another light.
    In(Box<Lit>),
}

impl<'a> Session<'a> {
    /// A stream before its first frame; the notes `told` have been printed already.
    ///
    /// # Errors
    /// A graphics processor that is asked for and missing.
    pub fn new(
        args: &'a Args,
        camera: &'a Camera,
        shared: &'a Arc<Shared>,
        orders: &'a mpsc::Receiver<Order>,
        stop: &'a Stoppable,
        scene: Option<Scene>,
        told: Vec<String>,
    ) -> Result<Self> {
        Ok(Self {
            args,
            camera,
            shared,
            orders,
            stop,
            beat: Beat::new(args.fps),
            automatic: Automatic::default(),
            workshop: Workshop::new(camera.clone(), args.view.optics_stage()?, &shared.lock()),
            recorder: Recorder::new(args, camera, shared),
            start: Instant::now(),
            begun: None,
            frames: 0,
            lit_before: false,
            exposure_s: None,
            scene,
            told: Notes::on_page(shared.clone()).after(told),
        })
    }

    /// Writes exposure and gain to a rig that was just opened, and reports what an earlier host
    /// left in its registers.
    ///
    /// # Errors
    /// Settings that the rig cannot take, a link that fails.
    pub fn begin(&mut self, rig: &mut Rig) -> Result<()> {
        let shared = self.shared.clone();
        rig.on_broken_link(move |error| {
            broken_link(error);
            shared.change(|state| {
                state.status = Status::Reconnecting;
                state.fault("link", error);
            });
        });
        self.program(rig)?;
        if let Some(held) = rig.injected()? {
            self.note("rig", format!("its registers hold {held}, which its frames show"));
        }
        self.beat.restart();
        Ok(())
    }

    /// Writes the latest exposure and gain, and the line times that the scene needs.
    fn program(&mut self, rig: &mut Rig) -> Result<()> {
        if let Some(scene) = &mut self.scene {
            scene.program(rig)?;
        }
        let (exposure_s, gain) = {
            let settings = &self.shared.lock().settings;
            (settings.exposure_s, settings.analog_gain)
        };
        Write::Exposure(exposure_s).apply(rig)?;
        Write::Gain(gain).apply(rig)
    }

    /// Streams until a signal, or enough frames. A rig that fails is reopened.
    ///
    /// # Errors
    /// A recording that cannot be finished.
    pub fn run(mut self, mut rig: Rig, mut lit: Lit) -> Result<()> {
        loop {
            match self.stream(&mut rig, &lit) {
                Ok(Next::End) => break,
                Ok(Next::In(other)) => lit = *other,
                Err(error) => match self.reconnect(error) {
                    Some(opened) => rig = opened,
                    None => break,
                },
            }
        }
        if let Some(scene) = self.scene.take() {
            scene.finish(self.frames);
        }
        self.recorder.finish()
    }

    /// Streams frames in one light.
    fn stream(&mut self, rig: &mut Rig, lit: &Lit) -> Result<Next> {
        let collapse =
            !self.args.spectral && rig.device().codecs >> (Codec::Electrons16 as u8) & 1 == 1;
        let cube = lit.cube();
        let feed =
            if collapse { Feed::collapsed(cube, &lit.sensor) } else { Feed::spectral(cube) };
        let mut feed = if feed.bytes() <= KEPT_BYTES { feed.kept() } else { feed };
        rig.set_camera(&lit.sensor)?;
        loop {
            if let Some(other) = self.ask(rig, lit)? {
                return Ok(Next::In(Box::new(other)));
            }
            self.beat.wait(rig, self.stop);
            if self.stop.is_asked() || Some(self.frames) == self.args.frames {
                return Ok(Next::End);
            }
            if let Some(other) = self.change(rig, lit)? {
                return Ok(Next::In(Box::new(other)));
            }
            if self.scene.as_ref().is_some_and(Scene::is_dark) {
                pace::wait_until(Instant::now() + LOOK, rig, self.stop);
                continue;
            }
            let late = self.beat.begin(Instant::now());
            let mut settings = self.camera.settings(self.frames, 1.0, None);
            settings.previous_exposure_s = self.exposure_s;
            let request = FrameRequest {
                arithmetic: self.args.arith,
                collapse,
                lit_before: self.lit_before,
                by_registers: true,
                ..FrameRequest::new(settings)
            };
            let timing = self.timing(late);
            let frame = rig.frame_from(&mut feed, &lit.sensor, &request)?;
            self.lit_before = true;
            self.exposure_s = Some(frame.start.exposure.exposure_s);
            self.take(rig, frame, lit, timing)?;
        }
    }

    /// Asks for the light of the next frame. If its rows are lit for an exposure, pending orders
    /// are carried out first; returns another light if they ask for one.
    fn ask(&mut self, rig: &mut Rig, lit: &Lit) -> Result<Option<Lit>> {
        if self.scene.as_ref().is_some_and(Scene::looks)
            && let Some(other) = self.obey(rig, lit)?
        {
            return Ok(Some(other));
        }
        self.scene.as_mut().map_or(Ok(()), |scene| scene.ask(rig))?;
        Ok(None)
    }

    /// The light of the frame that begins now, if it differs from the previous one: because the
    /// scene changed, or by an order.
    fn change(&mut self, rig: &mut Rig, lit: &Lit) -> Result<Option<Lit>> {
        if !self.scene.as_ref().is_some_and(Scene::has_looked)
            && let Some(other) = self.obey(rig, lit)?
        {
            return Ok(Some(other));
        }
        let cube = self.scene.as_mut().and_then(|scene| scene.light(self.shared));
        self.lit_before &= cube.is_none();
        Ok(cube.map(|cube| lit.later(cube)))
    }

    /// The times of a frame that begins now.
    fn timing(&mut self, late: bool) -> Timing {
        let now = Instant::now();
        let period = self.begun.replace(now).map_or(Duration::ZERO, |before| now - before);
        self.frames += 1;
        Timing {
            frame: self.frames.into(),
            at_s: (now - self.start).as_secs_f64(),
            period_ms: 1e3 * period.as_secs_f64(),
            late,
        }
    }

    /// Passes a frame to the pages, the recording and the automatic exposure.
    fn take(&mut self, rig: &mut Rig, frame: RigFrame, lit: &Lit, timing: Timing) -> Result<()> {
        self.recorder.take(&frame, &lit.sensor, timing.at_s);
        let raw = (!frame.dropped).then(|| frame.to_raw(&lit.sensor)).transpose()?;
        let exposure = frame.start.exposure;
        let missed = self.scene.as_mut().and_then(|scene| scene.taken(exposure.exposure_s));
        if let Some(missed) = missed {
            self.note("scene", missed);
        }
        if let Some(restored) = &frame.restored {
            self.note("rig", format!("it restarted with other registers; restored: {restored}"));
        }
        let wanted =
            raw.as_ref().and_then(|raw| self.automatic.next(raw, f64::from(exposure.exposure_s)));
        let mut settings = self.camera.settings(frame.start.frame, 1.0, None);
        (settings.exposure_s, settings.analog_gain) = (exposure.exposure_s, exposure.analog_gain);
        let frame = raw.map(|raw| Frame {
            number: timing.frame,
            raw,
            settings,
            counter: frame.start.counter,
            injected: frame.injected(),
            light: lit.light.clone(),
        });
        let before = self.shared.change(|state| {
            state.count(timing);
            match frame {
                Some(frame) => state.newest = Some(Arc::new(frame)),
                None => state.dropped += 1,
            }
            std::mem::replace(&mut state.status, Status::Streaming)
        });
        if before == Status::Reconnecting {
            // It may be another rig, or have lost power.
            self.program(rig)?;
            self.note("link", "the rig is back; exposure and gain were restored");
        }
        match wanted {
            Some(exposure_s) if !self.write(rig, Write::Exposure(exposure_s))? => {
                self.switch_automatic(false);
                self.note("rig", "automatic exposure is off: the rig cannot follow the light");
                Ok(())
            }
            Some(exposure_s) => {
                self.shared.change(|state| state.settings.exposure_s = exposure_s);
                Ok(())
            }
            None => Ok(()),
        }
    }

    /// Carries out the page's orders; returns the new light, if it changes.
    fn obey(&mut self, rig: &mut Rig, lit: &Lit) -> Result<Option<Lit>> {
        let mut other = None;
        let orders = self.orders;
        for order in orders.try_iter() {
            if let Order::Lux(lux) = order {
                let now = other.as_ref().unwrap_or(lit);
                match now.at(self.camera, lux) {
                    Ok(dimmed) => other = Some(dimmed),
                    Err(error) => self.fault("optics", error),
                }
            } else {
                self.carry_out(order, rig)?;
            }
        }
        match self.workshop.ready(self.shared) {
            Some(Ok(ready)) => {
                let lux = other.as_ref().unwrap_or(lit).light.header.lux;
                match self.lit(ready, lux) {
                    Ok(fresh) => other = Some(fresh),
                    Err(error) => self.fault("optics", error),
                }
            }
            Some(Err(error)) => self.fault("optics", error),
            None => {}
        }
        if let Some(other) = &other {
            self.lit_before = false;
            self.tell_light(other);
        }
        Ok(other)
    }

    /// A finished scene, at the previous light level if both have one.
    fn lit(&mut self, ready: Ready, lux: Option<f64>) -> Result<Lit> {
        let Ready { wanted, view } = ready;
        self.told.tell(view.notes.iter().cloned());
        let fresh = Lit::new(self.camera, view)?;
        let fresh = match lux {
            Some(lux) if fresh.light.header.lux.is_some() => fresh.at(self.camera, lux)?,
            _ => fresh,
        };
        self.shared.change(|state| state.settings.scene = wanted.scene);
        Ok(fresh)
    }

    fn tell_light(&self, lit: &Lit) {
        self.shared.change(|state| {
            let scene = state.settings.scene.clone();
            lit.tell(&scene, &mut state.settings);
        });
        let effects: Vec<_> = remembering(&lit.sensor).collect();
        if !effects.is_empty() {
            let effects = effects.join(", ");
            let said = "the light changed: the next frame is computed as after a dark one";
            self.note("rig", format!("{said} ({effects})"));
        }
    }

    fn carry_out(&mut self, order: Order, rig: &mut Rig) -> Result<()> {
        match order {
            Order::ExposureS(exposure_s) => {
                self.switch_automatic(false);
                if self.write(rig, Write::Exposure(exposure_s))? {
                    self.shared.change(|state| state.settings.exposure_s = exposure_s);
                }
            }
            Order::AnalogGain(gain) => {
                if self.write(rig, Write::Gain(gain))? {
                    self.shared.change(|state| state.settings.analog_gain = gain);
                }
            }
            Order::AutoExposure(on) => self.switch_automatic(on),
            Order::Scene(name) => {
                if let Err(error) = self.workshop.want_scene(name) {
                    self.fault("optics", error);
                }
            }
            Order::Illuminant(name) => {
                if let Err(error) = self.workshop.want_light(name) {
                    self.fault("optics", error);
                }
            }
            Order::Registers => drop(self.read_registers(rig)?),
            Order::Register { address, value } => {
                let taken = self.write(rig, Write::Register(address, value))?;
                let found = self.read_registers(rig)?;
                if taken {
                    self.adopt(&found);
                    self.note("rig", format!("register {address:#06x} = {value}"));
                    if let Some(cut) = exposure_cut(rig)? {
                        self.note("rig", cut);
                    }
                }
            }
            Order::Record(true) => self.recorder.begin(),
            Order::Record(false) => self.recorder.end(),
            Order::Lux(_) => {} // Changes the light, see `obey`.
        }
        Ok(())
    }

    fn switch_automatic(&mut self, on: bool) {
        self.automatic.switch(on);
        self.shared.change(|state| state.settings.auto_exposure = on);
    }

    /// Writes to the rig; false if the rig refuses, which the page reports.
    fn write(&self, rig: &mut Rig, write: Write) -> Result<bool> {
        match write.apply(rig) {
            Ok(()) => Ok(true),
            Err(e) if matches!(e.kind(), ErrorKind::Limit | ErrorKind::Input) => {
                self.fault("rig", e);
                Ok(false)
            }
            Err(e) => Err(e),
        }
    }

    /// Updates the settings from the registers, after one was written.
    fn adopt(&self, found: &[Register]) {
        if let Some((exposure_s, gain)) = registers::settings(found) {
            self.shared.change(|state| {
                (state.settings.exposure_s, state.settings.analog_gain) = (exposure_s, gain);
            });
        }
    }

    fn read_registers(&self, rig: &mut Rig) -> Result<Vec<Register>> {
        let found = registers::read(rig)?;
        self.shared.change(|state| state.registers.clone_from(&found));
        Ok(found)
    }

    /// Reopens the rig after a fault, trying until it works; `None` if a signal asks to stop.
    fn reconnect(&mut self, error: Error) -> Option<Rig> {
        self.shared.change(|state| {
            state.status = Status::Reconnecting;
            state.fault("link", &error);
        });
        self.lit_before = false;
        loop {
            self.stop.sleep_until(Instant::now() + RETRY);
            if self.stop.is_asked() {
                return None;
            }
            let opened = Rig::open(&self.args.url).and_then(|mut rig| {
                self.begin(&mut rig)?;
                Ok(rig)
            });
            match opened {
                Ok(rig) => return Some(rig),
                Err(error) => self.fault("link", error),
            }
        }
    }

    fn note(&self, source: &'static str, text: impl Into<String>) {
        self.shared.change(|state: &mut State| state.note(source, text));
    }

    fn fault(&self, source: &'static str, error: Error) {
        self.shared.change(|state| state.fault(source, &error));
    }
}

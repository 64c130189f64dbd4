//! `camrig rig view`: the console, a live page of a rig.

mod automatic;
mod beat;
mod files;
mod light;
mod recorder;
mod registers;
mod scene;
mod session;

use super::arguments::{arithmetic, duration, gain, positive};
use super::notes::{Notes, Page};
use super::scene_lights::SceneLights;
use super::times::TimeArgs;
use super::view_args::ViewArgs;
use crate::stop::Stoppable;
use crate::view::{Desk, Frame, Order, Shared, View};
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_render::Arithmetic;
use camrig_rig::Rig;
use camrig_rig::remembering::remembering;
use camrig_rig::stage::changing_light;
use light::Lit;
use scene::Scene;
use session::Session;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::{Arc, mpsc};

/// Show a rig's frames live in the browser, and control the rig from there
///
/// Picture with clipping and pixel values, profile, histogram, noise, frame timing; exposure, gain,
/// light, scene and registers; saving and recording of frames. Prints the address of the page, runs
/// until it is interrupted, and reopens a broken link. The address contains a token that keeps
/// other web pages out.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig rig view emulator: --camera mt9v024 --scene colorchecker\n  \
    camrig rig view tcp://127.0.0.1:7420 --camera mt9v024 --scene dots --exposure 5ms --fps 10\n  \
    camrig rig view emulator: --camera mt9v024 --scene tcp://127.0.0.1:7500 --fps 10\n  \
    camrig rig view emulator: --camera mt9v024 --set sensor.timing.line_time_us=20 \\\n    \
        --scene ramp --lamp mains:hz=100,depth=0.3")]
pub struct Args {
    /// Address of the rig
    url: String,
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    time: TimeArgs,
    /// Exposure time at the start
    #[arg(
        long,
        value_parser = duration,
        allow_hyphen_values = true,
        value_name = "TIME",
        default_value = "10ms"
    )]
    exposure: f64,
    /// Analog gain at the start
    #[arg(long, value_parser = gain, value_name = "G", default_value_t = 1.0)]
    gain: f64,
    /// Maximum frame rate, frames/s
    #[arg(long, value_parser = positive, value_name = "F", default_value_t = 25.0)]
    fps: f64,
    /// Arithmetic of the rig's sensor stage
    #[arg(long, value_parser = arithmetic(), default_value_t)]
    arith: Arithmetic,
    /// Send all spectral bands instead of mean electrons: the same frames as `rig stream` without
    /// --collapse, for some thirty times the bytes on the link
    #[arg(long)]
    spectral: bool,
    /// End after this many frames
    #[arg(long, value_name = "N")]
    frames: Option<u32>,
    /// Folder for saved frames and recordings; existing files are never replaced
    #[arg(short, long, value_name = "FOLDER", default_value = ".")]
    output: PathBuf,
    /// Format of recordings
    #[arg(long, value_name = "FORMAT", value_parser = ["mcap", "csi2"], default_value = "mcap")]
    to: String,
    /// Address of the page
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:0")]
    listen: String,
    /// Allow an address that other machines can reach: anyone with the token can see the frames and
    /// control the rig, and the token crosses the network unencrypted
    #[arg(long)]
    allow_remote: bool,
}

/// Orders that may be pending. A trade-off: more than a person gives within a frame, yet a stalled
/// stream is soon reported on the page.
const WAITING_ORDERS: usize = 64;

/// Passes orders from the page to the stream, and saves frames without holding it up.
struct FrontDesk {
    orders: mpsc::SyncSender<Order>,
    camera: Camera,
    folder: PathBuf,
}

impl Desk for FrontDesk {
    fn order(&self, order: Order) -> Result<()> {
        self.orders
            .try_send(order)
            .map_err(|_| Error::device("the stream has stalled and takes no orders"))
    }

    fn save(&self, frame: &Frame) -> Result<String> {
        Ok(files::save(frame, &self.camera, &self.folder)?.display().to_string())
    }
}

impl Page for Arc<Shared> {
    fn note(&self, text: &str) {
        self.change(|state| state.note_again("scene", text));
    }

    fn waits_for(&self, what: String) {
        self.change(|state| state.busy = Some(what));
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let opens =
        "see and control the rig with this page's token, which crosses the network unencrypted";
    super::listen::remote(&args.listen, args.allow_remote, opens)?;
    if !args.output.is_dir() {
        return Err(Error::input("folder not found")
            .at(args.output.display())
            .help("create it, or choose another for saved frames and recordings"));
    }
    let page = View::listen(&args.listen)?;
    let mut rig = Rig::open(&args.url)?;
    let camera = args.view.camera.load()?;
    let changes = args.view.motion.is_some()
        || args.time.is_given()
        || args.view.sequence.is_sequence(&args.view.scene)?;
    // A still scene has no times, and its page may use any frame rate.
    let times = if changes { args.time.times(&camera, Some(args.fps))? } else { None };
    let (source, settings) = light::description(args, &camera)?;
    let shared = Arc::new(Shared::new(source, settings));
    let (sender, orders) = mpsc::sync_channel(WAITING_ORDERS);
    // The address goes to standard output: scripts wait for it. The page shows what is pending.
    println!("{}", page.url());
    let _ = std::io::stdout().flush();
    let folder = args.output.clone();
    page.serve(shared.clone(), FrontDesk { orders: sender, camera: camera.clone(), folder });
    let told = Notes::on_page(shared.clone());
    let (lights, view) = SceneLights::open(&args.view, &camera, Some(args.fps), times, told)?;
    let lit = Lit::new(&camera, view)?;
    if let (false, Some(effect)) = (lights.stand_still(), remembering(&lit.sensor).next()) {
        return Err(changing_light(effect));
    }
    light::tell_first(&shared, &lit, lights.stand_still());
    let stop = Stoppable::new();
    let told = lights.notes().to_vec();
    let scene = Scene::new(lights, lit.first(), &shared);
    let mut session = Session::new(args, &camera, &shared, &orders, &stop, scene, told)?;
    session.begin(&mut rig)?;
    session.run(rig, lit)
}

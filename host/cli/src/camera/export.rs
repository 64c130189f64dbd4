//! `camrig camera export`: the noise of a camera in the form of another program, and what that form
//! cannot hold.

use crate::arguments::{ChangeArgs, positive};
use camrig_base::Result;
use camrig_base::output::write_file;
use camrig_camera::draft::{Draft, Request};
use camrig_camera::{Camera, Change};
use camrig_fit::exchange::{self, Beside, Profile};
use camrig_render::noise_profile;
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Write the noise of a camera in the form of another program, and say what that cannot hold
#[derive(clap::Args, Debug)]
#[command(
    after_help = "`camrig camera new --noise FILE` reads the same forms. What is written is \
    read again, and what\n\
    comes back otherwise, or not at all, is a note. Examples:\n  \
    camrig camera export imx477 --as profile -o imx477.csv\n  \
    camrig camera export ./mine.toml --as pmn --gain 16 -o mine.json"
)]
pub struct ExportArgs {
    /// Camera file or preset
    camera: String,
    #[command(flatten)]
    changes: ChangeArgs,
    /// profile: S and O of a DNG NoiseProfile, Noise Flow's two betas (CSV); darktable: the same as
    /// its noise profiles, of raw frames (JSON); pmn: lines of read noise over the system gain, of
    /// ELD and PMN (JSON); libcamera: rpi.noise, rpi.black_level and rpi.alsc
    #[arg(long = "as", value_name = "FORM")]
    form: Form,
    /// Largest gain; profiles are those of 1, 2, 4, ... up to it
    #[arg(long, value_name = "G", default_value_t = 16.0, value_parser = positive)]
    gain: f64,
    /// Output
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Print one JSON object on standard output: what the form cannot hold
    #[arg(long)]
    json: bool,
    /// Replace an existing file
    #[arg(long)]
    force: bool,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum Form {
    Profile,
    Darktable,
    Pmn,
    Libcamera,
}

/// Part by which a figure may come back otherwise without a note: less is seen in no picture.
const MAX_OFF: f64 = 0.005;
/// Gains at which what comes back is compared, beside those of a table.
const PLACES: usize = 17;
/// Figures of a camera that no form holds at each gain.
const CONSTANT: [&str; 6] = [
    "sensor.black_level_dn",
    "sensor.noise.prnu",
    "sensor.noise.dark_current_e_per_s",
    "sensor.noise.dsnu_e_per_s",
    "sensor.noise.row_fpn_e",
    "sensor.noise.read_e",
];

/// Runs the command.
pub fn run(args: &ExportArgs) -> Result<ExitCode> {
    let camera = args.changes.load(&args.camera)?;
    let sensor = &camera.sensor;
    let profile = |gain: f64| {
        let (shot, offset) = noise_profile(&camera, gain)[0];
        let black_level_dn = sensor.at_gain(gain).black_level_dn;
        let white_level_dn = f64::from((1u32 << sensor.bits) - 1);
        Profile { gain, shot, offset, black_level_dn, white_level_dn }
    };
    let most = args.gain.max(1.0);
    let gains = std::iter::successors(Some(1.0), |g| Some(2.0 * g)).take_while(|g| *g <= most);
    let profiles: Vec<Profile> = gains.map(profile).collect();
    let text = match args.form {
        Form::Profile => exchange::to_table(&profiles),
        Form::Darktable => format!("{:#}\n", exchange::to_darktable(&profiles, &camera.name)),
        Form::Pmn => format!("{:#}\n", exchange::to_lines(&camera, args.gain)?),
        Form::Libcamera => format!("{:#}\n", exchange::to_tuning(&camera)),
    };
    let lost = Lost::of(&camera, &text, most)?;
    write_file(&args.output, args.force, text.as_bytes())?;
    lost.lines().iter().for_each(|line| eprintln!("note: {line}"));
    if args.json {
        let object = json!({
            "output": args.output, "differs": lost.json(), "left_out": lost.left_out,
        });
        println!("{object}");
    }
    Ok(ExitCode::SUCCESS)
}

/// A figure of the camera at a gain, and what comes back of it.
struct Figure {
    name: &'static str,
    unit: &'static str,
    gain: f64,
    camera: f64,
    form: f64,
}

impl Figure {
    fn off(&self) -> f64 {
        (self.form - self.camera).abs() / self.camera.abs().max(f64::MIN_POSITIVE)
    }
}

/// What a form cannot hold.
struct Lost {
    /// The worst of each figure that comes back otherwise.
    differs: Vec<Figure>,
    /// Keys and effects of which nothing comes back.
    left_out: Vec<String>,
}

impl Lost {
    /// Of the text that was made of a camera, up to a gain.
    fn of(camera: &Camera, text: &str, most: f64) -> Result<Self> {
        let sensor = &camera.sensor;
        let beside = Beside {
            name: camera.name.clone(),
            bits: Some(sensor.bits),
            size: Some([sensor.width as f64, sensor.height as f64]),
            black_level_dn: Some(sensor.black_level_dn),
            prnu: Some(sensor.noise.prnu),
            full_well_e: Some(sensor.full_scale_e),
            model: Some(camera.name.clone()),
        };
        let found = exchange::read_text(text, &beside)?;
        let held = |key: &str| found.known.iter().any(|known| known.change.key == key);
        let missing: Vec<&str> = CONSTANT.into_iter().filter(|key| !held(key)).collect();
        let mut given = vec![
            Change::new("sensor.width", sensor.width as i64),
            Change::new("sensor.height", sensor.height as i64),
            Change::new("sensor.pitch_um", sensor.pitch_um),
            Change::new("sensor.bits", i64::from(sensor.bits)),
            Change::new("sensor.cfa", sensor.cfa.to_string()),
            Change::new("sensor.noise.read_e_post", 0.0),
        ];
        given.retain(|change| !held(&change.key));
        given.extend(missing.iter().map(|key| Change::new(*key, 0.0)));
        if !held("sensor.full_well_e") {
            given.push(Change::new("sensor.full_well_e", sensor.full_scale_e));
        }
        let mut draft = Draft::of(&Request { given, known: found.known, ..Request::default() })?;
        draft.made.extend(found.tables);
        let back = draft.camera(Path::new(""))?;
        let noise = &sensor.noise;
        let own = [
            sensor.black_level_dn,
            noise.prnu,
            noise.dark_current_e_per_s,
            noise.dsnu_e_per_s,
            noise.row_fpn_e,
            // Part of the noise in the dark.
            0.0,
        ];
        let values = CONSTANT.into_iter().zip(own);
        let values = values.filter(|(key, value)| missing.contains(key) && *value != 0.0);
        let mut left_out: Vec<String> =
            values.map(|(key, value)| format!("{key} = {value}")).collect();
        let kinds = |camera: &Camera| -> Vec<&str> {
            camera.effects.iter().map(|effect| effect.entry().kind).collect()
        };
        let known = kinds(&back);
        let effects = kinds(camera).into_iter().filter(|kind| !known.contains(kind));
        left_out.extend(effects.map(|kind| format!("effect {kind}")));
        let black = !missing.contains(&"sensor.black_level_dn");
        Ok(Self { differs: differs(camera, &back, most, black), left_out })
    }

    fn lines(&self) -> Vec<String> {
        let line = |f: &Figure| {
            let Figure { name, unit, gain, camera, form } = f;
            format!(
                "{name} at gain {gain:.3}: {form:.4} {unit} in this form, {camera:.4} {unit} in the \
                 camera, {:.1} % off",
                100.0 * f.off()
            )
        };
        let mut lines: Vec<String> = self.differs.iter().map(line).collect();
        if !self.left_out.is_empty() {
            lines.push(format!("this form has nothing of {}", self.left_out.join(", ")));
        }
        lines
    }

    fn json(&self) -> Vec<Json> {
        let object = |f: &Figure| {
            json!({
                "figure": f.name, "unit": f.unit, "gain": f.gain, "camera": f.camera,
                "form": f.form,
            })
        };
        self.differs.iter().map(object).collect()
    }
}

/// The figures that differ between two cameras by more than [`MAX_OFF`], each at its worst gain.
fn differs(camera: &Camera, back: &Camera, most: f64, black: bool) -> Vec<Figure> {
    let place = |i: usize| libm::pow(most, i as f64 / (PLACES - 1) as f64);
    let own = camera.sensor.gains.iter().flat_map(|gains| gains.at.iter().copied());
    let gains: Vec<f64> =
        (0..PLACES).map(place).chain(own).filter(|g| (1.0..=most).contains(g)).collect();
    let dark_e = |camera: &Camera, gain: f64| {
        let at = camera.sensor.at_gain(gain);
        let top = f64::from((1u32 << camera.sensor.bits) - 1);
        let (_, offset) = noise_profile(camera, gain)[0];
        offset.sqrt() * (top - at.black_level_dn) / at.dn_per_e
    };
    let mut found = Vec::new();
    let mut judge = |name: &'static str, unit: &'static str, of: &dyn Fn(&Camera, f64) -> f64| {
        let figure = |gain: &f64| {
            let [camera, form] = [camera, back].map(|c| of(c, *gain));
            Figure { name, unit, gain: *gain, camera, form }
        };
        let worst = gains.iter().map(figure).max_by(|a, b| a.off().total_cmp(&b.off()));
        found.extend(worst.filter(|figure| figure.off() > MAX_OFF));
    };
    judge("system gain", "DN/e-", &|camera, gain| camera.sensor.at_gain(gain).dn_per_e);
    judge("noise in the dark with rounding", "e-", &dark_e);
    if black {
        judge("black level", "DN", &|camera, gain| camera.sensor.at_gain(gain).black_level_dn);
    }
    found
}

//! Capture plans: which stacks to take, for `camrig capture`.
//!
//! A plan is a TOML file (`format = "plan/1"`) of `[[stack]]` tables. `exposure_s`,
//! `temperature_c`, `analog_gain` and `fill` take one number, a list, or `{ from, to, count }`; a
//! stack is taken for every combination, and for every scene of a folder that is a sequence. Flats
//! have narrow-band light whose amount is `irradiance_w_m2`, or `fill`: the mean signal as a
//! fraction of saturation in the channel that gets most.

use camrig_base::alternatives::Numbers;
use camrig_base::{Error, ErrorCode, Result, mistakes, toml_text};
use camrig_captures::{CapturedScene, Light, Role};
use camrig_scene_files::sequence::{self, folder};
use schemars::{JsonSchema, Schema, schema_for};
use serde::Deserialize;
use std::path::Path;

/// Built-in plans: name and text.
pub const BUILT_IN: [(&str, &str); 5] = [
    ("diagnosis", include_str!("../plans/diagnosis.toml")),
    ("emva", include_str!("../plans/emva.toml")),
    ("ptc", include_str!("../plans/ptc.toml")),
    ("optics", include_str!("../plans/optics.toml")),
    ("paper", include_str!("../plans/paper.toml")),
];

/// One stack to take: a capture without its frames.
#[derive(Clone, Debug)]
pub struct Shot {
    /// Unique name.
    pub id: String,
    /// What it is for.
    pub role: Role,
    /// Frames.
    pub frames: u32,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Analog gain; the camera's own where `None`.
    pub analog_gain: Option<f64>,
    /// Sensor temperature, °C; the camera's own where `None`.
    pub temperature_c: Option<f64>,
    /// The light.
    pub light: Light,
    /// Bandwidth of narrow-band light, nm.
    pub width_nm: f64,
    /// Mean signal as a fraction of saturation, instead of an irradiance.
    pub fill: Option<f64>,
    /// The scene.
    pub scene: Option<CapturedScene>,
    /// Whether saturation is meant.
    pub saturates: bool,
}

/// Which stacks to take. Where keys take several values, a stack is taken for every combination.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// `"plan/1"`.
    format: String,
    /// The stacks, in order of time.
    stack: Vec<Stack>,
}

/// A stack of frames, or several that differ in one condition.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Stack {
    /// Name within the set; where several stacks are made, each name ends with its number.
    id: String,
    /// What it is for.
    role: Role,
    /// Frames.
    frames: u32,
    /// Exposure time, s.
    exposure_s: Numbers,
    /// Temperature of the sensor, °C; left out: the camera's own.
    temperature_c: Option<Numbers>,
    /// Gain before the converter; left out: the camera's own.
    analog_gain: Option<Numbers>,
    /// Mean signal as a fraction of saturation in the channel that gets most, instead of an amount
    /// of light.
    fill: Option<Numbers>,
    /// The light.
    light: Option<PlanLight>,
    /// What an edge, a chart, dots or a scene looks at.
    scene: Option<CapturedScene>,
    /// Whether saturation is meant; otherwise it is refused.
    #[serde(default)]
    saturates: bool,
}

/// The light of a stack.
#[derive(Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct PlanLight {
    /// Wavelength of narrow-band light on a flat, nm.
    wavelength_nm: Option<f64>,
    /// Bandwidth of that light, nm.
    #[serde(default = "default_width_nm")]
    width_nm: f64,
    /// Irradiance at the sensor, W m⁻².
    irradiance_w_m2: Option<f64>,
    /// Illuminant of a scene: a name or a file.
    illuminant: Option<String>,
    /// Illuminance of a scene, lx.
    lux: Option<f64>,
}

/// The JSON schema of a plan.
pub fn schema() -> Schema {
    schema_for!(File)
}

/// Bandwidth of narrow-band light unless a plan sets another, nm: that of the filters of Chen et
/// al. 2009, section IV-C.
const WIDTH_NM: f64 = 10.0;

fn default_width_nm() -> f64 {
    WIDTH_NM
}

/// The text of a built-in plan; empty for a name that is none.
pub fn text(name: &str) -> &'static str {
    BUILT_IN.iter().find(|b| b.0 == name).map_or("", |b| b.1)
}

/// Loads a built-in plan by name, or a file.
///
/// # Errors
/// Unknown names and keys, values that make no stack.
pub fn load(spec: &str) -> Result<Vec<Shot>> {
    if let Some((_, text)) = BUILT_IN.iter().find(|(name, _)| name.eq_ignore_ascii_case(spec)) {
        return parse(text);
    }
    if !spec.contains(['/', '\\', '.']) {
        let names: Vec<&str> = BUILT_IN.iter().map(|b| b.0).collect();
        return Err(Error::input(format!("unknown plan {spec:?}")).help(format!(
            "{}; or give a file such as ./plan.toml",
            toml_text::did_you_mean(spec, &names)
        )));
    }
    let text = std::fs::read_to_string(spec).map_err(|e| Error::io("read", Path::new(spec), e))?;
    parse(&text).map_err(|e| e.at(spec))
}

/// Parses the text of a plan.
pub fn parse(text: &str) -> Result<Vec<Shot>> {
    let file: File = mistakes::read(text)?;
    if file.format != "plan/1" {
        return Err(Error::unsupported(format!("plan format {:?}", file.format))
            .help("this program reads format = \"plan/1\""));
    }
    let mut shots: Vec<Shot> = Vec::new();
    for stack in &file.stack {
        let made = expand(stack).map_err(|e| e.at(format!("[[stack]] id {:?}", stack.id)))?;
        for shot in made {
            if shots.iter().any(|s| s.id == shot.id) {
                return Err(Error::input(format!("two stacks are called {:?}", shot.id))
                    .help("give every [[stack]] its own id"));
            }
            shots.push(shot);
        }
    }
    if shots.is_empty() {
        return Err(Error::input("a plan without stacks").help("add [[stack]] tables"));
    }
    Ok(shots)
}

fn expand(stack: &Stack) -> Result<Vec<Shot>> {
    if stack.frames == 0 {
        return Err(Error::input("frames = 0").help("take at least one frame"));
    }
    let plain = stack.id.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c));
    if !plain || stack.id.is_empty() || stack.id.starts_with('.') {
        return Err(Error::input(format!("id {:?}", stack.id))
            .help("ids name folders: use letters, digits, '-', '_' and '.'"));
    }
    let light = stack.light.clone();
    let amount = light.as_ref().and_then(|l| l.irradiance_w_m2);
    match stack.role {
        Role::Dark if light.is_some() || stack.fill.is_some() => {
            return Err(Error::input("a dark stack with light").help("remove light and fill"));
        }
        Role::Flat
            if light.as_ref().and_then(|l| l.wavelength_nm).is_none()
                || amount.is_some() == stack.fill.is_some() =>
        {
            return Err(Error::input("a flat whose light is not determined")
                .help("give light = { wavelength_nm = ... } and either fill or irradiance_w_m2"));
        }
        // What is not applied must not be written down as if it were.
        Role::Flat
            if light.as_ref().is_some_and(|l| l.illuminant.is_some() || l.lux.is_some()) =>
        {
            return Err(Error::input("a flat under an illuminant").help(
                "flats have narrow-band light: wavelength_nm with fill or irradiance_w_m2",
            ));
        }
        Role::Edge | Role::Chart | Role::Dots | Role::Scene
            if light.as_ref().is_some_and(|l| l.wavelength_nm.is_some())
                || amount.is_some()
                || stack.fill.is_some() =>
        {
            return Err(Error::input("a scene in narrow-band light")
                .help("scenes take light = { illuminant = \"D65\", lux = 300.0 }"));
        }
        Role::Edge | Role::Chart | Role::Dots | Role::Scene if stack.scene.is_none() => {
            return Err(Error::input("no scene to look at")
                .help("add scene = { scene = \"slanted-edge\" }"));
        }
        Role::Rotation => {
            return Err(Error::unsupported("rotation stacks are not taken by plans")
                .help("simulate the bench that rotates the camera")
                .with_code(ErrorCode::RotationStacks));
        }
        _ => {}
    }
    let optional = |n: &Option<Numbers>| match n {
        Some(n) => n.values().map(|values| values.into_iter().map(Some).collect()),
        None => Ok(vec![None]),
    };
    let mut shots = Vec::new();
    for &exposure_s in &stack.exposure_s.values()? {
        for &temperature_c in &optional(&stack.temperature_c)? {
            for &analog_gain in &optional(&stack.analog_gain)? {
                for &fill in &optional(&stack.fill)? {
                    let positive =
                        [Some(exposure_s), analog_gain, fill, amount].into_iter().flatten();
                    for value in positive {
                        if value.is_nan() || value <= 0.0 || value.is_infinite() {
                            return Err(Error::input(format!("a value of {value}"))
                                .help("exposures, gains, fills and irradiances are above zero"));
                        }
                    }
                    shots.push(Shot {
                        id: String::new(),
                        role: stack.role,
                        frames: stack.frames,
                        exposure_s,
                        analog_gain,
                        temperature_c,
                        light: Light {
                            irradiance_w_m2: amount,
                            wavelength_nm: light.as_ref().and_then(|l| l.wavelength_nm),
                            illuminant: light.as_ref().and_then(|l| l.illuminant.clone()),
                            lux: light.as_ref().and_then(|l| l.lux),
                            ..Light::default()
                        },
                        width_nm: light.as_ref().map_or(WIDTH_NM, |l| l.width_nm),
                        fill,
                        scene: stack.scene.clone(),
                        saturates: stack.saturates,
                    });
                }
            }
        }
    }
    let mut shots = with_sequences(shots)?;
    let several = shots.len() > 1;
    for (i, shot) in shots.iter_mut().enumerate() {
        shot.id = if several { format!("{}-{i:02}", stack.id) } else { stack.id.clone() };
    }
    Ok(shots)
}

/// The same shots, of a folder that is a sequence one for each of its scenes: the frames of a stack
/// look at the same.
fn with_sequences(shots: Vec<Shot>) -> Result<Vec<Shot>> {
    let mut all = Vec::new();
    for shot in shots {
        let spec = shot.scene.as_ref().map(CapturedScene::spec).unwrap_or_default();
        if sequence::passes_by(&spec) {
            return Err(Error::unsupported(format!("a stack of {spec:?}, whose scene moves")).help(
                "the frames of a stack look at the same: give a folder of pictures, which becomes \
                 a stack for each, or simulate the sequence, frame by frame",
            ));
        }
        match folder::files(&spec)? {
            None => all.push(shot),
            Some(files) => all.extend(files.into_iter().map(|file| {
                let scene = CapturedScene { scene: file, angle_deg: None };
                Shot { scene: Some(scene), ..shot.clone() }
            })),
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_plans_parse() {
        for (name, _) in BUILT_IN {
            let shots = load(name).unwrap();
            assert!(shots.iter().any(|s| s.role == Role::Dark), "{name}");
        }
        assert_eq!(load("emva").unwrap().iter().filter(|s| s.role == Role::Flat).count(), 51);
    }

    #[test]
    fn wrong_plans_are_refused() {
        let said = |body: &str| {
            parse(&format!("format = \"plan/1\"\n[[stack]]\n{body}")).unwrap_err().to_string()
        };
        let base = "id='a'\nframes=2\nexposure_s=0.1\n";
        assert!(said(&format!("{base}role='flat'")).contains("light is not determined"));
        assert!(said(&format!("{base}role='dark'\nfill=0.5")).contains("with light"));
        assert!(said(&format!("{base}role='edge'")).contains("no scene"));
        for moving in ["clip.y4m", "clip.Y4M:matrix=bt709", "-", "tcp://127.0.0.1:7500"] {
            let said = said(&format!("{base}role='scene'\nscene={{scene='{moving}'}}"));
            assert!(said.contains("a folder of pictures"), "{moving}: {said}");
        }
        let scene = "scene={scene='dots'}\nrole='dots'";
        for light in ["light={wavelength_nm=550.0}", "light={irradiance_w_m2=1.0}", "fill=0.5"] {
            assert!(said(&format!("{base}{scene}\n{light}")).contains("narrow-band"), "{light}");
        }
        let flat = "role='flat'\nfill=0.5\nlight={wavelength_nm=550.0, illuminant='A'}";
        assert!(said(&format!("{base}{flat}")).contains("under an illuminant"));
        assert!(said(&format!("{base}role='dark'\nfrmaes=2")).contains("frmaes"));
        assert!(said("id='../a'\nframes=2\nexposure_s=0.1\nrole='dark'").contains("id"));
        assert!(said("id='a'\nframes=2\nexposure_s=-1\nrole='dark'").contains("above zero"));
    }
}

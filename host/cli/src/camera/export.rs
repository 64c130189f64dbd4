//! `camrig camera export`: the noise of a camera in the form of another program.

use crate::arguments::{ChangeArgs, positive};
use camrig_base::Result;
use camrig_base::output::write_file;
use camrig_fit::exchange::{self, Profile};
use camrig_render::noise_profile;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write the noise of a camera in the form of another program
#[derive(clap::Args, Debug)]
#[command(after_help = "`camrig camera new --noise FILE` reads the same forms. Examples:\n  \
    camrig camera export imx477 --as profile -o imx477.csv\n  \
    camrig camera export ./mine.toml --as pmn --gain 16 -o mine.json")]
pub struct ExportArgs {
    /// Camera file or preset
    camera: String,
    #[command(flatten)]
    changes: ChangeArgs,
    /// profile: S and O of a DNG NoiseProfile, Noise Flow's two betas (CSV); pmn: lines of read
    /// noise over the system gain, of ELD and PMN (JSON); libcamera: rpi.noise and rpi.black_level
    #[arg(long = "as", value_name = "FORM")]
    form: Form,
    /// Largest gain; profiles are those of 1, 2, 4, ... up to it
    #[arg(long, value_name = "G", default_value_t = 16.0, value_parser = positive)]
    gain: f64,
    /// Output
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Replace an existing file
    #[arg(long)]
    force: bool,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum Form {
    Profile,
    Pmn,
    Libcamera,
}

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
    let text = match args.form {
        Form::Profile => {
            let gains = std::iter::successors(Some(1.0), |g| Some(2.0 * g));
            let gains = gains.take_while(|g| *g <= args.gain.max(1.0));
            exchange::to_table(&gains.map(profile).collect::<Vec<_>>())
        }
        Form::Pmn => format!("{:#}\n", exchange::to_lines(&camera, args.gain)?),
        Form::Libcamera => format!("{:#}\n", exchange::to_tuning(&camera)),
    };
    write_file(&args.output, args.force, text.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}

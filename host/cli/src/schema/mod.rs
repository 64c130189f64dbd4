//! `camrig schema`: the files that people write, as JSON schemas for editors and as a page.

mod markdown;

use camrig_base::Result;
use serde_json::Value;
use std::process::ExitCode;

/// The JSON schema of a file that people write, for editors; or the reference of all of them
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig schema > camera.schema.json\n  \
    camrig schema captures > captures.schema.json\n  \
    camrig schema --markdown > reference.md\n\n\
    Editors that know Taplo's directive take a schema from a file's first line:\n  \
    #:schema ./camera.schema.json")]
pub struct Args {
    /// Which file
    #[arg(value_enum, default_value_t)]
    file: File,
    /// Print the page of docs/reference.md, which has all of them
    #[arg(long, conflicts_with = "file")]
    markdown: bool,
}

/// A kind of file.
#[derive(clap::ValueEnum, Clone, Copy, Debug, Default)]
enum File {
    /// Camera file
    #[default]
    Camera,
    /// Capture set: captures.toml
    Captures,
    /// Plan of `camrig capture`
    Plan,
    /// Sweep of `camrig batch`
    Sweep,
    /// Script of `camrig rig stream`
    Script,
    /// Cameras of `camrig rig record`
    Cameras,
    /// Lens prescription written by hand
    Lens,
}

impl File {
    const ALL: [Self; 7] = [
        Self::Camera,
        Self::Captures,
        Self::Plan,
        Self::Sweep,
        Self::Script,
        Self::Cameras,
        Self::Lens,
    ];

    fn heading(self) -> &'static str {
        match self {
            Self::Camera => "Camera file",
            Self::Captures => "Capture set: `captures.toml`",
            Self::Plan => "Plan of `camrig capture`",
            Self::Sweep => "Sweep of `camrig batch`",
            Self::Script => "Script of `camrig rig stream`",
            Self::Cameras => "Cameras of `camrig rig record`",
            Self::Lens => "Lens prescription",
        }
    }

    fn schema(self) -> Value {
        match self {
            Self::Camera => camrig_camera::schema::schema(),
            Self::Captures => camrig_captures::manifest::schema().to_value(),
            Self::Plan => camrig_capture::plan::schema().to_value(),
            Self::Sweep => camrig_batch::sweep::schema().to_value(),
            Self::Script => camrig_rig::script::schema().to_value(),
            Self::Cameras => camrig_rig::trigger::schema().to_value(),
            Self::Lens => camrig_lens::prescription::toml::schema().to_value(),
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    if args.markdown {
        let files: Vec<_> = File::ALL.iter().map(|f| (f.heading(), f.schema())).collect();
        print!("{}", markdown::page(&files));
    } else {
        println!("{:#}", args.file.schema());
    }
    Ok(ExitCode::SUCCESS)
}

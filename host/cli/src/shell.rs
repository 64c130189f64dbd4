//! `camrig completions` and `camrig man`: shell completions and manual pages.

use camrig_base::Result;
use camrig_base::output::OutputDir;
use clap::CommandFactory;
use std::path::PathBuf;
use std::process::ExitCode;

/// Print shell completions
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig completions bash > ~/.local/share/bash-completion/completions/camrig\n  \
    camrig completions zsh > ~/.zfunc/_camrig\n  \
    camrig completions fish > ~/.config/fish/completions/camrig.fish")]
pub struct CompletionsArgs {
    /// Shell
    shell: clap_complete::Shell,
}

/// Write manual pages, one for each command
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig man -o man1 && man -l man1/camrig-simulate.1")]
pub struct ManArgs {
    /// Directory for the pages
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace existing pages
    #[arg(long)]
    force: bool,
}

/// Runs `camrig completions`.
pub fn run_completions(args: &CompletionsArgs) -> Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut super::Cli::command(), "camrig", &mut script);
    print!("{}", String::from_utf8_lossy(&script));
    Ok(ExitCode::SUCCESS)
}

/// Runs `camrig man`.
pub fn run_man(args: &ManArgs) -> Result<ExitCode> {
    let output = OutputDir::create(&args.output, args.force)?;
    let mut command = super::Cli::command();
    command.build();
    write_page(&output, &command, "camrig")?;
    output.finish()?;
    Ok(ExitCode::SUCCESS)
}

/// The page of a command and those of its subcommands.
fn write_page(output: &OutputDir, command: &clap::Command, name: &str) -> Result<()> {
    let mut page = Vec::new();
    let named = command.clone().name(name.to_string()).display_name(name.to_string());
    // Writing to memory does not fail.
    let _ = clap_mangen::Man::new(named).render(&mut page);
    output.write(format!("{name}.1"), &page)?;
    let inner = command.get_subcommands().filter(|c| c.get_name() != "help" && !c.is_hide_set());
    for command in inner {
        write_page(output, command, &format!("{name}-{}", command.get_name()))?;
    }
    Ok(())
}

//! The program `camrig`.

fn main() -> std::process::ExitCode {
    camrig_cli::main()
}

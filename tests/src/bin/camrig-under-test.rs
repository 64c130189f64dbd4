//! The program `camrig`, built with the tests so that they always run the current one.

fn main() -> std::process::ExitCode {
    camrig_cli::main()
}

//! The program `camrig`.

fn main() -> std::process::ExitCode {
    camrig::cli::main()
}

//! The `koehler` command.

fn main() -> std::process::ExitCode {
    koehler::cli::main()
}

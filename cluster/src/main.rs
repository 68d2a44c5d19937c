//! The `koehler-cluster` command.

fn main() -> std::process::ExitCode {
    koehler_cluster::main()
}

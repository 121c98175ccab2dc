//! The `nullray` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    nullray::cli::main()
}

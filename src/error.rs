//! What can go wrong, in words that say what to do next.

use std::path::PathBuf;

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// A failure that a caller could not foresee. Every message is one line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A scene file says something it may not.
    #[error("{}:{line}:{column}: {reason}", path.display())]
    Scene {
        /// The scene file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What was found and what was expected.
        reason: String,
    },
    /// A `--set` override says something a scene may not.
    #[error("--set {assignment}: {reason}")]
    Override {
        /// The assignment as given.
        assignment: String,
        /// What was found and what was expected.
        reason: String,
    },
    /// A mesh, texture or film cannot be read as what it should be.
    #[error("{}: {reason}", path.display())]
    Asset {
        /// The file.
        path: PathBuf,
        /// What was found and what was expected.
        reason: String,
    },
    /// The scene cannot be rendered as it stands.
    #[error("{0}")]
    World(String),
    /// An argument of the command line does not fit.
    #[error("{argument}: {reason}")]
    Usage {
        /// The option or argument.
        argument: String,
        /// What was found and what was expected.
        reason: String,
    },
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// No Vulkan device can run the kernels.
    #[error("no Vulkan device: {missing}")]
    NoDevice {
        /// What is missing.
        missing: String,
    },
    /// A window cannot be opened or drawn to.
    #[error("no window: {0}")]
    Window(String),
    /// The device is out of memory.
    #[error("the device has no memory for {what} ({bytes} bytes); render a smaller film or scene, or use --backend cpu")]
    OutOfMemory {
        /// What was to be stored.
        what: String,
        /// Its size.
        bytes: u64,
    },
    /// The device stopped answering.
    #[error("the device was lost while running `{kernel}`; try again, or use --backend cpu")]
    DeviceLost {
        /// The kernels in flight.
        kernel: String,
    },
    /// A Vulkan call failed.
    #[error("{call} failed: {result}")]
    Vulkan {
        /// The function.
        call: &'static str,
        /// Its result.
        result: String,
    },
    /// A check did not hold; the report has been printed.
    #[error("{0}")]
    CheckFailed(String),
    /// Interrupted by the user; what was rendered has been written.
    #[error("interrupted")]
    Interrupted,
}

impl Error {
    /// Process exit code: 2 for bad input, 130 after Ctrl-C, 1 otherwise.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Scene { .. }
            | Error::Override { .. }
            | Error::Asset { .. }
            | Error::World(_)
            | Error::Usage { .. }
            | Error::Io { .. } => 2,
            Error::Interrupted => 130,
            _ => 1,
        }
    }
}

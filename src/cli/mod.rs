//! The command line: one file per subcommand.

mod bench;
mod check;
mod chrome_trace;
mod devices;
mod profile;
mod render;
mod trace;
mod trace_input;
mod trace_output;
mod validate;
mod view;

pub use bench::form_overrides;

use crate::backend::cpu::CpuBackend;
use crate::backend::vulkan::VulkanBackend;
use crate::backend::{Backend, Precision};
use crate::error::{Error, Result};
use crate::scene::{Scene, load_scene};
use crate::world::World;
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::FmtSpan;
use tracing_subscriber::prelude::*;

/// A path tracer for light that bends: full global illumination with every ray curved, on Vulkan and on the CPU.
#[derive(Parser)]
#[command(name = "nullray", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Render a scene to PNG or EXR files
    Render(render::RenderArgs),
    /// Open a window to fly around in a scene
    View(view::ViewArgs),
    /// Trace single rays from a CSV file and write where they end
    Trace(trace::TraceArgs),
    /// Compare the film of the GPU with the film of the CPU; exit 1 when they differ
    Validate(validate::ValidateArgs),
    /// The thesis' tables: time per sample, linear and non-linear
    Bench(bench::BenchArgs),
    /// Where the time of a frame goes, kernel by kernel and bounce by bounce
    Profile(profile::ProfileArgs),
    /// Read and validate scene files
    Check(check::CheckArgs),
    /// List every Vulkan device and the features nullray needs of it
    Devices(devices::DevicesArgs),
}

/// Which backend renders.
#[derive(Clone, Copy, Debug, Default, PartialEq, ValueEnum)]
pub enum BackendChoice {
    /// A Vulkan GPU if there is one, else the CPU
    #[default]
    Auto,
    /// A Vulkan device, software ones included
    Vulkan,
    /// The processor
    Cpu,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum PrecisionChoice {
    F32,
    F64,
}

impl From<PrecisionChoice> for Precision {
    fn from(choice: PrecisionChoice) -> Precision {
        match choice {
            PrecisionChoice::F32 => Precision::F32,
            PrecisionChoice::F64 => Precision::F64,
        }
    }
}

/// Options that choose where to render.
#[derive(Args, Clone, Debug)]
struct DeviceArgs {
    /// Which backend renders
    #[arg(long, value_enum, default_value_t)]
    backend: BackendChoice,
    /// Vulkan device, by number or part of its name (see `nullray devices`)
    #[arg(long)]
    device: Option<String>,
    /// Precision of the curve integration [default: f32, of trace f64]
    #[arg(long, value_enum)]
    precision: Option<PrecisionChoice>,
    /// Threads of the CPU backend
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=4096))]
    threads: Option<u32>,
}

impl DeviceArgs {
    /// The precision asked for, or the command's own.
    fn precision(&self, default: Precision) -> Precision {
        self.precision.map_or(default, Precision::from)
    }

    /// Opens the backend; `auto` says on stderr why it is not a GPU.
    fn open(&self) -> Result<Box<dyn Backend>> {
        let cpu = || CpuBackend::new(self.threads.map(|t| t as usize));
        match self.backend {
            BackendChoice::Cpu => Ok(Box::new(cpu()?)),
            BackendChoice::Vulkan => Ok(Box::new(VulkanBackend::new(self.device.as_deref())?)),
            BackendChoice::Auto => match VulkanBackend::new(self.device.as_deref()) {
                Ok(vulkan) if vulkan.is_software() && self.device.is_none() => {
                    eprintln!("nullray: the only Vulkan device is a software one; using the CPU backend (--backend vulkan overrides)");
                    Ok(Box::new(cpu()?))
                }
                Ok(vulkan) => Ok(Box::new(vulkan)),
                Err(e @ Error::NoDevice { .. }) if self.device.is_none() => {
                    eprintln!("nullray: {e}; using the CPU backend");
                    Ok(Box::new(cpu()?))
                }
                Err(e) => Err(e),
            },
        }
    }
}

/// Options that change the scene.
#[derive(Args, Clone, Debug, Default)]
struct SceneArgs {
    /// Film size in pixels, as WIDTHxHEIGHT
    #[arg(long, value_name = "WxH")]
    size: Option<String>,
    /// Most scattering events of a path
    #[arg(long)]
    max_depth: Option<u32>,
    /// Render with straight light
    #[arg(long)]
    linear: bool,
    /// Override a value of the scene, e.g. spacetime.mass=0.5
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl SceneArgs {
    /// The assignments to the scene that they stand for; straight light is not one.
    fn overrides(&self) -> Result<Vec<String>> {
        let mut set = self.set.clone();
        if let Some(size) = &self.size {
            let (w, h) = size
                .split_once(['x', 'X'])
                .filter(|(w, h)| [w, h].iter().all(|v| v.parse::<u32>().is_ok_and(|n| (1..=32768).contains(&n))))
                .ok_or_else(|| Error::Usage {
                    argument: format!("--size {size}"),
                    reason: "expected WIDTHxHEIGHT, each from 1 to 32768".into(),
                })?;
            set.push(format!("film.width={w}"));
            set.push(format!("film.height={h}"));
        }
        if let Some(depth) = self.max_depth {
            set.push(format!("film.max_depth={depth}"));
        }
        Ok(set)
    }

    /// Loads and compiles a scene with these options.
    fn load(&self, path: Option<&PathBuf>) -> Result<(Scene, World)> {
        let mut scene = load_scene(path.map(PathBuf::as_path), &self.overrides()?)?;
        if self.linear {
            scene.spacetime = crate::scene::Spacetime::flat();
        }
        let world = World::compile(&scene)?;
        if world.dark {
            eprintln!(
                "nullray: warning: {}: nothing emits light and the environment is black, the picture will be too",
                scene.path.display()
            );
        }
        Ok((scene, world))
    }
}

/// Parses the arguments, runs the command, and turns its result into an exit code.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => {
            let _ = e.print();
            return ExitCode::from(if e.use_stderr() { 2 } else { 0 });
        }
    };
    let outcome = start_log().and_then(|()| match cli.command {
        Command::Render(args) => render::run(&args),
        Command::View(args) => view::run(&args),
        Command::Trace(args) => trace::run(&args),
        Command::Validate(args) => validate::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Profile(args) => profile::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Devices(args) => devices::run(&args),
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("nullray: error: {e}");
            ExitCode::from(e.exit_code())
        }
    }
}

/// Sends the spans and events that `NULLRAY_LOG` names (`nullray=debug`, say) to stderr. Without it they cost nothing.
fn start_log() -> Result<()> {
    let Some(wanted) = std::env::var("NULLRAY_LOG").ok().filter(|w| !w.is_empty()) else { return Ok(()) };
    let targets = wanted.parse::<Targets>().map_err(|e| Error::Usage {
        argument: format!("NULLRAY_LOG={wanted}"),
        reason: format!("{e}, expected targets and levels such as nullray=debug"),
    })?;
    let stderr = std::io::stderr;
    let lines = tracing_subscriber::fmt::layer().with_writer(stderr).with_ansi(stderr().is_terminal()).with_span_events(FmtSpan::CLOSE);
    // A program that uses the library may have a subscriber of its own.
    let _ = tracing_subscriber::registry().with(lines.with_filter(targets)).try_init();
    Ok(())
}

/// Writes a line to stdout; a reader that went away is no error.
fn print_line(line: &str) -> Result<()> {
    use std::io::Write;
    match writeln!(std::io::stdout(), "{line}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Error::Io { path: "stdout".into(), source: e }),
        _ => Ok(()),
    }
}

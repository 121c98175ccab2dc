//! Generates the bending models for both backends and compiles every shader variant.

use glslang::include::{IncludeHandler, IncludeResult, IncludeType};
use glslang::{Compiler, CompilerOptions, ShaderInput, ShaderMessage, ShaderSource, ShaderStage, SpirvVersion, Target, VulkanVersion};
use std::collections::HashMap;
use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[path = "src/kernels/constants.rs"]
#[allow(dead_code, reason = "the build script reads the tables only")]
mod constants;
#[path = "src/spacetime/mod.rs"]
#[allow(dead_code, unused_imports, reason = "the build script uses the formulas only")]
mod spacetime;
#[path = "src/kernels/tableau.rs"]
mod tableau;

use spacetime::expr::emit::Dialect;
use spacetime::expr::model::ModelFormulas;

/// Kernels that exist once, and the one that exists per model and precision.
const SHARED_KERNELS: &[&str] = &["generate", "prepare", "shade", "escape", "resolve", "develop"];
const MODEL_KERNEL: &str = "advance";
/// Stages that draw a canvas over a window.
const DRAWING_STAGES: &[(&str, ShaderStage)] = &[("present.vert", ShaderStage::Vertex), ("present.frag", ShaderStage::Fragment)];

fn main() -> Result<(), Box<dyn Error>> {
    for path in ["build.rs", "shaders", "src/spacetime", "src/kernels/constants.rs", "src/kernels/tableau.rs"] {
        println!("cargo:rerun-if-changed={path}");
    }
    let out = PathBuf::from(std::env::var("OUT_DIR")?);

    let mut rust = String::from("// Generated from src/spacetime by build.rs.\n");
    let mut includes: HashMap<String, String> = HashMap::new();
    for dialect in [Dialect::Glsl32, Dialect::Glsl64] {
        includes.insert(format!("constants{}", suffix(dialect)), constants_glsl(dialect));
        includes.insert(format!("tableau{}", suffix(dialect)), tableau_glsl(dialect));
    }
    macro_rules! formulas {
        (Medium, $model:path) => {
            ModelFormulas::of_medium::<$model>()
        };
        (Metric, $model:path) => {
            ModelFormulas::of_metric::<$model>()
        };
        (Flow, $model:path) => {
            ModelFormulas::of_flow::<$model>()
        };
    }
    macro_rules! generate {
        ($(($name:ident, $stem:ident, $class:ident)),+ $(,)?) => {
            $(
                let formulas = formulas!($class, spacetime::$name);
                rust += &formulas.rust(stringify!($name));
                for dialect in [Dialect::Glsl32, Dialect::Glsl64] {
                    includes.insert(format!("{}{}", stringify!($stem), suffix(dialect)), formulas.glsl(dialect));
                }
            )+
        };
    }
    for_each_model!(generate);
    std::fs::write(out.join("models.rs"), rust)?;

    let mut table = String::from("/// SPIR-V of every kernel and drawing stage, by name.\npub static SPIRV: &[(&str, &[u8])] = &[\n");
    let mut compile = |file: &str, stage: ShaderStage, name: &str, dialect: Dialect, model: &str| -> Result<(), Box<dyn Error>> {
        let words = compile_shader(file, stage, dialect, model, &includes)?;
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        std::fs::write(out.join(format!("{name}.spv")), bytes)?;
        writeln!(table, "    ({name:?}, include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{name}.spv\"))),")?;
        Ok(())
    };
    for kernel in SHARED_KERNELS {
        compile(&format!("{kernel}.comp"), ShaderStage::Compute, kernel, Dialect::Glsl32, "flat")?;
    }
    for &(file, stage) in DRAWING_STAGES {
        compile(file, stage, file, Dialect::Glsl32, "flat")?;
    }
    for model in spacetime::ModelKind::ALL {
        for dialect in [Dialect::Glsl32, Dialect::Glsl64] {
            let name = format!("{MODEL_KERNEL}_{}{}", model.stem(), suffix(dialect));
            compile(&format!("{MODEL_KERNEL}.comp"), ShaderStage::Compute, &name, dialect, model.stem())?;
        }
    }
    table.push_str("];\n");
    std::fs::write(out.join("spirv.rs"), table)?;
    Ok(())
}

fn suffix(dialect: Dialect) -> &'static str {
    if dialect == Dialect::Glsl64 { "_f64" } else { "_f32" }
}

/// The GLSL twin of `kernels/constants.rs`.
fn constants_glsl(dialect: Dialect) -> String {
    let mut text = String::new();
    for (name, value) in constants::UINTS {
        let _ = writeln!(text, "const uint {name} = {value}u;");
    }
    for (name, value) in constants::FLOATS {
        let _ = writeln!(text, "const float {name} = {:?};", *value);
    }
    for (name, value) in constants::REALS {
        let _ = writeln!(text, "const real {name} = {};", dialect.constant(*value));
    }
    text
}

/// The entries of all tableaus, one after another.
fn tableau_glsl(dialect: Dialect) -> String {
    let tableaus = (0..constants::TABLEAU_COUNT).flat_map(|i| tableau::packed(constants::METHOD_RUNGE_KUTTA + i));
    let entries = tableaus.enumerate().filter(|&(_, value)| value != 0.0);
    let entries: String = entries.map(|(at, value)| format!("at == {at}u ? {} : ", dialect.constant(value))).collect();
    // Choices, because drivers keep an array in memory even where every index into it is a constant.
    format!("real tableau_entry(uint at) {{ return {entries}real(0.0); }}\n")
}

/// Resolves `#include`: the generated `constants.glsl`, `tableau.glsl` and `model.glsl`, everything else from shaders/.
struct Includes<'a> {
    generated: &'a HashMap<String, String>,
    dialect: Dialect,
    model: &'a str,
}

impl IncludeHandler for Includes<'_> {
    fn include(&mut self, _: IncludeType, name: &str, _: &str, _: usize) -> Option<IncludeResult> {
        let data = match name {
            "constants.glsl" => self.generated.get(&format!("constants{}", suffix(self.dialect)))?.clone(),
            "tableau.glsl" => self.generated.get(&format!("tableau{}", suffix(self.dialect)))?.clone(),
            "model.glsl" => self.generated.get(&format!("{}{}", self.model, suffix(self.dialect)))?.clone(),
            _ => std::fs::read_to_string(Path::new("shaders").join(name)).ok()?,
        };
        Some(IncludeResult { name: name.to_owned(), data })
    }
}

fn compile_shader(
    file: &str,
    stage: ShaderStage,
    dialect: Dialect,
    model: &str,
    generated: &HashMap<String, String>,
) -> Result<Vec<u32>, Box<dyn Error>> {
    let path = Path::new("shaders").join(file);
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let mut defines: Vec<(&str, Option<&str>)> = vec![];
    if dialect == Dialect::Glsl64 {
        defines.push(("REAL64", Some("1")));
    }
    if model == "flat" {
        defines.push(("FLAT", Some("1")));
    }
    let kind = spacetime::ModelKind::ALL.iter().find(|k| k.stem() == model);
    defines.extend(kind.and_then(|k| match k.class() {
        spacetime::Class::Medium => Some(("MEDIUM", Some("1"))),
        spacetime::Class::Metric => Some(("METRIC", Some("1"))),
        spacetime::Class::Flow => None,
    }));
    if kind.is_some_and(|k| k.moves_at_infinity()) {
        defines.push(("MOVING_FRAME", Some("1")));
    }
    if kind.is_some_and(|k| k.has_throat()) {
        defines.push(("THROAT", Some("1")));
    }
    if kind.is_some_and(|k| k.has_rim()) {
        defines.push(("RIM", Some("1")));
    }
    let options = CompilerOptions {
        target: Target::Vulkan { version: VulkanVersion::Vulkan1_2, spirv_version: SpirvVersion::SPIRV1_5 },
        messages: ShaderMessage::VULKAN_RULES | ShaderMessage::SPV_RULES,
        ..CompilerOptions::default()
    };
    let compiler = Compiler::acquire().ok_or("glslang does not start")?;
    let source = ShaderSource::from(text);
    let mut includes = Includes { generated, dialect, model };
    let describe = |e: glslang::error::GlslangError| format!("{} ({model}): {e}", path.display());
    let input = ShaderInput::new(&source, stage, &options, Some(defines.as_slice()), Some(&mut includes)).map_err(describe)?;
    let shader = compiler.create_shader(input).map_err(describe)?;
    Ok(shader.compile().map_err(describe)?)
}

//! nullray: a path tracer for light that bends.
//!
//! | module | what it holds |
//! | --- | --- |
//! | [`scene`] | what the user describes, read from TOML, meshes and images |
//! | [`world`] | the scene compiled to flat arrays: BVH, clearance grid, lights |
//! | [`spacetime`] | bending models, each one formula; the generator that differentiates and emits them |
//! | [`kernels`] | the renderer itself, twin of the GLSL in `shaders/` |
//! | [`simd`] | lane types the kernels are generic over |
//! | [`backend`] | the [`backend::Backend`] trait, on the CPU and on Vulkan |
//! | [`scheduler`] | which samples next, how much at a time, and when to stop |
//! | [`profile`] | where the time of a frame goes |
//! | [`film`] | sums, AOVs, PNG and EXR |
//! | [`viewer`] | the window to fly around in |
//! | [`cli`] | the command line |

#![warn(missing_docs)]

pub mod backend;
pub mod cli;
pub mod error;
pub mod film;
pub mod kernels;
pub mod profile;
pub mod scene;
pub mod scheduler;
pub mod simd;
pub mod spacetime;
pub mod viewer;
pub mod world;

pub use error::{Error, Result};

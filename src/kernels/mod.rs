//! The kernels: one algorithm in two languages. What shaders compute too has a twin of the same stem in `shaders/` with the same functions;
//! `tests/structure.rs` lists the pairs, and what one side alone needs.

pub mod bvh;
pub mod camera;
pub mod clearance;
pub mod constants;
pub mod curve;
pub mod integrator;
pub mod layout;
pub mod light;
pub mod material;
pub mod path;
pub mod primitive;
pub mod rng;
pub mod sampling;
pub mod surface;
pub mod table;
pub mod tableau;
pub mod texture;
pub mod traverser;
pub mod triangle;
pub mod view;
pub mod work;

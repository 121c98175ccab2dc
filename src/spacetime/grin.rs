//! Gradient-index media: Maxwell's fish-eye, Luneburg's lens, radial profiles, layers of air (mirages).
//!
//! Fish-eye: n = n0 / (1 + (r/R)^2), every ray a circle from a point to its image. Luneburg: n = sqrt(2 - (r/R)^2) inside R, 1 outside,
//! which focuses parallel light on the far rim. Radial: n = c0 + c1 r^2 + c2 r^4 + ... inside a radius and constant beyond it.
//! Layered: n changes with height only, from one index to the next by 3 t^2 - 2 t^3 between the heights given.

use super::{Medium, NoParameters, Scalar, Vec3, parameters};

/// Maxwell's fish-eye.
pub struct Fisheye;
/// Luneburg's lens.
pub struct Luneburg;
/// A polynomial in r^2.
pub struct Radial;
/// Layers.
pub struct Layered;

parameters! {
    /// A fish-eye around the origin.
    FisheyeLens {
        /// Index at the center.
        n0,
        /// Radius R at which the index has halved.
        radius
    }
}

parameters! {
    /// A lens around the origin.
    LuneburgLens {
        /// Radius R of the rim.
        radius
    }
}

parameters! {
    /// A profile around the origin.
    RadialProfile {
        /// Coefficients of r^0, r^2, r^4, r^6, r^8.
        c0, c1, c2, c3, c4,
        /// Radius beyond which the index is constant.
        radius
    }
}

parameters! {
    /// The index at the lowest height, and the way up.
    LayerFrame {
        /// Unit normal of the layers.
        nx, ny, nz,
        /// Index below all layers.
        base
    }
}

parameters! {
    /// One change of index.
    Layer {
        /// Unit normal of the layers.
        nx, ny, nz,
        /// Heights between which the index changes.
        low, high,
        /// Change of the index.
        change
    }
}

impl Medium for Fisheye {
    type Global<S: Scalar> = FisheyeLens<S>;
    type Source<S: Scalar> = NoParameters;

    fn index<S: Scalar>(lens: &FisheyeLens<S>, x: Vec3<S>, _: S, _: S) -> S {
        lens.n0 / (S::constant(1.0) + x.dot(x) / lens.radius.square())
    }

    fn safe_step<S: Scalar>(lens: &FisheyeLens<S>, x: Vec3<S>, _: Vec3<S>) -> S {
        (x.dot(x) + lens.radius.square()).sqrt() * S::constant(0.5)
    }
}

impl Medium for Luneburg {
    type Global<S: Scalar> = LuneburgLens<S>;
    type Source<S: Scalar> = NoParameters;

    fn index<S: Scalar>(lens: &LuneburgLens<S>, x: Vec3<S>, _: S, _: S) -> S {
        (S::constant(2.0) - x.dot(x) / lens.radius.square()).max(S::constant(1.0)).sqrt()
    }

    fn safe_step<S: Scalar>(lens: &LuneburgLens<S>, _: Vec3<S>, _: Vec3<S>) -> S {
        lens.radius * S::constant(0.3)
    }
}

impl Medium for Radial {
    type Global<S: Scalar> = RadialProfile<S>;
    type Source<S: Scalar> = NoParameters;

    fn index<S: Scalar>(p: &RadialProfile<S>, x: Vec3<S>, _: S, _: S) -> S {
        let t = x.dot(x).min(p.radius.square());
        (((p.c4 * t + p.c3) * t + p.c2) * t + p.c1) * t + p.c0
    }

    fn safe_step<S: Scalar>(p: &RadialProfile<S>, x: Vec3<S>, _: Vec3<S>) -> S {
        (x.length_or_zero() - p.radius).max(S::constant(0.0)) + p.radius * S::constant(0.3)
    }
}

/// Parameters of a layer, in their order: from one height to the next the index changes by `change`.
pub fn layer_values(normal: [f64; 3], heights: [f64; 2], change: f64) -> [f64; 6] {
    [normal[0], normal[1], normal[2], heights[0], heights[1], change]
}

impl Medium for Layered {
    type Global<S: Scalar> = LayerFrame<S>;
    type Source<S: Scalar> = Layer<S>;

    fn source_potential<S: Scalar>(layer: &Layer<S>, x: Vec3<S>) -> S {
        let height = x.dot(Vec3(layer.nx, layer.ny, layer.nz));
        let t = ((height - layer.low) / (layer.high - layer.low)).max(S::constant(0.0)).min(S::constant(1.0));
        layer.change * t.square() * (S::constant(3.0) - t * S::constant(2.0))
    }

    fn index<S: Scalar>(frame: &LayerFrame<S>, _: Vec3<S>, potential: S, _: S) -> S {
        frame.base + potential
    }

    fn source_safe_step<S: Scalar>(layer: &Layer<S>, x: Vec3<S>, _: Vec3<S>) -> S {
        let height = x.dot(Vec3(layer.nx, layer.ny, layer.nz));
        let outside = (layer.low - height).max(height - layer.high).max(S::constant(0.0));
        // Rays go nearly along the layers: a step may be many thicknesses long before it leaves one.
        outside + (layer.high - layer.low) * S::constant(8.0)
    }
}

//! Rays that follow a law of motion outright (Groeller 1995): chaotic flows and parametric curves.
//!
//! Lorenz: V = (s (y - x), r x - y - x z, x y - b z); Roessler: V = (-y - z, x + a y, b + z (x - c)), at the point q = scale (x - offset)
//! of the field. The ray's velocity is the unit vector along (1 - w) d + w V/|V|, d its own direction: with the weight w = 1 it is a
//! flow line and forgets d. Parametric rays are x(s) = o + s d + A(s) n1 + B(s) n2 in the frame of their own direction, n1 as near to +Y
//! as it can be: parabola A = k s^2, sine A = k sin(w s), helix A = k (cos(w s) - 1), B = k sin(w s).

use super::{Flow, Scalar, Vec3, parameters};

/// The Lorenz flow.
pub struct Lorenz;
/// The Roessler flow.
pub struct Rossler;
/// Curves in the ray's own frame.
pub struct Parametric;

parameters! {
    /// Coefficients of the Lorenz flow and its place.
    LorenzField {
        /// Prandtl number, Rayleigh number, aspect.
        sigma, r, b,
        /// Field units per length, and the point of the world where the field's origin is.
        scale, ox, oy, oz,
        /// Weight of the flow against the ray's own direction.
        weight
    }
}

parameters! {
    /// Coefficients of the Roessler flow and its place.
    RosslerField {
        /// The three coefficients.
        a, b, c,
        /// Field units per length, and the point of the world where the field's origin is.
        scale, ox, oy, oz,
        /// Weight of the flow against the ray's own direction.
        weight
    }
}

parameters! {
    /// Velocity d + (linear s + wave cos(w s) + turn sin(w s)) n1 + around cos(w s) n2.
    ParametricCurve {
        /// Coefficients of the velocity.
        linear, wave, turn, around,
        /// Angular frequency w.
        frequency
    }
}

/// Unit vector along a vector, zero for a vanishing one.
fn unit<S: Scalar>(v: Vec3<S>) -> Vec3<S> {
    v * (S::constant(1.0) / v.length_or_zero())
}

fn blend<S: Scalar>(field: Vec3<S>, direction: Vec3<S>, weight: S) -> Vec3<S> {
    unit(direction * (S::constant(1.0) - weight) + unit(field) * weight)
}

impl Flow for Lorenz {
    type Global<S: Scalar> = LorenzField<S>;

    fn velocity<S: Scalar>(f: &LorenzField<S>, x: Vec3<S>, direction: Vec3<S>, _: S) -> Vec3<S> {
        let Vec3(x, y, z) = (x - Vec3(f.ox, f.oy, f.oz)) * f.scale;
        blend(Vec3(f.sigma * (y - x), f.r * x - y - x * z, x * y - f.b * z), direction, f.weight)
    }

    fn safe_step<S: Scalar>(f: &LorenzField<S>, _: Vec3<S>) -> S {
        S::constant(4.0) / f.scale
    }
}

impl Flow for Rossler {
    type Global<S: Scalar> = RosslerField<S>;

    fn velocity<S: Scalar>(f: &RosslerField<S>, x: Vec3<S>, direction: Vec3<S>, _: S) -> Vec3<S> {
        let Vec3(x, y, z) = (x - Vec3(f.ox, f.oy, f.oz)) * f.scale;
        blend(Vec3(-(y + z), x + f.a * y, f.b + z * (x - f.c)), direction, f.weight)
    }

    fn safe_step<S: Scalar>(f: &RosslerField<S>, _: Vec3<S>) -> S {
        S::constant(4.0) / f.scale
    }
}

impl Flow for Parametric {
    type Global<S: Scalar> = ParametricCurve<S>;

    fn velocity<S: Scalar>(c: &ParametricCurve<S>, _: Vec3<S>, d: Vec3<S>, s: S) -> Vec3<S> {
        let up = Vec3(S::constant(0.0), S::constant(1.0), S::constant(0.0));
        let n1 = unit(up - d * d.1);
        let n2 = d.cross(n1);
        let phase = c.frequency * s;
        d + n1 * (c.linear * s + c.wave * phase.cos() + c.turn * phase.sin()) + n2 * (c.around * phase.cos())
    }

    fn safe_step<S: Scalar>(c: &ParametricCurve<S>, _: Vec3<S>) -> S {
        S::constant(1.0) / c.frequency.max(S::constant(1e-6))
    }
}

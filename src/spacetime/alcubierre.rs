//! Alcubierre's warp bubble in coordinates that move with it (Alcubierre 1994; Weiskopf 2000).
//!
//! ds^2 = -dt^2 + (dX - v (f - 1) u dt)^2 with X = x - v t u, u the direction of travel, r = |X| and
//! f = [tanh(s (r + R)) - tanh(s (r - R))] / (2 tanh(s R)): lapse 1, space flat, shift v (1 - f) u. Inside (f = 1) the Eulerian observer is
//! at rest in the bubble, outside (f = 0) at rest in the world it flies through. The wall is as thin as 1/s with nothing to see on
//! either side, so steps are bounded by the distance to it.

use super::{Metric, Scalar, Scaled, Vec3, parameters};

/// The warp bubble.
pub struct Alcubierre;

parameters! {
    /// A bubble around the origin.
    Bubble {
        /// Speed v in units of light's.
        speed,
        /// Radius R.
        radius,
        /// Steepness s of the wall, an inverse length.
        sigma,
        /// Unit direction of travel u.
        ux, uy, uz
    }
}

/// Half thickness of the wall in units of 1/s.
const WALL: f64 = 4.0;

impl Metric for Alcubierre {
    type Global<S: Scalar> = Bubble<S>;

    fn shift<S: Scalar>(bubble: &Bubble<S>, x: Vec3<S>, _: [S; 3]) -> Scaled<S> {
        let r = x.length_or_zero();
        let norm = (bubble.sigma * bubble.radius).tanh() * S::constant(2.0);
        let f = ((bubble.sigma * (r + bubble.radius)).tanh() - (bubble.sigma * (r - bubble.radius)).tanh()) / norm;
        Scaled { factor: bubble.speed * (S::constant(1.0) - f), v: Vec3(bubble.ux, bubble.uy, bubble.uz) }
    }

    fn far_frequency<S: Scalar>(q: Vec3<S>, _: S) -> S {
        q.length()
    }

    fn safe_step<S: Scalar>(bubble: &Bubble<S>, x: Vec3<S>, _: Vec3<S>) -> S {
        let from_wall = x.length_or_zero() - bubble.radius;
        let width = S::constant(1.0) / bubble.sigma;
        (from_wall.max(-from_wall) - width * S::constant(WALL)).max(S::constant(0.0)) + width * S::constant(0.5)
    }
}

//! How the camera moves: orbit, look, fly, dolly, all as functions of where it is.

use crate::scene::Camera;
use glam::{DQuat, DVec3};

/// Least angle between the viewing direction and `up` (radians).
const POLE: f64 = 0.02;
/// Least distance of the target.
const NEAREST: f64 = 1e-3;
/// Farthest that camera and target may go, well inside what a scene may state.
const FARTHEST: f64 = 1e8;
/// Share of the distance that one notch of the wheel leaves.
const NOTCH: f64 = 0.88;

/// Where the camera is and what it looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The eye.
    pub position: DVec3,
    /// The point it looks at, around which it orbits.
    pub look_at: DVec3,
    /// What is up for it; of any length, not along the view.
    pub up: DVec3,
    /// Vertical field of view (degrees).
    pub fov: f64,
}

impl Pose {
    /// Unit viewing direction.
    pub fn forward(&self) -> DVec3 {
        (self.look_at - self.position).try_normalize().unwrap_or(DVec3::Z)
    }

    /// Unit directions to the right of the picture and to its top.
    pub fn right_and_up(&self) -> [DVec3; 2] {
        let forward = self.forward();
        let right = forward.cross(self.up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        [right, right.cross(forward)]
    }

    /// Distance of the target.
    pub fn distance(&self) -> f64 {
        self.position.distance(self.look_at)
    }

    /// Around the target, so far to the camera's right and up (radians). It stops short of the poles.
    pub fn orbit(self, right: f64, up: f64) -> Pose {
        let offset = self.position - self.look_at;
        Pose { position: self.look_at + turned(offset, self.up, right, up), ..self }
    }

    /// Turns the view so far to the right and up (radians). It stops short of the poles.
    pub fn look(self, right: f64, up: f64) -> Pose {
        let view = self.look_at - self.position;
        Pose { look_at: self.position + turned(view, self.up, -right, up), ..self }
    }

    /// Moves camera and target by lengths to the right, up and forward.
    pub fn fly(self, [right, up, forward]: [f64; 3]) -> Pose {
        let [axis_right, _] = self.right_and_up();
        let step = axis_right * right + self.up.normalize_or_zero() * up + self.forward() * forward;
        let moved = Pose { position: self.position + step, look_at: self.look_at + step, ..self };
        if moved.position.abs().max(moved.look_at.abs()).max_element() <= FARTHEST { moved } else { self }
    }

    /// Nearer to the target by notches of the wheel, or farther if negative.
    pub fn dolly(self, notches: f64) -> Pose {
        let distance = (self.distance() * NOTCH.powf(notches)).clamp(NEAREST, FARTHEST);
        Pose { position: self.look_at - self.forward() * distance, ..self }
    }
}

/// The camera as a person has put it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    /// Where it is.
    pub pose: Pose,
    /// Its velocity against the Eulerian observer, in units of light's.
    pub velocity: DVec3,
    /// Whether its focus goes with the target.
    pub follows_target: bool,
}

impl Eye {
    /// Puts a camera there.
    pub fn apply(&self, camera: &mut Camera) {
        let pose = &self.pose;
        let [right, up] = pose.right_and_up();
        camera.position = pose.position;
        camera.forward = pose.forward();
        camera.right = right;
        camera.up = up;
        camera.fov_radians = pose.fov.to_radians();
        camera.velocity = self.velocity;
        if self.follows_target {
            camera.focus_distance = pose.distance();
        }
    }
}

/// A vector turned about `axis` and then away from its foot (radians), but not to the poles.
fn turned(vector: DVec3, axis: DVec3, around: f64, up: f64) -> DVec3 {
    let axis = axis.try_normalize().unwrap_or(DVec3::Y);
    let size = vector.length();
    let Some(direction) = vector.try_normalize() else { return vector };
    let level = (direction - axis * direction.dot(axis)).try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
    let level = DQuat::from_axis_angle(axis, around) * level;
    let height = direction.dot(axis).clamp(-1.0, 1.0).asin() + up;
    let limit = std::f64::consts::FRAC_PI_2 - POLE;
    let (sin, cos) = height.clamp(-limit, limit).sin_cos();
    (level * cos + axis * sin) * size
}

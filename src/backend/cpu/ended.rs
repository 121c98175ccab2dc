//! Rays that ended: what is observed there is computed for a register of them at once.

use super::advance::Landing;
use super::lanes::{Ends, Lanes, Row};
use super::solo::{Observed, Solo};
use super::step::*;
use crate::kernels::constants::*;
use crate::kernels::integrator::*;
use crate::kernels::surface::matter_velocity;
use crate::spacetime::Class;
use fearless_simd::Simd;

/// Rays that ended and are not reported yet, so that what is observed there is computed for many at once.
pub struct Ended<T> {
    ends: Ends<T>,
    rays: Vec<EndedRay<T>>,
}

struct EndedRay<T> {
    /// Which ray.
    index: usize,
    /// Where it ended.
    solo: Solo<T>,
    /// `STATUS_*`.
    status: u32,
    /// Frequency at the start.
    frequency: T,
    /// Relative drift of the conserved Hamiltonian, if it is wanted.
    drift: f32,
}

impl<T: Scalar> Ended<T> {
    /// None yet.
    pub fn none() -> Self {
        Ended { ends: Ends::idle(), rays: Vec::with_capacity(T::WIDTH) }
    }

    /// Whether there is no room for another.
    #[inline(always)]
    pub fn is_full(&self) -> bool {
        self.rays.len() == T::WIDTH
    }

    /// Adds the end of lane `i`; there must be room.
    #[inline(always)]
    pub fn add(&mut self, course: &Course<T>, functions: &PointFunctions<T>, lanes: &Lanes<T>, i: usize, solo: Solo<T>, status: u32) {
        let (energy, sense) = (lanes.energy[i], lanes.sense[i]);
        let drift = if course.drift {
            let at = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
            let (x, p) = (at(&lanes.x), at(&lanes.p));
            (functions.observe)((), course.model, x, p, energy, sense, lanes.parameter[i]).2.to_f32().abs()
        } else {
            0.0
        };
        let (to, ends) = (self.rays.len(), &mut self.ends);
        for (axis, x) in solo.end().into_iter().enumerate() {
            (ends.x[axis][to], ends.p[axis][to]) = (x, solo.p[axis]);
        }
        (ends.energy[to], ends.sense[to], ends.parameter[to]) = (energy, sense, solo.parameter);
        self.rays.push(EndedRay { index: lanes.index[i], solo, status, frequency: lanes.frequency[i], drift });
    }

    /// Reports them all.
    #[inline]
    pub fn report<S: Simd>(
        &mut self,
        simd: S,
        course: &Course<T>,
        functions: &PointFunctions<T>,
        kernels: &ModelKernels<S, T>,
        land: &mut impl FnMut(usize, Landing<T>),
    ) {
        if self.rays.is_empty() {
            return;
        }
        (kernels.observe)(simd, course, &mut self.ends);
        let ends = &self.ends;
        for (i, ray) in self.rays.drain(..).enumerate() {
            let at = |v: &[Row<T>; 3]| [v[0][i], v[1][i], v[2][i]];
            let frequency = ends.frequency[i];
            let escaped = ray.status == STATUS_ESCAPED;
            let end = if escaped { ends.far_frequency[i] } else { frequency };
            let mut frame = [[1.0; 3], [0.0; 3]];
            let mut doppler = 1.0;
            if let Some((hit, position)) = ray.solo.hit {
                if course.kind.class() == Class::Metric {
                    frame = [to_vec3(at(&ends.frame_diagonal)).into(), to_vec3(at(&ends.frame_mixed)).into()];
                }
                if let Some(velocity) = matter_velocity(&course.view, &hit, position) {
                    let (x, p, energy, sense) = (at(&ends.x), at(&ends.p), ends.energy[i], ends.sense[i]);
                    let emitted = (functions.matter_frequency)((), course.model, x, p, energy, sense, from_vec3(velocity));
                    doppler = (frequency / emitted).to_f32();
                }
            }
            let observed = Observed {
                // An escaped ray has its asymptotic direction already, unless the chart moves.
                direction: if escaped && !course.kind.moves_at_infinity() { None } else { Some(at(&ends.direction)) },
                redshift: (ray.frequency / end).to_f32(),
                constraint_error: ray.drift,
                frame,
                doppler,
            };
            land(ray.index, ray.solo.landing(ray.status, &observed));
        }
    }
}

//! The state of rays in flight, a row of numbers for each of its parts, a lane for each ray.

use super::step::Scalar;
use crate::kernels::bvh::{RootSpans, Slabs};
use crate::kernels::curve::Curve;
use crate::kernels::integrator::Flight;
use crate::simd::{Lane, MAX_LANES, load3};
use bytemuck::Zeroable;

/// A number per lane.
pub type Row<T> = [T; MAX_LANES];

/// The lanes of a mask, the first first.
#[inline(always)]
pub fn lanes_of(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(
        #[inline(always)]
        move || {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask.wrapping_sub(1);
            (lane < MAX_LANES).then_some(lane)
        },
    )
}

/// State of the rays in flight, and where the step in hand leads.
#[derive(Zeroable)]
#[repr(align(64))]
pub struct Lanes<T> {
    /// Positions.
    pub x: [Row<T>; 3],
    /// Momenta.
    pub p: [Row<T>; 3],
    /// Velocities.
    pub v: [Row<T>; 3],
    /// Forces.
    pub a: [Row<T>; 3],
    /// Step lengths, in the model's parameter.
    pub h: Row<T>,
    /// Parameters so far.
    pub parameter: Row<T>,
    /// Conserved energies.
    pub energy: Row<T>,
    /// Senses.
    pub sense: Row<T>,
    /// Frequencies at the start.
    pub frequency: Row<T>,
    /// Widths of the cones at the start.
    pub width: Row<T>,
    /// Growth of the cones.
    pub spread: Row<T>,
    /// Lengths by which the errors of the steps are measured.
    pub detail: Row<T>,
    /// Lengths with which the last steps would just have met their tolerance, in the model's parameter; 0 where that is not known.
    pub ideal: Row<T>,
    /// Lower bounds of the clearance, in cells of the coarsest level of the grid.
    pub room: Row<T>,
    /// Coordinate lengths so far.
    pub length: Row<T>,
    /// Signed distances from where the rays are to stop: negative before it.
    pub until: Row<T>,
    /// State at the end of the step.
    pub next: Next<T>,
    /// Which ray is in each lane.
    pub index: [usize; MAX_LANES],
    /// Steps of each ray.
    pub steps: [u32; MAX_LANES],
    /// Chords of each ray.
    pub chords: [u32; MAX_LANES],
    /// Side of the wormhole each ray is on: 0 or 1.
    pub side: [u32; MAX_LANES],
}

/// State at the end of a step.
#[derive(Zeroable)]
#[repr(align(64))]
pub struct Next<T> {
    /// Positions.
    pub x: [Row<T>; 3],
    /// Momenta.
    pub p: [Row<T>; 3],
    /// Velocities.
    pub v: [Row<T>; 3],
    /// Forces.
    pub a: [Row<T>; 3],
    /// Local errors of the steps.
    pub error: Row<T>,
    /// How far the cubics through both ends stray from the rays between.
    pub stray: Row<T>,
    /// Lengths that the model allows the next steps, in its parameter.
    pub safe: Row<T>,
    /// Lengths by which their errors are measured.
    pub detail: Row<T>,
    /// Lengths with which the steps would just have met their tolerance, in the model's parameter; 0 where that is not known.
    pub ideal: Row<T>,
    /// Lengths of the next steps.
    pub h: Row<T>,
    /// Coordinate lengths of the steps.
    pub travelled: Row<T>,
    /// Lower bounds of the clearance there, in cells of the coarsest level of the grid.
    pub room: Row<T>,
    /// Where geometry may be met first along each step.
    pub from: Row<T>,
    /// Where it may be met last.
    pub to: Row<T>,
    /// The steps between these, cut into chords; valid where geometry may be met.
    pub pieces: Pieces<T>,
}

/// Pieces of steps as [`Curve`]s, and their chords as [`Slabs`].
#[derive(Zeroable)]
#[repr(align(64))]
pub struct Pieces<T> {
    start: [Row<T>; 3],
    c1: [Row<T>; 3],
    c2: [Row<T>; 3],
    c3: [Row<T>; 3],
    chords: Row<T>,
    inverse: [Row<T>; 3],
    near: [Row<T>; 3],
    far: [Row<T>; 3],
    /// Where they meet the root of the BVH.
    pub root: RootSpans<T>,
}

impl<T: Scalar> Pieces<T> {
    /// Keeps a piece for each lane.
    #[inline(always)]
    pub fn store<L: Lane<Real = T>>(&mut self, curve: &Curve<L>, slabs: &Slabs<L>) {
        let mut all = [
            (&mut self.start, curve.start),
            (&mut self.c1, curve.c1),
            (&mut self.c2, curve.c2),
            (&mut self.c3, curve.c3),
            (&mut self.inverse, slabs.inverse),
            (&mut self.near, slabs.near),
            (&mut self.far, slabs.far),
        ];
        for (rows, values) in &mut all {
            for axis in 0..3 {
                values[axis].store(&mut rows[axis]);
            }
        }
        curve.chords.store(&mut self.chords);
    }

    /// The piece of lane `i`.
    #[inline(always)]
    pub fn of_lane(&self, i: usize) -> (Curve<f32>, Slabs<f32>) {
        let at = |rows: &[Row<T>; 3]| [rows[0][i].to_f32(), rows[1][i].to_f32(), rows[2][i].to_f32()];
        let (start, c1, c2, c3) = (at(&self.start), at(&self.c1), at(&self.c2), at(&self.c3));
        let (inverse, near, far) = (at(&self.inverse), at(&self.near), at(&self.far));
        (Curve { start, c1, c2, c3, chords: self.chords[i].to_f32() }, Slabs { inverse, near, far })
    }
}

impl<T: Scalar> Lanes<T> {
    /// Lanes without rays, far from everything.
    pub fn idle() -> Self {
        let one = [T::from_f64(1.0); MAX_LANES];
        let far = [T::from_f64(1e6); MAX_LANES];
        Lanes {
            x: [far; 3],
            p: [one; 3],
            v: [one; 3],
            energy: one,
            sense: one,
            frequency: one,
            width: one,
            detail: one,
            ..Zeroable::zeroed()
        }
    }

    /// State and derivatives at the start of the step.
    #[inline(always)]
    pub fn flight<L: Lane<Real = T>>(&self, token: L::Token) -> Flight<L> {
        Flight { x: load3(token, &self.x), p: load3(token, &self.p), v: load3(token, &self.v), a: load3(token, &self.a) }
    }

    /// Moves the lanes of `accepted` to the end of their step.
    #[inline(always)]
    pub fn commit<L: Lane<Real = T>>(&mut self, token: L::Token, accepted: u32) {
        let moves = L::mask(token, accepted);
        let next = &self.next;
        // A row chosen from itself and another becomes a masked store, which takes some processors twenty times as long as a whole one;
        // so the compiler does not get to see that it is itself.
        let hidden = |row: &Row<T>| std::hint::black_box(L::load(token, row));
        for axis in 0..3 {
            for (row, moved) in [
                (&mut self.x[axis], &next.x[axis]),
                (&mut self.p[axis], &next.p[axis]),
                (&mut self.v[axis], &next.v[axis]),
                (&mut self.a[axis], &next.a[axis]),
            ] {
                L::select(moves, L::load(token, moved), hidden(row)).store(row);
            }
        }
        for (row, moved) in [(&mut self.detail, &next.detail), (&mut self.ideal, &next.ideal), (&mut self.room, &next.room)] {
            L::select(moves, L::load(token, moved), hidden(row)).store(row);
        }
        for (row, gain) in [(&mut self.parameter, &self.h), (&mut self.length, &next.travelled)] {
            let before = hidden(row);
            L::select(moves, before + L::load(token, gain), before).store(row);
        }
        self.h = next.h;
    }

    /// The share of the whole step of lane `i` at parameter `t` of its piece.
    #[inline(always)]
    pub fn share(&self, i: usize, t: f32) -> T {
        let (from, to) = (self.next.from[i].to_f32(), self.next.to[i].to_f32());
        T::from_f64(f64::from(from + (to - from) * t))
    }

    /// Puts the ray in lane `from` of `other` into lane `to`.
    #[inline(always)]
    pub fn take(&mut self, to: usize, other: &Lanes<T>, from: usize) {
        for axis in 0..3 {
            self.x[axis][to] = other.x[axis][from];
            self.p[axis][to] = other.p[axis][from];
            self.v[axis][to] = other.v[axis][from];
            self.a[axis][to] = other.a[axis][from];
        }
        self.h[to] = other.h[from];
        self.parameter[to] = other.parameter[from];
        self.energy[to] = other.energy[from];
        self.sense[to] = other.sense[from];
        self.frequency[to] = other.frequency[from];
        self.width[to] = other.width[from];
        self.spread[to] = other.spread[from];
        self.detail[to] = other.detail[from];
        self.ideal[to] = T::from_f64(0.0);
        self.room[to] = other.room[from];
        self.length[to] = other.length[from];
        self.until[to] = other.until[from];
        self.index[to] = other.index[from];
        self.steps[to] = other.steps[from];
        self.chords[to] = other.chords[from];
        self.side[to] = other.side[from];
    }
}

/// Ends of rays, and what a local observer sees there.
#[derive(Zeroable)]
#[repr(align(64))]
pub struct Ends<T> {
    /// Positions.
    pub x: [Row<T>; 3],
    /// Momenta.
    pub p: [Row<T>; 3],
    /// Conserved energies.
    pub energy: Row<T>,
    /// Senses.
    pub sense: Row<T>,
    /// Parameters.
    pub parameter: Row<T>,
    /// Unit directions of travel in the local frame.
    pub direction: [Row<T>; 3],
    /// Frequencies there.
    pub frequency: Row<T>,
    /// Frequencies for a distant static observer, if the rays escape.
    pub far_frequency: Row<T>,
    /// Diagonals of the local frames of a metric.
    pub frame_diagonal: [Row<T>; 3],
    /// Their entries xy, xz, yz.
    pub frame_mixed: [Row<T>; 3],
}

impl<T: Scalar> Ends<T> {
    /// Far from everything.
    pub fn idle() -> Self {
        let Lanes { x, p, energy, sense, .. } = Lanes::idle();
        Ends { x, p, energy, sense, ..Zeroable::zeroed() }
    }
}

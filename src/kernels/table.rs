//! A table of three functions over the unit square as a bicubic B-spline: part of the metric of models without a closed form.

use super::constants::*;
use crate::simd::{Lane, MAX_LANES, Real};
use crate::spacetime::dust_disc::table::TABLE_SIZE;

// The solver, which the build script compiles too, cannot read the kernels' constants.
const _: () = assert!(TABLE_SIZE[0] == TABLE_ROWS as usize && TABLE_SIZE[1] == TABLE_COLUMNS as usize);

/// Weights of the four control points of a cubic B-spline at the fraction `f` of a cell, and their derivatives.
#[inline(always)]
pub fn spline_weights<T: Real>(f: T) -> ([T; 4], [T; 4]) {
    let c = T::from_f64;
    let (f2, g) = (f * f, c(1.0) - f);
    let f3 = f2 * f;
    let sixth = c(1.0 / 6.0);
    let weights = [g * g * g * sixth, (c(3.0) * f3 - c(6.0) * f2 + c(4.0)) * sixth, (c(3.0) * (f2 - f3 + f) + c(1.0)) * sixth, f3 * sixth];
    let slopes = [c(-0.5) * g * g, c(1.5) * f2 - c(2.0) * f, f + c(0.5) - c(1.5) * f2, c(0.5) * f2];
    (weights, slopes)
}

/// The three functions at (u, v), each in [0, 1], and their derivatives by u and by v.
///
/// `table` holds `TABLE_ROWS` x `TABLE_COLUMNS` control points of three numbers, rows of constant u.
#[inline(always)]
pub fn table_lookup<L: Lane>(token: L::Token, table: &[L::Real], u: L, v: L) -> ([L; 3], [L; 3], [L; 3]) {
    let mut lanes = [[L::Real::default(); MAX_LANES]; 11];
    u.store(&mut lanes[9]);
    v.store(&mut lanes[10]);
    for i in 0..L::LANES {
        let found = lookup_one(table, lanes[9][i], lanes[10][i]);
        for (lane, value) in lanes.iter_mut().zip(found) {
            lane[i] = value;
        }
    }
    let three = |first: usize| [L::load(token, &lanes[first]), L::load(token, &lanes[first + 1]), L::load(token, &lanes[first + 2])];
    (three(0), three(3), three(6))
}

/// Values, derivatives by u and derivatives by v at one point.
fn lookup_one<T: Real>(table: &[T], u: T, v: T) -> [T; 9] {
    let (rows, columns) = ((TABLE_ROWS - 3) as f64, (TABLE_COLUMNS - 3) as f64);
    let (cells_u, cells_v) = (T::from_f64(rows), T::from_f64(columns));
    let (s, t) = (u * cells_u, v * cells_v);
    // What is not a number reads the first cell and stays one.
    let (i, j) = (s.to_f64().clamp(0.0, rows - 1.0) as usize, t.to_f64().clamp(0.0, columns - 1.0) as usize);
    let (weight_u, slope_u) = spline_weights(s - T::from_f64(i as f64));
    let (weight_v, slope_v) = spline_weights(t - T::from_f64(j as f64));
    let mut sums = [T::from_f64(0.0); 9];
    for a in 0..4 {
        for b in 0..4 {
            let at = 3 * ((i + a) * TABLE_COLUMNS as usize + j + b);
            for k in 0..3 {
                let control = table[at + k];
                sums[k] = sums[k] + weight_u[a] * weight_v[b] * control;
                sums[3 + k] = sums[3 + k] + slope_u[a] * weight_v[b] * control * cells_u;
                sums[6 + k] = sums[6 + k] + weight_u[a] * slope_v[b] * control * cells_v;
            }
        }
    }
    sums
}

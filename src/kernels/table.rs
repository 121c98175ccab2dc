//! A table of three functions over the unit square as a bicubic B-spline: part of the metric of models without a closed form.

use super::constants::*;
use crate::simd::{Lane, MAX_LANES, Real, store};
use crate::spacetime::dust_disc::table::TABLE_SIZE;

// The solver, which the build script compiles too, cannot read the kernels' constants.
const _: () = assert!(TABLE_SIZE[0] == TABLE_ROWS as usize && TABLE_SIZE[1] == TABLE_COLUMNS as usize);

/// Weights of the four control points of a cubic B-spline at the fraction `f` of a cell, and their derivatives.
#[inline(always)]
pub fn spline_weights<L: Lane>(token: L::Token, f: L) -> ([L; 4], [L; 4]) {
    let c = |value: f64| L::constant(token, value);
    let (f2, g) = (f * f, c(1.0) - f);
    let f3 = f2 * f;
    let sixth = c(1.0 / 6.0);
    let weights = [g * g * g * sixth, (c(3.0) * f3 - c(6.0) * f2 + c(4.0)) * sixth, (c(3.0) * (f2 - f3 + f) + c(1.0)) * sixth, f3 * sixth];
    let slopes = [c(-0.5) * g * g, c(1.5) * f2 - c(2.0) * f, f + c(0.5) - c(1.5) * f2, c(0.5) * f2];
    (weights, slopes)
}

/// Four control points of each lane, from the one at `first` on, summed by weights and by slopes.
#[inline(always)]
pub fn table_row<L: Lane>(
    token: L::Token,
    table: &[L::Real],
    first: &[usize; MAX_LANES],
    weights: &[L; 4],
    slopes: &[L; 4],
) -> ([L; 3], [L; 3]) {
    let mut controls = [[L::Real::default(); MAX_LANES]; 12];
    for (lane, &first) in first.iter().enumerate().take(L::LANES) {
        for (control, &value) in controls.iter_mut().zip(&table[3 * first..3 * first + 12]) {
            control[lane] = value;
        }
    }
    let zero = [L::constant(token, 0.0); 3];
    let (mut value, mut change) = (zero, zero);
    for (b, (&weight, &slope)) in weights.iter().zip(slopes).enumerate() {
        for k in 0..3 {
            let control = L::load(token, &controls[3 * b + k]);
            value[k] = control.mul_add(weight, value[k]);
            change[k] = control.mul_add(slope, change[k]);
        }
    }
    (value, change)
}

/// The three functions at (u, v), each in [0, 1], and their derivatives by u and by v.
///
/// `table` holds `TABLE_ROWS` x `TABLE_COLUMNS` control points of three numbers, rows of constant u.
#[inline(always)]
pub fn table_lookup<L: Lane>(token: L::Token, table: &[L::Real], u: L, v: L) -> ([L; 3], [L; 3], [L; 3]) {
    let c = |value: u32| L::constant(token, f64::from(value));
    let (cells_u, cells_v) = (c(TABLE_ROWS - 3), c(TABLE_COLUMNS - 3));
    let (s, t) = (u * cells_u, v * cells_v);
    let i = s.max(c(0)).min(cells_u - c(1)).floor();
    let j = t.max(c(0)).min(cells_v - c(1)).floor();
    let (weights_u, slopes_u) = spline_weights(token, s - i);
    let (weights_v, slopes_v) = spline_weights(token, t - j);
    // What is not a number reads some cell and stays one.
    let (rows, columns) = (store(i), store(j));
    let mut first = std::array::from_fn(|lane| rows[lane].to_f64() as usize * TABLE_COLUMNS as usize + columns[lane].to_f64() as usize);
    let zero = [c(0); 3];
    let (mut value, mut by_u, mut by_v) = (zero, zero, zero);
    for (weight, slope) in weights_u.into_iter().zip(slopes_u) {
        let (along, change) = table_row(token, table, &first, &weights_v, &slopes_v);
        for k in 0..3 {
            value[k] = along[k].mul_add(weight, value[k]);
            by_u[k] = along[k].mul_add(slope * cells_u, by_u[k]);
            by_v[k] = change[k].mul_add(weight * cells_v, by_v[k]);
        }
        for at in &mut first {
            *at += TABLE_COLUMNS as usize;
        }
    }
    (value, by_u, by_v)
}

//! Rigidly rotating disc of dust (Neugebauer & Meinel, Phys. Rev. Lett. 75 (1995) 3046), tabulated once per parameter mu.
//!
//! The metric is ds^2 = e^{2 alpha} (drho^2 + dzeta^2) + rho^2 e^{-2 nu} (dphi - omega dt)^2 - e^{2 nu} dt^2, disc radius 1.
//! We do not invert the hyperelliptic integrals: nu and omega solve a boundary value problem (Bardeen & Wagoner 1971) that a
//! Chebyshev collocation in oblate spheroidal coordinates solves by Newton's method, on the disc itself too; the explicit solution
//! is the oracle of the tests. U, A and k of the form -e^{2U} (dt + A dphi)^2 are singular where e^{2U} = 0, the ergosurface,
//! which exists for mu > 1.69; nu, omega and alpha are smooth everywhere, so the table holds these.

use super::table::{DustDisc, TABLE_SIZE, spline_control};
use std::f64::consts::{FRAC_PI_2, PI};

/// Largest mu that `tabulate` accepts; the solution itself exists up to 4.63, where it becomes an extreme Kerr black hole.
pub const MU_MAX: f64 = 3.0;

/// Fewest control points along an axis: six samples, as the slopes at both ends take, and one point more at each end.
const LEAST_TABLE_SIZE: usize = 8;

/// Computes the table for one mu, 0 < mu <= `MU_MAX`; takes about a second, mostly dense linear algebra.
///
/// # Errors
/// A line of text if mu is outside its range or if Newton's method does not converge.
pub fn tabulate(mu: f64) -> Result<DustDisc, String> {
    tabulate_sized(mu, TABLE_SIZE)
}

/// As [`tabulate`], with `size` control points along s and along eta, at least 8 each, in place of [`TABLE_SIZE`].
///
/// # Errors
/// A line of text if mu is outside its range, if the table is too small, or if Newton's method does not converge.
pub fn tabulate_sized(mu: f64, size: [usize; 2]) -> Result<DustDisc, String> {
    if !(mu > 0.0 && mu <= MU_MAX) {
        return Err(format!("dust disc: mu = {mu} is outside 0 < mu <= {MU_MAX}"));
    }
    if size.iter().any(|count| *count < LEAST_TABLE_SIZE) {
        return Err(format!("dust disc: {} x {} control points, expected at least {LEAST_TABLE_SIZE} each", size[0], size[1]));
    }
    let field = Field::solve(mu)?;
    let samples = field.sample(size[0] - 2, size[1] - 2);
    let infinity = samples[(size[0] - 3) * (size[1] - 2)];
    Ok(DustDisc {
        mu,
        omega: field.omega,
        v0: 0.5 * (2.0 * field.omega * field.omega / mu).ln(),
        mass: -infinity[0],
        angular_momentum: 0.5 * infinity[1],
        size,
        values: spline_control(&samples, size[1] - 2),
    })
}

/// Chebyshev-Gauss-Radau nodes mapped to [0, end]: with `end` itself (`closed_at_end`) or with 0, without the other.
struct Nodes {
    at: Vec<f64>,
    barycentric: Vec<f64>,
    /// First and second differentiation matrices, row-major.
    first: Vec<f64>,
    second: Vec<f64>,
}

impl Nodes {
    fn radau(count: usize, end: f64, closed_at_end: bool) -> Self {
        let angle = |j: usize| (2.0 * PI * j as f64 / (2 * count - 1) as f64).cos();
        let at: Vec<f64> = (0..count).map(|j| 0.5 * end * if closed_at_end { 1.0 + angle(j) } else { 1.0 - angle(j) }).collect();
        // Scaling by 4 / end keeps the products near 1.
        let product = |j: usize| (0..count).filter(|&k| k != j).map(|k| (at[j] - at[k]) * 4.0 / end).product::<f64>();
        let barycentric: Vec<f64> = (0..count).map(|j| 1.0 / product(j)).collect();
        let mut first = vec![0.0; count * count];
        let mut second = vec![0.0; count * count];
        for i in 0..count {
            let mut diagonal = 0.0;
            for j in (0..count).filter(|&j| j != i) {
                first[i * count + j] = barycentric[j] / barycentric[i] / (at[i] - at[j]);
                diagonal -= first[i * count + j];
            }
            first[i * count + i] = diagonal;
            let mut second_diagonal = 0.0;
            for j in (0..count).filter(|&j| j != i) {
                second[i * count + j] = 2.0 * first[i * count + j] * (diagonal - 1.0 / (at[i] - at[j]));
                second_diagonal -= second[i * count + j];
            }
            second[i * count + i] = second_diagonal;
        }
        Self { at, barycentric, first, second }
    }

    fn count(&self) -> usize {
        self.at.len()
    }

    /// Weights that interpolate nodal values to x.
    fn weights_at(&self, x: f64) -> Vec<f64> {
        if let Some(hit) = self.at.iter().position(|&node| node == x) {
            return (0..self.count()).map(|j| if j == hit { 1.0 } else { 0.0 }).collect();
        }
        let terms: Vec<f64> = self.at.iter().zip(&self.barycentric).map(|(node, weight)| weight / (x - node)).collect();
        let sum: f64 = terms.iter().sum();
        terms.iter().map(|term| term / sum).collect()
    }

    /// Weights that give the derivative of the interpolant at x.
    fn slope_weights_at(&self, x: f64) -> Vec<f64> {
        let count = self.count();
        let weights = self.weights_at(x);
        (0..count).map(|j| (0..count).map(|i| weights[i] * self.first[i * count + j]).sum()).collect()
    }
}

/// Solution at the nodes of theta = arccot xi (0 is infinity, pi/2 the disc) and y = eta^2.
struct Field {
    theta: Nodes,
    y: Nodes,
    /// n, then w: theta-major; the derivative of a function of xi or eta never leaves a row or a column.
    unknowns: [Vec<f64>; 2],
    omega: f64,
}

/// One of n, w at a node with its derivatives.
#[derive(Clone, Copy)]
struct Jet {
    value: f64,
    theta: f64,
    theta2: f64,
    y: f64,
    y2: f64,
}

/// Partial derivatives of an equation by the members of a `Jet`, same order.
type JetRow = [f64; 5];

/// Nodes of theta and of y on the way to mu.
const COARSE: [usize; 2] = [18, 10];
/// Nodes for the result. Measured error of V0 with 24 x 16: 2e-9 at mu = 1.6, 6e-7 at mu = 3; with 32 x 22: 1e-9 at mu = 3.
const FINE: [usize; 2] = [24, 16];
const FINEST: [usize; 2] = [32, 22];
const FINE_UP_TO_MU: f64 = 1.75;
const LARGEST_MU_STEP: f64 = 0.5;
const NEWTON_STEPS: usize = 12;
/// Newton's method doubles the digits per step, so that what is left after a step this small is rounding.
const LAST_STEP: f64 = 1e-6;

impl Field {
    /// Walks from a nearly Newtonian disc to mu on a coarse grid, then refines.
    fn solve(mu: f64) -> Result<Self, String> {
        let stages = (mu / LARGEST_MU_STEP).ceil().max(1.0);
        let mut field = Self::newtonian(COARSE, mu / stages);
        for stage in 1..=stages as usize {
            field.relax(mu * stage as f64 / stages)?;
        }
        let mut fine = field.resampled(if mu <= FINE_UP_TO_MU { FINE } else { FINEST });
        fine.relax(mu)?;
        Ok(fine)
    }

    /// Maclaurin disc: nu = -M {arccot xi + P2(eta) [(3 xi^2 + 1) arccot xi - 3 xi] / 2}, M = 4 Omega^2 / (3 pi), omega = 0.
    fn newtonian(size: [usize; 2], mu: f64) -> Self {
        let theta = Nodes::radau(size[0], FRAC_PI_2, true);
        let y = Nodes::radau(size[1], 1.0, false);
        // V0 = -Omega^2 closes mu = 2 Omega^2 e^{-2 V0} well enough for a start.
        let square = 0.5 * mu / (1.0 + mu);
        let mass = 4.0 * square / (3.0 * PI);
        let mut n = Vec::with_capacity(size[0] * size[1]);
        for &t in &theta.at {
            let xi = 1.0 / t.tan();
            // Far out the bracket cancels; there it is 4 / (15 xi^3).
            let bracket = if xi > 30.0 { 4.0 / (15.0 * xi.powi(3)) } else { (3.0 * xi * xi + 1.0) * t - 3.0 * xi };
            n.extend(y.at.iter().map(|&y| -mass * (t + 0.25 * (3.0 * y - 1.0) * bracket) / t.sin()));
        }
        let w = vec![0.0; n.len()];
        Self { theta, y, unknowns: [n, w], omega: square.sqrt() }
    }

    fn resampled(&self, size: [usize; 2]) -> Self {
        let theta = Nodes::radau(size[0], FRAC_PI_2, true);
        let y = Nodes::radau(size[1], 1.0, false);
        let across: Vec<Vec<f64>> = y.at.iter().map(|&y| self.y.weights_at(y)).collect();
        let unknowns = [0, 1].map(|k| {
            let mut values = Vec::with_capacity(size[0] * size[1]);
            for &t in &theta.at {
                let column = self.combine_rows(k, &self.theta.weights_at(t));
                values.extend(across.iter().map(|weights| dot(weights, &column)));
            }
            values
        });
        Self { theta, y, unknowns, omega: self.omega }
    }

    /// Sum over theta of weights times the nodal values of unknown k: one number per y node.
    fn combine_rows(&self, k: usize, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.y.count()];
        for (weight, row) in weights.iter().zip(self.unknowns[k].chunks_exact(self.y.count())) {
            for (total, value) in sum.iter_mut().zip(row) {
                *total += weight * value;
            }
        }
        sum
    }

    fn jet(&self, k: usize, i: usize, j: usize) -> Jet {
        let (rows, columns) = (self.theta.count(), self.y.count());
        let values = &self.unknowns[k];
        let along = |matrix: &[f64]| (0..rows).map(|m| matrix[i * rows + m] * values[m * columns + j]).sum::<f64>();
        let across = |matrix: &[f64]| (0..columns).map(|m| matrix[j * columns + m] * values[i * columns + m]).sum::<f64>();
        Jet {
            value: values[i * columns + j],
            theta: along(&self.theta.first),
            theta2: along(&self.theta.second),
            y: across(&self.y.first),
            y2: across(&self.y.second),
        }
    }

    /// Newton's method at fixed mu.
    fn relax(&mut self, mu: f64) -> Result<(), String> {
        let points = self.unknowns[0].len();
        for _ in 0..NEWTON_STEPS {
            let (mut matrix, mut step) = self.linearize(mu);
            if !solve_dense(&mut matrix, &mut step) {
                break;
            }
            let largest = step.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            if !largest.is_finite() {
                break;
            }
            for (p, change) in step[..2 * points].iter().enumerate() {
                self.unknowns[p / points][p % points] -= change;
            }
            self.omega -= step[2 * points];
            if largest < LAST_STEP {
                return Ok(());
            }
        }
        Err(format!("dust disc: Newton's method does not converge at mu = {mu}"))
    }

    /// Jacobian (row-major, square) and residual of all equations.
    fn linearize(&self, mu: f64) -> (Vec<f64>, Vec<f64>) {
        let (rows, columns) = (self.theta.count(), self.y.count());
        let points = rows * columns;
        let order = 2 * points + 1;
        let mut matrix = vec![0.0; order * order];
        let mut residual = vec![0.0; order];
        for i in 0..rows {
            for j in 0..columns {
                let jets = [self.jet(0, i, j), self.jet(1, i, j)];
                // Node 0 of theta is the disc.
                let equations = if i == 0 {
                    disc_conditions(&jets, self.y.at[j], self.omega, mu)
                } else {
                    vacuum_equations(&jets, self.theta.at[i], self.y.at[j])
                };
                for (k, equation) in equations.iter().enumerate() {
                    let row = k * points + i * columns + j;
                    residual[row] = equation.residual;
                    let line = &mut matrix[row * order..(row + 1) * order];
                    self.scatter(line, equation, i, j);
                }
            }
        }
        // The rim carries no density: d nu / d xi = 0 at xi = eta = 0 fixes Omega.
        residual[order - 1] = self.jet(0, 0, 0).theta;
        for m in 0..rows {
            matrix[(order - 1) * order + m * columns] = self.theta.first[m];
        }
        (matrix, residual)
    }

    /// Turns derivatives by the jets of node (i, j) into derivatives by the unknowns.
    fn scatter(&self, line: &mut [f64], equation: &Equation, i: usize, j: usize) {
        let (rows, columns) = (self.theta.count(), self.y.count());
        for (k, by) in equation.by_jet.iter().enumerate() {
            let block = &mut line[k * rows * columns..(k + 1) * rows * columns];
            block[i * columns + j] += by[0];
            for m in 0..rows {
                block[m * columns + j] += by[1] * self.theta.first[i * rows + m] + by[2] * self.theta.second[i * rows + m];
            }
            for m in 0..columns {
                block[i * columns + m] += by[3] * self.y.first[j * columns + m] + by[4] * self.y.second[j * columns + m];
            }
        }
        line[2 * rows * columns] = equation.by_omega;
    }

    /// (n, w, q) on a uniform grid of s = xi / (1 + xi) and eta, both from 0 to 1, rows of s.
    fn sample(&self, count_s: usize, count_eta: usize) -> Vec<[f64; 3]> {
        let columns = Columns::new(&self.y, count_eta);
        let mut samples = Vec::with_capacity(count_s * count_eta);
        for row in 0..count_s {
            let s = row as f64 / (count_s - 1) as f64;
            let theta = (1.0 - s).atan2(s);
            let (weights, slopes) = (self.theta.weights_at(theta), self.theta.slope_weights_at(theta));
            let lines = [0, 1].map(|k| [self.combine_rows(k, &weights), self.combine_rows(k, &slopes)]);
            let conformal = columns.integrate_conformal(&lines, theta);
            for (weights, q) in columns.nodes.iter().zip(conformal) {
                samples.push([dot(weights, &lines[0][0]), dot(weights, &lines[1][0]), q]);
            }
        }
        samples
    }
}

/// One equation at one node: what is left over, and its derivatives by the two jets and by Omega.
struct Equation {
    residual: f64,
    by_jet: [JetRow; 2],
    by_omega: f64,
}

/// Vacuum field equations, divided by sin theta and sin^3 theta:
/// laplacian nu = rho^2 e^{-4 nu} |grad omega|^2 / 2 and div(rho^2 e^{-4 nu} grad omega) = 0.
fn vacuum_equations(jets: &[Jet; 2], theta: f64, y: f64) -> [Equation; 2] {
    let [n, w] = *jets;
    let (s, c) = theta.sin_cos();
    let x = 1.0 - y;
    let yx = 4.0 * y * x;

    // Source of nu: (1 - y) e^{-4 nu} sin^3 [(3 cos w + sin w_theta)^2 + 4 y (1 - y) w_y^2] / 2.
    let twist = 3.0 * c * w.value + s * w.theta;
    let strength = x * (-4.0 * s * n.value).exp() * s * s * s;
    let source = 0.5 * strength * (twist * twist + yx * w.y * w.y);
    let first = Equation {
        residual: s * s * n.theta2 + 2.0 * s * c * n.theta - s * s * n.value + yx * n.y2 + (2.0 - 6.0 * y) * n.y - source,
        by_jet: [
            [-s * s + 4.0 * s * source, 2.0 * s * c, s * s, 2.0 - 6.0 * y, yx],
            [-strength * twist * 3.0 * c, -strength * twist * s, 0.0, -strength * yx * w.y, 0.0],
        ],
        by_omega: 0.0,
    };

    let pull = c * n.value + s * n.theta;
    let second = Equation {
        residual: s * s * w.theta2 + 4.0 * s * c * w.theta - 3.0 * s * s * w.value + yx * w.y2 + (2.0 - 10.0 * y) * w.y
            - 4.0 * s * (pull * twist + yx * n.y * w.y),
        by_jet: [
            [-4.0 * s * c * twist, -4.0 * s * s * twist, 0.0, -4.0 * s * yx * w.y, 0.0],
            [-3.0 * s * s - 12.0 * s * c * pull, 4.0 * s * c - 4.0 * s * s * pull, s * s, 2.0 - 10.0 * y - 4.0 * s * yx * n.y, yx],
        ],
        by_omega: 0.0,
    };
    [first, second]
}

/// Dust that co-rotates with Omega: its Killing vector has the norm e^{2 V0} = 2 Omega^2 / mu, and A in the co-rotating frame has
/// no normal derivative (both together: the co-rotating Ernst potential is the constant e^{2 V0}).
fn disc_conditions(jets: &[Jet; 2], y: f64, omega: f64, mu: f64) -> [Equation; 2] {
    let [n, w] = *jets;
    let x = 1.0 - y;
    let lag = omega - w.value;
    let (lapse2, inverse2) = ((2.0 * n.value).exp(), (-2.0 * n.value).exp());
    let norm = Equation {
        residual: lapse2 - x * inverse2 * lag * lag - 2.0 * omega * omega / mu,
        by_jet: [[2.0 * lapse2 + 2.0 * x * inverse2 * lag * lag, 0.0, 0.0, 0.0, 0.0], [2.0 * x * inverse2 * lag, 0.0, 0.0, 0.0, 0.0]],
        by_omega: -2.0 * x * inverse2 * lag - 4.0 * omega / mu,
    };
    let speed2 = x * lag * lag * inverse2 * inverse2;
    let speed2_by_lag = 2.0 * x * lag * inverse2 * inverse2;
    let by_lag = 4.0 * n.theta + w.theta * speed2_by_lag;
    let normal = Equation {
        residual: 4.0 * n.theta * lag + w.theta * (1.0 + speed2),
        by_jet: [[-4.0 * w.theta * speed2, 4.0 * lag, 0.0, 0.0, 0.0], [-by_lag, 1.0 + speed2, 0.0, 0.0, 0.0]],
        by_omega: by_lag,
    };
    [norm, normal]
}

/// Abscissae in (-1, 1) and weights of the five-point Gauss rule.
pub const GAUSS: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// Where a cell is integrated: y, the measure in y, and the weights of value and slope there.
struct GaussPoint {
    y: f64,
    measure: f64,
    value: Vec<f64>,
    slope: Vec<f64>,
}

/// Interpolation from the y nodes to a uniform grid of eta and to the Gauss points of its cells.
struct Columns {
    nodes: Vec<Vec<f64>>,
    gauss: Vec<[GaussPoint; 5]>,
    /// Slope weights at the axis.
    axis: Vec<f64>,
}

impl Columns {
    fn new(y: &Nodes, count: usize) -> Self {
        let width = 1.0 / (count - 1) as f64;
        let nodes = (0..count).map(|j| y.weights_at((j as f64 * width).powi(2))).collect();
        let point = |cell: usize, (x, weight): (f64, f64)| {
            let eta = (cell as f64 + 0.5 * (1.0 + x)) * width;
            GaussPoint { y: eta * eta, measure: weight * width * eta, value: y.weights_at(eta * eta), slope: y.slope_weights_at(eta * eta) }
        };
        let gauss = (0..count - 1).map(|cell| GAUSS.map(|rule| point(cell, rule))).collect();
        Self { nodes, gauss, axis: y.slope_weights_at(1.0) }
    }

    /// q = (alpha + nu) / (sin^2 theta (1 - y)) along a row, integrated from the axis, where alpha + nu = 0.
    fn integrate_conformal(&self, lines: &[[Vec<f64>; 2]; 2], theta: f64) -> Vec<f64> {
        let count = self.nodes.len();
        let slope = |y: f64, value: &[f64], slope: &[f64]| {
            let jets = [0, 1].map(|k| Jet {
                value: dot(value, &lines[k][0]),
                theta: dot(value, &lines[k][1]),
                theta2: 0.0,
                y: dot(slope, &lines[k][0]),
                y2: 0.0,
            });
            conformal_slope(&jets, theta, y)
        };
        let mut q = vec![0.0; count];
        q[count - 1] = -slope(1.0, &self.nodes[count - 1], &self.axis);
        let mut integral = 0.0;
        for cell in (0..count - 1).rev() {
            for point in &self.gauss[cell] {
                integral -= point.measure * slope(point.y, &point.value, &point.slope);
            }
            let eta = cell as f64 / (count - 1) as f64;
            q[cell] = integral / (1.0 - eta * eta);
        }
        q
    }
}

/// d(alpha + nu)/dy / sin^2 theta at fixed theta, from k_z = 2 rho [nu_z^2 - rho^2 e^{-4 nu} omega_z^2 / 4] with z = rho + i zeta.
fn conformal_slope(jets: &[Jet; 2], theta: f64, y: f64) -> f64 {
    let [n, w] = *jets;
    let (s, c) = theta.sin_cos();
    let x = 1.0 - y;
    let pull = c * n.value + s * n.theta;
    let twist = 3.0 * c * w.value + s * w.theta;
    let strength = 0.25 * x * (-4.0 * s * n.value).exp() * s * s;
    let difference = pull * pull - 4.0 * y * x * n.y * n.y - strength * (twist * twist - 4.0 * y * x * w.y * w.y);
    let product = pull * n.y - strength * twist * w.y;
    0.5 * (difference - 4.0 * c * x * product) / (c * c + y * s * s)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Gaussian elimination with partial pivoting; `right` becomes the solution. False if the matrix is singular.
fn solve_dense(matrix: &mut [f64], right: &mut [f64]) -> bool {
    let order = right.len();
    for pivot in 0..order {
        let best = (pivot..order).max_by(|&a, &b| matrix[a * order + pivot].abs().total_cmp(&matrix[b * order + pivot].abs()));
        let Some(best) = best.filter(|&row| matrix[row * order + pivot] != 0.0) else {
            return false;
        };
        if best != pivot {
            let (above, below) = matrix.split_at_mut(best * order);
            above[pivot * order..(pivot + 1) * order].swap_with_slice(&mut below[..order]);
            right.swap(pivot, best);
        }
        let (above, below) = matrix.split_at_mut((pivot + 1) * order);
        let pivot_row = &above[pivot * order + pivot..];
        for (row, line) in below.chunks_exact_mut(order).enumerate() {
            let factor = line[pivot] / pivot_row[0];
            if factor != 0.0 {
                for (value, above) in line[pivot..].iter_mut().zip(pivot_row) {
                    *value -= factor * above;
                }
                right[pivot + 1 + row] -= factor * right[pivot];
            }
        }
    }
    for row in (0..order).rev() {
        let known = dot(&matrix[row * order + row + 1..(row + 1) * order], &right[row + 1..]);
        right[row] = (right[row] - known) / matrix[row * order + row];
    }
    true
}

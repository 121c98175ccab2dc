//! The field of the disc of dust as a table: a bicubic spline in oblate spheroidal coordinates.

/// Control points of the table: along s = xi / (1 + xi) and along eta.
pub const TABLE_SIZE: [usize; 2] = [96, 48];

/// Field of the disc as a bicubic B-spline over s = xi / (1 + xi) in [0, 1] and eta in [0, 1].
///
/// rho = sqrt(1 + xi^2) sqrt(1 - eta^2), |zeta| = xi eta; s = 0 is the disc, s = 1 is infinity, eta = 1 the axis, eta = 0 the
/// equatorial plane outside the disc. The spline gives three smooth functions (n, w, q), from which
/// nu = n / sqrt(1 + xi^2), omega = w / (1 + xi^2)^{3/2}, alpha = rho^2 q / (1 + xi^2)^2 - nu.
///
/// To evaluate, with `[m, n] = size`: u = s (m - 3), i = min(floor(u), m - 4), f = u - i, the same with eta and n for j and g; then
/// sum over a, b in 0..4 of B_a(f) B_b(g) `values[(i + a) n + j + b]`, with B_0 = (1-f)^3 / 6, B_1 = (3 f^3 - 6 f^2 + 4) / 6,
/// B_2 = (-3 f^3 + 3 f^2 + 3 f + 1) / 6, B_3 = f^3 / 6. The result has two continuous derivatives in s and eta.
#[derive(Clone, Debug)]
pub struct DustDisc {
    /// Parameter 2 Omega^2 rho0^2 e^{-2 V0}: 0 is Newtonian.
    pub mu: f64,
    /// Angular velocity of the dust, in units of 1 / rho0.
    pub omega: f64,
    /// Co-rotating surface potential V0 (the logarithm itself, negative): dust has u^t = e^{-V0}.
    pub v0: f64,
    /// Gravitational mass M in units of rho0: nu -> -M / r.
    pub mass: f64,
    /// Angular momentum J in units of rho0^2: omega -> 2 J / r^3.
    pub angular_momentum: f64,
    /// Control points along s and along eta.
    pub size: [usize; 2],
    /// B-spline control points of (n, w, q), rows of constant s.
    pub values: Vec<[f64; 3]>,
}

/// A point of the table: coordinates and their derivatives by rho and zeta.
struct Spheroidal {
    xi: f64,
    eta: f64,
    xi_gradient: [f64; 2],
    eta_gradient: [f64; 2],
}

impl Spheroidal {
    /// Oblate spheroidal coordinates of (rho, zeta); for zeta = 0 inside the disc the side zeta > 0 is meant.
    fn of(rho: f64, zeta: f64) -> Self {
        let height = zeta.abs();
        // (r - 1)(r + 1) in a form that keeps its digits near the rim.
        let excess = (rho - 1.0) * (rho + 1.0) + height * height;
        let root = excess.hypot(2.0 * height);
        let (xi, eta) = if excess >= 0.0 {
            let xi = (0.5 * (root + excess)).sqrt();
            (xi, if xi > 0.0 { (height / xi).min(1.0) } else { 0.0 })
        } else {
            let eta = (0.5 * (root - excess)).sqrt().min(1.0);
            (height / eta, eta)
        };
        let side = if zeta < 0.0 { -1.0 } else { 1.0 };
        // xi^2 + eta^2 = root vanishes only on the rim, where the gradient has no limit.
        let inverse = 1.0 / root.max(1e-12);
        Self {
            xi,
            eta,
            xi_gradient: [xi * rho * inverse, side * eta * (1.0 + xi * xi) * inverse],
            eta_gradient: [-eta * rho * inverse, side * xi * (1.0 - eta * eta) * inverse],
        }
    }
}

/// Weights of the four control points of a cubic B-spline and their derivatives by f.
fn spline_weights(f: f64) -> ([f64; 4], [f64; 4]) {
    let (f2, f3, g) = (f * f, f * f * f, 1.0 - f);
    let weights = [g * g * g / 6.0, (3.0 * f3 - 6.0 * f2 + 4.0) / 6.0, (-3.0 * f3 + 3.0 * f2 + 3.0 * f + 1.0) / 6.0, f3 / 6.0];
    let slopes = [-0.5 * g * g, 1.5 * f2 - 2.0 * f, -1.5 * f2 + f + 0.5, 0.5 * f2];
    (weights, slopes)
}

impl DustDisc {
    /// nu, omega and alpha at (rho, zeta), rho >= 0; even in zeta.
    pub fn evaluate(&self, rho: f64, zeta: f64) -> [f64; 3] {
        self.evaluate_with_gradient(rho, zeta).0
    }

    /// nu, omega and alpha, and of each the derivatives [d/drho, d/dzeta]; on the disc those of the side zeta > 0.
    pub fn evaluate_with_gradient(&self, rho: f64, zeta: f64) -> ([f64; 3], [[f64; 2]; 3]) {
        let at = Spheroidal::of(rho, zeta);
        let s = at.xi / (1.0 + at.xi);
        let (spline, by_s, by_eta) = self.spline(s, at.eta);

        // Undo the scaling: nu = c n, omega = c^3 w, alpha + nu = rho^2 c^4 q with c = 1 / sqrt(1 + xi^2).
        let c = 1.0 / (1.0 + at.xi * at.xi).sqrt();
        let (c2, c3) = (c * c, c * c * c);
        let [n, w, q] = spline;
        let nu = c * n;
        let kappa = rho * rho * c2 * c2 * q;

        let s_by_xi = (1.0 - s) * (1.0 - s);
        let c_by_xi = -at.xi * c3;
        let mut gradient = [[0.0; 2]; 3];
        for (axis, rho_d) in [1.0, 0.0].into_iter().enumerate() {
            let (xi_d, eta_d) = (at.xi_gradient[axis], at.eta_gradient[axis]);
            let along = |k: usize| by_s[k] * s_by_xi * xi_d + by_eta[k] * eta_d;
            let c_d = c_by_xi * xi_d;
            gradient[0][axis] = c * along(0) + c_d * n;
            gradient[1][axis] = c3 * along(1) + 3.0 * c2 * c_d * w;
            let kappa_d = rho * c3 * (2.0 * rho_d * c * q + 4.0 * rho * c_d * q + rho * c * along(2));
            gradient[2][axis] = kappa_d - gradient[0][axis];
        }
        ([nu, c3 * w, kappa - nu], gradient)
    }

    /// U, A and k of ds^2 = e^{-2U} [e^{2k} (drho^2 + dzeta^2) + rho^2 dphi^2] - e^{2U} (dt + A dphi)^2, or None where
    /// e^{2U} <= 0 (the ergoregion, mu > 1.69). A -> +2 J rho^2 / r^3 for Omega > 0.
    pub fn papapetrou(&self, rho: f64, zeta: f64) -> Option<[f64; 3]> {
        let [nu, omega, alpha] = self.evaluate(rho, zeta);
        let inertia = rho * rho * (-2.0 * nu).exp();
        let e2u = (2.0 * nu).exp() - inertia * omega * omega;
        if e2u <= 0.0 {
            return None;
        }
        let u = 0.5 * e2u.ln();
        Some([u, inertia * omega / e2u, alpha + u])
    }

    /// (n, w, q) of the spline at s and eta, both in [0, 1], then their derivatives by s, then those by eta.
    pub fn spline(&self, s: f64, eta: f64) -> ([f64; 3], [f64; 3], [f64; 3]) {
        let cells = [(self.size[0] - 3) as f64, (self.size[1] - 3) as f64];
        let (u, v) = (s * cells[0], eta * cells[1]);
        let (i, j) = (u.floor().min(cells[0] - 1.0), v.floor().min(cells[1] - 1.0));
        let (weights_s, slopes_s) = spline_weights(u - i);
        let (weights_eta, slopes_eta) = spline_weights(v - j);
        let (mut value, mut by_s, mut by_eta) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for a in 0..4 {
            let row = (i as usize + a) * self.size[1] + j as usize;
            for b in 0..4 {
                for k in 0..3 {
                    let control = self.values[row + b][k];
                    value[k] += weights_s[a] * weights_eta[b] * control;
                    by_s[k] += slopes_s[a] * cells[0] * weights_eta[b] * control;
                    by_eta[k] += weights_s[a] * slopes_eta[b] * cells[1] * control;
                }
            }
        }
        (value, by_s, by_eta)
    }
}

/// Control points of the bicubic spline through samples: one more at each end of both axes than there are samples.
pub(super) fn spline_control(samples: &[[f64; 3]], columns: usize) -> Vec<[f64; 3]> {
    let rows = samples.len() / columns;
    let (tall, wide) = (rows + 2, columns + 2);
    let mut control = vec![[0.0; 3]; tall * wide];
    for k in 0..3 {
        let mut half = vec![0.0; tall * columns];
        for j in 0..columns {
            let line: Vec<f64> = (0..rows).map(|i| samples[i * columns + j][k]).collect();
            for (i, value) in spline_control_line(&line).into_iter().enumerate() {
                half[i * columns + j] = value;
            }
        }
        for i in 0..tall {
            for (j, value) in spline_control_line(&half[i * columns..(i + 1) * columns]).into_iter().enumerate() {
                control[i * wide + j][k] = value;
            }
        }
    }
    control
}

/// Control points of the cubic spline through a line of samples whose end slopes are six-point one-sided differences.
fn spline_control_line(samples: &[f64]) -> Vec<f64> {
    const ONE_SIDED: [f64; 6] = [-137.0 / 60.0, 5.0, -5.0, 10.0 / 3.0, -1.25, 0.2];
    let count = samples.len();
    let slope_first: f64 = ONE_SIDED.iter().zip(samples).map(|(weight, value)| weight * value).sum();
    let slope_last: f64 = -ONE_SIDED.iter().zip(samples.iter().rev()).map(|(weight, value)| weight * value).sum::<f64>();

    // Solve c[i-1] + 4 c[i] + c[i+1] = 6 samples[i]; at the ends the outer point follows from the slope.
    let mut right: Vec<f64> = samples.iter().map(|value| 6.0 * value).collect();
    right[0] += 2.0 * slope_first;
    right[count - 1] -= 2.0 * slope_last;
    let mut upper = vec![0.0; count];
    upper[0] = 0.5;
    right[0] /= 4.0;
    for i in 1..count {
        let lower = if i == count - 1 { 2.0 } else { 1.0 };
        let pivot = 4.0 - lower * upper[i - 1];
        upper[i] = 1.0 / pivot;
        right[i] = (right[i] - lower * right[i - 1]) / pivot;
    }
    for i in (0..count - 1).rev() {
        right[i] -= upper[i] * right[i + 1];
    }
    let mut control = Vec::with_capacity(count + 2);
    control.push(right[1] - 2.0 * slope_first);
    control.extend_from_slice(&right);
    control.push(right[count - 2] + 2.0 * slope_last);
    control
}

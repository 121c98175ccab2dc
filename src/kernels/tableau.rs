//! Runge-Kutta methods as the tableaus that `integrator.rs` runs; `build.rs` writes them into `tableau.glsl`.
//!
//! Every tableau ends with a stage at the new state, so that its derivatives can start the next step: methods that lack one get it.

use super::constants::*;

/// Nodes, matrix rows and error weights of a method.
struct Tableau {
    nodes: &'static [f64],
    rows: &'static [&'static [f64]],
    /// Weights of the solution minus those of the embedded one; none for a method of fixed steps.
    error: &'static [f64],
    /// Weights of the quartic term of its dense output: x(s) is the cubic through both ends plus s^2 (1 - s)^2 times this; none where the
    /// cubic is as exact as the method.
    quartic: &'static [f64],
}

/// Explicit Euler.
const EULER: Tableau = Tableau { nodes: &[0.0, 1.0], rows: &[&[], &[1.0]], error: &[], quartic: &[] };

/// Kutta's classical method of order 4.
const RK4: Tableau = Tableau {
    nodes: &[0.0, 0.5, 0.5, 1.0, 1.0],
    rows: &[&[], &[0.5], &[0.0, 0.5], &[0.0, 0.0, 1.0], &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0]],
    error: &[],
    quartic: &[],
};

/// Bogacki and Shampine's 3(2) pair (Appl. Math. Lett. 2, 1989).
const BOGACKI_SHAMPINE: Tableau = Tableau {
    nodes: &[0.0, 0.5, 0.75, 1.0],
    rows: &[&[], &[0.5], &[0.0, 0.75], &[2.0 / 9.0, 1.0 / 3.0, 4.0 / 9.0]],
    error: &[2.0 / 9.0 - 7.0 / 24.0, 1.0 / 3.0 - 0.25, 4.0 / 9.0 - 1.0 / 3.0, -0.125],
    quartic: &[],
};

/// Dormand and Prince's 5(4) pair (J. Comput. Appl. Math. 6, 1980); its dense output as in Hairer, Norsett and Wanner, Solving
/// Ordinary Differential Equations I, section II.6 (DOPRI5).
const DORMAND_PRINCE: Tableau = Tableau {
    nodes: &[0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0],
    rows: &[
        &[],
        &[0.2],
        &[3.0 / 40.0, 9.0 / 40.0],
        &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
        &[19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0],
        &[9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
        &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
    ],
    error: &[71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -0.025],
    quartic: &[
        -12715105075.0 / 11282082432.0,
        0.0,
        87487479700.0 / 32700410799.0,
        -10690763975.0 / 1880347072.0,
        701980252875.0 / 199316789632.0,
        -1453857185.0 / 822651844.0,
        69997945.0 / 29380423.0,
    ],
};

/// Tableaus of the methods from `METHOD_RUNGE_KUTTA` on.
const TABLEAUS: [&Tableau; TABLEAU_COUNT as usize] = [&EULER, &RK4, &BOGACKI_SHAMPINE, &DORMAND_PRINCE];

const _: () = assert!(MAX_STAGES == 7, "integrator.glsl takes six stages after the first");

/// The tableau of a method (`METHOD_*`), packed: number of stages, 1 if it estimates its error, nodes, error weights, weights of the quartic
/// term, rows of the matrix. Methods without one get Dormand and Prince's, to which traced rays may change (`world/trace.rs`).
pub fn packed(method: u32) -> [f64; TABLEAU_SIZE as usize] {
    const STAGES: usize = MAX_STAGES as usize;
    let t = method.checked_sub(METHOD_RUNGE_KUTTA).map_or(&DORMAND_PRINCE, |i| TABLEAUS[i as usize]);
    let mut packed = [0.0; TABLEAU_SIZE as usize];
    packed[0] = t.nodes.len() as f64;
    packed[1] = f64::from(u8::from(!t.error.is_empty()));
    packed[2..2 + t.nodes.len()].copy_from_slice(t.nodes);
    packed[2 + STAGES..2 + STAGES + t.error.len()].copy_from_slice(t.error);
    packed[2 + 2 * STAGES..2 + 2 * STAGES + t.quartic.len()].copy_from_slice(t.quartic);
    for (i, row) in t.rows.iter().enumerate() {
        let start = 2 + (3 + i) * STAGES;
        packed[start..start + row.len()].copy_from_slice(row);
    }
    packed
}

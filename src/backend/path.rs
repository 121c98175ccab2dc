//! Paths of rays traced on their own: where they are after each of their steps.
//!
//! A backend reports the ends of rays only, so the same rays are traced with more and more steps: that is quadratic in their number,
//! and meant for plots.

use super::{Backend, TraceOptions, TraceRay, TraceResult};
use crate::error::{Error, Result};
use crate::kernels::constants::STATUS_EXHAUSTED;

/// Hands every place behind the start of each ray to `push`, with the ray's index: where it is after each `stride` steps, and its end.
///
/// `ends` is what tracing the rays gave. An error of `go_on`, which is asked before each round, ends it.
pub fn trace_steps(
    backend: &mut dyn Backend,
    rays: &[TraceRay],
    ends: &[TraceResult],
    options: TraceOptions,
    stride: u32,
    mut go_on: impl FnMut() -> Result<()>,
    mut push: impl FnMut(usize, &TraceResult),
) -> Result<()> {
    let anchors = outermost(rays);
    let mut going: Vec<usize> = (0..rays.len()).collect();
    for steps in (1..).map(|i| i * stride) {
        going.retain(|&i| ends[i].steps > steps);
        if going.is_empty() {
            break;
        }
        go_on()?;
        let others = anchors.iter().filter(|anchor| going.binary_search(anchor).is_err());
        let batch: Vec<TraceRay> = going.iter().chain(others).map(|&i| rays[i]).collect();
        let stepped = backend.trace(&batch, TraceOptions { max_steps: Some(steps), ..options })?;
        for (&i, at) in going.iter().zip(&stepped).filter(|(_, at)| at.status == STATUS_EXHAUSTED) {
            push(i, at);
        }
    }
    ends.iter().enumerate().for_each(|(i, end)| push(i, end));
    Ok(())
}

/// Traces a ray to its end; also returns its path from start to end, of at most about `points` points. Once `go_on` says no, which is
/// asked before each point, the path ends.
pub fn trace_path(
    backend: &mut dyn Backend,
    ray: &TraceRay,
    options: TraceOptions,
    points: u32,
    mut go_on: impl FnMut() -> bool,
) -> Result<Option<(TraceResult, Vec<[f64; 3]>)>> {
    let rays = [*ray];
    let ends = backend.trace(&rays, options)?;
    let Some(end) = ends.first().copied() else { return Ok(None) };
    let stride = end.steps.div_ceil(points.max(1)).max(1);
    let mut path = vec![ray.origin];
    let extend = |_: usize, at: &TraceResult| {
        // A step that was rejected leaves the ray where it was.
        if path.last() != Some(&at.position) && at.position.iter().all(|c| c.is_finite()) {
            path.push(at.position);
        }
    };
    let check = || if go_on() { Ok(()) } else { Err(Error::Interrupted) };
    match trace_steps(backend, &rays, &ends, options, stride, check, extend) {
        Ok(()) | Err(Error::Interrupted) => Ok(Some((end, path))),
        Err(e) => Err(e),
    }
}

/// Rays that start furthest out along each axis. The region that is integrated reaches around all rays that are traced together, so some
/// of them with these are traced as all of them are.
fn outermost(rays: &[TraceRay]) -> Vec<usize> {
    let mut indices = Vec::new();
    for axis in 0..3 {
        let order = |a: &usize, b: &usize| rays[*a].origin[axis].total_cmp(&rays[*b].origin[axis]);
        indices.extend((0..rays.len()).min_by(order));
        indices.extend((0..rays.len()).max_by(order));
    }
    indices.sort_unstable();
    indices.dedup();
    indices
}

//! How far two films of the same samples are apart.

use super::{Film, luminance};
use crate::kernels::constants::STATUS_HIT;

/// Measured difference between two films.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Share of pixels whose radiance differs by more than 1% of itself plus 1% of the mean.
    pub pixels: f64,
    /// Share of pixels whose camera ray ended elsewhere: another status or object, or a distance to a surface that differs
    /// by more than 0.1%. How far a ray is when it is found to have escaped, or to be captured, is a matter of its last step.
    pub rays: f64,
    /// Relative difference of the mean luminance.
    pub mean: f64,
    /// 99th percentile over pixels of the difference of luminance, relative to the mean.
    pub p99: f64,
}

/// Largest difference at which films count as equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// See [`Difference::pixels`].
    pub pixels: f64,
    /// See [`Difference::rays`].
    pub rays: f64,
    /// See [`Difference::mean`].
    pub mean: f64,
}

impl Thresholds {
    /// For one sample and at most two bounces: rounding may flip a hit at a silhouette or beside a photon ring now and then, and
    /// moves nothing else.
    pub const SHALLOW: Thresholds = Thresholds { pixels: 0.01, rays: 0.02, mean: 0.01 };
    /// For whole paths: flipped hits add up over bounces.
    pub const DEEP: Thresholds = Thresholds { pixels: 0.05, rays: 0.02, mean: 0.01 };

    /// Whether a difference stays below every threshold.
    pub fn hold(&self, d: &Difference) -> bool {
        d.pixels <= self.pixels && d.rays <= self.rays && d.mean <= self.mean
    }
}

/// Compares films of equal size pixel by pixel.
pub fn compare(a: &Film, b: &Film) -> Difference {
    let count = a.sums.len().min(b.sums.len()).max(1);
    let light = |f: &Film, i: usize| f64::from(luminance(f.radiance(i)));
    let mean_a = (0..count).map(|i| light(a, i)).sum::<f64>() / count as f64;
    let mean_b = (0..count).map(|i| light(b, i)).sum::<f64>() / count as f64;
    let floor = mean_a.max(mean_b).max(1e-12);
    let mut pixels = 0usize;
    let mut rays = 0usize;
    let mut differences = Vec::with_capacity(count);
    for i in 0..count {
        let (ra, rb) = (a.radiance(i), b.radiance(i));
        let differs = ra.iter().zip(rb).any(|(x, y)| f64::from((x - y).abs()) > 0.01 * (f64::from(x.max(y)) + floor));
        pixels += usize::from(differs);
        differences.push((light(a, i) - light(b, i)).abs() / floor);
        let (p, q) = (&a.aovs[i], &b.aovs[i]);
        let apart = p.status == STATUS_HIT && (p.distance - q.distance).abs() > 1e-3 * p.distance.max(q.distance).max(1e-3);
        rays += usize::from(p.status != q.status || p.object != q.object || apart);
    }
    differences.sort_by(f64::total_cmp);
    let share = |n: usize| n as f64 / count as f64;
    Difference { pixels: share(pixels), rays: share(rays), mean: (mean_a - mean_b).abs() / floor, p99: differences[(count - 1) * 99 / 100] }
}

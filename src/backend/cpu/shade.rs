//! Shading of the rays of a batch: what they meet one by one, where they go on in registers of lanes.

use crate::film::Statistics;
use crate::kernels::constants::*;
use crate::kernels::layout::Aov;
use crate::kernels::material::is_delta;
use crate::kernels::path::*;
use crate::kernels::rng::random_pairs;
use crate::kernels::surface::{Arrival, surface_at};
use crate::kernels::view::SceneView;
use crate::simd::{Lane, Vector, store};
use fearless_simd::{Simd, f32x16};

/// Paths that draw their directions at once.
const LANES: usize = 16;
/// Kinds of scattering that are drawn apart: the materials that scatter, and smooth dielectrics.
const KINDS: usize = 4;

/// A pixel of the film.
pub struct Pixel {
    /// Column.
    pub x: u32,
    /// Row.
    pub y: u32,
    /// Seed of its random numbers.
    pub seed: u32,
}

/// A path that waits for its next direction.
struct Waiting {
    path: u32,
    encounter: Encounter,
}

/// One sample of each pixel of a batch.
pub struct Batch<'a> {
    /// The scene.
    pub view: &'a SceneView<'a>,
    /// Pixel of each path.
    pub pixels: &'a [Pixel],
    /// Number of the sample.
    pub sample: u32,
    /// The paths.
    pub paths: &'a mut [PathState],
    /// AOVs of the camera rays, if they are wanted.
    pub aovs: Option<&'a mut Vec<Option<Aov>>>,
}

impl Batch<'_> {
    /// Handles the end of the ray of every active path; the paths that go on stay active.
    #[inline(always)]
    pub fn shade<S: Simd>(&mut self, simd: S, arrivals: &[Option<Arrival>], active: &mut Vec<u32>, statistics: &mut Statistics) {
        let view = self.view;
        let mut waiting: [Vec<Waiting>; KINDS] = std::array::from_fn(|_| Vec::with_capacity(LANES));
        // As many paths have been read as are kept or wait, or more.
        let mut kept = 0;
        for slot in 0..active.len() {
            let index = active[slot];
            // Every launched ray lands.
            let Some(arrival) = &arrivals[slot] else { continue };
            let path = &mut self.paths[index as usize];
            let aovs = if path.bounce == 0 { self.aovs.as_deref_mut() } else { None };
            if arrival.status != STATUS_HIT {
                statistics.exhausted += u64::from(arrival.status == STATUS_EXHAUSTED);
                if let Some(aovs) = aovs {
                    aovs.push(Some(miss_aov(arrival)));
                }
                escape(view, path, arrival);
                continue;
            }
            let surface = surface_at(view, arrival);
            if let Some(aovs) = aovs {
                aovs.push(Some(hit_aov(view, &surface, arrival)));
            }
            match meet_surface(view, &surface, path, arrival) {
                Meeting::Ends => {}
                Meeting::Passes => {
                    active[kept] = index;
                    kept += 1;
                }
                Meeting::Scatters(encounter) => {
                    let bsdf = &encounter.scattering.bsdf;
                    let kind = if is_delta((), bsdf) { KINDS - 1 } else { bsdf.kind as usize };
                    waiting[kind].push(Waiting { path: index, encounter });
                    if waiting[kind].len() == LANES {
                        self.scatter(simd, &mut waiting[kind], active, &mut kept);
                    }
                }
            }
        }
        for some in &mut waiting {
            self.scatter(simd, some, active, &mut kept);
        }
        active.truncate(kept);
    }

    /// Sends paths of one kind on their way.
    #[inline(always)]
    fn scatter<S: Simd>(&mut self, simd: S, waiting: &mut Vec<Waiting>, active: &mut [u32], kept: &mut usize) {
        let Some(last) = waiting.len().checked_sub(1) else { return };
        // Lanes without a path repeat the last one.
        let of_lane = |lane: usize| &waiting[lane.min(last)];
        let scattering = Scattering::<f32x16<S>>::by_lane(simd, |lane| &of_lane(lane).encounter.scattering);
        let (mut seeds, mut pairs) = ([0; LANES], [[0; LANES]; BOUNCE_PAIRS as usize]);
        for lane in 0..LANES {
            let index = of_lane(lane).path as usize;
            seeds[lane] = self.pixels[index].seed;
            let first = CAMERA_PAIRS + self.paths[index].bounce * BOUNCE_PAIRS;
            for (pair, row) in pairs.iter_mut().enumerate() {
                row[lane] = first + pair as u32;
            }
        }
        let random = |pair: usize| random_pairs(simd, &seeds, &pairs[pair], self.sample);
        let choice = if self.view.scene.light_count > MAX_SUMMED_LIGHTS { random(2)[0] } else { f32x16::splat(simd, 0.0) };
        let random = BouncePairs { direction: random(0), lobe: random(1), choice };
        let drawn = draw_direction(simd, self.view, &scattering, &random);
        let (wi, weight, chances) = (drawn.wi.rows(), drawn.weight.rows(), store(random.lobe[1]));
        for (lane, Waiting { path, encounter }) in waiting.drain(..).enumerate() {
            let at = |rows: &[[f32; LANES]; 3]| Vector::from([rows[0][lane], rows[1][lane], rows[2][lane]]);
            let draw = Draw { wi: at(&wi), weight: at(&weight) };
            if leave_surface(self.view, &mut self.paths[path as usize], &encounter, &draw, chances[lane]) {
                active[*kept] = path;
                *kept += 1;
            }
        }
    }
}

/// Starts a path in every pixel.
#[inline(always)]
pub fn start<S: Simd>(simd: S, view: &SceneView, pixels: &[Pixel], sample: u32, paths: &mut Vec<PathState>) {
    for some in pixels.chunks(LANES) {
        // Lanes without a pixel repeat the last one.
        let pixel = |lane: usize| {
            let Pixel { x, y, .. } = some[lane.min(some.len() - 1)];
            (x, y)
        };
        start_path::<f32x16<S>>(simd, view, pixel, sample, |lane, path| {
            if lane < some.len() {
                paths.push(path);
            }
        });
    }
}

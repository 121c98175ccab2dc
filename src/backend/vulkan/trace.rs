//! Rays traced on their own: their state is written into path slots, flown, and read back.

use super::batch::Push;
use super::buffer::Buffer;
use super::scene::{download, upload_at};
use super::{Loaded, Purpose, VulkanBackend};
use crate::backend::{Precision, Prepared, RawLanding, Stop, TraceOptions, TraceRay, TraceResult, Tracer};
use crate::error::Result;
use crate::kernels::constants::*;
use crate::spacetime::ModelKind;
use crate::world::Reach;
use gpu_allocator::MemoryLocation;

/// Steps word of a traced ray that has not started (`bindings.glsl`).
const FRESH: u32 = 0xffff_ffff;
/// Words of a path that hold the end of a traced ray (`bindings.glsl`, `flight.glsl`).
const RESULT_WORDS: [u64; 12] = [2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13];

impl VulkanBackend {
    pub(super) fn trace_in(&mut self, loaded: &mut Loaded, rays: &[TraceRay], options: TraceOptions) -> Result<Vec<TraceResult>> {
        let world = loaded.world.clone();
        let origins: Vec<[f64; 3]> = rays.iter().map(|r| r.origin).collect();
        let reach = if loaded.precision == Precision::F64 { Reach::Exact } else { Reach::Picture };
        let parameters = world.trace_parameters(&origins, reach, options);
        loaded.scene.set_parameters(&mut self.commands, &parameters)?;
        let model = world.traced_model(options.stop);
        if !loaded.kernels.tracing.as_ref().is_some_and(|(m, method, _)| (*m, *method) == (model, parameters.method)) {
            let pipeline = self.advance(model, loaded.precision, &parameters, Purpose::Tracing)?;
            loaded.kernels.tracing = Some((model, parameters.method, pipeline));
        }
        let tracer = Tracer::new(&world);
        let mut results = Vec::with_capacity(rays.len());
        for chunk in rays.chunks(self.capacity as usize) {
            let count = chunk.len() as u32;
            let prepared: Vec<Prepared> = chunk.iter().map(|r| tracer.prepare(r)).collect();
            let mut staging = Buffer::new(&self.device, "staging", 1 << 20, MemoryLocation::CpuToGpu)?;
            for (word, values) in launch_words(&prepared, loaded.precision) {
                let offset = word * u64::from(self.capacity) * 16;
                upload_at(&mut self.commands, &mut staging, &self.paths, offset, bytemuck::cast_slice(&values))?;
            }
            let order: Vec<u32> = (0..count).collect();
            upload_at(&mut self.commands, &mut staging, &self.queues, 0, bytemuck::cast_slice(&order))?;
            self.fly(loaded, stop_push(options.stop, Push { slot_count: count, ..self.push(loaded) }))?;
            let mut words = Vec::new();
            for word in RESULT_WORDS {
                let offset = word * u64::from(self.capacity) * 16;
                let bytes = download(&mut self.commands, &mut self.readback, &self.paths, offset, u64::from(count) * 16)?;
                words.push(bytemuck::pod_collect_to_vec::<u8, [u32; 4]>(&bytes));
            }
            results.extend(prepared.iter().enumerate().map(|(i, p)| tracer.result(p, &landing(&words, i, loaded.precision, model))));
        }
        loaded.scene.set_parameters(&mut self.commands, &loaded.parameters)?;
        Ok(results)
    }

    /// Runs rounds until every ray has landed.
    fn fly(&mut self, loaded: &Loaded, mut push: Push) -> Result<()> {
        let mut started = 0;
        loop {
            self.commands.begin()?;
            if started == 0 {
                self.commands.clear(&self.counters);
                self.commands.barrier();
                self.commands.dispatch(&self.layout, &loaded.kernels.prepare, bytemuck::bytes_of(&push), 1);
                self.commands.barrier();
            }
            for _ in 0..8 {
                push.parity = started % 2;
                self.record_round(&loaded.kernels, Purpose::Tracing, push, started)?;
                started += 1;
            }
            if self.finish_submission()?.remaining == 0 {
                return Ok(());
            }
        }
    }
}

/// Push constants with a stop.
fn stop_push(stop: Stop, push: Push) -> Push {
    let (kind, values) = match stop {
        Stop::Never => (STOP_NONE, [0.0; 4]),
        Stop::Length(v) => (STOP_LENGTH, [v, 0.0, 0.0, 0.0]),
        Stop::Parameter(v) => (STOP_PARAMETER, [v, 0.0, 0.0, 0.0]),
        Stop::Sphere(v) => (STOP_SPHERE, [v, 0.0, 0.0, 0.0]),
        Stop::Plane([x, y, z], d) => (STOP_PLANE, [x, y, z, d]),
    };
    let stop_high = values.map(|v| v as f32);
    let stop_low = [0, 1, 2, 3].map(|i| (values[i] - f64::from(stop_high[i])) as f32);
    Push { stop: kind, stop_high, stop_low, ..push }
}

/// State words of rays about to be launched: (word, values).
fn launch_words(rays: &[Prepared], precision: Precision) -> Vec<(u64, Vec<[u32; 4]>)> {
    let beside = |[x, y, z]: [f64; 3], w: u32| [(x as f32).to_bits(), (y as f32).to_bits(), (z as f32).to_bits(), w];
    let single = |v: [f64; 3], w: f64| beside(v, (w as f32).to_bits());
    let pair = |a: f64, b: f64| {
        let (a, b) = (a.to_bits(), b.to_bits());
        [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32]
    };
    let mut words = vec![
        (0, rays.iter().map(|r| single(r.origin, 0.0)).collect()),
        (1, rays.iter().map(|r| beside(r.direction, r.side)).collect()),
        (12, rays.iter().map(|r| [(r.sense as f32).to_bits(), r.side, FRESH, 0]).collect()),
        // A cone of width 1 that does not grow; the frequency is that at the start.
        (16, rays.iter().map(|_| beside([1.0, 0.0, 1.0], 0)).collect()),
    ];
    match precision {
        Precision::F32 => {
            words.push((8, rays.iter().map(|r| single(r.origin, r.speed)).collect()));
            words.push((10, rays.iter().map(|r| single(r.direction, 0.0)).collect()));
        }
        Precision::F64 => {
            words.push((8, rays.iter().map(|r| pair(r.origin[0], r.origin[1])).collect()));
            words.push((9, rays.iter().map(|r| pair(r.origin[2], r.speed)).collect()));
            words.push((10, rays.iter().map(|r| pair(r.direction[0], r.direction[1])).collect()));
            words.push((11, rays.iter().map(|r| pair(r.direction[2], 0.0)).collect()));
        }
    }
    words
}

/// The end of ray `i`, from the result words of its path.
fn landing(words: &[Vec<[u32; 4]>], i: usize, precision: Precision, model: ModelKind) -> RawLanding {
    let word = |w: u64| RESULT_WORDS.iter().position(|&r| r == w).map_or([0; 4], |at| words[at][i]);
    let floats = |w: u64| word(w).map(f32::from_bits).map(f64::from);
    let double = |w: u64, half: usize| f64::from_bits(u64::from(word(w)[2 * half]) | u64::from(word(w)[2 * half + 1]) << 32);
    let three = |w: u64| [floats(w)[0], floats(w)[1], floats(w)[2]];
    let (position, direction, momentum, length, parameter) = match (model, precision) {
        (ModelKind::Flat, _) => (three(4), three(5), three(5), floats(6)[2], 0.0),
        (_, Precision::F32) => (three(8), three(10), three(2), floats(13)[0], floats(13)[1]),
        (_, Precision::F64) => (
            [double(8, 0), double(8, 1), double(9, 0)],
            [double(10, 0), double(10, 1), double(11, 0)],
            [double(2, 0), double(2, 1), double(3, 0)],
            double(13, 0),
            double(13, 1),
        ),
    };
    RawLanding {
        status: word(5)[3] % SIDE_UNIT,
        primitive: word(4)[3],
        position,
        direction,
        momentum,
        length,
        parameter,
        side: word(5)[3] / SIDE_UNIT,
        steps: word(7)[0],
        chords: word(7)[1],
    }
}

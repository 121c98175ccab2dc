//! What following rays takes, counted in the inner loops.
//!
//! Here every count is an addition beside loads of whole cache lines, and always made; on the GPU only pipelines that are specialised
//! for a profile count. Both count the same things.

/// Counts of the inner loops of integration and traversal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Integration steps that were tried, rejected ones included; none where space is flat.
    pub steps: u64,
    /// Accepted steps that the clearance grid kept out of the BVH.
    pub skips: u64,
    /// Pieces of rays that were looked up in the BVH: straight ways, and steps cut into chords.
    pub chords: u64,
    /// Nodes whose eight children were tested.
    pub nodes: u64,
    /// Analytic primitives tested, once for each chord that was near.
    pub primitives: u64,
    /// Blocks of up to eight triangles tested, once for each chord that was near.
    pub blocks: u64,
}

impl Work {
    /// Work from its counts in the order of the fields, as the GPU stores them.
    pub const fn from_counts([steps, skips, chords, nodes, primitives, blocks]: [u64; 6]) -> Work {
        Work { steps, skips, chords, nodes, primitives, blocks }
    }

    /// Counts pieces of rays that met no child of the root, one for each bit.
    #[inline(always)]
    pub fn pass_root(&mut self, pieces: u32) {
        self.chords += u64::from(pieces.count_ones());
        self.nodes += u64::from(pieces.count_ones());
    }

    /// Adds the work of other rays.
    pub fn add(&mut self, other: &Work) {
        self.steps += other.steps;
        self.skips += other.skips;
        self.chords += other.chords;
        self.nodes += other.nodes;
        self.primitives += other.primitives;
        self.blocks += other.blocks;
    }
}

// What following rays takes; documented in src/kernels/work.rs. Only pipelines specialised for a profile count.

layout(constant_id = 0) const bool COUNTING = false;

struct Work {
    uint steps;
    uint skips;
    uint chords;
    uint nodes;
    uint primitives;
    uint blocks;
};

// What this invocation has done.
Work work;

void add_work(uint kind, uint amount) {
    uint at = COUNT_WORK + 2 * kind;
    uint before = atomicAdd(counters[at], amount);
    if (before + amount < before) {
        atomicAdd(counters[at + 1], 1);
    }
}

void begin_work() {
    work = Work(0u, 0u, 0u, 0u, 0u, 0u);
}

void report_work() {
    if (COUNTING) {
        add_work(0, work.steps);
        add_work(1, work.skips);
        add_work(2, work.chords);
        add_work(3, work.nodes);
        add_work(4, work.primitives);
        add_work(5, work.blocks);
    }
}

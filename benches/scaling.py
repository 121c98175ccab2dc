"""How the cost of a ray grows with triangles, and that of a picture with pixels, samples and threads; straight and bent light.

A square of waves of 1 thousand to 10 million triangles fills the picture of a camera above it; every path is at most eight bounces long.
Straight light is compared with a Schwarzschild hole over the middle of the square. Prints a table and draws docs/scaling.svg.

Needs Python 3.11 or later, matplotlib (pip install matplotlib) and target/release/nullray (cargo build --release).
"""
import argparse
import json
import math
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import matplotlib

matplotlib.use("svg")
from matplotlib import pyplot

ROOT = pathlib.Path(__file__).resolve().parent.parent
MODELS = {"straight": [], "Schwarzschild": ["spacetime.kind=schwarzschild", "spacetime.mass=0.1", "spacetime.position=[0, 1.5, 0]"]}
SCENE = """
[camera]
position = [0, 4, 7]
look_at = [0, 0, 0]
[film]
width = 640
height = 360
filter = "box"
[environment]
kind = "gradient"
[[material]]
name = "ground"
[[mesh]]
file = "waves.obj"
material = "ground"
"""


def write_waves(path, cells):
    """A square of 10 x 10 with 2 cells^2 triangles."""
    at = [10 * i / cells - 5 for i in range(cells + 1)]
    with open(path, "w") as out:
        for z in at:
            row = math.sin(2.1 * z)
            out.writelines(f"v {x:.5g} {0.3 * math.sin(1.7 * x) * row:.5g} {z:.5g}\n" for x in at)
        for j in range(cells):
            first = j * (cells + 1) + 1
            for i in range(first, first + cells):
                below = i + cells + 1
                out.write(f"f {i} {below} {i + 1}\nf {i + 1} {below} {below + 1}\n")


def run(program, *arguments):
    """JSON that nullray prints."""
    done = subprocess.run([program, *arguments], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"scaling: {' '.join(arguments[:2])} failed: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout)


def settings(model):
    return [part for value in MODELS[model] for part in ("--set", value)]


def by_triangles(program, folder, largest, repeats):
    """For each model, (triangles, nanoseconds of a core per ray, nodes per ray)."""
    points = {model: [] for model in MODELS}
    for exponent in range(3, largest + 1):
        cells = round(math.sqrt(10**exponent / 2))
        scene = folder / "scene.toml"
        scene.write_text(SCENE)
        write_waves(folder / "waves.obj", cells)
        for model in MODELS:
            command = ["profile", str(scene), "--backend", "cpu", "--threads", "1", "--frames", "3", "--json", "-", *settings(model)]
            runs = [run(program, *command) for _ in range(repeats)]
            advance = [next(k for k in r["kernels"] if k["kernel"] == "advance") for r in runs]
            time_per_ray = statistics.median(1e9 / a["items_per_second"] for a in advance)
            total = runs[0]["counters"]["total"]
            points[model].append((2 * cells**2, time_per_ray, total["nodes"] / total["rays"]))
            print(f"{2 * cells**2:>9} triangles, {model:<13} {time_per_ray:7.0f} ns per ray, {points[model][-1][2]:5.1f} nodes per ray", flush=True)
    return points


def seconds(program, scene, model, size, samples, threads):
    start = time.perf_counter()
    output = scene.parent / "out.png"
    command = ["render", str(scene), "--backend", "cpu", "--threads", str(threads), "--size", size, "--spp", str(samples), "--json", "-o", str(output)]
    run(program, *command, *settings(model))
    return time.perf_counter() - start


def by_work(program, folder, repeats):
    """For each model, (label, cost, cost if it were proportional), the cost of loading taken off."""
    scene = folder / "scene.toml"
    scene.write_text(SCENE)
    write_waves(folder / "waves.obj", 71)
    cases = [("320x180, 16 samples", "320x180", 16, 2), ("640x360, 16", "640x360", 16, 2), ("1280x720, 16", "1280x720", 16, 2),
             ("640x360, 4", "640x360", 4, 2), ("640x360, 64", "640x360", 64, 2), ("640x360, 16, one thread", "640x360", 16, 1)]
    rows = []
    for model in MODELS:
        def cost(size, samples, threads):
            whole = lambda n: statistics.median(seconds(program, scene, model, size, n, threads) for _ in range(repeats))
            return whole(2 * samples) - whole(samples)
        unit = cost("640x360", 16, 2)
        for label, size, samples, threads in cases:
            width, height = map(int, size.split("x"))
            ideal = width * height * samples / (640 * 360 * 16) * 2 / threads
            measured = cost(size, samples, threads) / unit
            rows.append((model, label, measured, ideal))
            print(f"{model:<13} {label:<24} {measured:6.2f} times 640x360 with 16 samples on two threads, {ideal:.2f} if proportional", flush=True)
    return rows


def draw(points, rows, path):
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4))
    for model, values in points.items():
        left.plot([v[0] for v in values], [v[1] for v in values], "o-", label=model)
    left.set(xscale="log", xlabel="triangles", ylabel="nanoseconds per ray and core", title="with triangles", ylim=(0, None))
    left.legend()
    for model in MODELS:
        chosen = [r for r in rows if r[0] == model]
        right.plot([r[3] for r in chosen], [r[2] for r in chosen], "o", label=model)
    ends = [min(r[3] for r in rows), max(r[3] for r in rows)]
    right.plot(ends, ends, "k:", label="proportional")
    right.set(xscale="log", yscale="log", xlabel="pixels x samples / threads", ylabel="time", title="with pixels, samples and threads")
    for axis in (right.xaxis, right.yaxis):
        axis.set_ticks([0.25, 0.5, 1, 2, 4], ["1/4", "1/2", "1", "2", "4"])
        axis.set_ticks([], minor=True)
    right.legend()
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nullray", default=str(ROOT / "target/release/nullray"), help="the program")
    parser.add_argument("--largest", type=int, default=7, help="power of ten of the most triangles (default 7)")
    parser.add_argument("--repeats", type=int, default=3, help="runs of which the median counts (default 3)")
    parser.add_argument("--output", type=pathlib.Path, default=ROOT / "docs/scaling.svg", help="the plot")
    arguments = parser.parse_args()
    if not pathlib.Path(arguments.nullray).is_file():
        sys.exit(f"scaling: {arguments.nullray} is not there, build it with: cargo build --release")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        points = by_triangles(arguments.nullray, folder, arguments.largest, arguments.repeats)
        rows = by_work(arguments.nullray, folder, arguments.repeats)
    draw(points, rows, arguments.output)


if __name__ == "__main__":
    main()

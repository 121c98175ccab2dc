#!/usr/bin/env python3
"""Milliseconds per sample of the linear benchmark scene in Mitsuba 3 (pip install mitsuba) beside nullray's CPU backend.

Reads assets/scenes/benchmark.toml itself, so both render the same scene: one path per pixel, at most 8 scattering events, every
core. Start-up and scene loading are taken out by timing two sample counts; the two programs take turns, and medians are printed. With
`--noise SECONDS` also what noise is left in either's picture (426x240) after that time.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time
import tomllib

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
SIZES = {"1080p": (1920, 1080), "720p": (1280, 720), "480p": (854, 480), "240p": (426, 240)}


def material(table):
    """A Mitsuba BSDF or emitter of a [[material]] table."""
    color = {"type": "rgb", "value": table.get("base_color", [0.8, 0.8, 0.8])}
    roughness = table.get("roughness", 0.0)
    match table.get("kind", "diffuse"):
        case "metallic":
            return {"bsdf": {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": roughness**2, "specular_reflectance": color}}
        case "dielectric":
            return {"bsdf": {"type": "dielectric", "int_ior": table.get("ior", 1.5)}}
        case "emissive":
            return {"emitter": {"type": "area", "radiance": {"type": "rgb", "value": table["emission"]}}}
        case _:
            return {"bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": color}}}


def transform_of(table, mi):
    """The map of a `transform` table: scale, then rotations about X, Y and Z, then translation."""
    transform = mi.ScalarTransform4f()
    given = table.get("transform", {})
    transform = transform.translate(given.get("translate", [0, 0, 0]))
    for axis, degrees in zip(([0, 0, 1], [0, 1, 0], [1, 0, 0]), reversed(given.get("rotate_degrees", [0, 0, 0]))):
        transform = transform.rotate(axis, degrees)
    return transform.scale(given.get("scale", 1.0))


def mitsuba_scene(file, size, mi):
    """The scene of a file as a Mitsuba dictionary."""
    camera, folder = file["camera"], ROOT / "assets/scenes"
    materials = {m["name"]: material(m) for m in file["material"]}
    identity = mi.ScalarTransform4f()
    scene = {
        "type": "scene",
        # Depth counts rays: 8 scattering events have 9.
        "integrator": {"type": "path", "max_depth": file["film"]["max_depth"] + 1},
        "sensor": {
            "type": "perspective",
            "fov": camera["fov_degrees"],
            "fov_axis": "y",
            "to_world": identity.look_at(origin=camera["position"], target=camera["look_at"], up=camera.get("up", [0, 1, 0])),
            "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}},
            "sampler": {"type": "independent"},
        },
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": file["environment"]["color"]}},
    }
    for i, s in enumerate(file.get("sphere", [])):
        scene[f"sphere{i}"] = {"type": "sphere", "center": s["center"], "radius": s["radius"]} | materials[s["material"]]
    for i, q in enumerate(file.get("quad", [])):
        corner, u, v = q["corner"], q["u"], q["v"]
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        length = sum(c * c for c in n) ** 0.5
        rows = [[u[k] / 2, v[k] / 2, n[k] / length, corner[k] + u[k] / 2 + v[k] / 2] for k in range(3)] + [[0, 0, 0, 1]]
        scene[f"quad{i}"] = {"type": "rectangle", "to_world": mi.ScalarTransform4f(rows)} | materials[q["material"]]
    for i, b in enumerate(file.get("box", [])):
        low, high = b["min"], b["max"]
        place = transform_of(b, mi).translate([(a + c) / 2 for a, c in zip(low, high)]).scale([(c - a) / 2 for a, c in zip(low, high)])
        scene[f"box{i}"] = {"type": "cube", "to_world": place} | materials[b["material"]]
    for i, m in enumerate(file.get("mesh", [])):
        path = str((folder / m["file"]).resolve())
        scene[f"mesh{i}"] = {"type": "obj", "filename": path, "to_world": transform_of(m, mi)} | materials[m["material"]]
    return mi.load_dict(scene)


def time_mitsuba(scene, mi, dr, counts):
    """Milliseconds per sample, from two sample counts."""
    times = []
    for i, count in enumerate(counts):
        start = time.perf_counter()
        dr.eval(mi.render(scene, spp=count, seed=i))
        dr.sync_thread()
        times.append(time.perf_counter() - start)
    return 1e3 * (times[1] - times[0]) / (counts[1] - counts[0])


def time_nullray(program, size):
    """Milliseconds per sample, from the program's own bench."""
    command = [program, "bench", "--table", "linear", "--sizes", size, "--backend", "cpu", "--repeats", "7", "--json"]
    output = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout
    return json.loads(output)["rows"][0]["ms_per_sample"]


def srgb(linear):
    """The sRGB curve of linear values, which are clamped to [0, 1]."""
    v = np.clip(linear, 0, 1)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)


def noise(pair):
    """Root of the mean square error of either of two independent pictures: linear, clamped to [0, 1], sRGB."""
    ways = (lambda v: v, lambda v: np.clip(v, 0, 1), srgb)
    return [float(np.sqrt(np.mean((way(pair[0]) - way(pair[1])) ** 2) / 2)) for way in ways]


def mitsuba_pictures(file, seconds, mi, dr):
    """Two pictures of about so many seconds each, and the samples of either."""
    size = SIZES["240p"]
    scene = mitsuba_scene(file, size, mi)
    time_mitsuba(scene, mi, dr, (2, 4))
    pictures, part, seed = [], 64, 100
    for _ in range(2):
        total, count, start = 0.0, 0, time.perf_counter()
        while time.perf_counter() - start < seconds:
            total = total + np.array(mi.render(scene, spp=part, seed=seed), dtype=np.float64)[..., :3]
            count, seed = count + part, seed + 1
        pictures.append(total * part / count)
    return pictures, count


def nullray_pictures(program, seconds, mi):
    """The same by nullray, from sample numbers far apart."""
    pictures = []
    with tempfile.TemporaryDirectory() as folder:
        for first in (0, 1_000_000):
            out = f"{folder}/{first}.exr"
            command = [program, "render", "assets/scenes/benchmark.toml", "--linear", "--backend", "cpu", "--size", "426x240"]
            command += ["--time", str(seconds), "--spp", "1000000", "--first-sample", str(first), "-o", out, "--json"]
            report = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout
            root = dict(mi.Bitmap(out).split())["<root>"]
            names = [root.struct_()[i].name for i in range(root.channel_count())]
            pictures.append(np.array(root, dtype=np.float64)[..., [names.index(c) for c in "RGB"]])
    return pictures, json.loads(report)["samples"]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", default="1080p,480p")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--picture", help="also write Mitsuba's picture to this EXR, to compare")
    parser.add_argument("--noise", type=float, metavar="SECONDS", help="also compare the noise after this time")
    arguments = parser.parse_args()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(arguments.variant)
    file = tomllib.loads((ROOT / "assets/scenes/benchmark.toml").read_text())
    program = str(ROOT / "target/release/nullray")
    print(f"mitsuba {mi.__version__} ({arguments.variant}); milliseconds per sample, medians of {arguments.repeats}")
    print("size      mitsuba   nullray   nullray / mitsuba")
    for size in arguments.sizes.split(","):
        scene = mitsuba_scene(file, SIZES[size], mi)
        time_mitsuba(scene, mi, dr, (2, 4))
        peer, own = [], []
        for _ in range(arguments.repeats):
            peer.append(time_mitsuba(scene, mi, dr, (2, 10)))
            own.append(time_nullray(program, size))
        a, b = statistics.median(peer), statistics.median(own)
        print(f"{size:8} {a:8.1f}  {b:8.1f}   {b / a:8.2f}", flush=True)
    if arguments.noise:
        print(f"noise after {arguments.noise:g} s  samples   linear  clamped     sRGB")
        for name, (pair, count) in (
            ("mitsuba", mitsuba_pictures(file, arguments.noise, mi, dr)),
            ("nullray", nullray_pictures(program, arguments.noise, mi)),
        ):
            print(f"{name:18} {count:8}", "".join(f" {v:8.5f}" for v in noise(pair)), flush=True)
    if arguments.picture:
        mi.util.write_bitmap(arguments.picture, mi.render(scene, spp=64))


if __name__ == "__main__":
    main()

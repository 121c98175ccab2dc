#!/usr/bin/env python3
"""Milliseconds per sample of the linear benchmark scene in Cycles (pip install "bpy>=5") beside nullray's CPU backend.

Reads assets/scenes/benchmark.toml itself, so both render the same scene: one path per pixel, at most 8 scattering events, every
core. Start-up and scene loading are taken out by timing two sample counts; the two programs take turns, and medians are printed.

Of Cycles' defaults are changed: depth, box filter, neither denoising nor adaptive sampling, no clamping and no blurring of glossy
light. Cycles has no spheres: they are meshes of 2880 triangles with smooth normals, but those that emit are its own round lamps, with
which it is twice as fast as with meshes. The time of the processor, all cores together, is printed as well: it says more where the
machine has other work.
"""

import argparse
import contextlib
import json
import math
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import time
import tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
NULLRAY = str(ROOT / "target/release/nullray")
SIZES = {"1080p": (1920, 1080), "720p": (1280, 720), "480p": (854, 480), "240p": (426, 240)}
SEGMENTS, RINGS = 48, 31


@contextlib.contextmanager
def quiet():
    """Send what Blender itself prints nowhere."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def material(table, bpy):
    """A Blender material of a [[material]] table."""
    made = bpy.data.materials.new(table["name"])
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    color = (*table.get("base_color", [0.8, 0.8, 0.8]), 1)
    match table.get("kind", "diffuse"):
        case "metallic":
            kind, inputs = "ShaderNodeBsdfGlossy", {"Color": color, "Roughness": table.get("roughness", 0.3)}
        case "dielectric":
            kind, inputs = "ShaderNodeBsdfGlass", {"Color": (1, 1, 1, 1), "Roughness": 0, "IOR": table.get("ior", 1.5)}
        case _:
            kind, inputs = "ShaderNodeBsdfDiffuse", {"Color": color}
    shader = nodes.new(kind)
    for name, value in inputs.items():
        shader.inputs[name].default_value = value
    links.new(shader.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return made


def transform_of(table, mathutils):
    """The map of a `transform` table: scale, then rotations about X, Y and Z, then translation."""
    given = table.get("transform", {})
    angles = [math.radians(d) for d in given.get("rotate_degrees", [0, 0, 0])]
    scale = given.get("scale", 1.0)
    return mathutils.Matrix.LocRotScale(
        mathutils.Vector(given.get("translate", [0, 0, 0])),
        mathutils.Euler(angles, "XYZ"),
        mathutils.Vector([scale] * 3 if isinstance(scale, (int, float)) else scale),
    )


def sphere(center, radius):
    """Points and faces of a sphere."""
    points = [(0, 1, 0), (0, -1, 0)]
    for ring in range(1, RINGS):
        polar = math.pi * ring / RINGS
        angles = (2 * math.pi * k / SEGMENTS for k in range(SEGMENTS))
        points += [(math.sin(polar) * math.sin(a), math.cos(polar), math.sin(polar) * math.cos(a)) for a in angles]
    at = lambda ring, k: 2 + (ring - 1) * SEGMENTS + k % SEGMENTS
    faces = [(0, at(1, k), at(1, k + 1)) for k in range(SEGMENTS)]
    faces += [(at(r, k), at(r + 1, k), at(r + 1, k + 1), at(r, k + 1)) for r in range(1, RINGS - 1) for k in range(SEGMENTS)]
    faces += [(1, at(RINGS - 1, k + 1), at(RINGS - 1, k)) for k in range(SEGMENTS)]
    return [[c + radius * p for c, p in zip(center, point)] for point in points], faces


def quad(corner, u, v):
    add = lambda *vectors: [sum(c) for c in zip(*vectors)]
    return [corner, add(corner, u), add(corner, u, v), add(corner, v)], [(0, 1, 2, 3)]


def box(low, high):
    points = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    return points, [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def build(file, bpy, mathutils):
    """Blender's scene of a file, in the file's own axes, and how Cycles is to render it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    emission = {m["name"]: m["emission"] for m in file["material"] if m.get("kind") == "emissive"}
    materials = {m["name"]: material(m, bpy) for m in file["material"] if m["name"] not in emission}

    def place(points, faces, table, smooth=False):
        mesh = bpy.data.meshes.new("shape")
        mesh.from_pydata(points, [], faces)
        mesh.shade_smooth() if smooth else mesh.shade_flat()
        mesh.materials.append(materials[table["material"]])
        shape = bpy.data.objects.new("shape", mesh)
        shape.matrix_world = transform_of(table, mathutils)
        scene.collection.objects.link(shape)

    def lamp(center, radius, radiance):
        light = bpy.data.lights.new("lamp", "POINT")
        # Power is pi radiance times the area.
        light.color, light.energy = radiance, 4 * (math.pi * radius) ** 2
        light.shadow_soft_size, light.use_soft_falloff = radius, False
        shape = bpy.data.objects.new("lamp", light)
        shape.location, shape.visible_camera = center, True
        scene.collection.objects.link(shape)

    for s in file.get("sphere", []):
        if s["material"] in emission:
            lamp(s["center"], s["radius"], emission[s["material"]])
        else:
            place(*sphere(s["center"], s["radius"]), s, smooth=True)
    for q in file.get("quad", []):
        place(*quad(q["corner"], q["u"], q["v"]), q)
    for b in file.get("box", []):
        place(*box(b["min"], b["max"]), b)
    for m in file.get("mesh", []):
        path = (ROOT / "assets/scenes" / m["file"]).resolve()
        bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z")
        for shape in bpy.context.selected_objects:
            shape.data.materials.clear()
            shape.data.materials.append(materials[m["material"]])
            shape.matrix_world = transform_of(m, mathutils)

    world = scene.world = bpy.data.worlds.new("sky")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*file["environment"]["color"], 1)

    given, lens = file["camera"], bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.angle_y = "VERTICAL", math.radians(given["fov_degrees"])
    scene.camera = bpy.data.objects.new("camera", lens)
    scene.collection.objects.link(scene.camera)
    eye = mathutils.Vector(given["position"])
    back = (eye - mathutils.Vector(given["look_at"])).normalized()
    right = mathutils.Vector(given.get("up", [0, 1, 0])).cross(back).normalized()
    axes = mathutils.Matrix((right, back.cross(right), back)).transposed()
    scene.camera.matrix_world = mathutils.Matrix.Translation(eye) @ axes.to_4x4()

    render, cycles = scene.render, scene.cycles
    render.engine, render.threads_mode, render.threads = "CYCLES", "FIXED", os.cpu_count()
    cycles.device, cycles.use_denoising, cycles.use_adaptive_sampling = "CPU", False, False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.sample_clamp_indirect, cycles.blur_glossy = 0.0, 0.0
    for kind in ("max", "diffuse", "glossy", "transmission"):
        setattr(cycles, "max_bounces" if kind == "max" else f"{kind}_bounces", file["film"]["max_depth"])
    return scene


def render_seconds(scene, samples, seed, bpy):
    """Seconds that Cycles takes, and those of the processor."""
    scene.cycles.samples, scene.cycles.seed = samples, seed
    with quiet():
        start = time.perf_counter(), time.process_time()
        bpy.ops.render.render()
        return time.perf_counter() - start[0], time.process_time() - start[1]


def time_cycles(scene, counts, bpy):
    """Milliseconds per sample, and those of the processor, from two sample counts."""
    few, many = (render_seconds(scene, count, i, bpy) for i, count in enumerate(counts))
    return [1e3 * (b - a) / (counts[1] - counts[0]) for a, b in zip(few, many)]


def time_nullray(size, counts=(3, 11)):
    """Milliseconds per sample from the program's own bench, and those of the processor from two sample counts."""
    used = []
    for count in counts:
        command = [NULLRAY, "bench", "--table", "linear", "--sizes", size, "--backend", "cpu", "--repeats", str(count), "--json"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        output = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return [json.loads(output)["rows"][0]["ms_per_sample"], 1e3 * (used[1] - used[0]) / (counts[1] - counts[0])]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="480p,240p")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--picture", help="also write Cycles' picture, of the last size and 64 samples, to this EXR, to compare")
    arguments = parser.parse_args()
    try:
        import bpy
        import mathutils
    except ImportError as error:
        sys.exit(f'cycles_bench: Blender\'s module is not installed ({error}): pip install "bpy>=5", with Python 3.11')
    if bpy.app.version < (5, 0):
        sys.exit(f'cycles_bench: bpy {bpy.app.version_string} is too old: pip install "bpy>=5"')
    if not pathlib.Path(NULLRAY).exists():
        sys.exit("cycles_bench: nullray is not built: cargo build --release")
    with quiet():
        scene = build(tomllib.loads((ROOT / "assets/scenes/benchmark.toml").read_text()), bpy, mathutils)
    print(f"cycles {bpy.app.version_string} (cpu, {os.cpu_count()} threads); milliseconds per sample, medians of {arguments.repeats}")
    print("             elapsed                      of the processor")
    print("size      cycles   nullray     ratio      cycles   nullray     ratio")
    for size in arguments.sizes.split(","):
        scene.render.resolution_x, scene.render.resolution_y = SIZES[size]
        render_seconds(scene, 2, 0, bpy)
        peer, own = [], []
        for _ in range(arguments.repeats):
            peer.append(time_cycles(scene, (2, 10), bpy))
            own.append(time_nullray(size))
        columns = []
        for which in range(2):
            a, b = (statistics.median(times[which] for times in runs) for runs in (peer, own))
            columns.append(f"{a:7.1f} {b:9.1f} {b / a:9.3f}")
        print(f"{size:8}", "     ".join(columns), flush=True)
    if arguments.picture:
        render_seconds(scene, 64, 0, bpy)
        scene.render.image_settings.file_format = "OPEN_EXR"
        bpy.data.images["Render Result"].save_render(str(pathlib.Path(arguments.picture).resolve()))


if __name__ == "__main__":
    main()

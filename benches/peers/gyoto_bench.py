#!/usr/bin/env python3
"""Curved rays per second and core, and their accuracy, in GYOTO (Debian: gyoto-bin) beside `nullray trace`.

A black hole of mass 1 with an opaque thin disc from its innermost stable orbit to r = 50 is seen from r = 100, a few degrees above
the disc, without spin (KerrBL; nullray's `schwarzschild`) and with it (KerrBL; `kerr`). GYOTO draws its screen of size x size
pixels; nullray is given the photons that arrive at the same pixels, in its own coordinates. Both end a ray at the disc, at the
horizon or far out.

Time is user CPU time of one thread. Of GYOTO it is the difference of two sizes of screen, of nullray that of one and of more copies
of the rays, so start-up is out. What is left in nullray's is reading and writing the rays as text; what that takes is seen from the
same rays with `--linear`, and is taken out in the second column. The programs take turns, and medians are printed.

GYOTO runs as it comes, where no step is longer than 1 M, and with steps of up to a tenth of the radius. Without any limit it is no
faster and loses the disc: 99th percentile of the error 6 M. Errors are those of the radius where a ray meets the disc, in M: nullray's
against GYOTO at 1e-12, GYOTO's against nullray at 1e-14. GYOTO finds the disc by bisection down to 1e-4 in time; "on the plane" is its
radius moved along the photon's velocity to the plane itself. nullray meets surfaces in single precision whatever the precision of the
curve; "at --plane" are the crossings it finds in double.
"""

import argparse
import csv
import math
import pathlib
import resource
import shutil
import statistics
import struct
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
NULLRAY = str(ROOT / "target/release/nullray")
DISTANCE, RIM, NO_HIT = 100.0, 50.0, 1e300
# Copies of the screen that are timed: few where a ray takes long.
FEW, MANY = 2, 24
LONG_STEPS = ["-EAstrobj::DeltaMaxInsideRMax=1e6", "-EDeltaMaxOverR=0.1"]


def innermost_stable_orbit(spin):
    """Radius of the innermost stable circular orbit, prograde (Bardeen, Press and Teukolsky 1972, equation 2.21)."""
    z1 = 1 + (1 - spin**2) ** (1 / 3) * ((1 + spin) ** (1 / 3) + (1 - spin) ** (1 / 3))
    z2 = math.sqrt(3 * spin**2 + z1**2)
    return 3 + z2 - math.sqrt((3 - z1) * (3 + z1 + 2 * z2))


def spherical_basis(theta):
    """Unit vectors of r, theta and phi at the azimuth 0."""
    return (math.sin(theta), 0.0, math.cos(theta)), (math.cos(theta), 0.0, -math.sin(theta)), (0.0, 1.0, 0.0)


def combine(factors, vectors):
    return tuple(sum(f * v[k] for f, v in zip(factors, vectors)) for k in range(3))


def solve(rows, right):
    """The vector p with row . p = right for three rows, by Cramer's rule."""
    cross = lambda u, v: (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    dual = cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])
    volume = sum(a * b for a, b in zip(rows[0], dual[0]))
    return combine([c / volume for c in right], dual)


class View:
    """A hole, its disc and the screen it is seen on."""

    def __init__(self, spin, inclination_degrees, fov):
        self.spin, self.fov = spin, fov
        self.theta = math.radians(inclination_degrees)
        self.inner = math.ceil(100 * innermost_stable_orbit(spin)) / 100

    def name(self):
        return f"a = {self.spin}, disc from {self.inner} to {RIM:g}, seen from r = {DISTANCE:g}, {math.degrees(self.theta):g} degrees from the axis"

    def gyoto_file(self):
        return f"""<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<Scenery>
  <Metric kind="KerrBL"><Spin>{self.spin}</Spin></Metric>
  <Screen>
    <Position>1000. {DISTANCE} {self.theta!r} 0.</Position>
    <Time unit="geometrical_time">1000.</Time>
    <FieldOfView>{self.fov}</FieldOfView>
  </Screen>
  <Astrobj kind="ThinDisk">
    <InnerRadius>{self.inner}</InnerRadius>
    <OuterRadius>{RIM}</OuterRadius>
    <OpticallyThick/>
  </Astrobj>
  <MinimumTime>0.</MinimumTime>
</Scenery>
"""

    def nullray_file(self, with_disc):
        hole = f'kind = "kerr"\nspin = {self.spin}\naxis = [0, 0, 1]' if self.spin else 'kind = "schwarzschild"'
        disc = f"[[accretion_disc]]\ninner_radius = {self.inner}\nouter_radius = {RIM}\nnormal = [0, 0, 1]\npeak_temperature = 7000\n"
        return f"[spacetime]\n{hole}\n\n" + (disc if with_disc else "")

    def pixels(self, size):
        """Components along r, theta and phi of the photons' directions at GYOTO's pixels, row by row ("EquatorialAngles")."""
        step, middle = self.fov / size, (size + 1) / 2
        for j in range(1, size + 1):
            for i in range(1, size + 1):
                alpha, delta = -step * (i - middle), step * (j - middle)
                yield math.cos(alpha) * math.cos(delta), math.sin(delta), math.sin(alpha) * math.cos(delta)

    def rays(self, size):
        """Header and rows of nullray's input."""
        if not self.spin:
            r = (DISTANCE - 1 + math.sqrt(DISTANCE * (DISTANCE - 2))) / 2
            basis = spherical_basis(self.theta)
            start = combine((r, 0, 0), basis)
            return "x,y,z,dx,dy,dz", [start + combine([-c for c in n], basis) for n in self.pixels(size)]
        return "x,y,z,px,py,pz", [self.kerr_photon(n) for n in self.pixels(size)]

    def kerr_photon(self, direction):
        """Start and covariant momentum, in Kerr-Schild coordinates, of the photon k^i = direction^i / sqrt(g_ii) of Boyer and Lindquist's.

        That is what GYOTO means by "ObserverAtInfinity". With t_KS = t + f(r), phi_KS = phi + g(r) only the component along r changes.
        """
        a, r = self.spin, DISTANCE
        sin, cos = math.sin(self.theta), math.cos(self.theta)
        sigma, delta = r * r + a * a * cos * cos, r * r - 2 * r + a * a
        g_tt, g_tp, g_rr, g_hh = 2 * r / sigma - 1, -2 * a * r * sin * sin / sigma, sigma / delta, sigma
        g_pp = ((r * r + a * a) ** 2 - a * a * delta * sin * sin) * sin * sin / sigma
        k_r, k_h, k_p = (n / math.sqrt(g) for n, g in zip(direction, (g_rr, g_hh, g_pp)))
        half = g_tp * k_p
        k_t = (-half - math.sqrt(half * half - g_tt)) / g_tt
        energy, angular = -g_tt * k_t - g_tp * k_p, g_tp * k_t + g_pp * k_p
        momentum = (g_rr * k_r + (2 * r * energy - a * angular) / delta, g_hh * k_h, angular)
        tangents = (sin, 0, cos), (r * cos, a * cos, -r * sin), (-a * sin, r * sin, 0)
        return (r * sin, a * sin, r * cos) + solve(tangents, momentum)

    def radius(self, x, y):
        """Boyer and Lindquist's radius of a point of nullray's equatorial plane."""
        distance = math.hypot(x, y)
        return math.sqrt(distance**2 - self.spin**2) if self.spin else distance * (1 + 1 / (2 * distance)) ** 2


def run(command):
    """User CPU seconds of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1]
        sys.exit(f"gyoto_bench: `{' '.join(command)}` failed: {said}")
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def read_impacts(path):
    """Per pixel (r, r moved onto the plane) of the photon at the disc, or None, from the FITS extension of `gyoto --impact-coords`."""
    data, at = path.read_bytes(), 0
    while at < len(data):
        cards, ended = {}, False
        while not ended:
            for k in range(at, at + 2880, 80):
                card = data[k : k + 80].decode("ascii")
                ended = ended or card.rstrip() == "END"
                key, _, value = card.partition("=")
                cards[key.strip()] = value.partition("/")[0].strip(" '")
            at += 2880
        count = math.prod(int(cards[f"NAXIS{k + 1}"]) for k in range(int(cards["NAXIS"])))
        if cards.get("EXTNAME") == "Gyoto Impact Coordinates":
            numbers, impacts = struct.unpack_from(f">{count}d", data, at), []
            for k in range(0, count, 16):
                t, r, theta, _, _, r_dot, theta_dot, _ = numbers[k + 8 : k + 16]
                impacts.append(None if t > NO_HIT else (r, r + r_dot / theta_dot * (math.pi / 2 - theta)))
            return impacts
        at += -(-8 * count // 2880) * 2880
    sys.exit(f"gyoto_bench: no impact coordinates in {path.name}; is this GYOTO 1.4 or later?")


class Bench:
    def __init__(self, view, size, folder):
        self.view, self.size, self.folder = view, size, folder
        (folder / "gyoto.xml").write_text(view.gyoto_file())
        for name, with_disc in (("disc", True), ("plane", False)):
            (folder / f"{name}.toml").write_text(view.nullray_file(with_disc))
        header, rows = view.rays(size)
        text = "".join(",".join(map(repr, row)) + "\n" for row in rows)
        for n in (1, 1 + FEW, 1 + MANY):
            (folder / f"rays{n}.csv").write_text(header + "\n" + n * text)

    def gyoto(self, options, size=None):
        size = size or self.size
        output = self.folder / "gyoto.fits"
        return run(["gyoto", "-s", "-T1", f"-r{size}", "--impact-coords", *options, str(self.folder / "gyoto.xml"), f"!{output}"])

    def nullray(self, options, copies=1, scene="disc"):
        files = [str(self.folder / name) for name in (f"{scene}.toml", f"rays{copies}.csv", "nullray.csv")]
        common = ["--backend", "cpu", "--threads", "1", "--set", "integrator.max_steps=1000000"]
        return run([NULLRAY, "trace", files[0], "--rays", files[1], "-o", files[2], *common, *options])

    def time_gyoto(self, options):
        """Seconds per ray."""
        half = self.size // 2
        small, large = (self.gyoto(options, size) for size in (half, self.size))
        return (large - small) / (self.size**2 - half**2)

    def time_nullray(self, options, copies):
        """Seconds per ray, text included."""
        small, large = (self.nullray(options, n) for n in (1, 1 + copies))
        return (large - small) / (copies * self.size**2)

    def radii_gyoto(self, options):
        """Per pixel the radius of the hit as it is and on the plane, or None."""
        self.gyoto(options)
        return read_impacts(self.folder / "gyoto.fits")

    def radii_nullray(self, options):
        """Per pixel the radius of the hit, or None."""
        self.nullray(options)
        with open(self.folder / "nullray.csv") as file:
            rows = list(csv.DictReader(file))
        return [self.view.radius(float(row["x"]), float(row["y"])) if row["status"] == "hit" else None for row in rows]

    def radii_at_plane(self, options):
        """Per pixel the radius of the first crossing of the plane inside the disc's rims, or None; without a disc in the scene."""
        self.nullray([*options, "--plane", "0,0,1,0"], scene="plane")
        radii = []
        with open(self.folder / "nullray.csv") as file:
            for row in csv.DictReader(file):
                found = (self.view.radius(float(row[f"c{k}_x"]), float(row[f"c{k}_y"])) for k in range(1, min(int(row["crossings"]), 16) + 1))
                radii.append(next((r for r in found if self.view.inner <= r <= RIM), None))
        return radii


def errors(radii, exact):
    """Median, 99th percentile and largest difference, as text."""
    differences = sorted(abs(a - b) for a, b in zip(radii, exact) if a is not None and b is not None)
    return "".join(f"{differences[min(int(q * len(differences)), len(differences) - 1)]:10.1e}" for q in (0.5, 0.99, 1))


def compare(bench, repeats):
    """Print the table of one view."""
    tight = bench.radii_gyoto(["-ERelTol=1e-12", "-EAbsTol=1e-12"])
    tight = [None if hit is None else hit[1] for hit in tight]
    best = bench.radii_at_plane(["--tolerance", "1e-14"])
    peers = {
        "gyoto 1e-6 (default)": [],
        "gyoto 1e-12": ["-ERelTol=1e-12", "-EAbsTol=1e-12"],
        "gyoto 1e-6, steps to r / 10": LONG_STEPS,
    }
    own = {
        "nullray f64 1e-12 (default)": ([], FEW),
        "nullray f64 1e-8": (["--tolerance", "1e-8"], FEW),
        "nullray f64 1e-6": (["--tolerance", "1e-6"], MANY),
        "nullray f32 1e-5 (default)": (["--precision", "f32"], MANY),
    }
    text, times = [], {name: [] for name in [*peers, *own]}
    for _ in range(repeats):
        for name, options in peers.items():
            times[name].append(bench.time_gyoto(options))
        for name, (options, copies) in own.items():
            times[name].append(bench.time_nullray(options, copies))
        text.append(bench.time_nullray(["--linear"], MANY))
    text = statistics.median(text)
    surface = {name: bench.radii_nullray(options) for name, (options, _) in own.items()}

    hits = surface["nullray f64 1e-12 (default)"]
    both = sum(a is not None and b is not None for a, b in zip(tight, hits))
    alone = [sum(a is not None and b is None for a, b in zip(*pair)) for pair in ((tight, hits), (hits, tight))]
    print(f"\n{bench.view.name()}")
    print(f"{len(hits)} rays: {both} meet the disc in both, {alone[0]} only in gyoto, {alone[1]} only in nullray")
    print(f"text takes nullray {1e6 * text:.1f} us a ray")
    print("rays per second and core         whole  without text    median       p99       max   error of the disc's radius, in M")
    for name, options in peers.items():
        rate, hit = 1 / statistics.median(times[name]), bench.radii_gyoto(options)
        print(f"{name:28} {rate:9.0f} {rate:13.0f}{errors([h and h[0] for h in hit], best)}")
        print(f"{'  on the plane':28} {'':23}{errors([h and h[1] for h in hit], best)}")
    for name in own:
        seconds = statistics.median(times[name])
        print(f"{name:28} {1 / seconds:9.0f} {1 / (seconds - text):13.0f}{errors(surface[name], tight)}")
    for name, (options, _) in own.items():
        if "f64" in name:
            print(f"{name + ' at --plane':38} {'':13}{errors(bench.radii_at_plane(options), tight)}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spins", default="0,0.9", help="from 0 to below 1")
    parser.add_argument("--size", type=int, default=64, help="pixels along a side of the screen, even")
    parser.add_argument("--inclination", type=float, default=80, help="degrees between the axis and the direction to the observer")
    parser.add_argument("--fov", type=float, default=0.3, help="side of the screen in radians")
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    if not shutil.which("gyoto"):
        sys.exit("gyoto_bench: gyoto is not installed: apt-get install --no-install-recommends gyoto-bin")
    if not pathlib.Path(NULLRAY).exists():
        sys.exit("gyoto_bench: nullray is not built: cargo build --release")
    version = subprocess.run(["gyoto", "--version"], capture_output=True, text=True).stdout.splitlines()[0]
    print(f"{version}; user CPU time of one thread, medians of {arguments.repeats}")
    for spin in map(float, arguments.spins.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            view = View(spin, arguments.inclination, arguments.fov)
            compare(Bench(view, arguments.size, pathlib.Path(folder)), arguments.repeats)


if __name__ == "__main__":
    main()

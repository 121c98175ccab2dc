//! Hot thin discs and the colour of heat: the innermost stable orbit (Bardeen, Press & Teukolsky 1972), the flux of a thin disc
//! (Page & Thorne 1974 in closed form), and black bodies in linear sRGB.
//!
//! Lengths are geometric (G = c = 1, the mass is a length). The colour matching functions are the analytic fit of Wyman, Sloan and
//! Shirley (JCGT 2013) to the CIE 1931 2-degree observer instead of its table. Along a ray `I_nu / nu^3` is conserved, so a black body
//! at T seen with the frequency ratio `g = nu_observed / nu_emitted` is exactly a black body at `g * T`: look up `g * T`, and apply no
//! further power of g.

use std::f64::consts::FRAC_PI_3;
use std::sync::LazyLock;

/// Temperature at which a black body has the luminance 1, in kelvin.
pub const BLACK_BODY_UNIT_KELVIN: f64 = 6500.0;

/// Largest |a / M| the flux is evaluated for: at 1 two of the roots below meet, though the flux has a limit.
const MAX_FLUX_SPIN: f64 = 1.0 - 1e-9;
/// Steps of the golden section search: shrinks the interval by 1e-10, below what a parabola's top resolves.
const SEARCH_STEPS: usize = 48;
/// Second radiation constant `h c / k` [nm K] (exact in the SI of 2019, rounded).
const SECOND_RADIATION_NM_KELVIN: f64 = 1.438_776_877e7;
/// The visible range [nm]; it is sampled at every whole nanometre.
const VISIBLE_NM: std::ops::RangeInclusive<u32> = 360..=830;
/// Linear sRGB (Rec. 709 primaries, white D65) from CIE XYZ, IEC 61966-2-1 to seven digits.
const SRGB_FROM_XYZ: [[f64; 3]; 3] =
    [[3.240_454_2, -1.537_138_5, -0.498_531_4], [-0.969_266_0, 1.876_010_8, 0.041_556_0], [0.055_643_4, -0.204_025_9, 1.057_225_2]];

/// `a / M`, limited to what a black hole can have; 0 for a hole without mass.
fn spin_ratio(mass: f64, spin: f64) -> f64 {
    if mass > 0.0 { (spin / mass).clamp(-1.0, 1.0) } else { 0.0 }
}

/// Boyer-Lindquist radius of the innermost stable circular orbit around a Kerr hole, in the unit of `mass`.
///
/// `mass` M > 0 and `spin` a = J / M are lengths; positive spin means an orbit turning with the hole, negative against it. |a| > M
/// counts as M. From 9 M (a = -M) over 6 M (a = 0) down to M (a = M); 0 where `mass <= 0`. Bardeen, Press & Teukolsky 1972, eq. 2.21.
pub fn isco(mass: f64, spin: f64) -> f64 {
    let a = spin_ratio(mass, spin);
    let z1 = 1.0 + (1.0 - a * a).cbrt() * ((1.0 + a).cbrt() + (1.0 - a).cbrt());
    let z2 = (3.0 * a * a + z1 * z1).sqrt();
    let root = ((3.0 - z1) * (3.0 + z1 + 2.0 * z2)).max(0.0).sqrt();
    mass.max(0.0) * (3.0 + z2 - root.copysign(a))
}

/// Angular velocity `d phi / d t` of a circular equatorial Kerr geodesic [1 / length], `sqrt(M) / (r^{3/2} + a sqrt(M))`.
///
/// `radius` > 0 is the Boyer-Lindquist radius, signs as in [`isco`]: the result is positive in the orbit's own sense. Bardeen, Press &
/// Teukolsky 1972, eq. 2.16.
pub fn keplerian(radius: f64, mass: f64, spin: f64) -> f64 {
    let root = mass.max(0.0).sqrt();
    root / (radius * radius.sqrt() + spin * root)
}

/// The function f of Page & Thorne [1 / length]: a thin disc's flux in its own frame is `F = f * accretion_rate / (4 pi radius)`.
///
/// Arguments as in [`isco`]; no torque at the innermost stable orbit, and 0 inside it, where `mass <= 0`, or for a NaN. |a| is held
/// below `(1 - 1e-9) M`. Page & Thorne 1974, eq. 15n, with the logarithms gathered by root:
/// `f = 3 / (2 M) / (x^2 (x^3 - 3 x + 2 a)) * [x - x0 - (3/2) a ln(x / x0) - sum_i w_i ln((x - x_i) / (x0 - x_i))]`,
/// `w_i = 3 (x_i - a)^2 / (x_i (x_i - x_j) (x_i - x_k))`, where `x = sqrt(r / M)`, a is in units of M, `x_i^3 - 3 x_i + 2 a = 0`.
pub fn disc_flux(radius: f64, mass: f64, spin: f64) -> f64 {
    let a = spin_ratio(mass, spin).clamp(-MAX_FLUX_SPIN, MAX_FLUX_SPIN);
    let x0 = isco(1.0, a).sqrt();
    let x = (radius / mass).sqrt();
    let outside = mass > 0.0 && x > x0 && x.is_finite();
    if !outside {
        return 0.0;
    }
    let third = a.acos() / 3.0;
    let (x1, x3) = (2.0 * (third - FRAC_PI_3).cos(), -2.0 * third.cos());
    // The product of the roots is -2 a: exact where this one passes through 0.
    let x2 = -2.0 * a / (x1 * x3);
    let term = |xi: f64, xj: f64, xk: f64| {
        let weight = 3.0 * (xi - a).powi(2) / (xi * (xi - xj) * (xi - xk));
        weight * ((x - x0) / (x0 - xi)).ln_1p()
    };
    let logarithms = term(x1, x2, x3) + term(x3, x1, x2) + if a == 0.0 { 0.0 } else { term(x2, x3, x1) };
    let bracket = x - x0 - 1.5 * a * ((x - x0) / x0).ln_1p() - logarithms;
    (1.5 / mass * bracket / (x * x * (x * x * x - 3.0 * x + 2.0 * a))).max(0.0)
}

/// Largest `f / r` [1 / length^2] over `r >= max(inner, isco)`: the flux of the hottest ring in units of `accretion_rate / (4 pi)`.
///
/// `inner` > 0 is a Boyer-Lindquist radius, the other arguments are as in [`isco`]. `f / r` has one maximum, well inside four times the
/// innermost stable orbit. 0 where `mass <= 0`.
pub fn max_flux_over_radius(mass: f64, spin: f64, inner: f64) -> f64 {
    let flux = |radius: f64| disc_flux(radius, mass, spin) / radius;
    let edge = isco(mass, spin);
    let start = inner.max(edge);
    let (mut low, mut high) = (start, start.max(4.0 * edge));
    let golden = (5f64.sqrt() - 1.0) / 2.0;
    for _ in 0..SEARCH_STEPS {
        let (left, right) = (high - golden * (high - low), low + golden * (high - low));
        if flux(left) < flux(right) {
            low = left;
        } else {
            high = right;
        }
    }
    flux(start).max(flux(0.5 * (low + high)))
}

/// Effective temperature of a thin disc relative to its hottest ring, `(F / F_max)^{1/4}` in [0, 1], at each of `radii`.
///
/// `radii` are Boyer-Lindquist, increasing from the disc's inner edge; the other arguments as in [`isco`]. `F_max` is taken over all
/// `r >= max(radii[0], isco)`, even beyond the last. 0 inside the innermost stable orbit; outside it the temperature starts like
/// `sqrt(r - isco)`. All 0 where `mass <= 0`.
pub fn disc_temperatures(mass: f64, spin: f64, radii: &[f64]) -> Vec<f32> {
    let max = radii.first().map_or(0.0, |inner| max_flux_over_radius(mass, spin, *inner));
    let temperature = |radius: &f64| {
        let flux = disc_flux(*radius, mass, spin) / radius;
        if flux > 0.0 { (flux / max).powf(0.25).min(1.0) as f32 } else { 0.0 }
    };
    radii.iter().map(temperature).collect()
}

/// CIE 1931 2-degree colour matching functions at a wavelength [nm]: the multi-lobe fit of Wyman, Sloan & Shirley 2013.
fn colour_matching(nm: f64) -> [f64; 3] {
    let lobe = |height: f64, center: f64, below: f64, above: f64| {
        let t = (nm - center) * if nm < center { below } else { above };
        height * (-0.5 * t * t).exp()
    };
    [
        lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) - lobe(0.065, 501.1, 0.0490, 0.0382),
        lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
        lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725),
    ]
}

/// CIE XYZ of a Planck radiator at a temperature in kelvin, in an arbitrary unit of radiance.
fn tristimulus(kelvin: f64) -> [f64; 3] {
    let mut xyz = [0.0; 3];
    for nm in VISIBLE_NM.map(f64::from) {
        // In units of 560 nm, so that the numbers stay near 1.
        let planck = (560.0 / nm).powi(5) / (SECOND_RADIATION_NM_KELVIN / (nm * kelvin)).exp_m1();
        for (sum, weight) in xyz.iter_mut().zip(colour_matching(nm)) {
            *sum += weight * planck;
        }
    }
    xyz
}

/// Moves a colour towards the grey of luminance `y` until no component is negative.
fn clip_to_gamut(rgb: [f64; 3], y: f64) -> [f64; 3] {
    let least = rgb[0].min(rgb[1]).min(rgb[2]);
    if least >= 0.0 { rgb } else { rgb.map(|c| (y + (c - y) * (y / (y - least))).max(0.0)) }
}

/// CIE 1931 tristimulus values X, Y, Z of a black body, in units where the luminance Y at 6500 K is 1.
///
/// As [`black_body`], but not limited to the colours of sRGB. Black where the temperature is not positive and finite.
pub fn black_body_xyz(temperature_kelvin: f64) -> [f64; 3] {
    static UNIT: LazyLock<f64> = LazyLock::new(|| tristimulus(BLACK_BODY_UNIT_KELVIN)[1]);
    if !(temperature_kelvin > 0.0 && temperature_kelvin.is_finite()) {
        return [0.0; 3];
    }
    tristimulus(temperature_kelvin).map(|v| v / *UNIT)
}

/// Linear sRGB radiance and luminance of a black body; see [`black_body`].
fn radiance_and_luminance(kelvin: f64) -> ([f64; 3], f64) {
    let xyz = black_body_xyz(kelvin);
    let rgb = SRGB_FROM_XYZ.map(|row| row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2]);
    (clip_to_gamut(rgb, xyz[1]), xyz[1])
}

/// Radiance of a black body in linear sRGB (Rec. 709 primaries, white D65), in units where the luminance at 6500 K is 1.
///
/// Planck's law integrated over 360-830 nm: brightness grows with temperature, 3000 K has a luminance of 0.01. Below about 1900 K the
/// colour lies outside sRGB; it is then moved towards grey at equal luminance until no component is negative. Against the CIE's own
/// table the chromaticity x, y is within 0.003 from 1900 K on and 0.011 at 1000 K, the luminance within 1 % from 600 K on. Black where
/// the temperature is not positive and finite. Seen with the frequency ratio g it is `black_body(g * T)`, without a factor of g.
pub fn black_body(temperature_kelvin: f64) -> [f64; 3] {
    radiance_and_luminance(temperature_kelvin).0
}

/// [`black_body`] at `entries` temperatures, uniform in ln T from `coldest` to `hottest` (kelvin).
///
/// `[0..3]` is the colour divided by its luminance, `[3]` the natural logarithm of the luminance: both vary slowly, while the luminance
/// itself spans 21 decades between 500 K and 100,000 K. All four numbers are meant to be interpolated linearly: with 256 entries over
/// that range the radiance `[0..3] * exp([3])` is off by less than 0.3 % of the luminance and 0.4 % of the largest component.
pub fn black_body_table(entries: usize, coldest: f64, hottest: f64) -> Vec<[f32; 4]> {
    let step = (hottest / coldest).ln() / (entries - 1) as f64;
    let entry = |index: usize| {
        let (rgb, luminance) = radiance_and_luminance(coldest * (step * index as f64).exp());
        let [r, g, b] = rgb.map(|c| (c / luminance) as f32);
        [r, g, b, luminance.ln() as f32]
    };
    (0..entries).map(entry).collect()
}

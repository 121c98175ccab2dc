//! Every constant both backends share. `build.rs` writes the same names into `constants.glsl`.
#![allow(missing_docs, reason = "one comment may stand for a group of constants")]

macro_rules! constants {
    (uint { $($(#[$um:meta])* $un:ident = $uv:expr;)* } float { $($(#[$fm:meta])* $fname:ident = $fv:expr;)* } real { $($(#[$rm:meta])* $rn:ident = $rv:expr;)* }) => {
        $($(#[$um])* pub const $un: u32 = $uv;)*
        $($(#[$fm])* pub const $fname: f32 = $fv;)*
        $($(#[$rm])* pub const $rn: f64 = $rv;)*
        /// Unsigned constants by name.
        pub const UINTS: &[(&str, u32)] = &[$((stringify!($un), $un)),*];
        /// Single-precision constants by name.
        pub const FLOATS: &[(&str, f32)] = &[$((stringify!($fname), $fname)),*];
        /// Constants in the precision of the integrator by name.
        pub const REALS: &[(&str, f64)] = &[$((stringify!($rn), $rn)),*];
    };
}

constants! {
    uint {
        /// Marks an index that names nothing.
        NO_INDEX = 0xffff_ffff;
        /// Threads per workgroup of every kernel.
        WORKGROUP_SIZE = 64;

        /// The ray is still on its way.
        STATUS_FLYING = 0;
        /// The ray met a surface.
        STATUS_HIT = 1;
        /// The ray left the bending region for good.
        STATUS_ESCAPED = 2;
        /// The ray fell into a horizon or a singular source.
        STATUS_CAPTURED = 3;
        /// The ray ran out of steps.
        STATUS_EXHAUSTED = 4;
        /// The ray came to where a traced ray was told to stop.
        STATUS_STOPPED = 5;
        /// What is added to a status on the far side of a wormhole.
        SIDE_UNIT = 256;

        /// BVH child: a block of triangles; the low bits are its index.
        CHILD_BLOCK = 0x8000_0000;
        /// BVH child: one analytic primitive; the low bits are its index.
        CHILD_PRIMITIVE = 0x4000_0000;
        /// Low bits of a BVH child.
        CHILD_INDEX = 0x3fff_ffff;
        /// Words of 16 bytes of a node, a block of triangles, an analytic primitive, a material, a light.
        NODE_WORDS = 14;
        BLOCK_WORDS = 20;
        PRIMITIVE_WORDS = 4;
        MATERIAL_WORDS = 5;
        LIGHT_WORDS = 3;
        /// Entries of the traversal stack; the builder proves that no tree needs more.
        STACK_SIZE = 128;
        /// Hit on an analytic primitive rather than a triangle.
        HIT_PRIMITIVE = 0x8000_0000;

        /// Kinds of analytic primitive.
        PRIMITIVE_SPHERE = 0;
        PRIMITIVE_QUAD = 1;
        PRIMITIVE_BOX = 2;
        PRIMITIVE_DISC = 3;

        /// Kinds of material.
        MATERIAL_DIFFUSE = 0;
        MATERIAL_METALLIC = 1;
        MATERIAL_DIELECTRIC = 2;
        MATERIAL_EMISSIVE = 3;
        /// Thermal matter on circular orbits; what is behind it is seen if it is not opaque.
        MATERIAL_ACCRETION = 4;
        /// Material flag: emits on both sides of a surface.
        MATERIAL_TWO_SIDED = 1;
        /// Material flag: some value is textured, so that texture coordinates are needed.
        MATERIAL_TEXTURED = 2;
        /// Material flag: nothing is seen through an accretion disc.
        MATERIAL_OPAQUE = 4;

        /// Kinds of light.
        LIGHT_SPHERE = 0;
        LIGHT_QUAD = 1;
        LIGHT_TRIANGLE = 2;
        LIGHT_ENVIRONMENT = 3;

        /// Kinds of environment.
        ENVIRONMENT_CONSTANT = 0;
        ENVIRONMENT_GRADIENT = 1;
        ENVIRONMENT_GRID = 2;
        ENVIRONMENT_IMAGE = 3;

        /// Kinds of camera.
        CAMERA_PERSPECTIVE = 0;
        CAMERA_PANORAMA = 1;

        /// Pixel filters.
        FILTER_BOX = 0;
        FILTER_GAUSSIAN = 1;

        /// What ends traced rays: nothing, a length, a value of the parameter, leaving a sphere, crossing a plane.
        STOP_NONE = 0;
        STOP_LENGTH = 1;
        STOP_PARAMETER = 2;
        STOP_SPHERE = 3;
        STOP_PLANE = 4;

        /// Integrators: those of their own, then, from METHOD_RUNGE_KUTTA on, those that run from a tableau.
        METHOD_EULER = 0;
        METHOD_NYSTROM = 1;
        METHOD_SYMPLECTIC = 2;
        METHOD_LEAPFROG = 3;
        METHOD_RUNGE_KUTTA = 4;
        METHOD_EXPLICIT_EULER = METHOD_RUNGE_KUTTA;
        METHOD_RK4 = METHOD_RUNGE_KUTTA + 1;
        METHOD_BOGACKI_SHAMPINE = METHOD_RUNGE_KUTTA + 2;
        METHOD_DORMAND_PRINCE = METHOD_RUNGE_KUTTA + 3;
        /// Methods that run from a tableau.
        TABLEAU_COUNT = METHOD_DORMAND_PRINCE - METHOD_RUNGE_KUTTA + 1;
        /// Most stages of a Runge-Kutta method.
        MAX_STAGES = 7;
        /// Entries of a packed tableau: stages, whether it estimates its error, nodes, error weights, weights of the quartic term, rows.
        TABLEAU_SIZE = 2 + 3 * MAX_STAGES + MAX_STAGES * MAX_STAGES;
        /// Most parameters of a model beside those of its sources.
        MAX_GLOBALS = 16;
        /// Iterations of the implicit kick of symplectic Euler.
        SYMPLECTIC_ITERATIONS = 4;

        /// Random pairs drawn for a camera ray: film, lens.
        CAMERA_PAIRS = 2;
        /// Random pairs drawn at a bounce: direction, lobe and roulette, choice among many lights.
        BOUNCE_PAIRS = 3;
        /// First bounce at which Russian roulette may end a path.
        ROULETTE_BOUNCE = 5;
        /// Up to this many lights the density of light sampling is summed over all of them, one pair of random numbers chooses the light and the
        /// direction, and there is a table of where they appear.
        MAX_SUMMED_LIGHTS = 16;
        /// Entries of the table of black bodies, uniform in the logarithm of temperature.
        BLACK_BODY_SIZE = 256;
        /// Entries of the profile of an accretion disc, uniform in radius.
        DISC_PROFILE_SIZE = 512;
        /// Control points of the table of a model without a closed form.
        TABLE_ROWS = 96;
        TABLE_COLUMNS = 48;
        /// Side of the table of GGX directional albedo, by cosine and by roughness.
        ALBEDO_SIZE = 32;
        /// Most chords one integration step is cut into.
        MAX_CHORDS = 32;
        /// Levels of the table that lights are aimed at by, each half as large as the one before, and cells along each of its axes.
        AIM_LEVELS = 4;
        AIM_SIDE = 16;
        /// Levels of the clearance grid, each half as large as the one before.
        GRID_LEVELS = 4;
        /// 2^24: the film's fixed-point unit is 2^-24.
        FILM_FRACTION_BITS = 24;

        /// Values of a film that a picture may show.
        CHANNEL_RADIANCE = 0;
        CHANNEL_ALBEDO = 1;
        CHANNEL_NORMAL = 2;
        CHANNEL_DISTANCE = 3;
        CHANNEL_REDSHIFT = 4;
        CHANNEL_STEPS = 5;
        CHANNEL_CHORDS = 6;
        CHANNEL_STATUS = 7;
        CHANNEL_CONSTRAINT_ERROR = 8;
        CHANNEL_COST = 9;

        /// Tone curves.
        TONE_NONE = 0;
        TONE_REINHARD = 1;
        TONE_ACES = 2;
    }
    float {
        PI = std::f32::consts::PI;
        INV_PI = std::f32::consts::FRAC_1_PI;
        TAU = std::f32::consts::TAU;
        /// A distance no scene reaches.
        FAR = 1e30;
        /// Rounding must not lose a box that is grazed: the share by which it is met earlier and later.
        BOX_ROUNDING = 4.0 * f32::EPSILON;
        /// Ray origins leave the surface by this share of their coordinates.
        ORIGIN_OFFSET = 1e-5;
        /// Smallest GGX alpha: below it a lobe is a mirror in f32.
        MIN_ALPHA = 1e-3;
        /// GGX alpha from which on the largest share of samples goes towards lights.
        LIGHT_ALPHA = 0.25;
        /// Largest share of samples that go towards lights.
        LIGHT_SHARE = 0.3;
        /// The same where space is bent and more of them miss.
        BENT_LIGHT_SHARE = 0.2;
        /// Spread of a ray cone after a diffuse bounce, radians.
        DIFFUSE_SPREAD = 0.02;
        /// Largest radiance one sample may add to the film, so that its 64-bit fixed-point sums hold 2^20 such samples.
        MAX_RADIANCE = 1048576.0;
        /// Largest luminance whose square enters the film's second moment, so that its sums hold 2^16 such samples.
        MAX_MOMENT_LUMINANCE = 4096.0;
        /// Largest probability with which Russian roulette lets a path live.
        MAX_SURVIVAL = 0.95;
        /// Smallest such probability: roulette multiplies no path by more than its inverse.
        MIN_SURVIVAL = 0.05;
        /// Barycentric slack that closes the seams between neighbouring triangles.
        TRIANGLE_SLACK = 5e-7;
        /// Share by which a chord reaches past its end, so that no gap opens between chords.
        CHORD_SLACK = 1e-6;
        /// Smallest share of a step that is worth cutting off at an end.
        LEAST_GAIN = 0.2;
        /// Range of the table of black bodies (kelvin).
        BLACK_BODY_MIN = 500.0;
        BLACK_BODY_MAX = 100000.0;
        /// Smallest component of a direction in slab tests.
        MIN_DIRECTION = 1e-20;
        /// Standard deviation of the Gaussian pixel filter, pixels.
        FILTER_SIGMA = 0.45;
        /// Radius at which the Gaussian pixel filter is cut off, pixels.
        FILTER_RADIUS = 1.5;
        /// Powers of two that the heat map of steps and of chords spans.
        HEAT_OCTAVES = 12.0;
        /// Powers of two below 1 that the heat map of the constraint error spans.
        ERROR_OCTAVES = 24.0;
        /// Powers of two of frequency at which the colours of red and blue shift are full.
        SHIFT_OCTAVES = 2.0;
        /// Distance that is shown half as bright as one of 0.
        HALF_DISTANCE = 10.0;
    }
    real {
        /// Nodes and weights of RKN4(3)4FM (Dormand, El-Mikkawy and Prince 1987).
        RKN_C1 = 1.0 / 4.0;
        RKN_C2 = 7.0 / 10.0;
        RKN_A10 = 1.0 / 32.0;
        RKN_A20 = 7.0 / 1000.0;
        RKN_A21 = 119.0 / 500.0;
        RKN_B0 = 1.0 / 14.0;
        RKN_B1 = 8.0 / 27.0;
        RKN_B2 = 25.0 / 189.0;
        RKN_V0 = 1.0 / 14.0;
        RKN_V1 = 32.0 / 81.0;
        RKN_V2 = 250.0 / 567.0;
        RKN_V3 = 5.0 / 54.0;
        /// Weights of the embedded third-order solution, subtracted from those above.
        RKN_E0 = 1.0 / 14.0 + 7.0 / 150.0;
        RKN_E1 = 8.0 / 27.0 - 67.0 / 150.0;
        RKN_E2 = 25.0 / 189.0 - 3.0 / 20.0;
        RKN_E3 = 1.0 / 20.0;
        RKN_F0 = 1.0 / 14.0 - 13.0 / 21.0;
        RKN_F1 = 32.0 / 81.0 + 20.0 / 27.0;
        RKN_F2 = 250.0 / 567.0 - 275.0 / 189.0;
        RKN_F3 = 5.0 / 54.0 + 1.0 / 3.0;
        /// Safety factor and limits of the step control.
        STEP_SAFETY = 0.85;
        STEP_SHRINK = 0.2;
        STEP_GROW = 3.0;
        /// Share of the tolerance below which an error says no more than that it is small.
        LEAST_ERROR = 1e-4;
        /// Largest error of a step as a share of the length over which rays change their way: wide cones are no reason to lose it.
        DETAIL_TOLERANCE = 1e-2;
        /// How far beyond a sharp edge of the region a ray may end, as a share of its radius.
        EDGE_SLACK = 1e-5;
        /// How near a rim counts as on it, as a share of its radius.
        RIM_SLACK_F32 = 1e-6;
        RIM_SLACK_F64 = 1e-10;
        /// Least cosine to the rim's normal with which a ray is taken across.
        RIM_COSINE = 1e-3;
        /// First step, as a share of the local radius of curvature.
        FIRST_STEP = 0.3;
        /// Error of a first step as a share of the way that the change of the force along it moves a ray.
        FIRST_ERROR = 0.08;
        /// How far inside the bending region a ray that enters it is put, as a share of the way to it.
        REGION_MARGIN_F32 = 1e-6;
        REGION_MARGIN_F64 = 1e-14;
        /// Smallest tolerance, as a share of the coordinates: below it rounding is all there is.
        TOLERANCE_FLOOR_F32 = 3e-8;
        TOLERANCE_FLOOR_F64 = 1e-15;
    }
}

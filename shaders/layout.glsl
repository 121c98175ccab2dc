// Structures both backends read; documented in src/kernels/layout.rs.

struct Triangle {
    uint vertices[3];
    uint object;
};

struct Vertex {
    float normal[3];
    float uv[2];
};

struct Primitive {
    float data[12];
    uint kind;
    uint object;
};

struct Material {
    vec3 base_color;
    uint kind;
    vec3 emission;
    float roughness;
    vec3 absorption;
    float ior;
    uint base_texture;
    uint roughness_texture;
    uint emission_texture;
    uint flags;
    float temperature;
    uint profile;
    float inner_radius;
    float outer_radius;
};

struct Texture {
    uint first_index;
    uint width;
    uint height;
};

struct Light {
    vec3 position;
    uint kind;
    vec3 edge_u;
    float size;
    vec3 edge_v;
    float cumulative;
};

struct EnvironmentParameters {
    vec3 color;
    uint kind;
    vec3 horizon;
    float scale;
    vec3 nadir;
    float angle;
    uint texture_index;
    uint columns;
    uint rows;
    float temperature;
};

struct SceneParameters {
    vec3 camera_position;
    float tan_half_fov;
    vec3 camera_right;
    float aspect;
    vec3 camera_up;
    float aperture_radius;
    vec3 camera_forward;
    float focus_distance;
    vec3 camera_velocity;
    uint far_root;
    EnvironmentParameters environment[2];
    vec3 region_center;
    float region_radius;
    vec3 grid_focus;
    float grid_inverse_cell;
    uvec3 grid_size;
    float region_strength;
    vec3 bounds_low;
    uint camera_kind;
    vec3 bounds_high;
    uint filter_kind;
    vec3 grid_focus_cell;
    uint film_width;
    vec3 grid_reach_low;
    uint film_height;
    vec3 grid_reach_high;
    float pixel_spread;
    vec3 aim_focus;
    float aim_scale;
    float cone_width;
    float origin_offset;
    float tolerance;
    float chord_tolerance;
    uint max_steps;
    uint method;
    uint literal_kick;
    uint max_depth;
    uint light_count;
    uint region_sharp;
    uint local_frames;
    float light_share;
};

struct Aov {
    vec3 albedo;
    float redshift;
    vec3 normal;
    float distance;
    vec3 position;
    float constraint_error;
    uint object;
    uint status;
    uint steps;
    uint chords;
};

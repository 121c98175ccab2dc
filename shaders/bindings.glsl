// Every buffer and its accessor. Scene arrays and the film are reached by address, so that they may be larger than a storage
// buffer range; paths and queues are descriptors. The accessors' twins are in src/kernels/view.rs.

#ifdef REAL64
#define real double
#define real3 dvec3
#define TOLERANCE_FLOOR TOLERANCE_FLOOR_F64
#define REGION_MARGIN REGION_MARGIN_F64
#define RIM_SLACK RIM_SLACK_F64
#else
#define real float
#define real3 vec3
#define TOLERANCE_FLOOR TOLERANCE_FLOOR_F32
#define REGION_MARGIN REGION_MARGIN_F32
#define RIM_SLACK RIM_SLACK_F32
#endif

#include "constants.glsl"
#include "layout.glsl"

layout(local_size_x = 64) in;

#define SCENE_BUFFER(name, type) layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer name { type items[]; }
SCENE_BUFFER(Nodes, BvhNode);
SCENE_BUFFER(Blocks, TriangleBlock);
SCENE_BUFFER(Triangles, Triangle);
SCENE_BUFFER(Vertices, Vertex);
SCENE_BUFFER(Primitives, Primitive);
SCENE_BUFFER(Uints, uint);
SCENE_BUFFER(Floats, float);
SCENE_BUFFER(Textures, Texture);
SCENE_BUFFER(Texels, uvec2);
layout(buffer_reference, std430, buffer_reference_align = 8) readonly buffer Profiles { vec2 items[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer BlackBodies { vec4 items[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Materials { Material items[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Lights { Light items[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Model {
    uint source_count;
    uint source_stride;
    uint source_start;
    uint global_start;
    uint table_start;
    uint table_rows;
    uint table_columns;
    uint value_count;
    real values[];
};
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Scene {
    Nodes nodes;
    Blocks blocks;
    Triangles triangles;
    Vertices vertices;
    Primitives primitives;
    Uints objects;
    Materials materials;
    Textures textures;
    Texels texels;
    Lights lights;
    Floats environment_cdf;
    Uints clearance;
    Floats albedo;
    BlackBodies black_bodies;
    Profiles profiles;
    Model model;
    SceneParameters parameters;
};
layout(buffer_reference, std430, buffer_reference_align = 16) buffer FilmSums { uvec4 items[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) buffer FilmAovs { Aov items[]; };

layout(push_constant) uniform Push {
    Scene scene;
    FilmSums sums;
    FilmAovs aovs;
    uint first_row;
    uint row_count;
    uint first_sample;
    uint slot_count;
    uint aov_sample;
    uint parity;
    uint stage;
    uint capacity;
    uint tracing;
    // Where traced rays end: STOP_* and up to four numbers, each the sum of two floats.
    uint stop;
    vec4 stop_high;
    vec4 stop_low;
} push;

layout(set = 0, binding = 0, std430) buffer PathBuffer { uvec4 path_words[]; };
layout(set = 0, binding = 1, std430) buffer CounterBuffer { uint counters[]; };
layout(set = 0, binding = 2, std430) buffer QueueBuffer { uint queue[]; };

#define SCENE push.scene.parameters

// Counters: indirect arguments and count of each queue, then what shading and flight go on with, then statistics,
// then what following rays took (work.glsl): six counts of two words.
const uint COUNT_ADVANCE = 0;
const uint COUNT_SHADE = 4;
const uint COUNT_ESCAPE = 8;
const uint COUNT_NEXT = 12;
const uint COUNT_FLYING = 13;
const uint COUNT_EXHAUSTED = 14;
const uint COUNT_INVALID = 15;
const uint COUNT_RAYS = 16;
const uint COUNT_WORK = 20;

// Words of a path.
const uint WORD_ORIGIN = 0;
const uint WORD_DIRECTION = 1;
const uint WORD_THROUGHPUT = 2;
const uint WORD_RADIANCE = 3;
const uint WORD_POSITION = 4;
const uint WORD_TRAVEL = 5;
const uint WORD_SURFACE = 6;
const uint WORD_LEDGER = 7;
const uint WORD_FLIGHT = 8;
const uint WORD_LAUNCH = 12;
const uint WORD_LENGTH = 13;
const uint WORD_DIAGONAL = 14;
const uint WORD_MIXED = 15;
const uint WORD_RATIO = 16;

// Steps word of a ray that has not started: from the path's origin, or from the flight's own words.
const uint FRESH = 0xffffffffu;
const uint FRESH_TRACED = 0xfffffffeu;

uvec4 load_word(uint slot, uint word) {
    return path_words[word * push.capacity + slot];
}

void store_word(uint slot, uint word, uvec4 value) {
    path_words[word * push.capacity + slot] = value;
}

void store_word(uint slot, uint word, vec3 xyz, uint w) {
    store_word(slot, word, uvec4(floatBitsToUint(xyz), w));
}

void store_word(uint slot, uint word, vec3 xyz, float w) {
    store_word(slot, word, xyz, floatBitsToUint(w));
}

uint queue_advance(uint parity) {
    return parity * push.capacity;
}

uint queue_shade() {
    return 2 * push.capacity;
}

uint queue_escape() {
    return 3 * push.capacity;
}

// Pixel and sample of a slot: samples of one pixel are whole films apart.
uvec3 slot_pixel(uint slot) {
    uint pixels = push.row_count * SCENE.film_width;
    uint pixel = slot % pixels;
    return uvec3(pixel % SCENE.film_width, push.first_row + pixel / SCENE.film_width, push.first_sample + slot / pixels);
}

uint scene_root(uint side) {
    return side == 0 ? 0 : SCENE.far_root;
}

float node_bound(uint node, uint plane, uint lane) {
    return push.scene.nodes.items[node].bounds[plane * 8 + lane];
}

uint node_child(uint node, uint lane) {
    return push.scene.nodes.items[node].child[lane];
}

uint block_triangle(uint block, uint lane) {
    return push.scene.blocks.items[block].triangle[lane];
}

vec3 block_vertex(uint block, uint lane) {
    return vec3(push.scene.blocks.items[block].vertex[lane], push.scene.blocks.items[block].vertex[8 + lane], push.scene.blocks.items[block].vertex[16 + lane]);
}

vec3 block_edge1(uint block, uint lane) {
    return vec3(push.scene.blocks.items[block].edge1[lane], push.scene.blocks.items[block].edge1[8 + lane], push.scene.blocks.items[block].edge1[16 + lane]);
}

vec3 block_edge2(uint block, uint lane) {
    return vec3(push.scene.blocks.items[block].edge2[lane], push.scene.blocks.items[block].edge2[8 + lane], push.scene.blocks.items[block].edge2[16 + lane]);
}

Triangle triangle_at(uint index) {
    return push.scene.triangles.items[index];
}

Vertex vertex_at(uint index) {
    return push.scene.vertices.items[index];
}

Primitive primitive_at(uint index) {
    return push.scene.primitives.items[index];
}

uint object_material(uint object) {
    return push.scene.objects.items[object];
}

Material material_at(uint index) {
    return push.scene.materials.items[index];
}

Texture texture_at(uint index) {
    return push.scene.textures.items[index];
}

vec4 texel(uint index) {
    uvec2 halves = push.scene.texels.items[index];
    return vec4(unpackHalf2x16(halves.x), unpackHalf2x16(halves.y));
}

Light light_at(uint index) {
    return push.scene.lights.items[index];
}

float environment_cdf(uint index) {
    return push.scene.environment_cdf.items[index];
}

float clearance(uint cell) {
    return float((push.scene.clearance.items[cell / 4] >> (8 * (cell % 4))) & 0xffu);
}

float albedo(uint index) {
    return push.scene.albedo.items[index];
}

vec4 black_body_entry(uint index) {
    return push.scene.black_bodies.items[index];
}

vec2 profile_entry(uint index) {
    return push.scene.profiles.items[index];
}

// The model's block: origin, step, throat, rim, Runge-Kutta tableau, global parameters, sources.
real3 model_origin() {
    return real3(push.scene.model.values[0], push.scene.model.values[1], push.scene.model.values[2]);
}

real model_step() {
    return push.scene.model.values[3];
}

real model_throat() {
    return push.scene.model.values[4];
}

real model_rim() {
    return push.scene.model.values[5];
}

real model_tableau(uint i) {
    return push.scene.model.values[6 + i];
}

real model_global(int i) {
    return push.scene.model.values[int(push.scene.model.global_start) + i];
}

real3 model_table(uint i) {
    uint at = push.scene.model.table_start + 3 * i;
    return real3(push.scene.model.values[at], push.scene.model.values[at + 1], push.scene.model.values[at + 2]);
}

int model_source_count() {
    return int(push.scene.model.source_count);
}

real model_source(int source, int i) {
    return push.scene.model.values[int(push.scene.model.source_start) + source * int(push.scene.model.source_stride) + i];
}

// Every buffer and its accessor. Queues, and paths where they are stored, are storage buffers; what all rays read alike, addresses and
// parameters, is a uniform block. What most rays read is loaded through texel buffers, which fetch up to 16 bytes at once; so are paths.
// Other arrays of the scene, and the film, are reached by address, so that they may be larger than a storage buffer range.
// The accessors' twins are in src/kernels/view.rs.
#extension GL_EXT_scalar_block_layout : require

#ifdef REAL64
#define real double
#define real3 dvec3
#define real4 dvec4
#define TOLERANCE_FLOOR TOLERANCE_FLOOR_F64
#define REGION_MARGIN REGION_MARGIN_F64
#define RIM_SLACK RIM_SLACK_F64
#else
#define real float
#define real3 vec3
#define real4 vec4
#define TOLERANCE_FLOOR TOLERANCE_FLOOR_F32
#define REGION_MARGIN REGION_MARGIN_F32
#define RIM_SLACK RIM_SLACK_F32
#endif

#include "constants.glsl"
#include "layout.glsl"

layout(local_size_x = 64) in;

#define SCENE_BUFFER(name, type) layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer name { type items[]; }
SCENE_BUFFER(Floats, float);
SCENE_BUFFER(Textures, Texture);
SCENE_BUFFER(Texels, uvec2);
layout(buffer_reference, std430, buffer_reference_align = 8) readonly buffer Profiles { vec2 items[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer BlackBodies { vec4 items[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) buffer FilmSums { uvec4 items[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) buffer FilmAovs { Aov items[]; };

layout(push_constant) uniform Push {
    // Where traced rays end: STOP_* and up to four numbers, each the sum of two floats.
    vec4 stop_high;
    vec4 stop_low;
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
    uint stop;
} push;

layout(set = 0, binding = 0, std430) buffer PathBuffer { uvec4 path_words[]; };
layout(set = 0, binding = 1, std430) buffer CounterBuffer { uint counters[]; };
layout(set = 0, binding = 2, std430) buffer QueueBuffer { uint queue[]; };
layout(set = 0, binding = 3, std430) uniform SceneBlock {
    Textures textures;
    Texels texels;
    Floats environment_cdf;
    BlackBodies black_bodies;
    Profiles profiles;
    SceneParameters parameters;
    // Sources of the model, the words of each, and the word that its table begins with.
    uint source_count;
    uint source_words;
    uint table_start;
    uint unused;
    // Origin, step, throat, rim, global parameters of the model.
    real model_values[6 + MAX_GLOBALS];
} scene;

layout(set = 0, binding = 4) uniform usamplerBuffer node_words;
layout(set = 0, binding = 5) uniform usamplerBuffer block_words;
layout(set = 0, binding = 6) uniform usamplerBuffer primitive_words;
layout(set = 0, binding = 7) uniform usamplerBuffer clearance_cells;
layout(set = 0, binding = 8) uniform usamplerBuffer model_words;
layout(set = 0, binding = 9) uniform usamplerBuffer triangle_words;
layout(set = 0, binding = 10) uniform usamplerBuffer vertex_words;
layout(set = 0, binding = 11) uniform usamplerBuffer objects;
layout(set = 0, binding = 12) uniform usamplerBuffer material_words;
layout(set = 0, binding = 13) uniform usamplerBuffer light_words;
layout(set = 0, binding = 14) uniform usamplerBuffer aim_words;
layout(set = 0, binding = 15) uniform usamplerBuffer albedos;
// What earlier dispatches stored in `path_words`.
layout(set = 0, binding = 16) uniform usamplerBuffer path_texels;

#define SCENE scene.parameters

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

// Words of a path. A kernel loads what earlier dispatches stored: it must not load what it has stored itself, and what it stores in place
// of a word that it loads must follow from that.
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
const uint WORD_CONE = 16;

// Steps word of a ray that has not started.
const uint FRESH = 0xffffffffu;

uvec4 load_word(uint slot, uint word) {
    return texelFetch(path_texels, int(word * push.capacity + slot));
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

// The last number of the word stays as it was.
void store_vector(uint slot, uint word, vec3 xyz) {
    path_words[word * push.capacity + slot].xyz = floatBitsToUint(xyz);
}

// Of the word of a launch only that it has not been yet.
void store_fresh(uint slot) {
    path_words[WORD_LAUNCH * push.capacity + slot].z = FRESH;
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
    uint film = slot / pixels;
    uint pixel = slot - film * pixels;
    uint row = pixel / SCENE.film_width;
    return uvec3(pixel - row * SCENE.film_width, push.first_row + row, push.first_sample + film);
}

uint scene_root(uint side) {
    return side == 0 ? 0 : SCENE.far_root;
}

// Children come in two halves of four.
vec4 node_bounds(uint node, uint plane, uint half_node) {
    return uintBitsToFloat(texelFetch(node_words, int(NODE_WORDS * node + 2 * plane + half_node)));
}

uvec4 node_children(uint node, uint half_node) {
    return texelFetch(node_words, int(NODE_WORDS * node + 12 + half_node));
}

// So do triangles: three rows of coordinates from `row` on, of the vertex (0), the first edge (3), the second edge (6).
mat3x4 block_rows(uint block, uint row, uint half_block) {
    int at = int(BLOCK_WORDS * block + 2 * row + half_block);
    return mat3x4(uintBitsToFloat(texelFetch(block_words, at)), uintBitsToFloat(texelFetch(block_words, at + 2)), uintBitsToFloat(texelFetch(block_words, at + 4)));
}

uint block_triangle(uint block, uint lane) {
    return texelFetch(block_words, int(BLOCK_WORDS * block + 18 + lane / 4))[lane % 4];
}

vec3 block_vector(uint block, uint row, uint lane) {
    mat3x4 rows = block_rows(block, row, lane / 4);
    return vec3(rows[0][lane % 4], rows[1][lane % 4], rows[2][lane % 4]);
}

Triangle triangle_at(uint index) {
    uvec4 word = texelFetch(triangle_words, int(index));
    return Triangle(uint[3](word.x, word.y, word.z), word.w);
}

Vertex vertex_at(uint index) {
    // Five numbers that begin anywhere in the first of two words: brought to its start by one place, by two, or both.
    int first = 5 * int(index);
    uvec4 a = texelFetch(vertex_words, first / 4), b = texelFetch(vertex_words, first / 4 + 1);
    bool one = (first & 1) != 0, two = (first & 2) != 0;
    uvec4 c = one ? uvec4(a.yzw, b.x) : a, d = one ? uvec4(b.yzw, 0u) : b;
    vec4 e = uintBitsToFloat(two ? uvec4(c.zw, d.xy) : c);
    return Vertex(float[3](e.x, e.y, e.z), float[2](e.w, uintBitsToFloat(two ? d.z : d.x)));
}

Primitive primitive_at(uint index) {
    int at = int(PRIMITIVE_WORDS * index);
    vec4 a = uintBitsToFloat(texelFetch(primitive_words, at));
    vec4 b = uintBitsToFloat(texelFetch(primitive_words, at + 1));
    vec4 c = uintBitsToFloat(texelFetch(primitive_words, at + 2));
    uvec4 d = texelFetch(primitive_words, at + 3);
    return Primitive(float[12](a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c.x, c.y, c.z, c.w), d.x, d.y);
}

uint object_material(uint object) {
    return texelFetch(objects, int(object)).x;
}

Material material_at(uint index) {
    int at = int(MATERIAL_WORDS * index);
    uvec4 a = texelFetch(material_words, at), b = texelFetch(material_words, at + 1), c = texelFetch(material_words, at + 2);
    uvec4 d = texelFetch(material_words, at + 3), e = texelFetch(material_words, at + 4);
    return Material(uintBitsToFloat(a.xyz), a.w, uintBitsToFloat(b.xyz), uintBitsToFloat(b.w), uintBitsToFloat(c.xyz), uintBitsToFloat(c.w),
        d.x, d.y, d.z, d.w, uintBitsToFloat(e.x), e.y, uintBitsToFloat(e.z), uintBitsToFloat(e.w));
}

Texture texture_at(uint index) {
    return scene.textures.items[index];
}

vec4 texel(uint index) {
    uvec2 halves = scene.texels.items[index];
    return vec4(unpackHalf2x16(halves.x), unpackHalf2x16(halves.y));
}

Light light_at(uint index) {
    int at = int(LIGHT_WORDS * index);
    uvec4 a = texelFetch(light_words, at), b = texelFetch(light_words, at + 1), c = texelFetch(light_words, at + 2);
    return Light(uintBitsToFloat(a.xyz), a.w, uintBitsToFloat(b.xyz), uintBitsToFloat(b.w), uintBitsToFloat(c.xyz), uintBitsToFloat(c.w));
}

vec4 aim(uint index) {
    return uintBitsToFloat(texelFetch(aim_words, int(index)));
}

float environment_cdf(uint index) {
    return scene.environment_cdf.items[index];
}

float clearance(uint cell) {
    return float(texelFetch(clearance_cells, int(cell)).x);
}

float albedo(uint index) {
    return uintBitsToFloat(texelFetch(albedos, int(index)).x);
}

vec4 black_body_entry(uint index) {
    return scene.black_bodies.items[index];
}

vec2 profile_entry(uint index) {
    return scene.profiles.items[index];
}

real3 model_origin() {
    return real3(scene.model_values[0], scene.model_values[1], scene.model_values[2]);
}

real model_step() {
    return scene.model_values[3];
}

real model_throat() {
    return scene.model_values[4];
}

real model_rim() {
    return scene.model_values[5];
}

real model_global(uint i) {
    return scene.model_values[6 + i];
}

#ifdef REAL64
real model_real(uint first_word, uint i) {
    uvec4 word = texelFetch(model_words, int(first_word + i / 2));
    return packDouble2x32(i % 2 == 0 ? word.xy : word.zw);
}

real3 model_table(uint i) {
    uint at = scene.table_start + 2 * i;
    return real3(model_real(at, 0), model_real(at, 1), model_real(at, 2));
}
#else
real model_real(uint first_word, uint i) {
    return uintBitsToFloat(texelFetch(model_words, int(first_word + i / 4))[i % 4]);
}

real3 model_table(uint i) {
    return uintBitsToFloat(texelFetch(model_words, int(scene.table_start + i)).xyz);
}
#endif

int model_source_count() {
    return int(scene.source_count);
}

real model_source(int source, int i) {
    return model_real(uint(source) * scene.source_words, uint(i));
}

// Directions towards emitters and the environment; documented in src/kernels/light.rs.

uint choose_light(float u) {
    uint low = 0;
    uint high = SCENE.light_count - 1;
    while (low < high) {
        uint middle = (low + high) / 2;
        if (u < light_at(middle).cumulative) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}

float sphere_cap(Light light, vec3 position) {
    vec3 to_center = light.position - position;
    float sin2 = light.size * light.size / dot(to_center, to_center);
    return sin2 >= 1.0 ? 2.0 : sin2 / (1.0 + sqrt(1.0 - sin2));
}

vec2 environment_uv(EnvironmentParameters environment, vec3 direction) {
    float azimuth = atan(direction.x, -direction.z) + environment.angle;
    return vec2(azimuth / TAU + 0.5, 1.0 - acos(clamp(direction.y, -1.0, 1.0)) * INV_PI);
}

uint search_cdf(uint first, uint count, float u) {
    uint low = 0;
    uint high = count - 1;
    while (low < high) {
        uint middle = (low + high) / 2;
        if (u < environment_cdf(first + middle)) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}

vec3 sample_environment(vec2 u) {
    uint columns = SCENE.environment[0].columns, rows = SCENE.environment[0].rows;
    uint row = search_cdf(0, rows, u.y);
    float row_low = row == 0 ? 0.0 : environment_cdf(row - 1);
    float row_high = environment_cdf(row);
    uint first = rows + row * columns;
    uint column = search_cdf(first, columns, u.x);
    float low = column == 0 ? 0.0 : environment_cdf(first + column - 1);
    float high = environment_cdf(first + column);
    float s = (float(column) + clamp((u.x - low) / (high - low), 0.0, 1.0)) / float(columns);
    float t = (float(row) + clamp((u.y - row_low) / (row_high - row_low), 0.0, 1.0)) / float(rows);
    vec2 polar = sin_cos_turns(t * 0.5);
    float turns = s - 0.5 - SCENE.environment[0].angle / TAU;
    vec2 around = sin_cos_turns(turns - floor(turns));
    return vec3(around.x * polar.x, polar.y, -around.y * polar.x);
}

float environment_pdf(vec3 direction) {
    uint columns = SCENE.environment[0].columns, rows = SCENE.environment[0].rows;
    vec2 uv = environment_uv(SCENE.environment[0], direction);
    uint column = min(uint((uv.x - floor(uv.x)) * float(columns)), columns - 1);
    uint row = min(uint((1.0 - uv.y) * float(rows)), rows - 1);
    uint first = rows + row * columns;
    float of_row = environment_cdf(row) - (row == 0 ? 0.0 : environment_cdf(row - 1));
    float of_column = environment_cdf(first + column) - (column == 0 ? 0.0 : environment_cdf(first + column - 1));
    float sin_polar = sqrt(max(1.0 - direction.y * direction.y, 1e-8));
    return of_row * of_column * float(columns * rows) / (TAU * PI * sin_polar);
}

vec3 sample_light(Light light, vec3 position, vec2 u) {
    if (light.kind == LIGHT_ENVIRONMENT) {
        return sample_environment(u);
    }
    if (light.kind == LIGHT_SPHERE) {
        float cap = sphere_cap(light, position);
        vec3 local = spherical_direction(1.0 - u.x * cap, u.y);
        vec3 axis = cap == 2.0 ? vec3(0.0, 0.0, 1.0) : normalize(light.position - position);
        return world_from_frame(axis, local);
    }
    vec2 s = u;
    if (light.kind == LIGHT_TRIANGLE) {
        float root = sqrt(u.x);
        s = vec2(1.0 - root, u.y * root);
    }
    return normalize(light.position + light.edge_u * s.x + light.edge_v * s.y - position);
}

float light_pdf(Light light, vec3 position, vec3 direction) {
    if (light.kind == LIGHT_ENVIRONMENT) {
        return environment_pdf(direction);
    }
    if (light.kind == LIGHT_SPHERE) {
        float cap = sphere_cap(light, position);
        vec3 to_center = light.position - position;
        vec3 offset = to_center - direction * dot(to_center, direction);
        bool inside = cap == 2.0;
        bool towards = dot(to_center, direction) > 0.0 && dot(offset, offset) < light.size * light.size;
        return inside || towards ? 1.0 / (TAU * cap) : 0.0;
    }
    vec3 found = intersect_quad(position, direction, light.position, light.edge_u, light.edge_v, FAR);
    if (found.x <= 0.0 || (light.kind == LIGHT_TRIANGLE && found.y + found.z >= 1.0)) {
        return 0.0;
    }
    vec3 normal = normalize(cross(light.edge_u, light.edge_v));
    return found.x * found.x / max(abs(dot(normal, direction)) * light.size, 1e-20);
}

vec3 light_center(Light light) {
    return light.position + (light.edge_u + light.edge_v) * (light.kind == LIGHT_TRIANGLE ? 1.0 / 3.0 : 0.5);
}

struct AimCell {
    uint first;
    vec3 upper;
};

AimCell aim_cell(vec3 position) {
    vec3 p = (position - SCENE.aim_focus) * SCENE.aim_scale;
    if (SCENE.aim_scale == 0.0 || !all(lessThan(abs(p), vec3(1.0)))) {
        return AimCell(NO_INDEX, vec3(0.0));
    }
    uint level = 0;
    while (level + 1 < AIM_LEVELS && all(lessThan(abs(p), vec3(0.5)))) {
        p *= 2.0;
        ++level;
    }
    float side = float(AIM_SIDE);
    vec3 q = clamp((p * 0.5 + 0.5) * side - 0.5, vec3(0.0), vec3(side - 1.0));
    vec3 lower = min(floor(q), vec3(side - 2.0));
    uvec3 cell = uvec3(lower);
    uint number = ((level * AIM_SIDE + cell.z) * AIM_SIDE + cell.y) * AIM_SIDE + cell.x;
    return AimCell(number * SCENE.light_count, q - lower);
}

vec4 apparent_light(AimCell cell, uint index) {
    if (cell.first == NO_INDEX) {
        return vec4(0.0);
    }
    uint stride = SCENE.light_count;
    vec3 upper = cell.upper;
    vec4 sum = vec4(0.0);
    for (uint i = 0; i < 4; ++i) {
        uint at = cell.first + index + stride * AIM_SIDE * ((i & 1) + AIM_SIDE * (i >> 1));
        float weight = ((i & 1) == 1 ? upper.y : 1.0 - upper.y) * ((i >> 1) == 1 ? upper.z : 1.0 - upper.z);
        sum += mix(aim(at), aim(at + stride), upper.x) * weight;
    }
    return sum;
}

vec3 apparent_position(AimCell cell, uint index, vec3 position) {
    if (SCENE.aim_scale == 0.0) {
        return position;
    }
    vec3 center = light_center(light_at(index));
    vec4 apparent = apparent_light(cell, index);
    return center + (position - apparent.xyz - center) / (1.0 + apparent.w);
}

float lights_pdf(uint chosen, AimCell cell, vec3 position, vec3 direction) {
    uint count = SCENE.light_count;
    if (count > MAX_SUMMED_LIGHTS) {
        return light_pdf(light_at(chosen), position, direction);
    }
    float sum = 0.0;
    float before = 0.0;
    for (uint i = 0; i < count; ++i) {
        Light light = light_at(i);
        sum += (light.cumulative - before) * light_pdf(light, apparent_position(cell, i, position), direction);
        before = light.cumulative;
    }
    return sum;
}

vec3 grid_radiance(EnvironmentParameters environment, vec3 direction) {
    float spacing = environment.angle;
    float polar = acos(clamp(direction.y, -1.0, 1.0)) / spacing;
    float azimuth = atan(direction.x, -direction.z) / spacing;
    float from_polar = abs(polar - floor(polar + 0.5)) * spacing;
    float from_azimuth = abs(azimuth - floor(azimuth + 0.5)) * spacing;
    float sin_polar = sqrt(max(1.0 - direction.y * direction.y, 0.0));
    bool on_line = from_polar < 0.5 * environment.scale || from_azimuth * sin_polar < 0.5 * environment.scale;
    if (on_line) {
        return environment.color;
    }
    return direction.y > 0.0 ? environment.horizon : environment.nadir;
}

vec3 environment_radiance(EnvironmentParameters environment, vec3 direction) {
    if (environment.kind == ENVIRONMENT_CONSTANT) {
        return environment.color;
    }
    if (environment.kind == ENVIRONMENT_GRADIENT) {
        vec3 end = direction.y > 0.0 ? environment.color : environment.nadir;
        return mix(environment.horizon, end, sqrt(abs(direction.y)));
    }
    if (environment.kind == ENVIRONMENT_GRID) {
        return grid_radiance(environment, direction);
    }
    vec4 value = sample_texture(environment.texture_index, environment_uv(environment, direction));
    return value.xyz * environment.scale;
}

// Camera rays; documented in src/kernels/camera.rs.

vec2 sample_filter(uint kind, vec2 u) {
    if (kind == FILTER_BOX) {
        return u - 0.5;
    }
    float cut = 1.0 - exp(-0.5 * (FILTER_RADIUS / FILTER_SIGMA) * (FILTER_RADIUS / FILTER_SIGMA));
    float radius = FILTER_SIGMA * sqrt(-2.0 * log(1.0 - u.x * cut));
    vec2 sin_cos = sin_cos_turns(u.y);
    return vec2(sin_cos.y, sin_cos.x) * radius;
}

vec3 film_direction(vec2 film) {
    float s = film.x / float(SCENE.film_width);
    float t = film.y / float(SCENE.film_height);
    if (SCENE.camera_kind == CAMERA_PANORAMA) {
        vec2 around = sin_cos_turns(clamp(s, 0.0, 1.0));
        vec2 down = sin_cos_turns(clamp(t, 0.0, 1.0) * 0.5);
        return SCENE.camera_up * down.y - (SCENE.camera_right * around.x + SCENE.camera_forward * around.y) * down.x;
    }
    float x = (2.0 * s - 1.0) * SCENE.tan_half_fov * SCENE.aspect;
    float y = (1.0 - 2.0 * t) * SCENE.tan_half_fov;
    return normalize(SCENE.camera_right * x + SCENE.camera_up * y + SCENE.camera_forward);
}

vec3 aberrate(vec3 direction, vec3 velocity, out float ratio) {
    float speed2 = dot(velocity, velocity);
    ratio = 1.0;
    if (speed2 == 0.0) {
        return direction;
    }
    float gamma = 1.0 / sqrt(1.0 - speed2);
    float along = dot(direction, velocity);
    float energy = gamma * (1.0 - along);
    vec3 boosted = direction + velocity * ((gamma - 1.0) * along / speed2 - gamma);
    ratio = 1.0 / energy;
    return boosted * (1.0 / energy);
}

void camera_ray(vec2 film, vec2 lens, out vec3 origin, out vec3 direction, out float ratio) {
    origin = SCENE.camera_position;
    direction = film_direction(film);
    if (SCENE.aperture_radius > 0.0 && SCENE.camera_kind != CAMERA_PANORAMA) {
        vec3 focus = direction * (SCENE.focus_distance / dot(direction, SCENE.camera_forward));
        vec2 disc = sample_disc(lens) * SCENE.aperture_radius;
        vec3 offset = SCENE.camera_right * disc.x + SCENE.camera_up * disc.y;
        origin += offset;
        direction = normalize(focus - offset);
    }
    direction = aberrate(direction, SCENE.camera_velocity, ratio);
}

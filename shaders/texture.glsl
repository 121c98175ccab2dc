// Bilinear lookups in the pool of texels; documented in src/kernels/texture.rs.

uint texel_index(Texture t, int x, int y) {
    int column = x % int(t.width);
    int row = y % int(t.height);
    column += column < 0 ? int(t.width) : 0;
    row += row < 0 ? int(t.height) : 0;
    return t.first_index + uint(row) * t.width + uint(column);
}

vec4 sample_texture(uint index, vec2 uv) {
    Texture t = texture_at(index);
    float x = (uv.x - floor(uv.x)) * float(t.width) - 0.5;
    float y = (1.0 - (uv.y - floor(uv.y))) * float(t.height) - 0.5;
    float x0 = floor(x), y0 = floor(y);
    float fx = x - x0, fy = y - y0;
    int ix = int(x0), iy = int(y0);
    vec4 lower = texel(texel_index(t, ix, iy)) * (1.0 - fx) + texel(texel_index(t, ix + 1, iy)) * fx;
    vec4 upper = texel(texel_index(t, ix, iy + 1)) * (1.0 - fx) + texel(texel_index(t, ix + 1, iy + 1)) * fx;
    return lower * (1.0 - fy) + upper * fy;
}

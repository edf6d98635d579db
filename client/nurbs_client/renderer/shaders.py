"""The shader programs: Blinn-Phong for triangles, lines and points, and the background.

Light is fixed to the camera, as in a CAD viewer: a key light from the upper left, a fill light from
the right, a little from the eye itself, sky and ground for the rest. Colours are linear until the
last line, which encodes sRGB.
Both sides are lit: a normal is turned to the side of the triangle that is seen, then mirrored in the
image plane where interpolation has turned it away from the viewer, so silhouettes stay smooth.

View space is x right, y up, z forward, with the eye in the origin.

Source: J. F. Blinn, Models of light reflection for computer synthesized pictures, 1977.
"""

from __future__ import annotations

VERTEX = """
#version 430 core
in vec3 position;
in ivec2 normal;
in vec4 row_x;      // of the tile's transform to view space, per draw
in vec4 row_y;
in vec4 row_z;
in vec4 colour_size; // linear colour, point size in pixels
uniform vec3 projection; // 2 f / w, 2 f / h, near
uniform float push_back; // lines lie behind the surfaces they fill gaps between
out vec3 view_position;
out vec3 view_normal;
flat out vec3 colour;

vec3 from_octahedral(vec2 e) {
    vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
    float t = max(-n.z, 0.0);
    n.xy -= vec2(n.x >= 0.0 ? t : -t, n.y >= 0.0 ? t : -t);
    return n;
}

void main() {
    vec4 p = vec4(position, 1.0);
    vec3 v = vec3(dot(row_x, p), dot(row_y, p), dot(row_z, p));
    vec3 n = from_octahedral(vec2(normal) / 32767.0);
    // Normals go with the cofactors, turned where the transform mirrors, as view space itself does.
    vec3 y_z = cross(row_y.xyz, row_z.xyz);
    view_normal = vec3(dot(y_z, n), dot(cross(row_z.xyz, row_x.xyz), n), dot(cross(row_x.xyz, row_y.xyz), n));
    if (dot(row_x.xyz, y_z) < 0.0) view_normal = -view_normal;
    view_normal *= inversesqrt(max(dot(view_normal, view_normal), 1e-36));
    view_position = v;
    colour = colour_size.rgb;
    v *= 1.0 + push_back;
    gl_Position = vec4(projection.x * v.x, projection.y * v.y, projection.z, v.z);
    gl_PointSize = colour_size.a;
}
"""

SHADING = """
vec3 encode_srgb(vec3 c) {
    c = clamp(c, 0.0, 1.0);
    return mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

vec3 shade(vec3 n, vec3 to_eye, vec3 albedo) {
    float facing = dot(n, to_eye);
    if (facing < 0.0) n -= 2.0 * facing * to_eye;
    const vec3 key = normalize(vec3(-0.50, 0.55, -0.80));
    const vec3 fill = normalize(vec3(0.80, 0.05, -0.55));
    const vec3 sky = vec3(0.26, 0.27, 0.29);
    const vec3 ground = vec3(0.13, 0.125, 0.12);
    vec3 ambient = mix(ground, sky, 0.5 + 0.5 * n.y) + 0.16 * abs(dot(n, to_eye));
    vec3 diffuse = ambient + 0.64 * max(dot(n, key), 0.0) + vec3(0.18, 0.19, 0.20) * max(dot(n, fill), 0.0);
    float gloss = pow(max(dot(n, normalize(key + to_eye)), 0.0), 42.0);
    gloss += 0.25 * pow(max(dot(n, normalize(fill + to_eye)), 0.0), 24.0);
    return albedo * diffuse + 0.16 * gloss;
}
"""

TRIANGLE_FRAGMENT = (
    """
#version 430 core
in vec3 view_position;
in vec3 view_normal;
flat in vec3 colour;
out vec4 pixel;
"""
    + SHADING
    + """
void main() {
    vec3 to_eye = -normalize(view_position);
    vec3 facet = cross(dFdx(view_position), dFdy(view_position));
    if (dot(facet, to_eye) < 0.0) facet = -facet;
    vec3 n = view_normal;
    float size = dot(n, n);
    n = size > 1e-12 ? n * inversesqrt(size) : normalize(facet);
    if (dot(n, facet) < 0.0) n = -n;
    pixel = vec4(encode_srgb(shade(n, to_eye, colour)), 1.0);
}
"""
)

THIN_FRAGMENT = (
    """
#version 430 core
in vec3 view_position;
in vec3 view_normal;
flat in vec3 colour;
uniform bool round_points;
out vec4 pixel;
"""
    + SHADING
    + """
void main() {
    if (round_points) {
        vec2 off = 2.0 * gl_PointCoord - 1.0;
        if (dot(off, off) > 1.3) discard;
    }
    vec3 n = view_normal * inversesqrt(max(dot(view_normal, view_normal), 1e-12));
    pixel = vec4(encode_srgb(shade(n, -normalize(view_position), colour)), 1.0);
}
"""
)

BACKGROUND_VERTEX = """
#version 430 core
out float height;
void main() {
    vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
    height = 0.5 + 0.5 * corner.y;
    gl_Position = vec4(corner, 0.0, 1.0);
}
"""

BACKGROUND_FRAGMENT = """
#version 430 core
in float height;
uniform vec3 bottom;
uniform vec3 top;
out vec4 pixel;
void main() {
    // Half a step of ordered dithering: an eight-bit gradient has no bands.
    ivec2 cell = ivec2(gl_FragCoord.xy) & 3;
    int bayer = ((cell.x ^ cell.y) & 1) * 8 + (cell.y & 1) * 4 + (((cell.x ^ cell.y) >> 1) & 1) * 2 + (cell.y >> 1);
    pixel = vec4(mix(bottom, top, smoothstep(0.0, 1.0, height)) + (float(bayer) / 16.0 - 0.5) / 255.0, 1.0);
}
"""

COVER_VERTEX = """
#version 430 core
void main() {
    gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}
"""

AVERAGE_FRAGMENT = """
#version 430 core
uniform sampler2D large;
uniform int factor;
out vec4 pixel;
void main() {
    ivec2 corner = ivec2(gl_FragCoord.xy) * factor;
    vec3 sum = vec3(0.0);
    for (int y = 0; y < factor; ++y)
        for (int x = 0; x < factor; ++x)
            sum += texelFetch(large, corner + ivec2(x, y), 0).rgb;
    pixel = vec4(sum / float(factor * factor), 1.0);
}
"""

#define R iResolution
uniform float r, z;
vec2 map(vec3 p) { vec2 a = vec2(length(p) - r, 1.0), b = vec2(z - p.z, 2.0); return a.x < b.x ? a : b; }
void mainImage(out vec4 c, vec2 f) {
    vec3 o = vec3((f / R.xy - 0.5) * vec2(4, 3), -3), d = vec3(0, 0, 1);
    float t = 0.0, m = 0.0;
    for (int i = 0; i < 9; i++) { vec2 h = map(o + d * t); m = h.y; if (abs(h.x) < .01) break; t += h.x; if (t > 20.) break; }
    c = vec4(m, t, o.z + t, 1);
}

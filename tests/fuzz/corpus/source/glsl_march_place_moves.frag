#define R iResolution
uniform float r, z;
float map(vec3 p) { return length(p) - r; }
void mainImage(out vec4 c, vec2 f) {
    vec3 o = vec3((f / R.xy - 0.5) * vec2(4, 3), -3), d = vec3(0, 0, 1);
    bool hit = false; vec3 p = o;
    for (int i = 0; i < 9; i++) { float h = map(p); if (h < .01) { hit = true; break; } p += d * h; if (p.z > 20.) break; }
    if (hit) c = vec4(1);
}

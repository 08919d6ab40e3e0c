#define R iResolution
uniform float r, z;
float map(vec3 p) { return length(p) - r; }
void mainImage(out vec4 c, vec2 f) {
    vec3 o = vec3((f / R.xy - 0.5) * vec2(4, 3), -3), d = vec3(0, 0, 1);
    float t = 0.0;
    for (int i = 0; i < 9; i++) { float h = map(o + d * t); t += h; if (t > 20. || abs(h) < .01) break; }
    c = vec4(t < 20. ? 1.0 : 0.0);
}

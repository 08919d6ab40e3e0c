#define R iResolution
uniform float r, z;
float map(vec3 p) { return length(p) - r; }
float lit(vec3 o, vec3 d) { float t = 0.0; for (int i = 0; i < 9 && t < 20.; i++) { float h = map(o + d * t); if (h < .01) return 1.0; t += h; } return 0.0; }
void mainImage(out vec4 c, vec2 f) {
    vec3 o = vec3((f / R.xy - 0.5) * vec2(4, 3), -3), d = vec3(0, 0, 1);
    c = vec4(lit(o, d));
}


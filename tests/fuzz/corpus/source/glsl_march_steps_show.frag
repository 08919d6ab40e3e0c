#define R iResolution
uniform float r, z;
float map(vec3 p) { return length(p) - r; }
void mainImage(out vec4 c, vec2 f) {
    vec3 o = vec3((f / R.xy - 0.5) * vec2(4, 3), -3), d = vec3(0, 0, 1);
    float t = 0.0, glow = 0.0;
    for (int i = 0; i < 9; i++) { float h = map(o + d * t); if (h < .01) break; glow += .02; t += h; if (t > 8.) break; }
    c = vec4(glow);
}




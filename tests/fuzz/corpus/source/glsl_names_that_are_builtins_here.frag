#version 300 es
float frac(float x) { return fract(x) + 1.0; } float lerp(float a, float b) { return mix(a, b, 0.25); } vec2 atan2(vec2 v) { return v.yx; } float saturate(float v) { return v * 0.5; }
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
c = vec3(frac(p.x * 4.0), lerp(p.y, 1.0), saturate(atan2(p).x));
    O = vec4(c, 1.0);
}

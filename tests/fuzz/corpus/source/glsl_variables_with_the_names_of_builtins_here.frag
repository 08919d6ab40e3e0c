#version 300 es
const float frac = 0.25; float rsqrt; const float HALF = radians(90.0);
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
vec2 lerp = fract(p * 3.0); float atan2 = 0.5; c = vec3(mix(lerp.x, frac, atan2), fract(p.y * 4.0) + rsqrt, inversesqrt(p.x + 1.0) + dot(p.x, atan2) + HALF);
    O = vec4(c, 1.0);
}

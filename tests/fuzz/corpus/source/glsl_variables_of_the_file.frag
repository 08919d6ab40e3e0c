#version 300 es
float level = 0.25; vec3 sum; const float K = 2.0; float twice() { level += 0.125; return level * K; } void add(vec3 v) { sum += v; sum.x += twice(); }
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
float level0 = level; add(vec3(p, 1)); { float level = 9.0; add(vec3(level)); } c = sum * level0;
    O = vec4(c, 1.0);
}

#version 300 es
uniform Block { vec2 shift; mat2 m; }; layout(std140, binding = 0) uniform Other { float level; vec3 tint[2]; } other;
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
c = other.tint[1] + other.level + vec3(m * shift, p.x);
    O = vec4(c, 1.0);
}

#version 300 es
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
c = unpackUnorm4x8(packUnorm4x8(vec4(p, 2.0, -1.0))).xyz; c.xy += unpackHalf2x16(packHalf2x16(p * 3.0)) + unpackSnorm2x16(packSnorm2x16(-p)) + unpackUnorm2x16(0x80000000u); c.z += unpackHalf2x16(packHalf2x16(vec2(0.0, 65504.0))).y / 65504.0 + unpackHalf2x16(0x0001u).x * 16777216.0;
    O = vec4(c, 1.0);
}

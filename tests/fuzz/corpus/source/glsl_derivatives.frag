#version 300 es
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
float d = length(I - 16.0); c = vec3(dFdx(d), dFdy(I.x * I.y), fwidth(sin(I.x) * 2.0));
    O = vec4(c, 1.0);
}

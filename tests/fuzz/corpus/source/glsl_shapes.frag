#version 300 es
uniform vec2 r; uniform float t;
mat2 turn(float a) { return mat2(cos(a), -sin(a), sin(a), cos(a)); }
vec3 last; float d = 9.; 
void hit(inout float a, float b, vec3 c) { if (b < a) { a = b; last = c; } }
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = (I - .5 * iResolution.xy) / iResolution.y; p *= turn(t);
    for (int i = 0, j = 3; i < j; i++) hit(d, length(p - r * float(i)) - .1, vec3(i, p));
    O = d < 0. ? vec4(last, 1) : vec4(fract(p.xyx * 4.), 0);
}

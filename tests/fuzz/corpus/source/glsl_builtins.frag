#version 300 es
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
c = vec3(mod(-p.x * 3.0, 1.0), fract(p.y * 5.0), mix(p.x, 1.0, p.y)) + inversesqrt(p.x + 1.0) + atan(p.y, p.x) + atan(p.x) + radians(90.0) * length(p.x - 0.5) + mix(vec3(1), vec3(2), lessThan(vec3(p, 1), vec3(0.5)));
    O = vec4(c, 1.0);
}

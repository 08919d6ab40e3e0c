#version 300 es
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
float a = 1, b; b = (a += 1.0, a * 2); bool k = p.x > 0.5 ^^ p.y > 0.5; c = vec3(b, k ? 1 : 0, 3 / 2);
    O = vec4(c, 1.0);
}

#version 300 es
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
float t = 0.0; while (t < p.x) t += 0.125; float i = 0.0; for (c *= 0.0; i++ < 3.0; c += p.y); c.x = t;
    O = vec4(c, 1.0);
}

#version 300 es
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
float d = 2.0; p.x < 0.5 ? d = p.y, c.x = 0.25 : d; c.y = p.x > 0.5 ? c.z = 1.0, 0.5 : d; p.y > 0.5 ? d = 4.0 : c.z += d;
    O = vec4(c, 1.0);
}

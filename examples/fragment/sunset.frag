// As on Shadertoy: a sun behind hills. Every edge is a comparison, and every comparison moves with a uniform.
uniform vec2 sun = vec2(0.1, 0.05);  // its centre, in heights of the image
uniform float radius = 0.16;
uniform float hills = 0.06;          // how high the hills rise
uniform float bands = 7.0;           // stripes of haze across the sun

#define sky(y) mix(vec3(0.98, 0.62, 0.35), vec3(0.25, 0.18, 0.42), smoothstep(-0.2, 0.5, y))

float ridge(float x) { return hills * (sin(5.0 * x) + 0.5 * sin(11.0 * x + 1.0)) - 0.18; }

void mainImage(out vec4 color, in vec2 point) {
    vec2 p = (point - 0.5 * iResolution.xy) / iResolution.y;
    vec3 c = sky(p.y);
    vec2 d = p - sun;
    if (length(d) < radius) {
        bool haze = d.y < 0.0 && fract(d.y * bands / radius * 0.5) < 0.35;
        c = haze ? mix(c, vec3(1.0, 0.8, 0.5), 0.3) : vec3(1.0, 0.85, 0.5);
    }
    if (p.y < ridge(p.x)) c = vec3(0.16, 0.1, 0.2);
    if (p.y < 0.7 * ridge(p.x + 0.8) - 0.12) c = vec3(0.08, 0.05, 0.12);
    color = vec4(c, 1.0);
}

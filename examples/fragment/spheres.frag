// Plain GLSL with an entry of its own: two balls that melt together, sphere-traced, one in the other's soft shadow.
#version 330
uniform vec2 u_resolution;
uniform float gap = 0.5, blend = 0.3, light = 0.8;
out vec4 color;

float map(vec3 p) {
    float a = length(p - vec3(-gap, 0.0, 0.0)) - 0.55, b = length(p - vec3(gap, 0.15, 0.2)) - 0.4;
    float h = clamp(0.5 + 0.5 * (b - a) / blend, 0.0, 1.0);
    return mix(b, a, h) - blend * h * (1.0 - h);
}

vec3 normal(vec3 p) {
    const vec2 e = vec2(1e-3, 0.0);
    return normalize(vec3(map(p + e.xyy) - map(p - e.xyy), map(p + e.yxy) - map(p - e.yxy), map(p + e.yyx) - map(p - e.yyx)));
}

float shadow(vec3 p, vec3 l) {
    float s = 1.0, t = 0.03;
    for (int i = 0; i < 24; i++) {
        float h = map(p + l * t);
        s = min(s, 9.0 * h / t);
        t += clamp(h, 0.03, 0.3);
    }
    return clamp(s, 0.0, 1.0);
}

void main() {
    vec2 p = (gl_FragCoord.xy - 0.5 * u_resolution) / u_resolution.y;
    vec3 eye = vec3(0.0, 0.5, -3.2), ray = normalize(vec3(p.x, p.y - 0.24, 1.8));
    float t = 0.0; bool hit = false;
    for (int i = 0; i < 72; i++) {
        float h = map(eye + ray * t);
        if (t > 6.0) break;
        if (h < 1e-3) { hit = true; break; }
        t += h;
    }
    vec3 c = mix(vec3(0.75, 0.82, 0.9), vec3(0.35, 0.5, 0.75), p.y + 0.5);
    if (hit) {
        vec3 q = eye + ray * t, l = normalize(vec3(cos(light), 0.6, -sin(light)));
        c = vec3(0.85, 0.4, 0.25) * (0.25 + 0.75 * max(dot(normal(q), l), 0.0) * shadow(q, l));
    }
    color = vec4(sqrt(c), 1.0);
}

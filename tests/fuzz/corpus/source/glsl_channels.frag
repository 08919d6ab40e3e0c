#version 300 es
uniform sampler2D iChannel0;
uniform vec3 iChannelResolution[4];
void mainImage(out vec4 c, in vec2 f) {
    c = texture(iChannel0, f / vec2(textureSize(iChannel0, 0))) + texelFetch(iChannel0, ivec2(f), 0) + iChannelResolution[0].x;
}



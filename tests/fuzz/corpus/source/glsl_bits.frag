#ifdef GL_ES
precision highp float;
#endif
varying vec2 uv;
uint h(uint x) { x ^= x >> 16; return x * 0x7feb352dU; }
float mod(int a, int b) { return float(a % b); }
void main() {
  int k = int(h(uint(uv.x * 9.)) & 3u);
  switch (k) { case 0: discard; case 1: gl_FragColor.r = 1.; break; default: gl_FragColor[k] = mod(k, 2) + mod(uv.y, .3); }
  do { k--; if (k < -4) continue; } while (k > 0);
  gl_FragColor.gb += fwidth(uv) + (uv.x > .5 ? k = 2, uv : uv.yx);
}

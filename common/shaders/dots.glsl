// Fragment shader of dots_vertex.glsl.
uniform float dotSize;
in vec3 dotPaint;
in float dotAlpha;
layout(location = 0) out vec4 colour;
void main() {
  float away = length(gl_PointCoord - 0.5) * dotSize;  // samples from the middle
  if (away > 0.5 * dotSize) discard;
  colour = vec4(mix(dotPaint, vec3(0.02), dotSize < 4.5 ? 0.0 : 0.8 * smoothstep(0.5 * dotSize - 1.1, 0.5 * dotSize - 0.4, away)), dotAlpha);
}

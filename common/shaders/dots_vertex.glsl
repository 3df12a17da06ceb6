// Vertex shader of candidates as dots. A dot is shown whole or not at all: its middle decides. A little behind what is seen is still
// seen, as with edges.
layout(location = 0) in vec3 position;  // metres from the camera
layout(location = 1) in vec3 paint;
uniform sampler2D dotSurface;
uniform vec3 viewRight, viewUp, viewForward;  // as in view.glsl
uniform vec2 viewScale;                       // one over the tangents of the half angles
uniform float viewHorizon, dotSize;
out vec3 dotPaint;
out float dotAlpha;
void main() {
  float depth = dot(position, viewForward);
  vec2 at = vec2(dot(position, viewRight), dot(position, viewUp)) * viewScale / max(depth, 1.0e-3);
  ivec2 samples = textureSize(dotSurface, 0);
  vec4 s = texelFetch(dotSurface, clamp(ivec2((at * 0.5 + 0.5) * vec2(samples)), ivec2(0), samples - 1), 0);
  bool hidden = s.w > 0.0 && depth > dot(s.xyz, viewForward) * 1.02 + 0.2;
  dotPaint = paint;
  dotAlpha = 1.0 - smoothstep(0.4, 0.9, length(position) / viewHorizon);
  gl_Position = depth < 0.1 || hidden ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(at, 0.0, 1.0);
  gl_PointSize = dotSize;
}

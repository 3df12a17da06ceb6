// Vertex shader of the mesh. Positions stay integers up to the camera's own step: 10^12 m out is as exact as the origin, and neighbours
// cannot crack. SHADED: vertices bring a normal and a colour along. BLOCKS: leaves are drawn together, a table says where each block of
// vertices lies, and `corner` is 1 in one of a triangle's corners each.
layout(location = 0) in ivec3 position;       // x, z, y in steps, x and z from the leaf's corner
#ifdef BLOCKS
uniform highp isampler2D leafTable;           // of each block what to add for steps from the camera's own step, and the level; negative: hidden
uniform int leafBlock, leafColumns;           // vertices of a block; blocks of a row
#else
uniform ivec3 leafOffset;                     // what to add for steps from the camera's own step
#endif
uniform vec3 remainder;                       // of the camera: x, z, y, in steps
uniform vec3 viewRight, viewUp, viewForward;  // as in view.glsl
uniform vec2 viewScale;                       // one over the tangents of the half angles
uniform float near;                           // metres before the camera where the mesh is cut off
uniform bool reversedDepth;                   // depth from 1 at `near` to 0 at infinity; else the fragment shader writes it
out vec3 offset;                              // metres from the camera
out float depth;                              // along its axis
#ifdef SHADED
layout(location = 1) in vec2 shadeNormal;     // stereographic
layout(location = 2) in vec3 shadeColour;     // roots of linear light
out vec3 normal, albedo;
#endif
#ifdef BLOCKS
out vec3 corner;
flat out float leafLevel;
#endif
void main() {
#ifdef SHADED
  float p = dot(shadeNormal, shadeNormal);
  normal = vec3(2.0 * shadeNormal.x, 1.0 - p, 2.0 * shadeNormal.y) / (1.0 + p);
  albedo = shadeColour * shadeColour;
#endif
#ifdef BLOCKS
  int block = gl_VertexID / leafBlock, k = gl_VertexID % 3;
  ivec4 leaf = texelFetch(leafTable, ivec2(block % leafColumns, block / leafColumns), 0);
  corner = vec3(k == 0, k == 1, k == 2);
  leafLevel = float(leaf.w);
  ivec3 leafOffset = leaf.xyz;
#endif
  vec3 metres = (vec3(position + leafOffset) - remainder) * (1.0 / 256.0);
  offset = metres.xzy;
  depth = dot(offset, viewForward);
  gl_Position = vec4(dot(offset, viewRight) * viewScale.x, dot(offset, viewUp) * viewScale.y, reversedDepth ? near : depth - 2.0 * near, depth);
#ifdef BLOCKS
  if (leaf.w < 0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
#endif
}

#pragma once
// What a picture shows: a camera in a world. Both renderings are drawn from equal views.

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "client/render/gl_objects.h"
#include "common/camera/camera.h"
#include "common/outcome/outcome.h"

namespace ridgecast::render {

class HeightTexture;

struct View {
  camera::Camera camera;  // projection: of the picture that is drawn, in samples
  double horizon = 0;     // metres from the camera at which both renderings end
  // Colours as samples of the picture's own width see them; else as points, with all the aliasing that has.
  bool filtered = true;
  // No terrain is higher or lower within the horizon: lets the ray march skip the air. Metres, absolute; the defaults are always right.
  double lowest = -131072, highest = 131072;
  const HeightTexture* heights = nullptr;  // where the text is a height map's: what is known of it; outlives the view
};

// The camera with n x n samples for each pixel.
View supersampled(const View& view, std::uint32_t n);

// The text of a world that the shaders are compiled from.
struct TerrainText {
  std::string source;  // the terrain file
  std::uint32_t seed = 0;
  bool neutral = false;  // the text is not to be had: a world without ground for the ray march, shading from the mesh alone
  bool shaded = false;   // neutral, but colours and normals come with the vertices
  bool raster = false;   // it is a height map's (common/terrain/raster.glsl): views need `heights`
};

// A full-screen program of version line, terrain prelude, terrain, shading, the view's own functions and `main`, which may call
//   void viewLocate(vec2 offset, out ivec2 cell, out vec2 fraction)   offset in metres from the camera, x and z
//   vec3 viewRay(vec2 sampleAt)                                       unit direction through gl_FragCoord.xy
//   float viewFootprint(float depth)                                  width in metres of a sample at this depth along the axis
//   float viewFilter(float depth)                                     what colours there are filtered by: the same, or 0
// and read the uniforms viewForward, viewCameraY (metres), viewHorizon, viewSeed.
Outcome<Program> buildTerrainProgram(std::string_view what, const TerrainText& terrain, std::string_view main);

// The vertex shader of such programs: one triangle that covers the picture, drawn without any buffer.
std::string_view fullScreenVertex();

// Sets those uniforms; the program must be in use.
void setView(const Program& program, const View& view, std::uint32_t seed);
// A uniform of three numbers.
void setVector(const Program& program, const char* name, const camera::Vec3& v);

}  // namespace ridgecast::render

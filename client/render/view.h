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

class EditTexture;
class HeightTexture;

struct View {
  camera::Camera camera;  // projection: of the picture that is drawn, in samples
  double horizon = 0;     // metres from the camera at which both renderings end
  // Colours as seen by samples of the picture's width; otherwise point-sampled, with aliasing.
  bool filtered = true;
  // Bounds of the terrain within the horizon, so that the ray march can skip air. Metres, absolute; the defaults are always valid.
  double lowest = -131072, highest = 131072;
  const HeightTexture* heights = nullptr;  // for a height map's text: its known samples; outlives the view
  const EditTexture* edits = nullptr;      // what members have made of the ground; the same
};

// The camera with n x n samples for each pixel.
View supersampled(const View& view, std::uint32_t n);

// The text of a world that the shaders are compiled from.
struct TerrainText {
  std::string source;  // the terrain file
  std::uint32_t seed = 0;
  bool neutral = false;  // the text is not available: no ground for the ray march, shading from the mesh alone
  bool shaded = false;   // neutral, but colours and normals come with the vertices
  bool raster = false;   // a height map's (common/terrain/raster.glsl): views need `heights`
  bool draped = false;   // and a picture lies on it
};

// A full-screen program of version line, terrain prelude, terrain with edits around it, shading, view.glsl and `main`.
Outcome<Program> buildTerrainProgram(std::string_view what, const TerrainText& terrain, std::string_view main);

// Sets the uniforms of view.glsl; the program must be in use.
void setView(const Program& program, const View& view, std::uint32_t seed);
// Of them the axes, the tangents and the horizon alone, and viewScale, one over the tangents.
void setCamera(const Program& program, const View& view);
// A uniform of three numbers.
void setVector(const Program& program, const char* name, const camera::Vec3& v);

}  // namespace ridgecast::render

// Colours a surface: ground by one of four ways, sky elsewhere and from the horizon on.
//   SHADE_NEUTRAL   without the terrain's functions: the mesh's normal, and a ramp of heights from green through ochre and grey to white
//   SHADE_CARRIED   a private terrain: what the vertices brought along, lit when the mesh was drawn
//   SHADE_RASTER    a height map: by its functions where the window of samples reaches, beyond it from the mesh's own shape
//   none of these   by the terrain's functions
// OVERLAID: overlaid(shown, s, range) paints over the ground's display values.
uniform sampler2D shadeSurface;
layout(location = 0) out vec4 colour;

vec3 shadeThroughAir(vec3 light, vec3 direction, float range) { return mix(skyColor(direction), light, clearness(range, viewHorizon)); }

#ifndef SHADE_CARRIED
// The normal of the mesh, from the positions beside this one (the nearer of the two on each axis, so that edges do not smear).
vec3 shadeAlong(vec3 here, ivec2 at, ivec2 next) {
  ivec2 last = textureSize(shadeSurface, 0) - 1;
  vec4 after = texelFetch(shadeSurface, min(at + next, last), 0);
  vec4 before = texelFetch(shadeSurface, max(at - next, ivec2(0)), 0);
  vec3 forwards = after.xyz - here;
  vec3 backwards = here - before.xyz;
  bool first = after.w > 0.0 && at + next == min(at + next, last);
  bool second = before.w > 0.0 && at - next == max(at - next, ivec2(0));
  return first && (!second || dot(forwards, forwards) < dot(backwards, backwards)) ? forwards : backwards;
}
vec3 shadeMeshNormal(vec3 here) {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec3 normal = cross(shadeAlong(here, at, ivec2(1, 0)), shadeAlong(here, at, ivec2(0, 1)));
  normal = dot(normal, normal) > 0.0 ? normalize(normal) : vec3(0.0, 1.0, 0.0);
  return normal.y < 0.0 ? -normal : normal;
}
vec3 shadePlainLight(vec3 normal) {
  return vec3(2.6, 2.3, 1.9) * max(dot(normal, kSunDirection), 0.0) + vec3(0.30, 0.38, 0.50) * (0.6 + 0.4 * normal.y);
}
#endif

#ifdef SHADE_CARRIED
uniform sampler2D shadeCarried;
#endif

vec3 shadeGround(vec4 s, float range) {
  vec3 direction = s.xyz / max(range, 1e-6);
#if defined(SHADE_CARRIED)
  return shadeThroughAir(texelFetch(shadeCarried, ivec2(gl_FragCoord.xy), 0).rgb, direction, range);
#elif defined(SHADE_NEUTRAL)
  float height = viewCameraY + s.y;
  vec3 ramp = mix(vec3(0.16, 0.20, 0.10), vec3(0.33, 0.29, 0.18), smoothstep(0.0, 800.0, height));
  ramp = mix(ramp, vec3(0.34, 0.33, 0.32), smoothstep(800.0, 1700.0, height));
  ramp = mix(ramp, vec3(0.62), smoothstep(1700.0, 3200.0, height));
  return shadeThroughAir(ramp * shadePlainLight(shadeMeshNormal(s.xyz)), direction, range);
#else
  ivec2 cell;
  vec2 fraction;
  viewLocate(s.xz, cell, fraction);
  float footprint = viewFilter(dot(s.xyz, viewForward));
  // The heights that colours depend on are the terrain's own, not the mesh's: they then follow from x and z alone, so that what is left
  // between the two renderings is where the surface is, not how it is painted.
#ifdef SHADE_RASTER
  float reach = max(footprint, rasterPitchMetres), least = 3.0e38;
  for (int i = 0; i < 5; ++i) {
    vec2 corner = i == 4 ? vec2(0.0) : vec2((i & 1) == 0 ? -reach : reach, i < 2 ? -reach : reach);
    least = min(least, heightNear(cell, fraction, corner.x, corner.y, i == 4 ? 0.0 : footprint, viewSeed));
  }
  if (least <= kUnknownHeight) {
    vec3 normal = shadeMeshNormal(s.xyz);
    vec3 albedo = terrainColor(cell, fraction, viewCameraY + s.y, normal, footprint, viewSeed);
    return shadeThroughAir(albedo * shadePlainLight(normal), direction, range);
  }
#endif
  return shadeTerrain(cell, fraction, footprint, direction, range, viewHorizon, viewSeed);
#endif
}

void main() {
  vec4 s = texelFetch(shadeSurface, ivec2(gl_FragCoord.xy), 0);
  float range = length(s.xyz);
  bool ground = s.w > 0.0 && range < viewHorizon;
  vec3 light;
  if (ground) light = shadeGround(s, range); else light = skyColor(viewRay(gl_FragCoord.xy));
  colour = vec4(toDisplay(light), ground ? 1.0 : 0.0);
#ifdef OVERLAID
  if (ground) colour.rgb = overlaid(colour.rgb, s, range);
#endif
}

// Linear red, green and blue of materials 1 to 8: earth, rock, gravel, sand, grass, asphalt, concrete, snow. Also compiled as C++.
vec3 materialColor(int material) {
  if (material <= 1) return vec3(0.16f, 0.10f, 0.06f);
  if (material == 2) return vec3(0.20f, 0.19f, 0.18f);
  if (material == 3) return vec3(0.30f, 0.28f, 0.25f);
  if (material == 4) return vec3(0.52f, 0.41f, 0.26f);
  if (material == 5) return vec3(0.07f, 0.14f, 0.03f);
  if (material == 6) return vec3(0.04f, 0.04f, 0.045f);
  if (material == 7) return vec3(0.42f, 0.41f, 0.39f);
  return vec3(0.85f, 0.88f, 0.92f);
}

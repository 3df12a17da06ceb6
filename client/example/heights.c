/* Prints heights of a terrain, without a server:  heights [TERRAIN] */
#include <ridgecast.h>
#include <stdio.h>

int main(int argc, char** argv) {
  rc_terrain* terrain;
  if (rc_terrain_open(argc > 1 ? argv[1] : "alpine", NULL, &terrain) != RC_OK) return fprintf(stderr, "heights: %s\n", rc_message()), 1;
  const double places[] = {10, 20, 11, 20, 4e12, -4e12}; /* x, z */
  float heights[3];
  if (rc_terrain_heights(terrain, places, 3, heights) != RC_OK) return fprintf(stderr, "heights: %s\n", rc_message()), 1;
  for (int k = 0; k < 3; ++k) printf("%g, %g: %.3f m\n", places[2 * k], places[2 * k + 1], heights[k]);
  rc_terrain_close(terrain);
}

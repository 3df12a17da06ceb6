/* A driven wheel at 1 kHz over the true ground, one contact a step by heights, normals and materials, and the time of a step:
   wheel [SECONDS] */
#include <math.h>
#include <ridgecast.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static const double kRadius = 0.35, kMass = 20, kStiffness = 60000, kDamping = 1500, kSpeed = 8, kStep = 0.001;

/* How a tyre grips: where it is not said, and on earth, rock, gravel, sand, grass, asphalt, concrete, snow; last on the terrain's own. */
static const double kGrip[] = {0.6, 0.6, 0.7, 0.6, 0.5, 0.55, 0.9, 0.8, 0.25, 0.4};

typedef struct Wheel {
  double at[3], velocity[3]; /* x, y, z: of the hub */
  size_t steps_on[256];      /* by material */
} Wheel;

static double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Returns how deep the tyre is pressed in; negative: it is in the air. */
static double contact(Wheel* wheel, rc_terrain* terrain, double* force) {
  const double place[] = {wheel->at[0], wheel->at[2]};
  float height, normals[3];
  uint8_t material;
  if (rc_terrain_heights(terrain, place, 1, &height) != RC_OK || rc_terrain_normals(terrain, place, 1, kRadius, normals) != RC_OK ||
      rc_terrain_materials(terrain, place, 1, &material) != RC_OK) {
    fprintf(stderr, "wheel: %s\n", rc_message());
    exit(1);
  }
  const double normal[] = {normals[0], normals[1], normals[2]};
  const double depth = kRadius - (wheel->at[1] - height) * normal[1];
  const double load = depth > 0 ? fmax(0, kStiffness * depth - kDamping * dot(wheel->velocity, normal)) : 0;
  /* Along the ground: driven towards +x, held sideways, as far as the friction goes. */
  const double across = dot(wheel->velocity, normal);
  double push[3];
  for (int k = 0; k < 3; ++k) push[k] = 400 * ((k == 0 ? kSpeed : 0) - wheel->velocity[k] + across * normal[k]);
  const double outwards = dot(push, normal);
  for (int k = 0; k < 3; ++k) push[k] -= outwards * normal[k];
  const double most = kGrip[material < 9 ? material : 9] * load, wanted = sqrt(dot(push, push));
  for (int k = 0; k < 3; ++k) force[k] += load * normal[k] + push[k] * (wanted > most ? most / wanted : 1);
  wheel->steps_on[material] += depth > 0;
  return depth;
}

static double step(Wheel* wheel, rc_terrain* terrain) {
  double force[] = {0, -9.81 * kMass, 0};
  const double depth = contact(wheel, terrain, force);
  for (int k = 0; k < 3; ++k) {
    wheel->velocity[k] += force[k] / kMass * kStep;
    wheel->at[k] += wheel->velocity[k] * kStep;
  }
  return depth;
}

static int ascending(const void* left, const void* right) {
  const double a = *(const double*)left, b = *(const double*)right;
  return (a > b) - (a < b);
}

static double now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

int main(int argc, char** argv) {
  const size_t steps = (size_t)(argc > 1 ? atoi(argv[1]) : 60) * 1000;
  rc_terrain* terrain;
  if (rc_terrain_open("alpine", NULL, &terrain) != RC_OK) return fprintf(stderr, "wheel: %s\n", rc_message()), 1;
  const double start[] = {1e9, -2e9};
  float height;
  if (steps == 0 || rc_terrain_heights(terrain, start, 1, &height) != RC_OK) return fprintf(stderr, "wheel: %s\n", rc_message()), 1;
  Wheel wheel = {{start[0], height + 2 * kRadius, start[1]}, {0, 0, 0}, {0}};
  double deepest = 0, *times = malloc(steps * sizeof *times);
  size_t rolling = 0;
  for (size_t k = 0; k < steps; ++k) {
    const double begin = now(), depth = step(&wheel, terrain);
    times[k] = now() - begin;
    deepest = fmax(deepest, depth);
    rolling += depth > 0;
  }
  qsort(times, steps, sizeof *times, ascending);
  printf("%zu s, %.0f m, on the ground %.0f %% of the time, pressed in at most %.3f m\n", steps / 1000,
         hypot(wheel.at[0] - start[0], wheel.at[2] - start[1]), 100.0 * (double)rolling / (double)steps, deepest);
  for (int k = 0; k < 256; ++k) {
    const char* name = rc_terrain_material(terrain, (uint8_t)k);
    if (wheel.steps_on[k] > 0)
      printf("%.0f %% of that on %s\n", 100.0 * (double)wheel.steps_on[k] / (double)rolling,
             name ? name : "ground of which it is not said");
  }
  printf("a step: %.2f us (median), %.2f us (p99), %.2f us (worst)\n", 1e6 * times[steps / 2], 1e6 * times[steps * 99 / 100],
         1e6 * times[steps - 1]);
  free(times);
  rc_terrain_close(terrain);
  return deepest < kRadius && rolling > steps / 10 ? 0 : 1; /* at kRadius the hub is in the ground */
}

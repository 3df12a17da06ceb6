/* A cart of four wheels rolls downhill in MuJoCo, over a height field that follows it, 10^9 m from the origin:  cart [SECONDS]
   MuJoCo's z is up: its x, y, z are Ridgecast's x, -z, y, from the start. */
#include <math.h>
#include <mujoco/mujoco.h>
#include <ridgecast.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { kHalf = 64, kSide = 2 * kHalf + 1 }; /* heights of the window */
static const double kSpacing = 0.25, kStart[] = {1e9 + 2000, -2e9}, kRadius = 0.4;

static const char kModel[] =
    "<mujoco><option timestep='0.001' integrator='implicit'/>"
    "<asset><hfield name='ground' nrow='129' ncol='129' size='16 16 1000 5'/></asset>"
    "<default><geom friction='1 0.01 0.001'/><default class='wheel'>"
    "<joint type='hinge' axis='0 1 0' damping='2'/><geom type='ellipsoid' size='0.4 0.15 0.4' mass='5'/></default></default>"
    "<worldbody><body name='ground' mocap='true'><geom type='hfield' hfield='ground'/></body>"
    "<body name='cart'><freejoint/><geom type='box' size='0.8 0.4 0.15' mass='40'/>"
    "<body name='w0' pos=' 0.7  0.6 -0.1'><joint class='wheel'/><geom class='wheel'/></body>"
    "<body name='w1' pos=' 0.7 -0.6 -0.1'><joint class='wheel'/><geom class='wheel'/></body>"
    "<body name='w2' pos='-0.7  0.6 -0.1'><joint class='wheel'/><geom class='wheel'/></body>"
    "<body name='w3' pos='-0.7 -0.6 -0.1'><joint class='wheel'/><geom class='wheel'/></body>"
    "</body></worldbody></mujoco>";

static void check(rc_status status) {
  if (status == RC_OK) return;
  fprintf(stderr, "cart: %s\n", rc_message());
  exit(1);
}

static mjModel* load(void) {
  static mjVFS files;
  char error[500] = "";
  mj_defaultVFS(&files);
  mj_makeEmptyFileVFS(&files, "cart.xml", sizeof kModel - 1);
  memcpy(files.filedata[0], kModel, sizeof kModel - 1);
  mjModel* model = mj_loadXML("cart.xml", &files, error, sizeof error);
  mj_deleteVFS(&files);
  if (!model) fprintf(stderr, "cart: %s\n", error), exit(1);
  return model;
}

/* Lays the window around a place. Its heights keep to whole metres, so the ground under the cart stays the same. */
static void lay(mjModel* model, mjData* data, rc_terrain* terrain, double x, double y) {
  static double places[2 * kSide * kSide];
  static float heights[kSide * kSide];
  for (int row = 0; row < kSide; ++row)
    for (int column = 0; column < kSide; ++column) {
      double* place = &places[2 * (row * kSide + column)];
      place[0] = kStart[0] + x + kSpacing * (column - kHalf);
      place[1] = kStart[1] - (y + kSpacing * (row - kHalf));
    }
  check(rc_terrain_heights(terrain, places, kSide * kSide, heights));
  float low = INFINITY, high = -INFINITY;
  for (int k = 0; k < kSide * kSide; ++k) low = fminf(low, heights[k]), high = fmaxf(high, heights[k]);
  for (int k = 0; k < kSide * kSide; ++k) model->hfield_data[k] = (heights[k] - low) / (high - low + 1); /* MuJoCo's are 0 to 1 */
  model->hfield_size[2] = high - low + 1;
  const double at[] = {x, y, low};
  memcpy(data->mocap_pos, at, sizeof at);
}

static double groundAt(rc_terrain* terrain, const double* at) {
  const double place[] = {kStart[0] + at[0], kStart[1] - at[1]};
  float height;
  check(rc_terrain_heights(terrain, place, 1, &height));
  return height;
}

int main(int argc, char** argv) {
  const int seconds = argc > 1 ? atoi(argv[1]) : 20;
  rc_terrain* terrain;
  check(rc_terrain_open("alpine", NULL, &terrain));
  mjModel* model = load();
  mjData* data = mj_makeData(model);
  double middle[] = {0, 0}, lowest = INFINITY, farthest = 0;
  int windows = 1;
  lay(model, data, terrain, 0, 0);
  data->qpos[2] = groundAt(terrain, data->qpos) + 2;
  while (data->time < seconds) {
    if (fmax(fabs(data->qpos[0] - middle[0]), fabs(data->qpos[1] - middle[1])) > kSpacing * kHalf / 2) {
      for (int k = 0; k < 2; ++k) middle[k] = round(data->qpos[k]);
      lay(model, data, terrain, middle[0], middle[1]);
      ++windows;
    }
    mj_step(model, data);
    for (int body = mj_name2id(model, mjOBJ_BODY, "w0"); body < model->nbody; ++body) /* the wheels */
      lowest = fmin(lowest, data->xpos[3 * body + 2] - groundAt(terrain, &data->xpos[3 * body]));
    farthest = fmax(farthest, hypot(data->qpos[0], data->qpos[1]));
  }
  int warnings = 0;
  for (int k = 0; k < mjNWARNING; ++k) warnings += data->warning[k].number;
  printf("%d s, %.0f m away, %d windows; lowest hub of a %.1f m wheel %.3f m above the true ground; %d warnings of MuJoCo\n", seconds,
         farthest, windows, kRadius, lowest, warnings);
  mj_deleteData(data);
  mj_deleteModel(model);
  rc_terrain_close(terrain);
  return lowest > 0 && warnings == 0 ? 0 : 1;
}

/* Ridgecast for programs in any language: the true height of endless terrain, anywhere, with or without a server; sessions that several
   programs share; the ground as triangles with a bound of their error.

     rc_terrain* alpine;
     if (rc_terrain_open("alpine", NULL, &alpine) != RC_OK) { puts(rc_message()); return 1; }
     double xz[] = {10, 20, 11, 20};
     float heights[2];
     rc_terrain_heights(alpine, xz, 2, heights);

   Frame and units: metres, right-handed, +Y up; x and z on the horizontal plane, y the height. Everything lies on a lattice of 2^-8 m: x
   and z are rounded to the nearest step. It ends 4.398e12 m from the origin, and a double holds each of its places exactly. Angles are
   radians; yaw 0 looks along -Z and grows to the left. Heights have the same bits on every machine, from a terrain opened here, from a
   server, and over HTTP.

   Errors: functions return an rc_status; where it is not RC_OK, rc_message() says in a sentence what is wrong and what would be right, and
   nothing was written unless said. No function throws or ends the process.

   Threads: a terrain of rc_terrain_open and a mesh may be used by any number of threads at once. Calls on one world, and on its terrain
   where that is not local, take turns: the second waits until the first is over. Worlds never wait for each other. What is closed must
   not be in use.

   Waiting: a `timeout` is in seconds. Where the connection is away, a call waits for it within its timeout and then goes on.

   Lists: of an array to be filled, only the first entry's `size` is read; it is that of all. They write up to `room` entries and say how
   many there are.

   Versions: functions and fields are added, never changed. A struct with `size` begins as {.size = sizeof(it)}; what is 0 otherwise
   means the default. So programs go on with newer libraries of the same major version. */
#ifndef RIDGECAST_H
#define RIDGECAST_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum rc_status {
  RC_OK = 0,
  RC_INVALID = 1, /* the call: a number out of range, a name that does not exist */
  RC_REFUSED = 2, /* the server, or a file, says no; or there is no such server */
  RC_LOST = 3,    /* there is no connection, or the server came back with another world */
  RC_TIMEOUT = 4, /* the server, or a member, did not answer in time */
  RC_MEMORY = 5,
  RC_INTERNAL = 6 /* a fault of this library */
} rc_status;

/* Why the last call on this thread failed. Never null; good until this thread's next call. */
const char* rc_message(void);
/* "0.1.0", of the library. */
const char* rc_version(void);

/* ---- terrains: the true ground, anywhere, at once ---- */

typedef struct rc_terrain rc_terrain;

typedef struct rc_parameter {
  const char* name;
  double value;
} rc_parameter;

typedef struct rc_terrain_options {
  size_t size;
  uint32_t seed; /* default: 1 */
  uint32_t parameter_count;
  const rc_parameter* parameters; /* of a built-in terrain or a terrain file */
  const char* raster;             /* of a height map: "pitch=30 nodata=fill", as the server's --raster, with spaces between */
  const char* program;            /* ridgecast-server, which tries a terrain file first; default: the one in PATH */
} rc_terrain_options;

/* `name`: alpine, canyon, archipelago, a terrain file (.glsl; takes a compiler and seconds, cached), or a height map (.tif .png .asc .hgt
   .r16 .raw). `options` may be null. */
rc_status rc_terrain_open(const char* name, const rc_terrain_options* options, rc_terrain** out);
void rc_terrain_close(rc_terrain* terrain); /* null: nothing */
/* Equal for equal grounds, everywhere. */
uint64_t rc_terrain_hash(const rc_terrain* terrain);

/* Places are pairs x, z. Some 20 ns a height, one thread. */
rc_status rc_terrain_heights(rc_terrain* terrain, const double* places, size_t count, float* heights);
/* Three numbers a place: unit normals of the plane through heights `spacing` metres to each side (0: 1/16 m). */
rc_status rc_terrain_normals(rc_terrain* terrain, const double* places, size_t count, double spacing, float* normals);

typedef struct rc_ray {
  double origin[3];    /* x, y, z */
  double direction[3]; /* of any length but 0 */
  double reach;        /* metres, at most 1e5 */
} rc_ray;
typedef struct rc_hit {
  double distance; /* metres; -1: no ground within reach, and the rest is 0 */
  double at[3];
  double normal[3];
} rc_hit;
/* The first contact with the ground. Obstacles thinner than a quarter of a metre, or 1/1024 of the distance, may be missed. */
rc_status rc_terrain_rays(rc_terrain* terrain, const rc_ray* rays, size_t count, rc_hit* hits);

/* ---- ground under bodies: tiles of heights around each, kept while they move, for physics engines ---- */

typedef struct rc_standing rc_standing;

typedef struct rc_standing_options {
  size_t size;
  double spacing; /* metres between heights, a multiple of 1/64 up to 4096; default: 1 */
  double radius;  /* metres of ground around each body; default: 32 times the spacing */
  size_t memory;  /* bytes of tiles at most; default: 50,000,000 */
} rc_standing_options;

/* `terrain` must outlive it. One thread at a time. */
rc_status rc_standing_open(rc_terrain* terrain, const rc_standing_options* options, rc_standing** out);
void rc_standing_close(rc_standing* standing); /* null: nothing */
/* Where all bodies are, once a step: pairs x, z, in the same order each time. Never waits for heights: a thread makes the ground ahead of
   them, the nearest first, where a server is asked slowly. */
rc_status rc_standing_move(rc_standing* standing, const double* places, size_t count);
/* Until the ground around all bodies is there: at the beginning, and after one was put elsewhere. */
rc_status rc_standing_wait(rc_standing* standing, double timeout);

/* A square of ground; neighbours share their border's heights. */
typedef struct rc_tile {
  size_t size;
  int64_t i, j;         /* its corner of least x and z lies at i, j times its side, which is 32 times the spacing */
  uint64_t version;     /* grows with each tile that is made */
  const float* heights; /* metres, 33 a row of ascending x, 33 rows of ascending z; the terrain's, bit for bit */
  double x, z;          /* of that corner */
  double spacing;
  double error; /* metres: the true ground is at most so far above or below the squares, split along either diagonal (measured) */
  float lowest, highest;
  int32_t gone; /* 1: it went; 0: it came */
} rc_tile;
/* The next `room` tiles that went or came, and how many there are in all; call again while that is more than `room`. Heights of a tile may
   be used until the next call after its `gone`. */
rc_status rc_standing_changes(rc_standing* standing, rc_tile* out, size_t room, size_t* count);

/* ---- meshes ---- */

/* Triangles, counter-clockwise from above. Positions are metres from `origin` (x, z), y absolute: exact within 65 km of it. */
typedef struct rc_mesh {
  double origin[2];
  double error; /* metres: the true ground is at most so far above or below; infinite: not known */
  size_t vertex_count, triangle_count;
  const float* positions;    /* x, y, z of each vertex */
  const uint32_t* triangles; /* three vertices each */
} rc_mesh;
void rc_mesh_close(const rc_mesh* mesh); /* null: nothing */

/* ---- worlds: a session, entered as a member ---- */

typedef struct rc_world rc_world;

typedef struct rc_join_options {
  size_t size;
  const char* name;   /* shown to the others */
  int32_t sensor;     /* 1: a member without a picture */
  int32_t follows;    /* 1: follows the clock: each step waits until this member has done it (rc_world_next_step) */
  int32_t lockstep;   /* 1: exactly one iteration for each pose; the same poses give the same meshes */
  int32_t stays_lost; /* 1: a connection that is lost does not come back */
  uint32_t triangles; /* of the mesh at most; default: the server's */
  double threshold;   /* of the mesh, in pixels; default: 0.6 */
  double timeout;     /* of joining, and of questions to the server; default: 10 s */
  const char* token;  /* default: none */
  const char* ca;     /* file of authorities to trust (PEM); default: the system's */
} rc_join_options;

/* `url`: ws://HOST:PORT?session=NAME&terrain=NAME&seed=N&param=NAME=NUMBER; the session is made if there is none and a terrain is named. */
rc_status rc_join(const char* url, const rc_join_options* options, rc_world** out);
void rc_world_close(rc_world* world); /* its terrain with it; null: nothing */

typedef struct rc_world_info {
  size_t size;
  const char* session; /* strings: good until the world is closed */
  const char* terrain;
  const char* server;
  uint64_t hash;   /* rc_terrain_hash of its terrain */
  uint64_t member; /* this member's number; another one after a reconnection */
  uint64_t reconnections;
  double horizon; /* metres */
  uint32_t seed;
  int32_t is_local; /* 1: heights are computed here; 0: the server is asked */
} rc_world_info;
rc_status rc_world_get_info(rc_world* world, rc_world_info* out);

/* The world's, closed with it. */
rc_terrain* rc_world_terrain(rc_world* world);

/* The ground over a circle as triangles, at most `error` metres off; their origin is the middle. Where that takes too many, the message
   says which error fits. */
rc_status rc_world_ground(rc_world* world, double x, double z, double radius, double error, double timeout, const rc_mesh** out);

/* ---- the session's clock: whole microseconds from its beginning ---- */

enum { RC_REAL_TIME = 0, RC_SCALED = 1, RC_STEPPED = 2 };

typedef struct rc_clock {
  size_t size;
  int64_t time;
  int64_t uncertainty; /* of `time`; 0 when stepped */
  uint64_t owner;      /* member; 0: nobody */
  uint64_t step;       /* number of the newest */
  double rate;         /* session seconds a second; 0 when stepped */
  int32_t mode;
} rc_clock;
rc_status rc_world_clock(rc_world* world, rc_clock* out);
/* Takes the clock, where nobody has it, and sets it. `rate`: of RC_SCALED. */
rc_status rc_world_set_clock(rc_world* world, int32_t mode, double rate, double timeout);
/* Takes the clock, where nobody has it, moves it by `time`, and waits until all who follow it have done the step. RC_TIMEOUT: the message
   names who has not; call again with time 0 to go on waiting. RC_LOST: nobody knows whether it was done; read the clock. */
rc_status rc_world_step(rc_world* world, int64_t time, double timeout);
/* Of a member that follows: says that the step returned last is done, waits for the next one, and writes the session's time. */
rc_status rc_world_next_step(rc_world* world, double timeout, int64_t* time);
/* As the clock's owner: no step waits for this member until it has caught up. */
rc_status rc_world_pass_over(rc_world* world, uint64_t member);

/* ---- cameras: where a member is, and the mesh that the server keeps for what it sees ---- */

typedef struct rc_camera {
  size_t size;
  double x, y, z;
  double yaw, pitch;      /* pitch: -pi/2 to pi/2, upwards */
  double vertical_fov;    /* default: 60 degrees */
  uint32_t width, height; /* pixels; default: 1280 x 720 */
  const uint8_t* state;   /* at most 256 bytes for the other members, such as how wheels turn; default: none */
  size_t state_size;
} rc_camera;

typedef struct rc_iteration {
  size_t size;
  uint64_t number, pose; /* of the iteration; of the pose that it was made for, from 1 on */
  uint64_t hash;         /* of the whole mesh: equal meshes, equal hashes */
  uint64_t triangles;
  double threshold; /* pixels: what was reached, when the server had too little time or triangles */
  int32_t settled;  /* 1: nothing is left to refine at this pose */
} rc_iteration;

/* Sends the pose and waits for its iteration, or a later one. Timeout 0: only sends and writes `pose`; then rc_world_receive. `out` may be
   null. */
rc_status rc_world_fly(rc_world* world, const rc_camera* camera, double timeout, rc_iteration* out);
/* The next iteration: call it often. RC_TIMEOUT: none came. */
rc_status rc_world_receive(rc_world* world, double timeout, rc_iteration* out);

/* The whole mesh held, from this origin. */
rc_status rc_world_mesh(rc_world* world, double x, double z, const rc_mesh** out);

/* A square of the mesh. To take again only what changed, compare versions. */
typedef struct rc_leaf {
  size_t size;
  int64_t i, j;     /* the corner of least x and z is at i, j times the side */
  double side;      /* metres */
  uint64_t version; /* grows whenever its triangles change */
  uint64_t triangles;
  int32_t level; /* 0: the finest */
} rc_leaf;
/* Up to `room` of them, and how many there are, by level, i, j. `out` may be null where room is 0. */
rc_status rc_world_leaves(rc_world* world, rc_leaf* out, size_t room, size_t* count);
/* One of them; its origin is its corner. */
rc_status rc_world_leaf(rc_world* world, int32_t level, int64_t i, int64_t j, const rc_mesh** out);

/* ---- the other members ---- */

typedef struct rc_member {
  size_t size;
  uint64_t member;
  int64_t time; /* session time of the pose, microseconds */
  double x, y, z, yaw, pitch;
  int32_t has_pose; /* 0: none yet */
  int32_t sensor;
  char name[256];      /* UTF-8, at most 128 bytes, ends with 0 */
  uint8_t state[256];  /* what it says of itself: rc_camera */
  uint32_t state_size; /* bytes of it */
} rc_member;
/* Up to `room` of them, and how many there are, by number. */
rc_status rc_world_members(rc_world* world, rc_member* out, size_t room, size_t* count);

#ifdef __cplusplus
}
#endif

#endif

/* Ridgecast for programs in any language: the true height of endless terrain, anywhere, with or without a server; sessions that several
   programs share; the ground as triangles with a bound on their error.

     rc_terrain* alpine;
     if (rc_terrain_open("alpine", NULL, &alpine) != RC_OK) { puts(rc_message()); return 1; }
     double xz[] = {10, 20, 11, 20};
     float heights[2];
     rc_terrain_heights(alpine, xz, 2, heights);

   Frame and units: metres, right-handed, +Y up; x and z on the horizontal plane, y the height. Everything lies on a lattice of 2^-8 m: x
   and z are rounded to the nearest step. It ends 4.398e12 m from the origin, and a double holds each of its places exactly. Angles are
   radians; yaw 0 looks along -Z, and yaw grows to the left. Heights have the same bits on every machine, from a terrain opened here, from a
   server, and over HTTP.

   Errors: functions return an rc_status. If it is not RC_OK, rc_message() says in a sentence what is wrong and what would be right, and
   nothing was written unless stated otherwise. No function throws or ends the process.

   Threads: any number of threads may use a terrain of rc_terrain_open, or a mesh, at once. Calls on one world, and on its terrain if that
   is not local, take turns: the second waits until the first is over. Worlds never wait for each other. Close nothing that is in use.

   Waiting: a `timeout` is in seconds. If the connection is lost, a call waits within its timeout until it is back, and then goes on.

   Lists: set `size` in the array's first entry only; it holds for all. A function writes up to `room` entries and says how many there are.

   Versions: functions and fields are added, never changed. Initialise a struct that has `size` as {.size = sizeof(it)}; other fields that
   are 0 mean the default. So programs keep working with newer libraries of the same major version. */
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
  RC_REFUSED = 2, /* by the server; or a file cannot be used, or there is no such server */
  RC_LOST = 3,    /* there is no connection, or the server came back with another world */
  RC_TIMEOUT = 4, /* the server, or a member, did not answer in time */
  RC_MEMORY = 5,
  RC_INTERNAL = 6 /* a bug in this library */
} rc_status;

/* Why the last call on this thread failed. Never null; valid until this thread's next call. */
const char* rc_message(void);
/* "0.2.0", of the library. */
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
  const char* raster;             /* of a height map: values of the server's --raster, separated by spaces: "pitch=30 nodata=fill" */
  const char* program;            /* ridgecast-server, which checks a terrain file first; default: the one in PATH */
  const char* classes; /* of a height map: a file of the server's --classes, named in `raster`: "class=10:forest class=30:grass" */
} rc_terrain_options;

/* `name`: alpine, canyon, archipelago, a terrain file (.glsl; needs a C++ compiler, and seconds the first time), or a height map (.tif .png
   .asc .hgt .r16 .raw). `options` may be null. */
rc_status rc_terrain_open(const char* name, const rc_terrain_options* options, rc_terrain** out);
void rc_terrain_close(rc_terrain* terrain); /* null: does nothing */
/* Equal for equal ground, on every machine. Of a world that was edited: of its terrain and its edits, undone ones included, so that ground
   that other edits have made equal has another hash. Waits for the edits that this member must know, as heights do. */
uint64_t rc_terrain_hash(const rc_terrain* terrain);

/* Places are pairs x, z. About 20 ns a height, on one thread. */
rc_status rc_terrain_heights(rc_terrain* terrain, const double* places, size_t count, float* heights);
/* Heights around bodies: of `offset_count` places each, which are pairs x (to the body's right), z (behind it). Bodies are x, z, yaw. */
rc_status rc_terrain_patches(rc_terrain* terrain, const double* bodies, size_t count, const double* offsets, size_t offset_count,
                             float* heights);
/* Three numbers a place: the unit normal of the plane through the heights `spacing` metres to each side (0: 1/16 m). */
rc_status rc_terrain_normals(rc_terrain* terrain, const double* places, size_t count, double spacing, float* normals);

/* What the ground is made of: a number a place. 0: it is not said; 1 earth, 2 rock, 3 gravel, 4 sand, 5 grass, 6 asphalt, 7 concrete,
   8 snow, as edits paint it, too; then the terrain's own, such as water. A height map says it by its `classes`, a terrain file by
   terrainMaterial. */
rc_status rc_terrain_materials(rc_terrain* terrain, const double* places, size_t count, uint8_t* materials);
/* The name of one, "grass", valid as long as the terrain. Null: it is not said, or there is no such one. */
const char* rc_terrain_material(const rc_terrain* terrain, uint8_t material);

typedef struct rc_ray {
  double origin[3];    /* x, y, z */
  double direction[3]; /* of any length but 0 */
  double reach;        /* how far it goes: metres, at most 1e5 */
} rc_ray;
typedef struct rc_hit {
  double distance; /* metres; -1: no ground within reach, and the rest is 0 */
  double at[3];
  double normal[3];
} rc_hit;
/* The first contact with the ground. Missed only where the ray is in the ground for less than 1/64 m, or 1/16384 of the distance: proven
   for height maps and edits, measured for built-in terrains. Terrains of GLSL files are sampled every 1/4 m, or 1/1024 of the distance,
   and any thinner obstacle may be missed. */
rc_status rc_terrain_rays(rc_terrain* terrain, const rc_ray* rays, size_t count, rc_hit* hits);
/* Which of these holds for this terrain: "proven", "measured" or "sampled". */
const char* rc_terrain_known(const rc_terrain* terrain);

/* ---- ground under bodies: tiles of heights that follow them, for physics engines ---- */

typedef struct rc_standing rc_standing;

typedef struct rc_standing_options {
  size_t size;
  double spacing; /* metres between heights, a multiple of 1/64 up to 4096; default: 1 */
  double radius;  /* metres of ground around each body; default: 32 times the spacing */
  size_t memory;  /* bytes of tiles at most; default: 50,000,000 */
} rc_standing_options;

/* `terrain` must outlive it. One thread at a time. `options` may be null. */
rc_status rc_standing_open(rc_terrain* terrain, const rc_standing_options* options, rc_standing** out);
void rc_standing_close(rc_standing* standing); /* null: does nothing */
/* Call once a step: where all bodies (up to 100,000) are, as pairs x, z, in the same order each time. Never waits for heights: a background
   thread makes the ground ahead of the bodies, the nearest first; slowly where it has to ask a server. */
rc_status rc_standing_move(rc_standing* standing, const double* places, size_t count);
/* For each body of the last rc_standing_move, 1: the ground around it is there, with all edits that were told by then; 0: it is being made.
   `count`: how many bodies there are. */
rc_status rc_standing_ready(rc_standing* standing, size_t count, uint8_t* ready);
/* Waits until the ground around all bodies is there, with all edits that this member has made or been told of: call it at the beginning,
   and after an edit, or moving a body elsewhere at once. */
rc_status rc_standing_wait(rc_standing* standing, double timeout);

/* A square of ground; neighbours share their border's heights. */
typedef struct rc_tile {
  size_t size;
  int64_t i, j;         /* its corner of least x and z is at i, j times its side, which is 32 times the spacing */
  uint64_t version;     /* grows with each tile that is made */
  const float* heights; /* metres, 33 a row of ascending x, 33 rows of ascending z; the terrain's, bit for bit */
  double x, z;          /* of that corner */
  double spacing;
  double error; /* metres: how far the true ground is above or below its squares at most, split along either diagonal (measured) */
  float lowest, highest;
  int32_t gone;  /* 1: the tile went; 0: it came */
  uint64_t edit; /* the last edit that its heights know; 0: none. Later ones have changed other ground */
} rc_tile;
/* The next `room` tiles that went or came, and how many there are in all; call again while that is more than `room`. A tile whose ground
   an edit has changed goes, and the one in its place comes, at once: first all that went are told. What rested on it may wake. The heights
   of a tile stay valid until the first call after the one that reported it gone. */
rc_status rc_standing_changes(rc_standing* standing, rc_tile* out, size_t room, size_t* count);

/* ---- meshes ---- */

/* Triangles, counter-clockwise from above. Positions are metres: x and z from `origin`, y absolute; exact within 65 km of the origin. */
typedef struct rc_mesh {
  double origin[2]; /* x, z */
  double error;     /* metres: how far the true ground is above or below at most; infinite: not known (rc_join_options.errors) */
  size_t vertex_count, triangle_count;
  const float* positions;    /* x, y, z of each vertex */
  const uint32_t* triangles; /* three vertices each */
} rc_mesh;
void rc_mesh_close(const rc_mesh* mesh); /* null: does nothing */

/* ---- worlds: a session, joined as a member ---- */

typedef struct rc_world rc_world;

typedef struct rc_join_options {
  size_t size;
  const char* name;    /* shown to the others */
  int32_t sensor;      /* 1: a member without a camera's mesh */
  int32_t follows;     /* 1: follows the clock: each step waits until this member has done it (rc_world_next_step) */
  int32_t lockstep;    /* 1: exactly one iteration for each pose; the same poses give the same meshes */
  int32_t stays_lost;  /* 1: a lost connection is not restored */
  uint32_t triangles;  /* of the mesh at most; default: the server's */
  double threshold;    /* of the mesh, in pixels; default: 0.6 */
  double timeout;      /* of joining, and of queries to the server, seconds; default: 10 */
  const char* token;   /* default: none */
  const char* ca;      /* file of certificate authorities to trust (PEM); default: the system's */
  int32_t everybody;   /* 1: hears of each member, not only of those near it: for programs that need all */
  int32_t places_only; /* 1: poses only say where this member is; no mesh is made of what it sees, and no iteration comes */
  /* The session's own, opened here, so that heights do not ask the server. It may be closed after joining. RC_REFUSED: it is another.
     Default: none; built-in ones are found anyway. */
  const rc_terrain* terrain;
  /* 1: rc_mesh.error is known of the mesh held. Each square that changes is then measured, which takes the server several times what
     making the mesh takes. */
  int32_t errors;
} rc_join_options;

/* `url`: ws://HOST:PORT?session=NAME&terrain=NAME&seed=N&param=NAME=NUMBER. A session that does not exist is created if the URL names a
   terrain. `options` may be null. */
rc_status rc_join(const char* url, const rc_join_options* options, rc_world** out);
void rc_world_close(rc_world* world); /* its terrain with it; null: does nothing */

typedef struct rc_world_info {
  size_t size;
  const char* session; /* strings: valid until the world is closed */
  const char* terrain;
  const char* server;
  uint64_t hash;   /* rc_terrain_hash of its terrain, with the edits that have come so far */
  uint64_t member; /* this member's number; another one after a reconnection */
  uint64_t reconnections;
  double horizon; /* metres */
  uint32_t seed;
  int32_t is_local; /* 1: heights are computed here; 0: the server is asked */
} rc_world_info;
rc_status rc_world_get_info(rc_world* world, rc_world_info* out);

/* The world's, closed with it. */
rc_terrain* rc_world_terrain(rc_world* world);

/* The ground in a circle as triangles, at most `error` metres off; their origin is its centre. If that takes too many triangles, the
   message says which error fits. */
rc_status rc_world_ground(rc_world* world, double x, double z, double radius, double error, double timeout, const rc_mesh** out);

/* ---- the session's clock: whole microseconds from its beginning ---- */

enum { RC_REAL_TIME = 0, RC_SCALED = 1, RC_STEPPED = 2 };

typedef struct rc_clock {
  size_t size;
  int64_t time;
  int64_t uncertainty; /* of `time`; 0 when stepped */
  uint64_t owner;      /* member; 0: nobody */
  uint64_t step;       /* number of the newest step */
  double rate;         /* session seconds a second; 0 when stepped */
  int32_t mode;
  int64_t end; /* of a recording, where the clock stands; 0: there is none */
} rc_clock;
rc_status rc_world_clock(rc_world* world, rc_clock* out);
/* Takes the clock if nobody owns it, and sets it. `rate`: for RC_SCALED. */
rc_status rc_world_set_clock(rc_world* world, int32_t mode, double rate, double timeout);
/* Takes the clock if nobody owns it, and moves it to `time`: ahead by at most an hour, but not while a step is under way; in a
   recording also back: it begins again there, and the connection with it. RC_REFUSED: the message says why. */
rc_status rc_world_jump(rc_world* world, int64_t time, double timeout);
/* Takes the clock if nobody owns it, advances it by `time`, and waits until all members that follow it have done the step. RC_TIMEOUT: the
   message names those that have not; call again with time 0 to go on waiting. RC_REFUSED: it is not done; the message says why.
   RC_LOST: whether it was done is unknown, read the clock; or the server has lost the clock, which has begun anew: then it is not done.
   Who calls this or any other function that waits for the clock is told that once. */
rc_status rc_world_step(rc_world* world, int64_t time, double timeout);
/* For a member that follows: reports the step returned last as done, waits for the next one, and writes the session's time. */
rc_status rc_world_next_step(rc_world* world, double timeout, int64_t* time);
/* For the clock's owner: no step waits for this member until it has caught up. */
rc_status rc_world_pass_over(rc_world* world, uint64_t member);

/* Changes the ground for everybody: a JSON object such as {"op": "crater", "x": 0, "z": 0, "radius": 12, "depth": 4} (PROTOCOL.md, Edits).
   Writes its number: then it is kept, and heights and meshes know it. `key`, at most 64 bytes: an edit that is sent again with it is made
   once; null: another one for each call. RC_TIMEOUT: the same call goes on waiting. RC_REFUSED: it was not made; the message says why. */
rc_status rc_world_edit(rc_world* world, const char* operation, const char* key, double timeout, uint64_t* number);

/* ---- cameras: where a member is, and the mesh that the server keeps for what it sees ---- */

typedef struct rc_camera {
  size_t size;
  double x, y, z;
  double yaw, pitch;      /* pitch: -pi/2 to pi/2, upwards */
  double vertical_fov;    /* default: 60 degrees */
  uint32_t width, height; /* pixels; default: 1280 x 720 */
  const uint8_t* state;   /* at most 256 bytes for the other members, such as the angles of wheels; default: none */
  size_t state_size;
} rc_camera;

typedef struct rc_iteration {
  size_t size;
  uint64_t number, pose; /* of the iteration; of the pose that it was made for, from 1 on */
  uint64_t hash;         /* of the whole mesh: equal meshes, equal hashes */
  uint64_t triangles;
  double threshold; /* pixels: what was reached; above the requested one if the server had too little time or too few triangles */
  int32_t settled;  /* 1: nothing is left to refine at this pose */
} rc_iteration;

/* Sends the pose and waits for its iteration, or a later one. Timeout 0: only sends and writes `pose`; then rc_world_receive. `out` may be
   null. */
rc_status rc_world_fly(rc_world* world, const rc_camera* camera, double timeout, rc_iteration* out);
/* The next iteration: call it often. RC_TIMEOUT: none came. */
rc_status rc_world_receive(rc_world* world, double timeout, rc_iteration* out);

/* The whole mesh held, with its origin at x, z. */
rc_status rc_world_mesh(rc_world* world, double x, double z, const rc_mesh** out);

/* A square of the mesh. To fetch only what has changed, compare versions. */
typedef struct rc_leaf {
  size_t size;
  int64_t i, j;     /* the corner of least x and z is at i, j times the side */
  double side;      /* metres */
  uint64_t version; /* grows whenever its triangles change */
  uint64_t triangles;
  int32_t level; /* 0: the finest */
} rc_leaf;
/* Up to `room` of them, ordered by level, i, j, and how many there are. `out` may be null if `room` is 0. */
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
  uint8_t state[256];  /* what it sent with its pose: rc_camera */
  uint32_t state_size; /* bytes of it */
} rc_member;
/* Up to `room` of them, ordered by number, and how many there are: the 64 to 96 nearest, of which the 24 nearest are heard of often, or
   everybody (rc_join_options). A server that knows no crowds (revision less than 7) tells of everybody. */
rc_status rc_world_members(rc_world* world, rc_member* out, size_t room, size_t* count);

/* How many members of the session, this one included, are in a square. */
typedef struct rc_crowd_cell {
  size_t size;
  double x, z; /* its corner of least x and z, metres */
  double side; /* metres */
  uint64_t members;
} rc_crowd_cell;
/* Up to `room` of them, and how many there are; none while rc_world_members names everybody. `others`: how many other members the session
   has, named or not; may be null. */
rc_status rc_world_crowd(rc_world* world, rc_crowd_cell* out, size_t room, size_t* count, uint64_t* others);

#ifdef __cplusplus
}
#endif

#endif

/* Quarry: rays through triangle models that do not fit memory. The C interface of libquarry, in C99.

   A scene is a store that `quarry-preprocess` has made, in a file or on a server. Its voxels are read when
   rays need them, into a cache of fixed size. A ray's hit is the one of Quarry's pictures: the least (t,
   triangle) of all triangles under one watertight test, so no ray passes between two triangles that share an
   edge.

   Rays. Positions are the model's own, as in its file. In double, META's offset is subtracted from an origin,
   the direction is made unit, and an origin far from the scene is moved along the ray to the scene's box;
   then origin and direction are rounded to float, once. Quarry traces that ray of floats. `t` comes
   back in lengths of the direction as given: the hit lies at origin + t * direction.

   Surfaces. A hole that a texture's cut-off makes is none. A surface without a cut-off is there where its
   opacity is at least 0.5. Glass is a surface, unless QUARRY_GLASS_PASSES.

   Errors. Calls return a status; quarry_error() has the sentence. After an error the caller's output arrays
   hold anything, and no miss stands for a ray that was not traced. After QUARRY_SOURCE, QUARRY_DATA and
   QUARRY_MEMORY the scene stays open, and the next call tries again.

   Threads. All calls may be made from any thread at any time, also for one scene at once, and quarry_close()
   during other calls. The library installs no signal handler, prints nothing, changes no setting of the
   process and does not end it. After fork() the child may open scenes of its own; the parent's are an error
   there.

   Memory. A scene takes `cache_bytes`, 32 MiB, 4 MiB for each thread and 400 bytes for each voxel. A call
   takes at most 3 MiB; quarry_all() 3 MiB for each million hits, and 128 bytes for each hit of a ray with
   more than 16,384.

   Example:

       quarry_scene *scene;
       if (quarry_open("plant.quarry", NULL, &scene) != QUARRY_OK) { puts(quarry_error()); return 1; }
       double ray[6] = {10, 20, 30, 0, 0, -1}, t;
       quarry_rays rays = QUARRY_RAYS_INIT;
       rays.count = 1;
       rays.origins = ray;
       rays.directions = ray + 3;
       quarry_hits hits = QUARRY_HITS_INIT;
       hits.t = &t;
       if (quarry_nearest(scene, &rays, &hits) != QUARRY_OK) { puts(quarry_error()); return 1; }
       quarry_close(scene);
*/
#ifndef QUARRY_H
#define QUARRY_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define QUARRY_API __attribute__((visibility("default")))
#else
#define QUARRY_API
#endif

/* An open scene. A handle is never used again, so that a closed one is an error, not a danger. */
typedef struct quarry_scene quarry_scene;

typedef enum quarry_status {
  QUARRY_OK = 0,
  QUARRY_ARGUMENT = 1,  /* an argument cannot be; the sentence names it, and the index in an array */
  QUARRY_SOURCE = 2,    /* a file or a server cannot be read now */
  QUARRY_DATA = 3,      /* no store, another version, or damaged; the sentence names the byte */
  QUARRY_MEMORY = 4,    /* no memory, or no thread */
  QUARRY_CANCELLED = 5, /* quarry_cancel() or quarry_close() */
  QUARRY_PROCESSOR = 6, /* no AVX2, FMA and BMI2, or none that QUARRY_ISA names */
  QUARRY_FORKED = 7     /* the scene was opened before fork(), by the parent */
} quarry_status;

/* Stands for no id: for the triangle of a ray that hits nothing. */
#define QUARRY_NONE 0xFFFFFFFFu

/* The sentence of this thread's last failed call, in UTF-8, without control codes; "" before the first. It
   stays as it is until the thread's next failure. */
QUARRY_API const char* quarry_error(void);
/* The release, such as "1.4.0". */
QUARRY_API const char* quarry_version(void);

/* Settings of a scene. `size` is sizeof(quarry_options): later releases append members. */
typedef struct quarry_options {
  size_t size;
  uint64_t cache_bytes; /* memory for decoded voxels; 0: 1 GiB. At least the scene's largest block. */
  uint32_t threads;     /* compute threads; 0: the processors that this process may use. At most 4,096. */
} quarry_options;
#define QUARRY_OPTIONS_INIT \
  { sizeof(quarry_options), 0, 0 }

/* Opens a store. `place`: a path, http://, https:// or s3://BUCKET/KEY, signed by the AWS_* variables or
   ~/.aws. `options`: NULL for the defaults. `*scene` is set where QUARRY_OK is returned, else NULL. Errors:
   ARGUMENT, SOURCE, DATA, MEMORY, PROCESSOR. */
QUARRY_API quarry_status quarry_open(const char* place, const quarry_options* options, quarry_scene** scene);
/* Ends the calls under way, which return QUARRY_CANCELLED, waits for them, and frees the scene. Closing NULL
   does nothing. Errors: ARGUMENT for a scene that is not open; FORKED. */
QUARRY_API quarry_status quarry_close(quarry_scene* scene);

/* What a scene holds. `size` is sizeof(quarry_description), set by the caller. */
typedef struct quarry_description {
  size_t size;
  double lower[3], upper[3]; /* box of the triangles, in the model's coordinates */
  double offset[3];          /* stored position + offset = the model's */
  double unit_in_metres;     /* 1 where that is not known */
  uint32_t up_axis;          /* 1: y, 2: z */
  uint32_t materials;        /* ids are below this */
  uint64_t parts;            /* ids are below this */
  uint64_t triangles;        /* with a surface; ids count all that the model's files hold */
  uint64_t triangle_ids;     /* ids are below this */
  uint64_t voxels;
  uint64_t decoded_bytes;       /* a cache of this size holds the whole scene */
  uint64_t largest_block_bytes; /* the least cache */
} quarry_description;
#define QUARRY_DESCRIPTION_INIT \
  { sizeof(quarry_description), {0, 0, 0}, {0, 0, 0}, {0, 0, 0}, 0, 0, 0, 0, 0, 0, 0, 0, 0 }
/* Errors: ARGUMENT, FORKED, PROCESSOR. */
QUARRY_API quarry_status quarry_describe(quarry_scene* scene, quarry_description* description);

/* Copies the name of a part or a material, in UTF-8, cut to `capacity` - 1 bytes and ended by a zero; ""
   where it has none. `length`: NULL, or gets the whole name's bytes without the zero. `name` may be NULL
   where `capacity` is 0. Errors: ARGUMENT (no such id), SOURCE, DATA, MEMORY, FORKED, PROCESSOR. */
QUARRY_API quarry_status quarry_part_name(quarry_scene* scene, uint32_t part, char* name, size_t capacity,
                                          size_t* length);
QUARRY_API quarry_status quarry_material_name(quarry_scene* scene, uint32_t material, char* name,
                                              size_t capacity, size_t* length);

typedef enum quarry_number { QUARRY_FLOAT64 = 0, QUARRY_FLOAT32 = 1 } quarry_number;

/* Flags of quarry_rays. */
#define QUARRY_GLASS_PASSES 1u /* materials that let light through are no surfaces */

/* Rays of a call, read from the caller's arrays, which must not change during it. */
typedef struct quarry_rays {
  size_t size;            /* sizeof(quarry_rays) */
  size_t count;           /* how many */
  quarry_number type;     /* of the numbers in all four arrays */
  uint32_t flags;         /* 0 or QUARRY_GLASS_PASSES */
  const void* origins;    /* three numbers a ray */
  const void* directions; /* three numbers a ray, of any length but 0 */
  ptrdiff_t stride;       /* bytes from one ray to the next in these two arrays; 0: three numbers */
  const void* tnear;      /* one number a ray, not negative: hits lie there or beyond; NULL: 0 */
  const void* tfar;       /* one number a ray, more than tnear: hits lie before it; NULL: infinity */
  ptrdiff_t t_stride;     /* bytes from one ray to the next in these two arrays; 0: one number */
  uint64_t tag;           /* for quarry_cancel() */
} quarry_rays;
#define QUARRY_RAYS_INIT \
  { sizeof(quarry_rays), 0, QUARRY_FLOAT64, 0, NULL, NULL, 0, NULL, NULL, 0, 0 }

/* Where a call writes its hits: arrays of the caller, packed, one entry for each hit. Those that are NULL are
   left out; `part`, `material` and `normal` cost a second look at the scene's blocks. */
typedef struct quarry_hits {
  size_t size;        /* sizeof(quarry_hits) */
  double* t;          /* in lengths of the ray's direction; infinity where there is no hit */
  uint32_t* triangle; /* its number in the model's files; QUARRY_NONE where there is no hit, as below */
  float* uv;          /* two: the weights of the triangle's second and third vertex */
  uint32_t* part;
  uint32_t* material;
  float* normal; /* three: unit, by the winding of the triangle, whichever side is hit; 0 where there is no
                    hit */
} quarry_hits;
#define QUARRY_HITS_INIT \
  { sizeof(quarry_hits), NULL, NULL, NULL, NULL, NULL, NULL }

/* The four asks. Errors of each: ARGUMENT, SOURCE, DATA, MEMORY, CANCELLED, FORKED, PROCESSOR. */

/* The nearest hit of each ray: `count` entries. Of two at one t the triangle of the lesser id. */
QUARRY_API quarry_status quarry_nearest(quarry_scene* scene, const quarry_rays* rays,
                                        const quarry_hits* hits);
/* Whether each ray hits anything: `count` bytes, 1 or 0. */
QUARRY_API quarry_status quarry_any(quarry_scene* scene, const quarry_rays* rays, uint8_t* hit);
/* How many hits each ray has: `count` numbers. */
QUARRY_API quarry_status quarry_count(quarry_scene* scene, const quarry_rays* rays, uint32_t* counts);
/* All hits of each ray, by (t, triangle). `splits`: `count` + 1 numbers, sums of what quarry_count() gave for
   the same rays: hits of ray i become the entries [splits[i], splits[i + 1]). `hits` has splits[count]
   entries. Errors: also ARGUMENT where a ray has another number of hits than `splits` says. */
QUARRY_API quarry_status quarry_all(quarry_scene* scene, const quarry_rays* rays, const uint64_t* splits,
                                    const quarry_hits* hits);

/* Ends the scene's calls under way with this tag, or all with QUARRY_EVERY_TAG: they return QUARRY_CANCELLED
   soon. Later calls are not affected. Errors: ARGUMENT for a scene that is not open; FORKED, PROCESSOR. */
#define QUARRY_EVERY_TAG UINT64_MAX
QUARRY_API quarry_status quarry_cancel(quarry_scene* scene, uint64_t tag);

/* Rays through the centres of pixels, as `quarry render` shoots them: `width` x `height` rays of six
   numbers, origin and direction, row by row from the upper left. At t = 1 a ray is at distance 1 along the
   axis of view. `fov_degrees`: the vertical angle, or with QUARRY_HORIZONTAL the horizontal one, in (0, 179].
   `eye`, `at` and `up` are three numbers. Errors: ARGUMENT, PROCESSOR. */
#define QUARRY_VERTICAL 0
#define QUARRY_HORIZONTAL 1
QUARRY_API quarry_status quarry_pinhole(const double* eye, const double* at, const double* up,
                                        double fov_degrees, int which_fov, uint32_t width, uint32_t height,
                                        double* rays);

/* Work since the scene was opened. `size` is sizeof(quarry_statistics), set by the caller. */
typedef struct quarry_statistics {
  size_t size;
  uint64_t rays; /* traced, of finished parts of calls; a ray goes on after each hit but the first */
  uint64_t rays_suspended; /* times that a ray waited for a block */
  uint64_t blocks_loaded, evictions;
  uint64_t bytes_decoded; /* of the blocks loaded */
  uint64_t cache_bytes;   /* decoded blocks held now */
  double compute_seconds; /* processor time of the compute threads */
  double stall_seconds;   /* of compute threads that waited for blocks */
} quarry_statistics;
#define QUARRY_STATISTICS_INIT \
  { sizeof(quarry_statistics), 0, 0, 0, 0, 0, 0, 0, 0 }
/* Errors: ARGUMENT, FORKED, PROCESSOR. */
QUARRY_API quarry_status quarry_measure(quarry_scene* scene, quarry_statistics* statistics);

#ifdef __cplusplus
}
#endif

#endif

/* Whether one point sees another, and which part stands between. Usage: sight STORE X Y Z X Y Z
   Compile: cc sight.c $(pkg-config --cflags --libs quarry) -o sight */
#include <quarry.h>
#include <stdio.h>
#include <stdlib.h>

static int fail(quarry_scene *scene) {
  fprintf(stderr, "sight: %s\n", quarry_error());
  quarry_close(scene);
  return 1;
}

int main(int argc, char **argv) {
  if (argc != 8) {
    fprintf(stderr, "usage: sight STORE X Y Z X Y Z\n");
    return 2;
  }
  double from[3], way[3], end = 1;
  for (int i = 0; i < 3; ++i) {
    from[i] = atof(argv[2 + i]);
    way[i] = atof(argv[5 + i]) - from[i];
  }
  quarry_options options = QUARRY_OPTIONS_INIT;
  options.cache_bytes = 256u << 20;
  quarry_scene *scene;
  if (quarry_open(argv[1], &options, &scene) != QUARRY_OK) return fail(NULL);

  /* The direction is the whole way, so that t is 1 at the other point. */
  quarry_rays rays = QUARRY_RAYS_INIT;
  rays.count = 1;
  rays.origins = from;
  rays.directions = way;
  rays.tfar = &end;
  double t;
  uint32_t part;
  quarry_hits hits = QUARRY_HITS_INIT;
  hits.t = &t;
  hits.part = &part;
  if (quarry_nearest(scene, &rays, &hits) != QUARRY_OK) return fail(scene);
  if (part == QUARRY_NONE) {
    printf("in sight\n");
  } else {
    char name[256];
    if (quarry_part_name(scene, part, name, sizeof name, NULL) != QUARRY_OK) return fail(scene);
    printf("hidden by %s after %.6g of the way\n", name[0] ? name : "a part without a name", t);
  }
  quarry_close(scene);
  return 0;
}

"""libquarry as C programs see it: what it exports, how it is found, and what happens to its process: no output, no signal handler, no end when memory
runs out or the processor is too old."""
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import textwrap

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, main

ROOT = pathlib.Path(__file__).parents[3]
BUILD = BIN.parent
EXAMPLE = ROOT / "common/api/examples/sight.c"
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror")

# Opens a store, asks for shade and hits, and closes it. Prints the worst status and its sentence.
ASKS = """
    #include <quarry.h>
    #include <stdio.h>
    #include <string.h>
    static char said[1024];
    static int worst = 0;
    static void note(quarry_status status) {
      if (status == QUARRY_OK || worst != 0) return;
      worst = (int)status;
      strncpy(said, quarry_error(), sizeof said - 1);
    }
    static double numbers[3000][6];
    static uint8_t hit[3000];
    static double t[3000];
    static uint32_t part[3000];
    int ask(const char *store) {
      quarry_options options = QUARRY_OPTIONS_INIT;
      quarry_scene *scene = NULL;
      quarry_rays rays = QUARRY_RAYS_INIT;
      quarry_hits hits = QUARRY_HITS_INIT;
      options.cache_bytes = 32u << 20;
      options.threads = 2;
      for (int i = 0; i < 3000; ++i) {
        numbers[i][0] = i % 60 * 3.0 - 90;
        numbers[i][1] = i / 60 * 3.0 - 75;
        numbers[i][2] = 200;
        numbers[i][5] = -1;
      }
      rays.count = 3000;
      rays.origins = numbers;
      rays.directions = &numbers[0][3];
      rays.stride = sizeof numbers[0];
      hits.t = t;
      hits.part = part;
      note(quarry_open(store, &options, &scene));
      if (scene) {
        note(quarry_any(scene, &rays, hit));
        note(quarry_nearest(scene, &rays, &hits));
        note(quarry_close(scene));
      }
      return worst;
    }
"""


class Library(Case):
    def compile(self, name, source, *options, strict=STRICT):
        code, program = self.path(f"{name}.c"), self.path(name)
        pathlib.Path(code).write_text(textwrap.dedent(source))
        done = subprocess.run(["cc", *strict, f"-I{ROOT}/common/api", code, "-o", program, *options], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return program

    def against_library(self):
        return (f"-L{BUILD}/lib", "-lquarry", f"-Wl,-rpath,{BUILD}/lib")

    def test_nothing_is_exported_but_the_calls(self):
        shown = subprocess.run(["nm", "-D", "--defined-only", BUILD / "lib/libquarry.so.0"], capture_output=True, text=True, check=True).stdout
        names = [line.split()[-1].split("@")[0] for line in shown.splitlines()]
        declared = [line.split("(")[0].split("*")[-1].split()[-1] for line in (ROOT / "common/api/quarry.h").read_text().splitlines()
                    if line.startswith("QUARRY_API")]
        self.assertEqual(sorted(name for name in names if name != "QUARRY_0"), sorted(declared))
        needs = subprocess.run(["readelf", "-d", BUILD / "lib/libquarry.so.0"], capture_output=True, text=True, check=True).stdout
        self.assertIn("[libquarry.so.0]", needs)
        for library in ("libOpenImageIO", "libboost", "libassimp", "libtbb", "libembree"):
            self.assertNotIn(library, needs)

    def test_an_installation_is_found_by_pkg_config_and_cmake_wherever_it_lies(self):
        prefix, moved = self.folder / "first", self.folder / "a moved one"
        for component in ("library", "development"):
            subprocess.run(["cmake", "--install", BUILD, "--prefix", prefix, "--component", component], check=True, capture_output=True)
        prefix.rename(moved)
        pc = next(moved.rglob("quarry.pc"))
        store, environment = self.store("plant", 5000), {**os.environ, "PKG_CONFIG_PATH": str(pc.parent), "LD_LIBRARY_PATH": str(pc.parents[1])}
        flags = subprocess.run(["pkg-config", "--cflags", "--libs", "quarry"], capture_output=True, text=True, env=environment, check=True).stdout
        done = subprocess.run(["cc", *STRICT, EXAMPLE, *shlex.split(flags), "-o", self.path("sight")], capture_output=True, text=True, env=environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        (self.folder / "by_cmake").mkdir()
        (self.folder / "by_cmake/CMakeLists.txt").write_text(textwrap.dedent(f"""
            cmake_minimum_required(VERSION 3.16)
            project(sight LANGUAGES C CXX)
            find_package(Quarry 0.1 REQUIRED)
            add_executable(sight {EXAMPLE})
            target_link_libraries(sight PRIVATE Quarry::quarry)
            add_executable(sight_cpp sight.cpp)
            target_link_libraries(sight_cpp PRIVATE Quarry::quarry)
        """))
        (self.folder / "by_cmake/sight.cpp").write_text(textwrap.dedent("""
            #include <quarry.hpp>
            #include <iostream>
            int main(int, char **argv) {
              try {
                quarry::OpenedScene scene(argv[1]);
                std::cout << scene.Describe().triangles << ' ' << scene.PartName(0) << std::endl;
                scene.PartName(1u << 30);
              } catch (const quarry::Failure &failure) {
                std::cout << failure.status() << ' ' << failure.what() << std::endl;
              }
            }
        """))
        for step in (["cmake", "-S", "by_cmake", "-B", "made", f"-DCMAKE_PREFIX_PATH={moved}"], ["cmake", "--build", "made"]):
            done = subprocess.run(step, cwd=self.folder, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        for program in (self.path("sight"), self.path("made/sight")):
            blocked = subprocess.run([program, store, "0", "0", "500", "0", "0", "-500"], capture_output=True, text=True, env=environment, timeout=TIMEOUT_S)
            self.assertRegex(blocked.stdout, r"^hidden by \S.* after 0\.\d+ of the way\n$", blocked.stderr)
            free = subprocess.run([program, store, "0", "0", "500", "10", "0", "500"], capture_output=True, text=True, env=environment, timeout=TIMEOUT_S)
            self.assertEqual(free.stdout, "in sight\n")
            bad = subprocess.run([program, EXAMPLE, *"000000"], capture_output=True, text=True, env=environment, timeout=TIMEOUT_S)
            self.assertEqual(bad.returncode, 1)
            self.assertRegex(bad.stderr, "^sight: .*not a Quarry scene store")
        said = subprocess.run([self.path("made/sight_cpp"), store], capture_output=True, text=True, env=environment, timeout=TIMEOUT_S).stdout
        self.assertRegex(said, r"^\d+ \S.*\n1 part is 1073741824; the scene has \d+ parts\n$")

    def test_the_process_is_left_as_it_was(self):
        store = self.store("plant", 20000)
        program = self.compile("same", ASKS + """
            #define _POSIX_C_SOURCE 200809L
            #include <signal.h>
            #include <sys/resource.h>
            int main(int argc, char **argv) {
              struct sigaction before[65], after;
              struct rlimit limits[2];
              sigset_t masks[2];
              (void)argc;
              sigprocmask(SIG_BLOCK, NULL, &masks[0]);
              getrlimit(RLIMIT_NOFILE, &limits[0]);
              for (int s = 1; s < 65; ++s) memset(&before[s], 0, sizeof before[s]), sigaction(s, NULL, &before[s]);
              const int status = ask(argv[1]) + ask("/dev/null") * 100;
              for (int s = 1; s < 65; ++s) {
                memset(&after, 0, sizeof after);
                sigaction(s, NULL, &after);
                if (before[s].sa_handler != after.sa_handler || before[s].sa_flags != after.sa_flags) return s;
              }
              sigprocmask(SIG_BLOCK, NULL, &masks[1]);
              getrlimit(RLIMIT_NOFILE, &limits[1]);
              if (memcmp(&masks[0], &masks[1], sizeof masks[0]) || limits[0].rlim_cur != limits[1].rlim_cur) return 70;
              return status == 100 * QUARRY_SOURCE || status == 100 * QUARRY_DATA ? 0 : 71;
            }
        """, *self.against_library(), strict=("-std=gnu99", "-Wall"))
        done = subprocess.run([program, store], capture_output=True, text=True, timeout=TIMEOUT_S)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))

    def test_memory_is_within_what_the_header_states(self):
        store = self.store("plant", 300000, voxel_size="64K")
        program = self.compile("memory", """
            #include <quarry.h>
            #include <stdio.h>
            #include <stdlib.h>
            #include <string.h>
            #define COUNT 300000
            static float numbers[COUNT][6];
            static uint8_t hit[COUNT];
            static uint32_t counts[COUNT], part[COUNT];
            static double t[COUNT];
            static long peak(void) {  /* KiB */
              char line[256];
              long found = 0;
              FILE *file = fopen("/proc/self/status", "r");
              while (fgets(line, sizeof line, file)) if (!strncmp(line, "VmHWM:", 6)) found = atol(line + 6);
              fclose(file);
              return found;
            }
            int main(int argc, char **argv) {
              quarry_options options = QUARRY_OPTIONS_INIT;
              quarry_description d = QUARRY_DESCRIPTION_INIT;
              quarry_rays rays = QUARRY_RAYS_INIT;
              quarry_hits hits = QUARRY_HITS_INIT;
              quarry_scene *scene;
              (void)argc;
              options.cache_bytes = 4u << 20;
              options.threads = (uint32_t)atoi(argv[2]);
              memset(hit, 1, sizeof hit), memset(counts, 1, sizeof counts), memset(part, 1, sizeof part), memset(t, 1, sizeof t);
              if (quarry_open(argv[1], &options, &scene) || quarry_describe(scene, &d)) return 1;
              srand(1);
              for (int i = 0; i < COUNT; ++i)
                for (int k = 0; k < 3; ++k) {
                  numbers[i][k] = (float)(d.lower[k] + (d.upper[k] - d.lower[k]) * i / COUNT);
                  numbers[i][3 + k] = (float)rand() / (float)RAND_MAX - 0.5f;
                }
              const long before = peak();
              rays.count = COUNT, rays.type = QUARRY_FLOAT32, rays.origins = numbers, rays.directions = &numbers[0][3], rays.stride = sizeof numbers[0];
              hits.t = t, hits.part = part;
              if (quarry_any(scene, &rays, hit) || quarry_nearest(scene, &rays, &hits) || quarry_count(scene, &rays, counts)) return 2;
              quarry_statistics s = QUARRY_STATISTICS_INIT;
              if (quarry_measure(scene, &s)) return 3;
              const long allowed = 4096 + 32768 + 4096L * atol(argv[2]) + 400 * (long)d.voxels / 1024 + 3072;
              printf("%ld of %ld KiB, %lu evictions\\n", peak() - before, allowed, (unsigned long)s.evictions);
              return peak() - before > allowed || s.evictions == 0 ? 4 : quarry_close(scene) != QUARRY_OK;
            }
        """, *self.against_library(), strict=("-std=gnu99", "-Wall"))
        for threads in ("1", "4"):
            done = subprocess.run([program, store, threads], capture_output=True, text=True, timeout=TIMEOUT_S)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_failing_allocations_are_errors_of_calls(self):
        """Each allocation fails once, and from each on all fail for a while: a call returns QUARRY_MEMORY or does without."""
        store = self.store("plant", 5000)
        program = self.compile("scarce", ASKS + """
            #include <stdlib.h>
            int main(int argc, char **argv) {
              (void)argc;
              const int status = ask(argv[1]);
              if (status == QUARRY_MEMORY && said[0] == 0) return 9;
              printf("%d", status);
              return status == QUARRY_OK || status == QUARRY_MEMORY ? 0 : 10 + status;
            }
        """, *self.against_library(), strict=("-std=gnu99", "-Wall"))
        shim = self.path("shim.so")
        pathlib.Path(self.path("shim.c")).write_text(textwrap.dedent("""
            #define _GNU_SOURCE
            #include <dlfcn.h>
            #include <errno.h>
            #include <stdatomic.h>
            #include <stdlib.h>
            // Allocations of the library's threads and calls are counted, once quarry_open() is reached.
            static atomic_long count, first = -1, end;
            static void *(*real)(size_t);
            __attribute__((constructor)) static void begin(void) {
              real = (void *(*)(size_t))dlsym(RTLD_NEXT, "malloc");
              first = atol(getenv("FAIL_FIRST"));
              end = first + atol(getenv("FAIL_COUNT"));
              count = 0;
            }
            void *malloc(size_t bytes) {
              if (!real) real = (void *(*)(size_t))dlsym(RTLD_NEXT, "malloc");
              const long at = atomic_fetch_add(&count, 1);
              if (first >= 0 && at >= first && at < end) { errno = ENOMEM; return NULL; }
              return real(bytes);
            }
        """))
        subprocess.run(["cc", "-shared", "-fPIC", self.path("shim.c"), "-o", shim, "-ldl"], check=True)
        failed = 0
        for first in (*range(0, 60), *range(60, 1500, 37)):
            for count in (1, 40, 10**9):
                done = subprocess.run([program, store], capture_output=True, text=True, timeout=TIMEOUT_S,
                                      env={**os.environ, "LD_PRELOAD": shim, "FAIL_FIRST": str(first), "FAIL_COUNT": str(count)})
                self.assertEqual((done.returncode, done.stderr), (0, ""), f"allocation {first} and {count - 1} more: {done.stdout}")
                failed += done.stdout == "4"
        self.assertGreater(failed, 100)

    def test_unknown_instruction_sets_and_empty_files_are_errors(self):
        store = self.store("plant", 5000)
        pathlib.Path(self.path("empty")).touch()
        program = self.compile("refused", ASKS + """
            int main(int argc, char **argv) {
              (void)argc;
              const int status = ask(argv[1]);
              printf("%d %s", status, said);
              return 0;
            }
        """, *self.against_library(), strict=("-std=gnu99", "-Wall"))
        for place, isa, said in ((store, "sse2", "^6 QUARRY_ISA names no instruction set"), (self.path("empty"), "avx2", "^3 .*empty: ")):
            done = subprocess.run([program, place], capture_output=True, text=True, timeout=TIMEOUT_S, env={**os.environ, "QUARRY_ISA": isa})
            self.assertRegex(done.stdout, said)

    def test_a_processor_without_avx2_is_an_error(self):
        emulator = shutil.which("qemu-x86_64")
        if not emulator:
            self.skipTest("no emulator of processors (qemu-user)")
        store = self.store("plant", 5000)
        program = self.compile("old", ASKS + """
            int main(int argc, char **argv) {
              (void)argc;
              const int status = ask(argv[1]);
              printf("%d %s %s", status, quarry_version(), said);
              return 0;
            }
        """, *self.against_library(), strict=("-std=gnu99", "-Wall"))
        # Without AVX: loading the library, too, must not use it.
        done = subprocess.run([emulator, "-cpu", "Nehalem", program, store], capture_output=True, text=True, timeout=TIMEOUT_S)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"^6 \d+\.\d+\.\d+ this processor lacks AVX2")


if __name__ == "__main__":
    main()

"""The command line as a user meets it: stores kept of models, refused and mistyped options, progress, statistics, logs."""
import fcntl
import json
import os
import pathlib
import pty
import re
import shutil
import signal
import struct
import subprocess
import sys
import termios
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, end, main

OBJ = "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"


class KeptStores(Case):
    """Stores that `quarry render MODEL` makes."""

    def setUp(self):
        super().setUp()
        self.write("m.obj", OBJ)
        self.write("m.mtl", "newmtl a\nKd 1 0 0\n")
        self.model = self.path("m.obj")

    def write(self, name, text):
        (self.folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())

    def render(self, name, model=None):
        """The picture, and whether a kept store was used."""
        done = self.must("quarry", "render", model or self.model, "-o", self.path(name), "--size", "32x32")
        return (self.folder / name).read_bytes(), "using the store kept of it" in done.stderr

    def textures(self):
        """Of the only store that is kept."""
        return self.info(self.kept()["stores"][0]["store"])["textures"]

    def kept(self):
        return json.loads(self.must("quarry", "cache", "list", "--json").stdout)

    def test_every_file_that_the_model_names_counts(self):
        red, kept = self.render("a.png")
        self.assertFalse(kept)
        self.assertEqual(self.render("b.png"), (red, True))
        self.must_fail(2, r"m\.mtl: is an input", "quarry", "render", self.model, "-o", self.path("x.png"), "--size", "32x32", "--stats",
                       self.path("m.mtl"), "--force")
        self.write("m.mtl", "newmtl a\nKd 0 1 0\n")  # the same length
        os.utime(self.path("m.mtl"), ns=(1, 1))
        green, kept = self.render("c.png")
        self.assertFalse(kept)
        self.assertNotEqual(green, red)
        self.write("m.mtl", "newmtl a\nKd 0 1 0\nmap_Kd t.ppm\n")  # an image that is not there
        missing, _ = self.render("d.png")
        self.assertEqual(self.render("e.png"), (missing, True))
        self.write("t.ppm", b"P6 1 1 255\n\0\0\xff")  # and comes to be there
        self.assertFalse(self.render("f.png")[1])
        self.assertEqual(len(self.textures()), 1)
        self.write("t.ppm", b"P6 1 1 255\n\xff\xff\xff")
        os.utime(self.path("t.ppm"), ns=(1, 1))
        self.assertFalse(self.render("g.png")[1])
        self.assertTrue(self.render("h.png")[1])
        os.remove(self.path("m.mtl"))
        self.assertFalse(self.render("i.png")[1])
        self.assertEqual(self.textures(), [])
        self.assertEqual(len(self.kept()["stores"]), 1)  # a model has one

    def test_buffers_of_gltf_count(self):
        model = {"asset": {"version": "2.0"}, "buffers": [{"uri": "b.bin", "byteLength": 36}],
                 "bufferViews": [{"buffer": 0, "byteLength": 36}],
                 "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
                 "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
        self.write("g.gltf", json.dumps(model))
        self.write("b.bin", struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0))
        before, _ = self.render("a.png", self.path("g.gltf"))
        self.assertEqual(self.render("b.png", self.path("g.gltf")), (before, True))
        self.write("b.bin", struct.pack("<9f", 0, 0, 0, 1, 0, 0, 1, 1, 0))
        os.utime(self.path("b.bin"), ns=(1, 1))
        after, kept = self.render("c.png", self.path("g.gltf"))
        self.assertFalse(kept)
        self.assertNotEqual(after, before)

    def test_an_empty_variable_counts_as_unset(self):
        home = self.folder / "home"
        environment = {k: v for k, v in os.environ.items() if k not in ("QUARRY_CACHE_DIR", "XDG_CACHE_HOME")}
        for variables, folder in (({"XDG_CACHE_HOME": "", "QUARRY_CACHE_DIR": ""}, home / ".cache/quarry"),
                                  ({"XDG_CACHE_HOME": str(self.folder / "xdg")}, self.folder / "xdg/quarry")):
            done = self.run_program("quarry", "render", self.model, "-o", self.path("x.png"), "--size", "8x8",
                                    env={**environment, "HOME": str(home), **variables})
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertTrue(list(folder.glob("m-*.quarry")), folder)

    def test_list_limit_and_clear(self):
        self.assertEqual(self.kept()["stores"], [])
        self.render("a.png")
        self.write("n.obj", OBJ)
        self.render("b.png", self.path("n.obj"))
        kept = self.kept()
        self.assertEqual([store["model"] for store in kept["stores"]], [self.model, self.path("n.obj")])
        self.assertIn("n.obj", self.must("quarry", "cache", "list").stdout)
        self.must("quarry", "cache", "limit", kept["bytes"] * 3 // 4)
        self.assertEqual([store["model"] for store in self.kept()["stores"]], [self.path("n.obj")])
        self.render("c.png")  # beyond the limit with it: the other one goes
        self.assertEqual([store["model"] for store in self.kept()["stores"]], [self.model])
        self.must("quarry", "cache", "limit", "none")
        self.must("quarry", "cache", "clear")
        self.assertEqual(self.kept()["stores"], [])
        self.must_fail(2, "is not a size", "quarry", "cache", "limit", "lots")
        (self.folder / "cache/limit").write_text("")  # cut off by a full disk, say
        self.must_fail(1, "limit: holds no size; quarry cache limit SIZE", "quarry", "cache", "list")
        self.must("quarry", "cache", "limit", "1G")
        self.must("quarry", "cache", "list")

    def test_an_interrupted_store_is_continued(self):
        model = self.path("plant.ply")
        self.must("quarry-scene", "plant", "--triangles", 1000000, "-o", model, "--quiet")
        reference = self.path("reference.png")
        self.must("quarry-preprocess", model, "-o", self.path("r.quarry"), "--quiet")
        self.must("quarry", "render", self.path("r.quarry"), "-o", reference, "--size", "64x48", "--quiet")
        went_on = False
        for delay_s in (0.8, 1.2, 1.6, 2.4):
            self.must("quarry", "cache", "clear")
            render = [str(BIN / "quarry"), "render", model, "-o", self.path("x.png"), "--size", "64x48"]
            process = subprocess.Popen(render, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True)
            self.addCleanup(end, process)
            time.sleep(delay_s)
            os.killpg(process.pid, signal.SIGINT)
            _, errors = process.communicate(timeout=TIMEOUT_S)
            if process.returncode == 0:
                break
            self.assertNotIn("--resume", errors)
            deadline = time.monotonic() + 10
            while list((self.folder / "cache").glob("*.lock")) and time.monotonic() < deadline:
                time.sleep(0.02)  # the preprocessor tidies up behind the command
            left = list((self.folder / "cache").glob("*.work"))
            done = self.must(*["quarry", *render[1:]])
            self.assertEqual((self.folder / "x.png").read_bytes(), pathlib.Path(reference).read_bytes())
            self.assertEqual(bool(left), "continuing" in done.stderr, done.stderr)
            self.assertEqual(list((self.folder / "cache").glob("*.work")), [])
            if left:
                self.assertIn("the same command continues", errors)
                went_on = True
                break
        if not went_on:
            self.skipTest("on this machine the model is done before its first checkpoint")

    def test_two_commands_at_once_make_one_store(self):
        self.must("quarry-scene", "plant", "--triangles", 300000, "-o", self.path("plant.ply"), "--quiet")
        done = [None, None]

        def render(n):
            done[n] = self.run_program("quarry", "render", self.path("plant.ply"), "-o", self.path(f"{n}.png"), "--size", "32x32")

        threads = [threading.Thread(target=render, args=(n,)) for n in (0, 1)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual([d.returncode for d in done], [0, 0], [d.stderr for d in done])
        self.assertEqual(sum("using the store kept of it" in d.stderr for d in done), 1, [d.stderr for d in done])
        self.assertEqual((self.folder / "0.png").read_bytes(), (self.folder / "1.png").read_bytes())

    def test_a_damaged_store_heals(self):
        right, _ = self.render("a.png")
        store = pathlib.Path(self.kept()["stores"][0]["store"])
        whole = store.read_bytes()
        for at in (0, 40, len(whole) // 2, len(whole) - 8):
            with self.subTest(byte=at):
                times = store.stat()
                store.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1:])
                os.utime(store, ns=(times.st_atime_ns, times.st_mtime_ns))  # as by a disk: no time tells of it
                done = self.must("quarry", "render", self.model, "-o", self.path("b.png"), "--size", "32x32")
                self.assertEqual((self.folder / "b.png").read_bytes(), right)
                self.assertEqual(store.read_bytes(), whole, done.stderr)
        store.write_bytes(whole[:-100])
        self.assertEqual(self.render("c.png")[0], right)
        self.assertEqual(store.read_bytes(), whole)

    def test_other_bytes_of_the_same_size_and_time(self):
        before, _ = self.render("a.png")
        times = os.stat(self.model)
        self.write("m.obj", OBJ.replace("v 0 1 0", "v 0 2 0"))
        os.utime(self.model, ns=(times.st_atime_ns, times.st_mtime_ns))
        after, kept = self.render("b.png")
        self.assertFalse(kept)
        self.assertNotEqual(after, before)

    def test_the_folder_is_the_user_s_own(self):
        cache = self.folder / "cache"
        self.render("a.png")
        self.assertEqual(cache.stat().st_mode & 0o777, 0o700)
        cache.chmod(0o777)
        self.must_fail(1, r"cache: other users may write there; chmod go-w it, or name another by QUARRY_CACHE_DIR", "quarry", "render",
                       self.model, "-o", self.path("b.png"))
        cache.chmod(0o755)
        self.render("c.png")
        if os.geteuid() == 0:
            os.chown(cache, 54321, -1)
            self.must_fail(1, "cache: belongs to another user", "quarry", "render", self.model, "-o", self.path("d.png"))

    def test_a_link_in_a_store_s_place_is_not_written_through(self):
        self.render("a.png")
        store = pathlib.Path(self.kept()["stores"][0]["store"])
        victim = self.folder / "victim"
        for place in (store, pathlib.Path(str(store) + ".json")):
            victim.write_text("mine")
            place.unlink()
            place.symlink_to(victim)
            self.assertFalse(self.render("b.png")[1])
            self.assertEqual(victim.read_text(), "mine")
            self.assertFalse(place.is_symlink())

    def test_a_copy_has_the_model_s_permissions(self):
        os.chmod(self.model, 0o640)
        self.render("a.png")
        store = self.kept()["stores"][0]["store"]
        self.assertEqual(os.stat(store).st_mode & 0o777, 0o640)

    def test_only_kept_stores_are_removed(self):
        self.render("a.png")
        own = self.folder / "cache/my.quarry"
        self.must("quarry-preprocess", self.model, "-o", own, "--stats", str(own) + ".json", "--quiet")
        named = self.folder / "cache/plant-0123456789abcdef.quarry"
        named.write_bytes(own.read_bytes())
        self.assertEqual(len(self.kept()["stores"]), 1)
        self.must("quarry", "cache", "limit", "1K")
        self.must("quarry", "cache", "clear")
        self.assertTrue(own.exists() and named.exists() and pathlib.Path(str(own) + ".json").exists())
        self.assertEqual(self.kept()["stores"], [])

    def test_without_a_home(self):
        environment = {k: v for k, v in os.environ.items() if k not in ("QUARRY_CACHE_DIR", "XDG_CACHE_HOME", "HOME")}
        render = ["quarry", "render", self.model, "-o", self.path("x.png"), "--size", "8x8"]
        own = pathlib.Path(f"/tmp/quarry-cache-{os.geteuid()}")
        was_there = own.exists()
        done = self.run_program(*render, env=environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(own.stat().st_mode & 0o777, 0o700)
        if not was_there:
            shutil.rmtree(own)
        for home in ("/proc", "/nonexistent/there" if os.geteuid() else "/proc/1"):
            done = self.run_program(*render, env={**environment, "HOME": home})
            self.assertEqual(done.returncode, 1)
            self.assertRegex(done.stderr, r"stores of models cannot be kept there: .*; name another by QUARRY_CACHE_DIR\n$")

    def test_import_options_pass_through_and_are_part_of_the_key(self):
        plain, _ = self.render("a.png")
        scaled = ["quarry", "render", self.model, "-o", self.path("b.png"), "--size", "32x32", "--scale", "0.001"]
        self.must(*scaled)
        self.assertEqual(len(self.kept()["stores"]), 2)
        self.assertIn("using the store kept of it", self.must(*scaled).stderr)
        self.assertTrue(self.render("a.png")[1])
        lengths = sorted(self.info(s["store"])["bounds_upper"][0] for s in self.kept()["stores"])
        self.assertAlmostEqual(lengths[0] * 1000, lengths[1], 5)
        self.must("quarry", "render", self.model, "-o", self.path("c.png"), "--size", "8x8", "--crease", 0, "--memory", "128M", "--no-textures",
                  "--voxel-size", "8K")
        self.must_fail(2, "--memory must be at least 64M", "quarry", "render", self.model, "-o", self.path("c.png"), "--memory", "1M")
        store = self.kept()["stores"][0]["store"]
        for option in (["--scale", 2], ["--crease", 1], ["--no-textures"], ["--memory", "1G"]):
            for command in (["render", store, "-o", self.path("d.png")], ["view", store]):
                self.must_fail(2, f"{option[0]} is for models that are preprocessed, and .* is a store; leave it out", "quarry", *command, *option)

    def test_a_command_continues_after_its_group_was_killed(self):
        model = self.path("plant.ply")
        self.must("quarry-scene", "plant", "--triangles", 400000, "-o", model, "--quiet")
        command = [str(BIN / "quarry"), "render", model, "-o", self.path("x.png"), "--size", "16x16", "--quiet"]
        for delay_s in (0.3, 0.5, 0.7, 0.9, 1.1):
            self.must("quarry", "cache", "clear")
            render = subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True)
            self.addCleanup(end, render)
            time.sleep(delay_s)
            os.killpg(render.pid, signal.SIGKILL)
            done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            render.wait()


class Options(Case):
    def setUp(self):
        super().setUp()
        (self.folder / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        (self.folder / "path.json").write_text('{"frames": [{"eye": [3, 3, 3], "at": [0, 0, 0]}]}')
        (self.folder / "lights.json").write_text('{"lights": []}')
        self.render = ["quarry", "render", self.path("m.obj"), "-o", self.path("x.png")]
        self.preprocess = ["quarry-preprocess", self.path("m.obj")]

    def test_options_without_effect_are_refused(self):
        walk = [*self.render, "--camera-path", self.path("path.json")]
        for command, option in (
                (walk, ["--eye", "1,2,3"]), (walk, ["--at", "1,2,3"]), (walk, ["--up", "0,0,1"]), (walk, ["--fov", 30]),
                (walk, ["--ortho", 3]), (self.render, ["--fov", 30, "--ortho", 3]), (self.render, ["--sun", "0,0,1"]),
                (self.render, ["--lights", self.path("lights.json")]), ([*self.render, "--mode", "voxels"], ["--sun", "0,0,1"]),
                (self.render, ["--bounces", 3]), ([*self.render, "--mode", "whitted"], ["--bounces", 3]), ([*self.render, "--mode", "shadow"], ["--sky", 3]),
                ([*self.render[:4], self.path("x.exr")], ["--exposure", 1]), ([*self.render[:4], self.path("x.exr")], ["--tonemap", "film"]), (self.render, ["--frames", 0]),
                *(([*self.render, "--master", "127.0.0.1:1"], [o, v]) for o, v in (("--workers", 2), ("--threads", 2), ("--cache", "1M"))),
                ([*self.preprocess, "--plan"], ["--resume"]),
                *((["quarry-master", self.path("m.obj"), "--serve-only"], [o, v]) for o, v in
                  (("--schedule", "random"), ("--foresight", 0), ("--frame-memory", "1G"), ("--spool", "s"), ("--trace", "t"))),
                (["quarry-worker", "--master", "127.0.0.1:1"], ["--http-header-host", "h"])):
            with self.subTest(option=option):
                self.must_fail(2, option[0] + r"\b.* (has no effect|needs)", *command, *option)
        # The environment is there for many commands.
        self.assertEqual(self.run_program(*self.render, "--size", "8x8", env={**os.environ, "QUARRY_CACHE": "64M"}).returncode, 0)

    def test_light_that_cannot_be(self):
        path, view = [*self.render, "--mode", "path"], self.path("view.json")
        for sentence, *options in (("--bounces: .*65", "--bounces", 65), ("--sky: .*11", "--sky", 11), ("--sky: .*1.5", "--sky", 1.5),
                                   ("--sky.*5 degrees", "--sky", 3, "--sun", "1,0,0.05", "--up-axis", "z"),
                                   ("needs a sun", "--sky", 3, "--lights", self.path("lights.json")), ("clip or film.*'hard'", "--tonemap", "hard")):
            self.must_fail(2, sentence, *path, *options)
        sun = {"type": "sun", "direction": [0, 0, 1], "radiance": [1, 1, 1]}
        rectangle = {"type": "rectangle", "position": [0, 0, 3], "edges": [[1, 0, 0], [0, 1, 0]], "radiance": [1, 1, 1]}
        for sentence, member in ((r"bounces", {"bounces": 65}), (r"sky\.turbidity", {"sky": {"turbidity": 12}}), ("tonemap.*clip or film", {"tonemap": "hard"}), ("sky.*color", {"sky": {"color": [1, 1, 1]}}),
                                 ("no area", {"lights": [{**rectangle, "edges": [[1, 0, 0], [2, 0, 0]]}]}), ("two sides", {"lights": [{**rectangle, "edges": [[1, 0, 0]]}]}),
                                 ("edges", {"lights": [{k: v for k, v in rectangle.items() if k != "edges"}]}), ("invalid", {"lights": [{**sun, "angle": 91}]}),
                                 ("sun, point or rectangle", {"lights": [{**sun, "type": "disc"}]}), ("radiance", {"lights": [{**sun, "radiance": [1, 1, None]}]})):
            pathlib.Path(view).write_text(json.dumps({"mode": "path", **member}))
            with self.subTest(sentence=sentence):
                failed = self.run_program(*self.render, "--view", view, "--quiet")
                self.assertIn(failed.returncode, (1, 2), failed.stderr)
                self.assertRegex(failed.stderr, sentence)
                self.assertEqual(len(failed.stderr.strip().splitlines()), 1, failed.stderr)

    def test_mistyped_names_get_a_suggestion(self):
        for command, sentence in (
                (["quarry", "rendr"], "^quarry: 'rendr' is not a command; did you mean render"),
                ([*self.render, "--eyee", "1,2,3"], "^quarry render: --eyee is not an option; did you mean --eye"),
                ([*self.render, "--mode", "witted"], "did you mean whitted"),
                (["quarry", "cache", "lst"], "^quarry cache: 'lst' is not a command; did you mean list"),
                (["quarry", "bench", "kernel"], "^quarry bench: 'kernel' .*did you mean kernels"),
                ([*self.preprocess, "-o", "x.quarry", "--memroy", "1G"], "^quarry-preprocess: --memroy .*did you mean --memory"),
                (["quarry-worker", "--mastr", "h:1"], "^quarry-worker: --mastr .*did you mean --master"),
                (["quarry-master", "x", "--listn", "h:1"], "^quarry-master: --listn .*did you mean --listen"),
                (["quarry-scene", "plnt"], "^quarry-scene: 'plnt' .*did you mean plant"),
                ([*self.render, "--zzzzzzzz"], "^quarry render: --zzzzzzzz is not an option; see quarry render --help"),
                ([*self.render, "again"], "^quarry render: 'again' is one argument too many"),
                (["quarry", "render", "x.obj"], "--output is required; see quarry render --help"),
                (["quarry"], "subcommand is required"), (self.preprocess, "-o must name the store to write, e.g. -o m.quarry")):
            with self.subTest(command=command[0], sentence=sentence):
                done = self.must_fail(2, sentence, *command)
                self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)

    def test_sizes(self):
        for size in ("512MB", "512mb", "70000k", "0.1g", "0.001T", "128MiB", str(64 << 20)):
            self.must(*self.preprocess, "--plan", "--memory", size, "--quiet")
        for size in ("512X", "M", "1MM", "1iB", "-1M"):
            self.must_fail(2, "--memory is not a size", *self.preprocess, "--plan", f"--memory={size}")

    def test_plan_needs_no_output(self):
        self.assertIn("1 triangles", self.must(*self.preprocess, "--plan").stdout)
        self.must(*self.preprocess, "--plan", "--quiet", "--stats", self.path("p.json"))
        self.assertEqual(json.loads((self.folder / "p.json").read_text())["input_triangles"], 1)

    def test_help_and_version(self):
        for program in ("quarry", "quarry-preprocess", "quarry-master", "quarry-worker", "quarry-scene"):
            self.assertRegex(self.must(program, "--version").stdout, rf"^{program} \d")
        for command in (["quarry"], ["quarry", "render"], ["quarry", "cache"], ["quarry", "bench"], ["quarry-preprocess"],
                        ["quarry-master"], ["quarry-worker"], ["quarry-scene"]):
            self.assertIn("Example", self.must(*command, "--help").stdout, command)

    def test_the_manual_names_every_option_and_variable(self):
        manual = (pathlib.Path(__file__).parents[3] / "deploy/MANUAL.md").read_text()
        # Options of several commands stand in sections of their own, to which the commands' sections link.
        shared = {"-".join(title.lower().split()): text for title, text in re.findall(r"^## (Options for .*)\n((?:(?!## ).*\n?)*)", manual, re.M)}
        self.assertEqual(len(shared), 3)
        for command in (["quarry", "render"], ["quarry", "view"], ["quarry-preprocess"], ["quarry-master"], ["quarry-worker"]):
            section = manual.split(f"\n## `{' '.join(command)}`")[1].split("\n## ")[0]
            section += "".join(shared[anchor] for anchor in re.findall(r"\(#(options-for-[\w-]+)\)", section))
            text = self.must(*command, "--help").stdout
            options = set(re.findall(r"^  (?:-\w,)?(--[\w-]+)", text, re.M)) - {"--help", "--version"}
            self.assertGreaterEqual(len(options), 10)
            with self.subTest(command=command):
                named = re.findall(r"^\| `(?:-\w, )?(--[\w-]+)`", section, re.M)
                self.assertEqual(sorted(named), sorted(options))
                variables = set(re.findall(r"Env:\s*(QUARRY_\w+)", text))
                self.assertEqual({name for name in variables if f"`{name}`" not in section}, set())

    def test_threads_follow_the_affinity(self):
        one = min(os.sched_getaffinity(0))
        done = subprocess.run([str(BIN / "quarry-preprocess"), "--help"], capture_output=True, text=True, timeout=TIMEOUT_S,
                              preexec_fn=lambda: os.sched_setaffinity(0, {one}))
        self.assertRegex(done.stdout, r"--threads UINT=1 ")

    def test_threads_follow_the_cgroup(self):
        group = pathlib.Path("/sys/fs/cgroup/cpu") / f"quarry-test-{os.getpid()}"
        try:
            group.mkdir()
        except OSError as error:
            self.skipTest(f"no cgroup of version 1 can be made here: {error}")
        self.addCleanup(group.rmdir)
        (group / "cpu.cfs_quota_us").write_text("50000")
        done = subprocess.run([str(BIN / "quarry-preprocess"), "--help"], capture_output=True, text=True, timeout=TIMEOUT_S,
                              preexec_fn=lambda: (group / "cgroup.procs").write_text(str(os.getpid())))
        self.assertRegex(done.stdout, r"--threads UINT=1 ")


class Sentences(Case):
    """Each sentence names the next step for the user."""

    def test_wrong_files(self):
        (self.folder / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        self.must("quarry", "render", self.path("m.obj"), "-o", self.path("p.png"), "--size", "8x8")
        self.must("quarry-preprocess", self.path("m.obj"), "-o", self.path("s.quarry"), "--quiet")
        for command in (["quarry", "info"], ["quarry", "verify"], ["quarry-master"]):
            self.must_fail(1, r"m\.obj: not a Quarry scene store; quarry-preprocess makes one", *command, self.path("m.obj"))
        self.must_fail(1, r"p\.png: .*(picture|image)", "quarry-preprocess", self.path("p.png"), "-o", self.path("x.quarry"))
        self.must_fail(1, r"s\.quarry: .*store", "quarry-preprocess", self.path("s.quarry"), "-o", self.path("x.quarry"))
        self.must_fail(1, r"nosuch\.json: .*looked for in", "quarry", "render", self.path("s.quarry"), "-o", self.path("x.png"),
                       "--camera-path", "nosuch.json")
        self.must_fail(2, "write 1000000", "quarry-scene", "plant", "--triangles", "1M", "-o", self.path("x.ply"))
        self.must_fail(2, "--lamps must be at most 500", "quarry-scene", "plant", "--triangles", 2000, "--lamps", 501,
                       "-o", self.path("x.ply"))
        self.must_fail(2, "--lamps", "quarry-scene", "city", "--triangles", 1000, "--lamps", 2, "-o", self.path("x.ply"))
        self.must("quarry-scene", "plant", "--triangles", 2000, "--lamps", 500, "-o", self.path("lamps.ply"), "--quiet")
        self.assertIn(b"element face 2000\n", pathlib.Path(self.path("lamps.ply")).read_bytes())

    def test_a_file_that_is_no_model_is_named_once(self):
        (self.folder / "x.zip").write_bytes(b"PK\3\4" + bytes(40))
        done = self.must_fail(1, r"^quarry-preprocess: \S*x\.zip: is a zip archive; unpack it", "quarry", "render", self.path("x.zip"), "-o",
                              self.path("x.png"), "--quiet")
        self.assertEqual(len(done.stderr.splitlines()), 1)

    def test_the_frame_of_an_error_is_named(self):
        (self.folder / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        camera = {"eye": [3, 3, 3], "at": [0, 0, 0]}
        for bad, sentence in (({"eye": [0, 0, 0], "at": [0, 0, 0]}, "frame 2: .*the same"), ({"eye": [0, 0, 9], "at": [0, 0, 0]}, "frame 2: .*up"),
                              ({"eye": "x", "at": [0, 0, 0]}, r"frames\[2\]\.eye")):
            (self.folder / "path.json").write_text(json.dumps({"frames": [camera, camera, bad]}))
            self.must_fail(2 if "frame 2" in sentence else 1, sentence, "quarry", "render", self.path("m.obj"), "-o", self.path("x.png"),
                           "--camera-path", self.path("path.json"), "--quiet")

    def test_a_port_in_use(self):
        store = self.store("cornell", 1000)
        _, address = self.start_master(store)
        self.must_fail(1, f"cannot listen at {address}: the address is in use by another program; give another port", "quarry-master", store, "--listen", address)

    def test_a_worker_s_bad_source(self):
        store = self.store("cornell", 1000)
        _, address = self.start_master(store)
        self.must_fail(1, r"--source file:nosuch\.quarry: nosuch\.quarry: cannot open", "quarry-worker", "--master", address, "--source",
                       "file:nosuch.quarry")


class Progress(Case):
    def on_terminal(self, columns, *command):
        """A program's output to a terminal of that width."""
        master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        process = subprocess.Popen(list(map(str, command)), stdin=slave, stdout=slave, stderr=slave, close_fds=True)
        os.close(slave)
        written = b""
        while True:
            try:
                piece = os.read(master, 65536)
            except OSError:
                break
            if not piece:
                break
            written += piece
        os.close(master)
        self.assertEqual(process.wait(timeout=TIMEOUT_S), 0, written)
        return written.decode()

    def test_one_line_on_terminals_of_any_width(self):
        model = self.path("a-plant-with-a-name-that-is-long.ply")
        self.must("quarry-scene", "plant", "--triangles", 2000000, "-o", model, "--quiet")
        for columns in (20, 40, 80):
            text = self.on_terminal(columns, BIN / "quarry-preprocess", model, "-o", self.path("x.quarry"))
            rewritten = [line for line in re.split(r"[\r\n]", text) if "\033[K" in line]
            self.assertTrue(rewritten)
            for line in rewritten:
                self.assertLess(len(line.replace("\033[K", "")), columns, line)

    def test_reading_is_shown_in_bytes(self):
        model = self.path("plant.ply")
        self.must("quarry-scene", "plant", "--triangles", 2000000, "-o", model, "--quiet")
        done = self.must("quarry-preprocess", model, "-o", self.path("x.quarry"))
        self.assertRegex(done.stderr, r"reading \S*plant\.ply: \d+ %")
        self.assertRegex(done.stderr, r"plant\.ply: \d+ triangles in")
        self.assertEqual(self.must("quarry-preprocess", model, "-o", self.path("x.quarry"), "--quiet").stderr, "")


class Logs(Case):
    def test_statistics_state_the_job(self):
        store = self.store("cornell", 2000)
        self.must("quarry", "render", store, "-o", self.path("x.png"), "--size", "40x30", "--spp", 4, "--mode", "whitted", "--stats",
                  self.path("s.json"), "--quiet")
        stats = json.loads((self.folder / "s.json").read_text())
        self.assertEqual((stats["scene"], stats["mode"], stats["width"], stats["height"], stats["spp"]), (store, "whitted", 40, 30, 4))
        self.assertIn("--spp 4", stats["command"])
        self.assertTrue(stats["version"] and stats["host"])
        self.assertEqual(stats["rays"], sum(frame["rays"] for frame in stats["frames"]))
        self.assertGreater(stats["rays"], 40 * 30 * 4)
        self.assertAlmostEqual(stats["rays_per_s"], stats["rays"] / stats["render_wall_s"], delta=1)

    def test_log_lines_name_each_worker(self):
        store = self.store("cornell", 2000)
        master = subprocess.Popen([str(BIN / "quarry-master"), store, "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, master)
        address = master.stdout.readline().split()[1]
        worker = self.start_worker(address)
        self.must("quarry", "render", store, "-o", self.path("x.png"), "--size", "40x30", "--master", address, "--quiet")
        time.sleep(0.3)
        for process in (worker, master):
            process.terminate()
        worker_said = worker.communicate(timeout=TIMEOUT_S)[1]
        said = master.communicate(timeout=TIMEOUT_S)[1]
        name = f"{os.uname().nodename}-{worker.pid}"
        self.assertRegex(worker_said, rf"{name}: has joined the master at {address}\n.*{name}: is given work")
        self.assertIn(f"worker {name} has joined", said)
        self.assertRegex(said, r"job \w+ from 127\.0\.0\.1:\d+: 1 frame of 40x30, ao, 4 samples a pixel, png")
        self.assertRegex(said, r"job \w+ is done")
        self.assertRegex(said, r"client 127\.0\.0\.1:\d+ has ended")
        self.assertNotRegex(said, r"\d closed the connection")


if __name__ == "__main__":
    main()

"""libquarry as other programs use it: the Python package, `quarry rays`, C by pkg-config, and what the library must leave alone in its process."""
import http.server
import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.exr import read_exr
from tests.integration.programs import BIN, PATIENCE, Case, main

ROOT = pathlib.Path(__file__).parents[3]
API = ROOT / "common/api"
LIBRARY = BIN.parent / "lib/libquarry.so.0"
SCENES = ROOT / "../shared/scenes"
os.environ.update(QUARRY_LIBRARY=str(LIBRARY), QUARRY_COMMAND=str(BIN / "quarry"))
sys.path.insert(0, str(API / "python"))

try:
    import numpy
except ImportError:  # the package is Debian's own Python's
    if sys.executable != "/usr/bin/python3":
        os.execv("/usr/bin/python3", ["/usr/bin/python3", *sys.argv])
    print("skipped: numpy is not there (python3-numpy)")
    sys.exit(77)
import quarry

FIELDS = ("t_hit", "geometry_ids", "primitive_ids", "primitive_uvs", "primitive_normals", "material_ids")


def net(side, seed=1, offset=(0, 0, 0)):
    """A bumpy net of triangles: vertices, triangles."""
    x, y = numpy.meshgrid(numpy.arange(side + 1.0), numpy.arange(side + 1.0))
    vertices = numpy.stack([x, y, numpy.random.default_rng(seed).random(x.shape)], axis=-1).reshape(-1, 3) + offset
    corner = (numpy.arange(side)[:, None] * (side + 1) + numpy.arange(side)).ravel()
    return vertices, numpy.concatenate([numpy.stack([corner, corner + 1, corner + side + 1], axis=1),
                                        numpy.stack([corner + 1, corner + side + 2, corner + side + 1], axis=1)])


def rays_down(count, side, height=10.0, seed=2, offset=(0, 0, 0)):
    places = numpy.random.default_rng(seed).random((count, 2)) * side
    return numpy.concatenate([numpy.column_stack([places, numpy.full(count, height)]) + offset, numpy.tile([0.0, 0.0, -2.0], (count, 1))], axis=1)


class Python(Case):
    def setUp(self):
        super().setUp()
        self.vertices, self.triangles = net(40, offset=(654321.5, 4_000_000.25, 7.5))
        self.rays = rays_down(3000, 40, 20, offset=(654321.5, 4_000_000.25, 0))
        self.scene = quarry.Scene.from_triangles(self.vertices, self.triangles)
        self.addCleanup(self.scene.close)

    def test_hits_lie_on_the_triangles_that_they_name(self):
        hits = self.scene.cast_rays(self.rays)
        self.assertEqual(set(hits), set(FIELDS))
        self.assertTrue(numpy.isfinite(hits["t_hit"]).all())
        corners = self.vertices[self.triangles[hits["primitive_ids"]]]
        u, v = hits["primitive_uvs"].astype(float).T
        on_triangle = (1 - u - v)[:, None] * corners[:, 0] + u[:, None] * corners[:, 1] + v[:, None] * corners[:, 2]
        on_ray = self.rays[:, :3] + hits["t_hit"][:, None] * self.rays[:, 3:]
        self.assertLess(numpy.abs(on_triangle - on_ray).max(), 1e-4)
        normals = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= numpy.linalg.norm(normals, axis=1)[:, None]
        self.assertGreater((normals * hits["primitive_normals"]).sum(axis=1).min(), 0.999)

    def test_asks_agree(self):
        rays = numpy.concatenate([self.rays, self.rays + [1000, 0, 0, 0, 0, 0]])
        nearest, occluded, counts = self.scene.cast_rays(rays), self.scene.test_occlusions(rays), self.scene.count_intersections(rays)
        hit = numpy.isfinite(nearest["t_hit"])
        self.assertTrue((occluded == hit).all() and ((counts > 0) == hit).all())
        self.assertFalse(hit[3000:].any())
        self.assertTrue((nearest["primitive_ids"][3000:] == quarry.INVALID_ID).all())
        every = self.scene.list_intersections(rays)
        self.assertTrue((numpy.diff(every["ray_splits"]) == counts).all())
        self.assertTrue((every["ray_ids"] == numpy.repeat(numpy.arange(len(rays)), counts)).all())
        first = every["ray_splits"][:-1][hit]
        for field in FIELDS:
            self.assertTrue((every[field][first] == nearest[field][hit]).all(), field)
        t = nearest["t_hit"][:3000]
        self.assertFalse(self.scene.test_occlusions(self.rays, tfar=t.min() * 0.999).any())
        self.assertFalse(self.scene.test_occlusions(self.rays, tnear=t.max() * 1.001).any())
        self.assertTrue(self.scene.test_occlusions(self.rays, tnear=t * 0.99, tfar=t * 1.01).all())

    def test_shapes_and_types(self):
        shaped = self.rays.reshape(3, 10, 100, 6)
        for dtype in (numpy.float32, numpy.float64):
            hits = self.scene.cast_rays(shaped.astype(dtype))
            self.assertEqual((hits["t_hit"].dtype, hits["t_hit"].shape, hits["primitive_normals"].shape), (dtype, (3, 10, 100), (3, 10, 100, 3)))
            self.assertEqual(self.scene.test_occlusions(shaped.astype(dtype)).shape, (3, 10, 100))
            self.assertEqual(self.scene.count_intersections(shaped.astype(dtype)).dtype, numpy.int32)
        turned = numpy.asfortranarray(self.rays)[::2]
        self.assertTrue((self.scene.cast_rays(turned)["t_hit"] == self.scene.cast_rays(self.rays)["t_hit"][::2]).all())
        self.assertEqual(self.scene.cast_rays(self.rays[0])["t_hit"].shape, ())
        self.assertEqual(self.scene.list_intersections(self.rays[:0])["ray_splits"].tolist(), [0])
        self.assertEqual(set(self.scene.cast_rays(self.rays, fields=("t_hit",))), {"t_hit"})

    def test_bad_arguments_are_named(self):
        bad = self.rays.copy()
        bad[2999, 3:] = 0
        nan = self.rays.copy()
        nan[17, 1] = numpy.nan
        for call, text in (
                (lambda: self.scene.cast_rays(bad), r"directions\[2999\] is 0"), (lambda: self.scene.count_intersections(nan), r"origins\[17\]"),
                (lambda: self.scene.cast_rays(self.rays[:, :5]), r"rays has shape \(3000, 5\)"),
                (lambda: self.scene.test_occlusions(self.rays.astype(int)), "rays has dtype int64"),
                (lambda: self.scene.cast_rays(self.rays, tnear=-1), r"tnear\[0\] is -1"),
                (lambda: self.scene.cast_rays(self.rays, tfar=[1, 2]), r"tfar has shape \(2,\)"),
                (lambda: self.scene.cast_rays(self.rays, glass="yes"), "glass is 'yes'"), (lambda: self.scene.cast_rays(self.rays, fields=["x"]), "fields has 'x'"),
                (lambda: quarry.Scene(self.scene._path, cache=10), "cache_bytes is 10"), (lambda: quarry.Scene(self.scene._path, cache="lots"), "cache is 'lots'"),
                (lambda: quarry.Scene.from_triangles(self.vertices, self.triangles + 1680), r"triangles\[\d+\] is"),
                (lambda: quarry.Scene.from_triangles(self.vertices[:, :2], self.triangles), "vertices has shape")):
            with self.assertRaisesRegex(quarry.ArgumentError, text):
                call()
        with self.assertRaises(quarry.SourceError):
            quarry.Scene(self.path("nothing.quarry"))
        pathlib.Path(self.path("cut.quarry")).write_bytes(pathlib.Path(self.scene._path).read_bytes()[:-100])
        with self.assertRaisesRegex(quarry.DataError, "cut.quarry"):
            quarry.Scene(self.path("cut.quarry"))

    def test_closed_scenes(self):
        with quarry.Scene(self.scene._path) as scene:
            self.assertIn("Scene(", repr(scene))
        scene.close()
        for call in (lambda: scene.cast_rays(self.rays), lambda: scene.parts[0], scene.cancel, lambda: scene.statistics):
            with self.assertRaisesRegex(quarry.ArgumentError, "closed"):
                call()

    def test_ctrl_c_ends_a_call(self):
        script = textwrap.dedent(f"""
            import numpy, quarry, sys, time
            scene = quarry.Scene({self.scene._path!r})
            rays = numpy.tile(numpy.array([[654340.0, 4000020.0, 20.0, 0.3, 0.2, -2.0]]), (3_000_000, 1))
            print("ready", flush=True)
            try:
                while True:
                    scene.list_intersections(rays)
            except KeyboardInterrupt:
                print("interrupted", scene.test_occlusions(rays[:5]).all(), flush=True)
        """)
        child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True,
                                 env={**os.environ, "PYTHONPATH": str(API / "python")})
        self.assertEqual(child.stdout.readline(), "ready\n")
        time.sleep(0.5)
        child.send_signal(signal.SIGINT)
        self.assertEqual(child.stdout.readline(), "interrupted True\n")
        self.assertEqual(child.wait(), 0)
        child.stdout.close()

    def test_a_second_ctrl_c_leaves_the_arrays_alone(self):
        """The library may still write when the second one comes: the process ends by the interrupt, and by no fault."""
        script = textwrap.dedent(f"""
            import numpy, quarry
            scene = quarry.Scene({self.scene._path!r})
            rays = numpy.tile(numpy.array([[654340.0, 4000020.0, 20.0, 0.3, 0.2, -2.0]]), (1_000_000, 1))
            print("ready", flush=True)
            while True:
                scene.list_intersections(rays)
        """)
        for pause in (0, 0.002, 0.01, 0.02):
            child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                                     env={**os.environ, "PYTHONPATH": str(API / "python")})
            self.assertEqual(child.stdout.readline(), "ready\n")
            time.sleep(0.3)
            child.send_signal(signal.SIGINT)
            time.sleep(pause)
            child.send_signal(signal.SIGINT)
            self.assertEqual(child.wait(), -signal.SIGINT)
            child.stdout.close()

    def test_a_mesh_and_the_command_make_the_same_store(self):
        ply = self.path("net.ply")
        from quarry import _stores
        with open(ply, "wb") as out:
            _stores._write_ply(out, *_stores._checked(self.vertices, self.triangles))
        with quarry.Scene(ply) as scene:
            self.assertNotEqual(scene._path, ply)
            ours, theirs = self.scene.cast_rays(self.rays), scene.cast_rays(self.rays)
            for field in FIELDS:
                self.assertTrue((ours[field] == theirs[field]).all(), field)
        again = quarry.Scene.from_triangles(self.vertices, self.triangles)
        self.assertEqual(again._path, self.scene._path)
        self.assertEqual(sorted(pathlib.Path(again._path).parent.iterdir()), [pathlib.Path(again._path)])


class Ranges(http.server.BaseHTTPRequestHandler):
    """Serves ranges of one file; while `away`, connections end without an answer."""
    protocol_version = "HTTP/1.1"
    file, away = b"", False

    def do_GET(self):
        if Ranges.away:
            self.close_connection = True
            return
        first, last = (int(x) for x in self.headers["Range"].removeprefix("bytes=").split("-"))
        part = Ranges.file[first:last + 1]
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{first + len(part) - 1}/{len(Ranges.file)}")
        self.send_header("Content-Length", str(len(part)))
        self.end_headers()
        self.wfile.write(part)

    def log_message(self, *_):
        pass


class Remote(Case):
    def test_a_server_that_was_away_is_asked_again(self):
        store = self.store("plant", 20000, voxel_size="16K")
        Ranges.file, Ranges.away = pathlib.Path(store).read_bytes(), False
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Ranges)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        with quarry.Scene(store) as local:
            lower, upper = local.bounds
            places = numpy.random.default_rng(5).random((5000, 3)) * (upper - lower) + lower
            rays = numpy.concatenate([places, numpy.random.default_rng(6).random((5000, 3)) - 0.5], axis=1)
            expected = local.cast_rays(rays)
            largest = local._description.largest_block_bytes
        # A cache of one block, so that each call needs the server.
        with quarry.Scene(f"http://127.0.0.1:{server.server_port}/s.quarry", cache=largest) as scene:
            self.assertTrue((scene.cast_rays(rays)["t_hit"] == expected["t_hit"]).all())
            Ranges.away = True
            with self.assertRaisesRegex(quarry.SourceError, "127.0.0.1"):
                scene.cast_rays(rays)
            Ranges.away = False
            again = scene.cast_rays(rays)
            for field in FIELDS:
                self.assertTrue((again[field] == expected[field]).all(), field)


class Pictures(Case):
    def test_pinhole_rays_are_those_of_the_picture(self):
        store = self.store("plant", 60000)
        eye, at, size = (0.0, 0.0, 0.0), (0.3, 1.0, 0.2), (321, 200)
        exr = self.path("p.exr")
        self.must("quarry", "render", store, "-o", exr, "--mode", "raycast", "--spp", "1", "--size", f"{size[0]}x{size[1]}", "--eye", "0,0,0", "--at",
                  ",".join(map(str, at)), "--up", "0,0,1", "--fov", "60", "--aov", "depth,primitive", "--quiet")
        picture = read_exr(pathlib.Path(exr))
        with quarry.Scene(store) as scene:
            rays = quarry.Scene.create_rays_pinhole(60, at, eye, (0, 0, 1), *size, vertical=True)
            hits = scene.cast_rays(rays)
            depth = numpy.array(picture.rows["depth.Z"], dtype=numpy.float32)
            ids = numpy.array(picture.rows["primitive.id"], dtype=numpy.uint32)
            hit = hits["primitive_ids"] != quarry.INVALID_ID
            self.assertGreater(hit.mean(), 0.2)
            self.assertTrue((ids == hits["primitive_ids"]).all())
            length = numpy.sqrt((rays[..., 3:] ** 2).sum(axis=-1))
            self.assertTrue((depth[hit] == (hits["t_hit"] * length)[hit].astype(numpy.float32)).all())
            self.assertEqual(hits["geometry_ids"].max(where=hit, initial=0) < len(scene.parts), True)
            self.assertTrue(scene.parts[int(hits["geometry_ids"][hit][0])])
            wide = quarry.Scene.create_rays_pinhole(90, at, eye, (0, 0, 1), 4, 2)
            middle = wide[:, 1:3, 3:].mean(axis=(0, 1))
            edge = 2 * wide[:, 0, 3:].mean(axis=0) - wide[:, 1, 3:].mean(axis=0)
            self.assertAlmostEqual(numpy.linalg.norm((wide[:, 0, 3:].mean(axis=0) + edge) / 2 - middle), 1.0, places=9)


class Command(Case):
    def setUp(self):
        super().setUp()
        vertices, triangles = net(30)
        self.scene = quarry.Scene.from_triangles(vertices, triangles)
        self.addCleanup(self.scene.close)
        self.rays = rays_down(5000, 30)

    def ask(self, rays, *options, status=0, raw=None):
        pathlib.Path(self.path("rays.npy")).unlink(missing_ok=True)
        if raw is None:
            numpy.save(self.path("rays.npy"), rays)
        else:
            pathlib.Path(self.path("rays.npy")).write_bytes(raw)
        with open(self.path("rays.npy"), "rb") as given:
            done = subprocess.run([BIN / "quarry", "rays", self.scene._path, *options], stdin=given, capture_output=True, timeout=120 * PATIENCE)
        self.assertEqual(done.returncode, status, done.stderr)
        return done

    def test_answers_are_those_of_the_library_in_the_rays_order(self):
        hits, out = self.scene.cast_rays(self.rays), self.path("hits.npy")
        for memory in ("1G", "1M"):
            self.ask(self.rays, "-o", out, "--memory", memory)
            found = numpy.load(out)
            for theirs, field in (("t", "t_hit"), ("triangle", "primitive_ids"), ("part", "geometry_ids"), ("uv", "primitive_uvs"),
                                  ("normal", "primitive_normals"), ("material", "material_ids")):
                self.assertTrue((found[theirs] == hits[field]).all(), theirs)
            done = self.ask(self.rays, "--any", "--memory", memory)
            pathlib.Path(out).write_bytes(done.stdout)
            self.assertEqual((numpy.load(out).dtype, numpy.load(out).all()), (numpy.bool_, True))
            self.ask(self.rays.astype(numpy.float32), "--count", "-o", out, "--memory", memory)
            self.assertTrue((numpy.load(out) == self.scene.count_intersections(self.rays.astype(numpy.float32))).all())
            self.ask(self.rays, "--all", "-o", out, "--memory", memory)
            every, found = self.scene.list_intersections(self.rays), numpy.load(out)
            self.assertTrue((found["ray"] == every["ray_ids"]).all() and (found["t"] == every["t_hit"]).all())
        ends = numpy.column_stack([self.rays, numpy.full(5000, 0.0), hits["t_hit"] * 0.9])
        self.ask(ends, "--any", "-o", out)
        self.assertFalse(numpy.load(out).any())

    def test_memory_of_windows(self):
        store = self.store("plant", 100000)
        numpy.save(self.path("many.npy"), numpy.random.default_rng(3).random((1_500_000, 6)) * [200, 200, 100, 1, 1, 1] - [100, 100, 0, 0.5, 0.5, 0.5])
        for ask in ((), ("--any",), ("--all",)):
            with open(self.path("many.npy"), "rb") as given:
                child = subprocess.Popen([BIN / "quarry", "rays", store, "-o", self.path("many.out"), "--force", "--quiet", "--cache", "16M", "--memory", "32M",
                                          "--threads", "2", *ask], stdin=given)
                peak = 0  # KiB; asked of the program itself, since wait4() counts this process's own before exec() too
                while child.poll() is None:
                    for line in pathlib.Path(f"/proc/{child.pid}/status").read_text().splitlines():
                        if line.startswith("VmHWM:") and os.readlink(f"/proc/{child.pid}/exe") == os.path.realpath(BIN / "quarry"):
                            peak = int(line.split()[1])
                    time.sleep(0.01)
            self.assertEqual(child.returncode, 0)
            self.assertGreater(peak / 1024, 16)
            self.assertLess(peak / 1024, 16 + 32 + 32 + 2 * 4 + 1, ask)

    def test_no_rays_have_no_answers(self):
        for ask in ((), ("--any",), ("--count",), ("--all",)):
            self.ask(self.rays[:0], "-o", self.path("none.npy"), "--force", *ask)
            self.assertEqual(len(numpy.load(self.path("none.npy"))), 0)

    def test_bad_input_is_named_by_its_byte_and_leaves_the_output_as_it_was(self):
        out = pathlib.Path(self.path("hits.npy"))
        numpy.save(self.path("x.npy"), self.rays)
        whole = pathlib.Path(self.path("x.npy")).read_bytes()
        nan = self.rays.copy()
        nan[4000, 4] = numpy.nan
        for raw, rays, text in ((whole[:-100], None, rb"ends at byte \d+, within row 4997 of 5000"), (whole[:50], None, b"ends at byte 50, within its header"),
                                (b"", None, b"is empty"), (b"P6 1 1", None, b"is not an .npy file"), (whole + b"x", None, b"goes on after its last row"),
                                (None, nan, b"row 4000, at byte 192128"), (None, self.rays.astype(int), b"give float32 or float64"),
                                (None, self.rays[:, :5].copy(), b"rows have 5 numbers"), (None, numpy.asfortranarray(self.rays), b"Fortran")):
            done = self.ask(rays, "-o", out, status=2, raw=raw)
            self.assertRegex(done.stderr.splitlines()[-1], text)
            self.assertFalse(out.exists())
        self.ask(self.rays, "-o", out)
        kept = out.read_bytes()
        self.ask(None, "-o", out, status=2, raw=whole[:-100])
        self.assertEqual(out.read_bytes(), kept)
        self.assertEqual([p.name for p in self.folder.glob("hits*")], ["hits.npy"])
        self.assertIn(b"--all needs -o", self.ask(self.rays, "--all", status=2).stderr)


class Examples(Case):
    def run_example(self, name, *arguments):
        done = subprocess.run([sys.executable, API / "python/examples" / name, *map(str, arguments)], capture_output=True, text=True, timeout=300 * PATIENCE,
                              env={**os.environ, "PYTHONPATH": str(API / "python")})
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_solar_hours(self):
        city, out = self.path("city.ply"), self.path("hours.ply")
        self.must("quarry-scene", "city", "--triangles", 50000, "-o", city, "--quiet")
        said = self.run_example("solar_hours.py", city, out, "--step", 60, "--day", 172)
        points, mean, most = (float(word) for word in (said.split()[0], said.split()[4], said.split()[9]))
        self.assertGreater(points, 1000)
        self.assertTrue(1 < mean < most <= 17, said)
        self.assertIn(b"property uchar red", pathlib.Path(out).read_bytes()[:400])
        winter = self.run_example("solar_hours.py", city, out, "--step", 60, "--day", 355)
        self.assertLess(float(winter.split()[4]), mean)

    def test_line_of_sight(self):
        tiles = sorted((SCENES / "terrain_srtm/hgt").glob("*.zip"))
        if not tiles:
            self.skipTest("no SRTM tiles (../shared/scenes/terrain_srtm)")
        terrain = self.path("terrain.ply")
        subprocess.run([sys.executable, SCENES / "tools/hgt2ply.py", terrain, "-step", "4", *tiles], check=True, capture_output=True)
        with quarry.Scene(terrain) as scene:
            (x0, y0, _), (x1, y1, _) = scene.bounds
        said = self.run_example("line_of_sight.py", terrain, (x0 + x1) / 2, (y0 + y1) / 2, self.path("seen.ply"), "--points", 40000, "--height", 50)
        self.assertTrue(0.2 < float(said.split()[0]) < 60, said)


    def test_the_page_s_example(self):
        page = (ROOT / "deploy/RAYS.md").read_text()
        self.store("plant", 20000)
        done = subprocess.run([sys.executable, "-c", page.split("```python\n")[1].split("```")[0] + "\nprint(len(seen), shaded.shape)"], cwd=self.folder,
                              capture_output=True, text=True, timeout=300 * PATIENCE, env={**os.environ, "PYTHONPATH": str(API / "python")})
        self.assertRegex(done.stdout, r"^[1-9]\d* \(480, 640\)$", done.stderr)


class Wheel(Case):
    def test_pip_installs_it(self):
        wheels = list((BIN.parent / "wheel").glob("*.whl"))
        if not wheels:
            self.skipTest("the build made no wheel")
        into = self.path("site")
        done = subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", into, wheels[0]], capture_output=True,
                              text=True)
        if "No module named pip" in done.stderr:
            self.skipTest("pip is not installed (python3-pip)")
        self.assertEqual(done.returncode, 0, done.stderr)
        environment = {key: value for key, value in os.environ.items() if key != "QUARRY_LIBRARY"} | {"PYTHONPATH": into}
        done = subprocess.run([sys.executable, "-c", "import quarry; print(quarry.__file__, quarry.version())"], capture_output=True, text=True, env=environment)
        self.assertIn(into, done.stdout, done.stderr)


if __name__ == "__main__":
    main()

"""Where models come from: pipes, packed files, far from the origin."""
import gzip
import json
import os
import pathlib
import struct
import subprocess
import unittest

from programs import BIN, Case

CUBE = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
FACES = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]


class Plan(Case):
    """`--plan` tells beforehand what a run then takes."""

    def plan(self, *arguments):
        self.must("quarry-preprocess", *arguments, "-o", self.path("x.quarry"), "--plan", "--quiet", "--stats", self.path("plan.json"))
        self.assertFalse(pathlib.Path(self.path("x.quarry")).exists())
        return json.loads(pathlib.Path(self.path("plan.json")).read_text())

    def test_counts_and_sizes(self):
        for scene in ("terrain", "plant", "forest", "city"):
            for ending in ("ply", "obj"):
                with self.subTest(scene=scene, ending=ending):
                    model = self.path(f"{scene}.{ending}")
                    self.must("quarry-scene", scene, "--triangles", 200000, "-o", model, "--quiet")
                    plan = self.plan(model)
                    self.must("quarry-preprocess", model, "-o", self.path("made.quarry"), "--quiet", "--stats", self.path("made.json"))
                    made = json.loads(pathlib.Path(self.path("made.json")).read_text())
                    self.assertEqual(plan["input_triangles"], made["input_triangles"])
                    self.assertLess(abs(plan["store_bytes"] / made["store_bytes"] - 1), 0.2)
                    self.assertLess(made["peak_rss_bytes"], plan["peak_rss_bytes"])
                    self.assertGreater(plan["preprocess_wall_s"], 0)
                    info = self.info(self.path("made.quarry"))
                    self.assertEqual(made["stored_triangle_references"], info["stored_triangle_references"])
                    self.assertGreater(made["top_tree_depth"], 2)
        self.must_fail(2, "standard input", "quarry-preprocess", "-", "-o", self.path("x.quarry"), "--plan", stdin=subprocess.DEVNULL)

    def test_a_model_whose_triangles_have_no_neighbours_in_the_file(self):
        count = 100000
        model = self.path("scattered.ply")
        with open(model, "wb") as out:
            out.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {3 * count}\nproperty float x\nproperty float y\n"
                      f"property float z\nelement face {count}\nproperty list uchar int vertex_indices\nend_header\n".encode())
            for k in range(3):
                out.write(b"".join(struct.pack("<3f", i % 300 + (k == 1), i // 300 + (k == 2), 0) for i in range(count)))
            out.write(b"".join(struct.pack("<B3i", 3, i, count + i, 2 * count + i) for i in range(count)))
        plan = self.plan(model)
        self.assertEqual(plan["input_triangles"], count)
        self.assertGreater(plan["store_bytes"], 0)

    def test_a_disk_too_small_is_refused_before_work(self):
        if os.geteuid() != 0:
            self.skipTest("needs root, to mount a small disk")
        small = self.path("small")
        pathlib.Path(small).mkdir()
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4M", "tmpfs", small], capture_output=True).returncode != 0:
            self.skipTest("may not mount a small disk")
        try:
            self.must("quarry-scene", "terrain", "--triangles", 100000, "-o", self.path("t.ply"), "--quiet")
            for plan in ([], ["--plan"]):
                self.must_fail(1, r"small: about .* MiB of spill are needed, but 4.00 MiB are free", "quarry-preprocess",
                               self.path("t.ply"), "-o", self.path("x.quarry"), "--tmp", small, "--quiet", *plan)
            self.must("quarry-scene", "terrain", "--triangles", 2000, "-o", self.path("t.ply"), "--quiet")
            self.must("quarry-preprocess", self.path("t.ply"), "-o", self.path("x.quarry"), "--tmp", small, "--quiet")
        finally:
            subprocess.run(["umount", small], check=True)


class Inputs(Case):
    def cubes(self, name, origin):
        """Cubes of 1/8, 1/64 and 1/512 at `origin`."""
        with open(self.path(name), "w") as out:
            for i, side in enumerate((0.125, 0.015625, 0.001953125)):
                for c in CUBE:
                    out.write("v " + " ".join(repr(o + (0.25 * i if a == 0 else 0) + side * c[a]) for a, o in enumerate(origin)) + "\n")
                for f in FACES:
                    out.write("f " + " ".join(str(8 * i + k) for k in f) + "\n")
        return self.path(name)

    def test_a_model_from_standard_input(self):
        self.must("quarry-scene", "terrain", "--triangles", 5000, "-o", self.path("t.ply"), "--quiet")
        content = pathlib.Path(self.path("t.ply")).read_bytes()
        for name, piped in (("plain", content), ("packed", gzip.compress(content))):
            with self.subTest(name):
                done = subprocess.run([str(BIN / "quarry-preprocess"), "-", "-o", self.path(name + ".quarry"), "--quiet"],
                                      input=piped, capture_output=True, timeout=60)
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertEqual(self.info(self.path(name + ".quarry"))["input_triangles"], 5000)
        done = subprocess.run([str(BIN / "quarry-preprocess"), "-", "-o", self.path("cut.quarry"), "--quiet"],
                              input=content[:-7], capture_output=True, timeout=60)
        self.assertEqual(done.returncode, 1)
        self.assertIn(b"standard input", done.stderr)
        self.assertFalse(pathlib.Path(self.path("cut.quarry")).exists())

    def test_two_renders_of_one_model_at_once(self):
        self.must("quarry-scene", "plant", "--triangles", 100000, "-o", self.path("p.ply"), "--quiet")
        both = [subprocess.Popen([str(BIN / "quarry"), "render", self.path("p.ply"), "-o", self.path(f"{i}.png"), "--size", "64x48", "--quiet"],
                                 stderr=subprocess.PIPE, text=True) for i in range(2)]
        for i, one in enumerate(both):
            _, errors = one.communicate(timeout=110)
            self.assertEqual(one.returncode, 0, errors)
        self.assertEqual(*(pathlib.Path(self.path(f"{i}.png")).read_bytes() for i in range(2)))
        self.assertEqual(len(list(pathlib.Path(self.path("cache")).iterdir())), 1)

    def test_a_packed_file_gives_the_store_of_the_plain_one(self):
        self.must("quarry-scene", "plant", "--triangles", 20000, "-o", self.path("p.obj"), "--quiet")
        self.must("quarry-preprocess", self.path("p.obj"), "-o", self.path("plain.quarry"), "--quiet")
        packed = self.path("packed") + "/p.obj.gz"
        pathlib.Path(packed).parent.mkdir()
        pathlib.Path(packed).write_bytes(gzip.compress(pathlib.Path(self.path("p.obj")).read_bytes()))
        for library in pathlib.Path(self.folder).glob("*.mtl"):
            (pathlib.Path(packed).parent / library.name).write_bytes(library.read_bytes())
        self.must("quarry-preprocess", packed, "-o", self.path("packed.quarry"), "--quiet")
        self.assertEqual(pathlib.Path(self.path("plain.quarry")).read_bytes(),
                         pathlib.Path(self.path("packed.quarry")).read_bytes())

    def test_millimetres_survive_far_from_the_origin(self):
        """A model in UTM metres gives the picture of the same model beside the origin, bit for bit."""
        far = (500736.0, 5000192.0, 0.0)
        pictures = []
        for name, origin in (("near", (0.0, 0.0, 0.0)), ("far", far)):
            store = self.path(name + ".quarry")
            self.must("quarry-preprocess", self.cubes(name + ".obj", origin), "-o", store, "--quiet")
            eye = ",".join(repr(a + b) for a, b in zip(origin, (0.25, -0.625, 0.375)))
            at = ",".join(repr(a + b) for a, b in zip(origin, (0.25, 0.0, 0.0)))
            picture = self.path(name + ".exr")
            self.must("quarry", "render", store, "-o", picture, "--eye", eye, "--at", at, "--mode", "shadow", "--size", "200x150",
                      "--aov", "depth,normal,primitive", "--quiet")
            pictures.append(pathlib.Path(picture).read_bytes())
            info = self.info(store)
            for a in range(3):
                self.assertEqual(info["bounds_lower"][a], origin[a])
        self.assertEqual(info["offset"], list(far))
        self.assertEqual(len(pictures[0]), len(pictures[1]))
        self.assertEqual(pictures[0], pictures[1])


if __name__ == "__main__":
    unittest.main(verbosity=2)

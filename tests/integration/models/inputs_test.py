"""Where models come from: pipes, packed files, far from the origin."""
import gzip
import json
import os
import pathlib
import random
import struct
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.exr import attributes_of
from tests.integration.programs import BIN, PATIENCE, TIMEOUT_S, Case, main
from tests.support.models import hard_models


CUBE = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
FACES = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]


class Plan(Case):
    """`--plan` bounds the figures of a run."""

    def plan(self, *arguments):
        self.must("quarry-preprocess", *arguments, "-o", self.path("x.quarry"), "--plan", "--quiet", "--stats", self.path("plan.json"))
        self.assertFalse(pathlib.Path(self.path("x.quarry")).exists())
        return json.loads(pathlib.Path(self.path("plan.json")).read_text())

    def test_triangles_in_each_others_way(self):
        # Just more than are split at once.
        for kind in hard_models.KINDS:
            with self.subTest(kind=kind):
                model = self.path(kind + ".ply")
                hard_models.write(model, kind, 270000)
                plan = self.plan(model)
                self.must("quarry-preprocess", model, "-o", self.path("made.quarry"), "--quiet", "--stats", self.path("made.json"))
                made = json.loads(pathlib.Path(self.path("made.json")).read_text())
                self.assertEqual(plan["input_triangles"], made["input_triangles"])
                self.assertLess(made["store_bytes"], plan["store_bytes_most"])
                self.assertLess(plan["spill_bytes"], plan["spill_bytes_most"])

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
                    self.assertLess(abs(plan["store_bytes"] / made["store_bytes"] - 1), 1)
                    self.assertLess(made["store_bytes"], plan["store_bytes_most"])
                    self.assertLessEqual(plan["spill_bytes"], plan["spill_bytes_most"])
                    self.assertLess(made["peak_rss_bytes"], plan["peak_rss_bytes"])
                    self.assertGreater(plan["preprocess_wall_s"], 0)
                    info = self.info(self.path("made.quarry"))
                    self.assertEqual(made["stored_triangle_references"], info["stored_triangle_references"])
                    self.assertGreater(made["top_tree_depth"], 2)
        with open(self.path("terrain.ply"), "rb") as model:
            told = self.must("quarry-preprocess", "-", "--plan", stdin=model).stdout
        self.assertIn(f"{self.plan(self.path('terrain.ply'))['input_triangles']} triangles", told)

    def test_empty_models_and_models_of_one_point(self):
        empty = self.path("empty.ply")
        header = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n" \
                 "property list uchar int vertex_indices\nend_header\n"
        pathlib.Path(empty).write_text(header.format(0, 0))
        for option in ([], ["--plan"]):
            self.must_fail(1, r"empty\.ply: holds no triangles", "quarry-preprocess", empty, "-o", self.path("x.quarry"), *option)
        # More than one region's, all but a few of them in one place: a window without extent.
        count = 300000
        heap = self.path("heap.ply")
        pathlib.Path(heap).write_text(header.format(5, count) + "0 0 0\n1e-3 0 0\n0 1e-3 0\n1000 1000 0\nnan 0 0\n" +
                                      "3 0 1 2\n" * (count - 2) + "3 0 1 3\n3 0 1 4\n")
        self.assertEqual(self.plan(heap)["input_triangles"], count)
        self.must("quarry-preprocess", heap, "-o", self.path("heap.quarry"), "--quiet")

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
                self.must_fail(1, r"small: about .* MiB are needed for spill, between .* and .*, and 4.00 MiB are free", "quarry-preprocess",
                               self.path("t.ply"), "-o", self.path("x.quarry"), "--tmp", small, "--quiet", *plan)
            # Room for the least that the run can take, not for the most.
            self.must("quarry-scene", "terrain", "--triangles", 58000, "-o", self.path("t.ply"), "--quiet")
            warned = self.must("quarry-preprocess", self.path("t.ply"), "-o", f"{small}/x.quarry", "--quiet", "--plan")
            self.assertRegex(warned.stderr, r"warning: \S*small: about .* are needed for spill and the store, between .*, and 4.00 MiB are free")
            self.must("quarry-scene", "terrain", "--triangles", 2000, "-o", self.path("t.ply"), "--quiet")
            self.must("quarry-preprocess", self.path("t.ply"), "-o", self.path("x.quarry"), "--tmp", small, "--quiet")
        finally:
            subprocess.run(["umount", small], check=True)


DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><up_axis>Y_UP</up_axis></asset>
<library_effects><effect id="fx"><profile_COMMON><technique sid="t"><lambert><diffuse><color>0.8 0.1 0.2 1</color></diffuse>
</lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="red" name="red"><instance_effect url="#fx"/></material></library_materials>
<library_geometries><geometry id="g" name="quad"><mesh><source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist material="m" count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4</vcount><p>0 1 2 3</p></polylist>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s">%s</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
NODE = """<node id="%s" name="%s"><translate>%s</translate><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="m" target="#red"/></technique_common></bind_material></instance_geometry></node>"""


class Foreign(Case):
    """Formats for which Quarry has no reader, by way of Assimp."""

    def expect_too_large(self):
        """More than the process may take."""
        quads = "".join(NODE % (f"n{i}", "part", f"{i} 0 0") for i in range(400000))
        (self.folder / "big.dae").write_text(DAE % quads)
        del quads
        refused = self.must_fail(1, "big.dae: needs more than --memory|big.dae: Assimp", "quarry-preprocess", self.folder / "big.dae", "-o",
                                 self.path("x.quarry"), "--memory", "64M")
        self.assertRegex(refused.stderr, r"big.dae: is read by Assimp, which loads a model whole, in up to 50 times its size of \d+ MiB; it may take 64 MiB")
        (self.folder / "big.dae").unlink()

    def test_collada(self):
        if not (BIN / "quarry-import-assimp").exists():
            self.skipTest("quarry-import-assimp was not built: Assimp is not there")
        model = self.folder / "two.dae"
        model.write_text(DAE % (NODE % ("a", "left", "5 0 0") + NODE % ("b", "right", "0 7 2")))
        self.must("quarry-preprocess", model, "-o", self.path("two.quarry"), "--quiet", "--stats", self.path("two.json"))
        # Files that the run made itself are no inputs: a kept store would never be reused.
        self.assertEqual([i["file"] for i in json.loads(pathlib.Path(self.path("two.json")).read_text())["inputs"]], [str(model)])
        pathlib.Path(self.path("two.json")).unlink()
        info = self.info(self.path("two.quarry"))
        self.assertEqual(info["input_triangles"], 4)
        self.assertEqual(info["bounds_lower"], [0, 0, 0])
        self.assertEqual(info["bounds_upper"], [6, 8, 2])
        plan = self.must("quarry-preprocess", model, "-o", self.path("x.quarry"), "--plan", "--quiet")
        self.assertEqual(plan.returncode, 0)
        for name, content in (("junk.fbx", random.Random(1).randbytes(5000)), ("a.txt", b"hello"), ("cut.dae", model.read_bytes()[:900])):
            with self.subTest(name=name):
                (self.folder / name).write_bytes(content)
                self.must_fail(1, name + ": (Assimp|is in none of the formats)", "quarry-preprocess", self.folder / name, "-o", self.path("x.quarry"), "--quiet")
        if PATIENCE == 1:  # with sanitizers nothing is limited
            self.expect_too_large()
        self.assertEqual(sorted(p.name for p in self.folder.iterdir()), ["a.txt", "cut.dae", "junk.fbx", "two.dae", "two.quarry"])


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
                                      input=piped, capture_output=True, timeout=TIMEOUT_S)
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertEqual(self.info(self.path(name + ".quarry"))["input_triangles"], 5000)
        done = subprocess.run([str(BIN / "quarry-preprocess"), "-", "-o", self.path("cut.quarry"), "--quiet"],
                              input=content[:-7], capture_output=True, timeout=TIMEOUT_S)
        self.assertEqual(done.returncode, 1)
        self.assertIn(b"standard input", done.stderr)
        self.assertFalse(pathlib.Path(self.path("cut.quarry")).exists())

    def test_two_renders_of_one_model_at_once(self):
        self.must("quarry-scene", "plant", "--triangles", 100000, "-o", self.path("p.ply"), "--quiet")
        both = [subprocess.Popen([str(BIN / "quarry"), "render", self.path("p.ply"), "-o", self.path(f"{i}.png"), "--size", "64x48", "--quiet"],
                                 stderr=subprocess.PIPE, text=True) for i in range(2)]
        for i, one in enumerate(both):
            _, errors = one.communicate(timeout=TIMEOUT_S)
            self.assertEqual(one.returncode, 0, errors)
        self.assertEqual(*(pathlib.Path(self.path(f"{i}.png")).read_bytes() for i in range(2)))
        self.assertEqual(len(list(pathlib.Path(self.path("cache")).glob("*.quarry"))), 1)

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
        self.assertEqual(self.info(self.path("packed.quarry"))["models"], ["p.obj"])
        self.assertRegex(self.must("quarry", "info", self.path("packed.quarry")).stdout, r"(?m)^  model      p\.obj$")

    @staticmethod
    def chunks_of_exr(path):
        """The bytes behind the header, which states the camera, and the table of places."""
        data = pathlib.Path(path).read_bytes()
        table = attributes_of(data)[1]
        return data[int.from_bytes(data[table:table + 8], "little"):]

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
            pictures.append(self.chunks_of_exr(picture))
            info = self.info(store)
            for a in range(3):
                self.assertEqual(info["bounds_lower"][a], origin[a])
        self.assertEqual(info["offset"], list(far))
        self.assertGreater(len(pictures[0]), 10000)
        self.assertTrue(pictures[0] == pictures[1])


class Named(Case):
    """Files that a model names: regular ones, in its folder; nothing that keeps one waiting, or unpacks for ever."""

    OBJ = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n"

    def put(self, name, content):
        path = self.folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(content) if isinstance(content, str) else path.write_bytes(content)
        return str(path)

    def gltf(self, name, buffer, image=None):
        content = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
                   "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "buffers": [{"byteLength": 36, "uri": buffer}],
                   "bufferViews": [{"buffer": 0, "byteLength": 36}],
                   "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}]}
        if image:
            content |= {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}], "textures": [{"source": 0}],
                        "images": [{"uri": image}]}
            content["meshes"][0]["primitives"][0]["material"] = 0
        return self.put(name, json.dumps(content))

    def setUp(self):
        super().setUp()
        os.mkfifo(self.path("fifo"))
        self.triangle = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
        self.put("secret.bin", self.triangle)
        self.put("m/here.bin", self.triangle)

    def preprocess(self, model, *more):
        return self.run_program("quarry-preprocess", model, "-o", self.path("x.quarry"), *more)

    def test_files_that_are_not_regular_are_not_waited_for(self):
        out = self.path("x.quarry")
        os.symlink("../fifo", self.path("m/fifo"))
        for uri in ("fifo", "/dev/zero", "."):
            self.must_fail(1, "regular file|is a folder|out of the model's folder", "quarry-preprocess",
                           self.gltf("m/a.gltf", uri), "-o", out)
        told = self.preprocess(self.gltf("m/a.gltf", "here.bin", "fifo"))
        self.assertEqual(told.returncode, 0, told.stderr)
        self.assertIn("is not there", told.stderr)
        for name in ("fifo", "/dev/zero", "."):
            told = self.preprocess(self.put("m/a.obj", self.OBJ.format(name)))
            self.assertEqual(told.returncode, 0, told.stderr)
            self.assertIn("is not there", told.stderr)
            self.put("m/a.mtl", f"newmtl m\nmap_Kd {name}\n")
            told = self.preprocess(self.put("m/a.obj", self.OBJ.format("a.mtl")))
            self.assertEqual(told.returncode, 0, told.stderr)
            self.assertIn("is not there", told.stderr)
            self.must_fail(1, "regular file", "quarry-preprocess", self.put("m/a.nff", f"b 0 0 1\ni 0 {name}\n"), "-o", out)
        os.mkfifo(self.path("m/a.materials.json"))
        ply = ("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
               "property list uchar int vertex_indices\nproperty ushort material_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 0\n")
        told = self.preprocess(self.put("m/a.ply", ply))
        self.assertIn("regular file", told.stderr)

    def test_paths_out_of_the_folder_are_refused_in_gltf_and_give_a_warning_elsewhere(self):
        for uri in ("../secret.bin", "%2e%2e/secret.bin", "x/../../secret.bin", "..\\secret.bin", self.path("secret.bin")):
            with self.subTest(uri=uri):
                self.must_fail(1, r"buffers\[0\]: the uri .* leads out of the model's folder", "quarry-preprocess",
                               self.gltf("m/a.gltf", uri), "-o", self.path("x.quarry"))
                told = self.preprocess(self.gltf("m/a.gltf", "here.bin", uri))
                self.assertEqual(told.returncode, 0, told.stderr)
                self.assertRegex(told.stderr, "outside the model's folder; the material does without|named by an absolute path")
        os.mkdir(self.path("m/sub"))
        self.assertEqual(self.preprocess(self.gltf("m/a.gltf", "sub/../here.bin")).returncode, 0)
        self.put("up.mtl", "newmtl m\nKd 1 0 0\n")
        self.put("t.ppm", b"P6 1 1 255\n123")
        self.put("m/sub/t.mtl", "newmtl m\nmap_Kd ../t.ppm\n")
        self.put("m/t.ppm", b"P6 1 1 255\n123")
        told = self.preprocess(self.put("m/a.obj", self.OBJ.format("../up.mtl")))
        self.assertEqual(told.returncode, 0, told.stderr)
        self.assertRegex(told.stderr, "names the file .*up.mtl, outside the model's folder; it is read")
        told = self.preprocess(self.put("m/a.obj", self.OBJ.format("sub/t.mtl")))
        self.assertNotIn("outside", told.stderr)
        self.put("m/out.mtl", "newmtl m\nmap_Kd ../t.ppm\n")
        told = self.preprocess(self.put("m/a.obj", self.OBJ.format("out.mtl")))
        self.assertRegex(told.stderr, "names the file .*t.ppm, outside the model's folder; it is read")
        self.put("up.nff", "b 0 0 1\np 3\n0 0 0\n1 0 0\n0 1 0\n")
        told = self.preprocess(self.put("m/a.nff", "b 0 0 1\ni 0 ../up.nff\n"))
        self.assertEqual(told.returncode, 0, told.stderr)
        self.assertRegex(told.stderr, "outside the model's folder; it is read")

    def test_packed_bombs(self):
        text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
        small = self.put("a.obj.gz", gzip.compress(text * 2000))
        self.must_fail(1, r"a\.obj\.gz.*unpacks to more than 1\.00 KiB \(--unpack-limit\)", "quarry-preprocess", small, "-o",
                       self.path("x.quarry"), "--unpack-limit", 1024)
        self.assertEqual(self.preprocess(small, "--unpack-limit", len(text) * 2000).returncode, 0)
        # Many small streams are one; each is packed well, and 400 MiB come of 0.4.
        line = gzip.compress((b"v 0 0 0 " + b" " * 1000 + b"\n") * 1000, 9)
        bomb = self.put("b.obj.gz", line * 400)
        began = os.times().elapsed
        self.must_fail(1, r"unpacks to more than 256 MiB \(more than 100 times its own .*--unpack-limit SIZE allows more",
                       "quarry-preprocess", bomb, "-o", self.path("x.quarry"), "--quiet")
        with open(bomb, "rb") as packed:
            self.must_fail(1, r"unpacks to more than 256 MiB", "quarry-preprocess", "-", "-o", self.path("x.quarry"), "--quiet", stdin=packed)
        self.assertLess(os.times().elapsed - began, 60 * PATIENCE)

    def test_spheres_are_counted_before_they_are_made(self):
        model = self.put("s.nff", "b 0 0 1\nf 1 1 1 1 0 0 0 1\n" + "".join(f"s {i % 100} {i // 100 % 100} {i // 10000} 0.4\n" for i in range(300000)))
        self.must_fail(1, r"s\.nff, line \d+: its first 94697 spheres and cones become 50000016 triangles \(528 a sphere, 48 a cone\), "
                       r"and at most 50000000 are made", "quarry-preprocess", model, "-o", self.path("x.quarry"), "--quiet")
        self.assertEqual([p.name for p in self.folder.iterdir() if "x.quarry" in p.name], [])


if __name__ == "__main__":
    main()

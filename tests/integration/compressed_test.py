"""glTF whose meshes are compressed, by meshopt (gltfpack) and by Draco (draco_encoder)."""
import json
import pathlib
import shutil
import subprocess

from programs import BIN, Case, main

DRACO = "KHR_draco_mesh_compression"


class Compressed(Case):
    """The same store whatever the memory, the threads and the kills; the triangles of the plain model."""

    def setUp(self):
        super().setUp()
        self.plain = self.path("t.obj")
        self.must("quarry-scene", "terrain", "--triangles", 300000, "-o", self.plain, "--quiet")

    def tool(self, *command):
        if not shutil.which(command[0]):
            self.skipTest(f"{command[0]} is not installed (deploy/install --tests)")
        subprocess.run([str(word) for word in command], check=True, capture_output=True, timeout=120)

    def packed(self, name, *options):
        self.tool("gltfpack", "-i", self.plain, "-o", self.path(name), *options)
        return self.path(name)

    def draco(self):
        """A GLB of a mesh that draco_encoder compresses; positions and texture coordinates are its attributes 0 and 1."""
        if not (BIN / "quarry-import-draco").exists():
            self.skipTest("quarry-import-draco was not built: Draco is not there")
        self.tool("draco_encoder", "-i", self.plain, "-o", self.path("t.drc"), "-qp", 14)
        mesh = pathlib.Path(self.path("t.drc")).read_bytes()
        document = {
            "asset": {"version": "2.0"}, "extensionsUsed": [DRACO], "extensionsRequired": [DRACO],
            "buffers": [{"byteLength": len(mesh)}], "bufferViews": [{"buffer": 0, "byteLength": len(mesh)}],
            "accessors": [{"componentType": 5126, "count": 1, "type": "VEC3"}, {"componentType": 5125, "count": 3, "type": "SCALAR"}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1,
                                        "extensions": {DRACO: {"bufferView": 0, "attributes": {"POSITION": 0}}}}]}],
            "nodes": [{"mesh": 0}]}
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        mesh += bytes(-len(mesh) % 4)
        word = lambda n: n.to_bytes(4, "little")
        glb = b"glTF" + word(2) + word(28 + len(text) + len(mesh)) + word(len(text)) + b"JSON" + text + word(len(mesh)) + b"BIN\0" + mesh
        model = pathlib.Path(self.path("draco.glb"))
        model.write_bytes(glb)
        return str(model)

    def made(self, model, *options):
        self.must("quarry-preprocess", model, "-o", self.path("s.quarry"), "--force", "--quiet", *options)
        return pathlib.Path(self.path("s.quarry")).read_bytes()

    def triangles(self, model):
        self.made(model)
        info = self.info(self.path("s.quarry"))
        return info["input_triangles"] - info["dropped_degenerate_triangles"]

    def check_sameness(self, model):
        whole = self.made(model)
        for options in (("--memory", "64M"), ("--threads", 1), ("--threads", 3, "--memory", "256M")):
            with self.subTest(options=options):
                self.assertTrue(self.made(model, *options) == whole, "other bytes")
        killed = self.made_in_spite_of_kills((0.1, 0.3, 0.5), model, "--memory", "64M", "--checkpoint", "0.02")
        self.assertTrue(killed == whole, "other bytes after kills")
        pathlib.Path(self.path("killed.quarry")).unlink()
        self.assertEqual([p.name for p in self.folder.iterdir() if "decoded" in p.name or ".work" in p.name], [])

    def test_meshopt(self):
        plain = self.triangles(self.packed("plain.glb"))
        for options in (("-c",), ("-cc",)):
            with self.subTest(options=options):
                self.assertEqual(self.triangles(self.packed("packed.glb", *options)), plain)
        self.assertEqual(self.triangles(self.packed("fallback.gltf", "-c", "-cf")), plain)
        pathlib.Path(self.path("fallback.fallback.bin")).unlink()  # the copy is not needed
        self.assertEqual(self.triangles(self.path("fallback.gltf")), plain)
        self.check_sameness(self.path("packed.glb"))

    def test_draco(self):
        model = self.draco()
        self.assertGreater(self.triangles(model), 290000)  # quantisation makes some triangles degenerate
        self.check_sameness(model)

    def test_damaged_meshes_leave_one_sentence_and_no_store(self):
        for model, sentence in ((self.packed("packed.glb", "-c"), r"packed\.glb: bufferViews\[\d\]\.extensions\.EXT_meshopt_compression: its bytes are damaged"),
                                (self.draco(), r"draco\.glb: a primitive of meshes\[0\]\." + DRACO + r": bufferViews\[0\]: ")):
            with self.subTest(model=model):
                document = bytearray(pathlib.Path(model).read_bytes())
                middle = document.index(b"BIN\0") + 4
                document[middle + 64:] = bytes(len(document) - middle - 64)
                pathlib.Path(model).write_bytes(document)
                self.must_fail(1, sentence, "quarry-preprocess", model, "-o", self.path("c.quarry"))
                self.assertFalse(pathlib.Path(self.path("c.quarry")).exists())


if __name__ == "__main__":
    main()

"""glTF whose meshes are compressed, by meshopt (gltfpack) and by Draco (draco_encoder)."""
import pathlib
import shutil
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, Case, main
from tests.support.models import first_files


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
        model = pathlib.Path(self.path("draco.glb"))
        model.write_bytes(first_files.draco_glb(mesh))
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
                                (self.draco(), r"draco\.glb: a primitive of meshes\[0\]\." + first_files.DRACO + r": bufferViews\[0\]: ")):
            with self.subTest(model=model):
                document = bytearray(pathlib.Path(model).read_bytes())
                middle = document.index(b"BIN\0") + 4
                document[middle + 64:] = bytes(len(document) - middle - 64)
                pathlib.Path(model).write_bytes(document)
                self.must_fail(1, sentence, "quarry-preprocess", model, "-o", self.path("c.quarry"))
                self.assertFalse(pathlib.Path(self.path("c.quarry")).exists())


if __name__ == "__main__":
    main()

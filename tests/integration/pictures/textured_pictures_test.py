"""Pictures with textures: texels, filters, cut-outs, and the same bytes whatever happens."""
import json
import os
import pathlib
import struct
import sys
import unittest
import unittest.mock

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.cases.model_cases import as_linear, pixels_of
from tests.integration.programs import Case, main
from tests.support.models.textured_scene import Glb, checkers, noise, png, sheet, write_scene


VIEW = ["--eye", "14,-7,7", "--at", "6,4,0.5", "--fov", "50", "--up", "0,0,1"]


def wrapped(i, size, wrap):
    if wrap == 33071:
        return min(max(i, 0), size - 1)
    period = 2 * size if wrap == 33648 else size
    return i % period if i % period < size else period - 1 - i % period


class TexturedPictures(Case):
    def preprocess(self, models, name, *arguments):
        store = self.path(name)
        self.must("quarry-preprocess", *models, "-o", store, "--quiet", *arguments)
        return store

    def picture(self, store, name, *arguments):
        self.must("quarry", "render", store, "-o", self.path(name), "--quiet", "--force", *arguments)
        return pathlib.Path(self.path(name)).read_bytes()

    def test_a_texel_is_a_pixel(self):
        """One pixel a texel, straight from the front: each pixel is its texel's code, for every wrap and transform."""
        width, height = 40, 24
        rows = [bytes(noise_row) for noise_row in self.random_rows(width, height)]
        for wrap in (10497, 33071, 33648):
            for scale, offset in (((1, 1), (0, 0)), ((-1, 1), (0, 0)), ((1, -1), (2, 1))):
                glb = Glb()
                transform = {"KHR_texture_transform": {"scale": list(scale), "offset": list(offset)}}
                # glTF has rows from the top down, and so has v.
                image = glb.image(png(width, height, lambda y: rows[y]), wrapS=wrap, wrapT=wrap)
                material = glb.material(pbrMetallicRoughness={
                    "baseColorTexture": {"index": image, "extensions": transform}, "metallicFactor": 0})
                glb.add(sheet(1, 1, lambda u, v: (3 * width * u, 3 * height * (1 - v), 0), 3), material)
                glb.write(self.path("t.glb"))
                store = self.preprocess([self.path("t.glb")], "t.quarry", "--up-axis", "y", "--force")
                centre = f"{1.5 * width},{1.5 * height}"
                self.picture(store, "t.png", "--mode", "raycast", "--exposure", 0, "--size", f"{3 * width}x{3 * height}",
                             "--eye", centre + ",10", "--at", centre + ",0", "--up", "0,1,0", "--ortho", 3 * height)
                for y, line in enumerate(pixels_of(self.path("t.png"))):
                    for x, seen in enumerate(line):
                        u = (x if scale[0] > 0 else -x - 1) + offset[0] * width
                        v = (y if scale[1] > 0 else -y - 1) + offset[1] * height
                        u, v = wrapped(u, width, wrap), wrapped(v, height, wrap)
                        if seen != tuple(rows[v][3 * u:3 * u + 3]):
                            self.fail(f"wrap {wrap}, scale {scale}: pixel {x}, {y} is {seen}, not texel {u}, {v}")

    @staticmethod
    def random_rows(width, height):
        import random
        chance = random.Random(7)
        return [[chance.randrange(256) for _ in range(3 * width)] for _ in range(height)]

    def test_boards_at_grazing_angles(self):
        """A board that runs to the horizon, against the mean of 16 x 16 pixels for each."""
        glb = Glb()
        board = glb.material(pbrMetallicRoughness={
            "baseColorTexture": {"index": glb.image(checkers(256, 256, 16))}, "metallicFactor": 0})
        glb.add(sheet(1, 1, lambda u, v: (400 * u - 200, 400 * v, 0), 25), board)
        glb.write(self.path("b.glb"))
        store = self.preprocess([self.path("b.glb")], "b.quarry", "--up-axis", "z")
        camera = ["--mode", "raycast", "--exposure", 0, "--eye", "0,-1,3", "--at", "0,20,0", "--up", "0,0,1", "--fov", 60]
        self.picture(store, "fine.png", "--size", "1536x1024", *camera)
        self.picture(store, "one.png", "--size", "96x64", *camera)
        fine, one = pixels_of(self.path("fine.png")), pixels_of(self.path("one.png"))
        total, worst, count = 0.0, 0.0, 0
        for y in range(30, 64):
            for x in range(96):
                mean = sum(as_linear(fine[16 * y + j][16 * x + i][0]) for j in range(16) for i in range(16)) / 256
                error = abs(as_linear(one[y][x][0]) - mean)
                total, worst, count = total + error, max(worst, error), count + 1
        print(f"boards: mean error {total / count:.4f}, largest {worst:.4f} of the whites' 0.87", file=sys.stderr)
        self.assertLess(total / count, 0.03)

    def stripes(self, name, cut):
        """Bars above a floor: by a cut-out of stripes 8 texels wide, or by geometry."""
        glb = Glb()
        grey = glb.material(doubleSided=True, pbrMetallicRoughness={"baseColorFactor": [0.7, 0.7, 0.7, 1], "metallicFactor": 0})
        glb.add(sheet(1, 1, lambda u, v: (14 * u - 2, 14 * v - 2, 0)), grey)
        if cut:
            image = glb.image(png(64, 8, lambda y: b"".join(bytes((255, 255, 255, 255 if x // 8 % 2 == 0 else 0)) for x in range(64)), 4))
            bars = glb.material(doubleSided=True, alphaMode="MASK", pbrMetallicRoughness={
                "baseColorFactor": [0.7, 0.7, 0.7, 1], "baseColorTexture": {"index": image}, "metallicFactor": 0})
            for z in (2, 3):
                glb.add(sheet(5, 5, lambda u, v, z=z: (10 * u, 10 * v, z + u)), bars)
        else:
            for z in (2, 3):
                for k in range(4):
                    glb.add(sheet(1, 5, lambda u, v, k=k, z=z: (10 * (2 * k + u) / 8, 10 * v, z + (2 * k + u) / 8)), grey)
        glb.write(self.path(f"{name}.glb"))
        return self.preprocess([self.path(f"{name}.glb")], f"{name}.quarry", "--up-axis", "z", "--voxel-size", "16K")

    def test_cut_outs_are_holes(self):
        """Like the same bars without a texture, but for pixels at their edges."""
        stores = {name: self.stripes(name, name == "cut") for name in ("cut", "bars")}
        self.assertTrue(self.info(stores["cut"])["opacity_masks"])
        for mode in ("raycast", "shadow", "whitted", "ao"):
            for name, store in stores.items():
                self.picture(store, f"{name}.png", "--mode", mode, "--no-edges", "--size", "320x240", "--exposure", 0, "--eye", "13,-7,9",
                             "--at", "5,5,1", "--up", "0,0,1", "--fov", 50,
                             *(["--sun", "0.3,0.2,1"] if mode in ("shadow", "whitted") else []))
            cut, bars = (pixels_of(self.path(f"{name}.png")) for name in stores)
            unlike = sum(max(abs(a - b) for a, b in zip(p, q)) > 8 for r, s in zip(cut, bars) for p, q in zip(r, s))
            print(f"cut-outs, {mode}: {unlike} of {320 * 240} pixels differ", file=sys.stderr)
            self.assertLess(unlike, 40)

    def veil(self, name, texel, factor):
        """A sheet of opacity texel / 255 * factor over a black floor."""
        glb = Glb()
        image = glb.image(png(4, 4, lambda y: bytes((255, 255, 255, texel)) * 4, 4))
        veil = glb.material(doubleSided=True, alphaMode="BLEND", pbrMetallicRoughness={
            "baseColorFactor": [1, 1, 1, factor], "baseColorTexture": {"index": image}, "metallicFactor": 0})
        black = glb.material(pbrMetallicRoughness={"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0})
        glb.add(sheet(2, 2, lambda u, v: (10 * u, 10 * v, 1)), veil)
        glb.add(sheet(2, 2, lambda u, v: (10 * u, 10 * v, 0)), black)
        glb.write(self.path(f"{name}.glb"))
        return self.preprocess([self.path(f"{name}.glb")], f"{name}.quarry", "--up-axis", "z")

    def test_opacity_without_a_cutoff_is_a_share_of_paths(self):
        """Opacity 0.25 gives a quarter of the brightness, by many samples, however the texel and the factor share it."""
        stores = {name: self.veil(name, *of) for name, of in (("texel", (64, 1)), ("factor", (128, 0.5)))}
        for mode in ("raycast", "shadow", "whitted"):
            for name, store in stores.items():
                self.picture(store, f"{name}.png", "--mode", mode, "--exposure", 0, "--size", "16x16", "--spp", 256,
                             "--eye", "5,5,9", "--at", "5,5,0", "--up", "0,1,0", "--ortho", 8)
            self.assertEqual(*(pixels_of(self.path(f"{name}.png")) for name in stores), mode)
            if mode != "raycast":
                continue
            seen = [as_linear(p[0]) for row in pixels_of(self.path("texel.png")) for p in row]
            self.assertAlmostEqual(sum(seen) / len(seen), 64 / 255, delta=0.01)
            self.assertGreater(max(seen) - min(seen), 0.01)  # paths differ

    def test_textures_need_coordinates(self):
        """A model without them does without its textures, whatever its voxels; one warning says so."""
        (self.folder / "t.png").write_bytes(noise(16, 16, 1))
        (self.folder / "m.mtl").write_text("newmtl a\nKd 0.5 0.5 0.5\nmap_Kd t.png\n")
        positions, _, triangles = sheet(40, 40, lambda u, v: (10 * u, 10 * v, (u > 0.5) * (v * v + u)))
        (self.folder / "m.obj").write_text("mtllib m.mtl\nusemtl a\n" + "".join(f"v {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in positions) +
                                           "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles))
        pictures = set()
        for size in ("8K", "1M"):
            done = self.must("quarry-preprocess", self.path("m.obj"), "-o", self.path("m.quarry"), "--force", "--voxel-size", size)
            self.assertIn("no vertex has texture coordinates", done.stderr)
            self.picture(self.path("m.quarry"), "m.png", "--mode", "raycast", "--size", "64x64", "--exposure", 0, "--eye", "5,-8,9", "--at", "5,5,0")
            pictures.add(str(pixels_of(self.path("m.png"))))
        self.assertEqual(len(pictures), 1)

    def test_the_bytes_are_the_same_for_any_memory_and_workers(self):
        store = self.preprocess(write_scene(self.folder), "s.quarry", "--voxel-size", "32K")
        largest = self.info(store)["largest_decoded_bytes"]
        for mode in ("raycast", "whitted", "ao"):
            arguments = ["--mode", mode, "--size", "128x96", "--spp", 2, "--aov", "normal,albedo", *VIEW]
            right = self.picture(store, "r.exr", *arguments, "--workers", 1, "--threads", 1)
            cases = [("--workers", 2, "--threads", 2), ("--workers", 1, "--threads", 2, "--cache", 2 * largest),
                     ("--workers", 2, "--threads", 1, "--cache", "1M"), ("--workers", 1, "--threads", 1, "--cache", largest),
                     ("--workers", 1, "--threads", 4, "--cache", largest)]
            for case in cases:
                with self.subTest(mode=mode, case=case):
                    self.assertEqual(self.picture(store, "c.exr", *arguments, *case), right)
            for isa in ("scalar", "avx2"):
                with self.subTest(mode=mode, isa=isa), unittest.mock.patch.dict(os.environ, QUARRY_ISA=isa):
                    self.assertEqual(self.picture(store, "i.exr", *arguments, "--workers", 1), right)

    def test_a_damaged_page_ends_the_job_with_its_place(self):
        store = self.preprocess(write_scene(self.folder, 32), "s.quarry")
        data = bytearray(pathlib.Path(store).read_bytes())
        table = [struct.unpack_from("<4sIQQ", data, 64 + 40 * k) for k in range(12)]
        offset, size = next((offset, size) for kind, _, offset, size in table if kind == b"TEXP")
        for at in range(offset, offset + size, 200):
            data[at] ^= 1
        pathlib.Path(store).write_bytes(data)
        for workers in (1, 2):
            self.must_fail(1, r"s\.quarry: block \d+ at byte \d+ is damaged \(checksum\); make the store again", "quarry", "render", store,
                           "-o", self.path("no.png"), "--quiet", "--mode", "raycast", "--exposure", 0, "--workers", workers, *VIEW)
            self.assertFalse(pathlib.Path(self.path("no.png")).exists())
        self.must_fail(1, r"page \d+ of texture \d+", "quarry", "verify", store)

    def test_pages_are_loaded_on_demand(self):
        store = self.preprocess(write_scene(self.folder), "s.quarry", "--voxel-size", "32K")
        info = self.info(store)
        loaded = {}
        for name, size in (("small", "64x48"), ("large", "1024x768")):
            self.picture(store, f"{name}.png", "--mode", "raycast", "--size", size, *VIEW, "--workers", 1,
                         "--stats", self.path(f"{name}.json"))
            loaded[name] = json.loads(pathlib.Path(self.path(f"{name}.json")).read_text())
        decoded = info["hot_decoded_bytes"] + info["shading_decoded_bytes"] + info["texture_decoded_bytes"]
        small, large = (loaded[name]["frames"][0]["workers"][0]["voxel_bytes_loaded"] for name in ("small", "large"))
        self.assertLess(small, large)
        self.assertLess(large, decoded)


if __name__ == "__main__":
    main()

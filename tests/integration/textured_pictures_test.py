"""Pictures with textures: texels, filters, cut-outs, and the same bytes whatever happens."""
import json
import os
import pathlib
import sys
import unittest
import unittest.mock

from model_cases import as_linear, pixels_of
from programs import Case, main

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
from textured_scene import Glb, checkers, noise, png, sheet, write_scene

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

    def test_the_same_bytes_whatever_happens(self):
        store = self.preprocess(write_scene(self.folder), "s.quarry", "--voxel-size", "32K")
        largest = self.info(store)["largest_decoded_bytes"]
        for mode in ("raycast", "whitted", "ao"):
            arguments = ["--mode", mode, "--size", "128x96", "--spp", 2, "--aov", "normal,albedo", *VIEW]
            right = self.picture(store, "r.exr", *arguments, "--workers", 1, "--threads", 1)
            cases = [("--workers", 2, "--threads", 2), ("--workers", 1, "--threads", 2, "--cache", 2 * largest),
                     ("--workers", 2, "--threads", 1, "--cache", "1M"), ("--workers", 1, "--threads", 1, "--cache", largest)]
            for case in cases:
                with self.subTest(mode=mode, case=case):
                    self.assertEqual(self.picture(store, "c.exr", *arguments, *case), right)
            for isa in ("scalar", "avx2"):
                with self.subTest(mode=mode, isa=isa), unittest.mock.patch.dict(os.environ, QUARRY_ISA=isa):
                    self.assertEqual(self.picture(store, "i.exr", *arguments, "--workers", 1), right)

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

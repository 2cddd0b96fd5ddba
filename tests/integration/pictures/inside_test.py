"""Views that hide parts, colour them and cut the model open: the same bits on any cluster, caps of the right area, one sentence for what cannot be."""
import json
import math
import os
import pathlib
import sys
import unittest.mock

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.exr import read_exr
from tests.integration.programs import Case, main

MODES = ("ao", "raycast", "shadow", "whitted", "path", "voxels")
LAYERS = "depth,normal,uv,primitive,material,part,voxel,albedo"
NONE = 0xFFFFFFFF


def prism(outer, inner, height, sides, first, inverted=False):
    """The OBJ lines of a closed ring of `sides` sides around the z axis, and its number of vertices."""
    lines, rings = [], []
    for radius in (outer, inner):
        for z in (0, height):
            rings.append([first + len(lines) + i for i in range(sides)])
            lines += [f"v {radius * math.cos(2 * math.pi * i / sides)} {radius * math.sin(2 * math.pi * i / sides)} {z}" for i in range(sides)]
    out_low, out_high, in_low, in_high = rings
    faces = []
    for i in range(sides):
        j = (i + 1) % sides
        faces += [(out_low[i], out_low[j], out_high[j], out_high[i]), (in_low[j], in_low[i], in_high[i], in_high[j]),
                  (out_high[i], out_high[j], in_high[j], in_high[i]), (out_low[j], out_low[i], in_low[i], in_low[j])]
    lines += ["f " + " ".join(map(str, reversed(face) if inverted else face)) for face in faces]
    return lines, 4 * sides


def ring_area(outer, inner, sides):
    return sides / 2 * math.sin(2 * math.pi / sides) * (outer ** 2 - inner ** 2)


class Inside(Case):
    def view(self, name, **members):
        path = self.path(name + ".json")
        pathlib.Path(path).write_text(json.dumps(members))
        return path

    def render(self, store, name, view, *arguments):
        output = self.path(name + ".exr")
        self.must("quarry", "render", store, "-o", output, "--quiet", "--force", "--view", view, *arguments)
        return pathlib.Path(output)


class SameBits(Inside):
    def test_parts_sections_and_colours_in_every_mode(self):
        model, store = self.path("plant.obj"), self.path("plant.quarry")
        self.must("quarry-scene", "plant", "--triangles", 60000, "-o", model, "--quiet")
        self.must("quarry-preprocess", model, "-o", store, "--quiet", "--voxel-size", "32K")
        largest = self.info(store)["largest_decoded_bytes"]
        for mode in MODES:
            view = self.view(mode, mode=mode, size=[160, 120], spp=2, aov=LAYERS.split(","), edges=mode == "ao",
                             camera={"eye": [-190, -150, 120], "at": [10, 10, 40], "up": [0, 0, 1], "fov": 50},
                             hide=["roof", "*pipe 1*", "south wall*"], colors=[{"parts": ["chimney*"], "color": [0.8, 0.1, 0.1]}],
                             section={"box": [[-110, -95, -5], [165, 130, 120]], "caps": True,
                                      "planes": [{"point": [0, 0, 33], "normal": [0.2, -0.3, 1]}]})
            reference = self.render(store, mode, view, "--workers", 1, "--threads", 1, "--cache", "64M").read_bytes()
            self.assertSeen(store, json.loads(pathlib.Path(view).read_text()), reference)
            for case in (("--workers", 2, "--threads", 2), ("--workers", 1, "--threads", 2, "--cache", largest)):
                with self.subTest(mode=mode, case=case):
                    self.assertEqual(self.render(store, "c", view, *case).read_bytes(), reference)
            for isa in ("scalar", "avx2"):
                with self.subTest(mode=mode, isa=isa), unittest.mock.patch.dict(os.environ, QUARRY_ISA=isa):
                    self.assertEqual(self.render(store, "i", view, "--workers", 1).read_bytes(), reference)
            crop = self.render(store, "crop", view, "--crop", "37,21,70,60")
            with self.subTest(mode=mode, case="crop"):
                whole, part = read_exr(self.path(mode + ".exr")).rows, read_exr(crop).rows
                for name in whole:
                    self.assertEqual([row[37:107] for row in whole[name][21:81]], part[name])

    def assertSeen(self, store, members, reference):
        """Each member of the view changes the picture: none is without effect here."""
        for member in ("hide", "colors", "section", "edges") if members["edges"] else ("hide", "section"):
            without = {name: value for name, value in members.items() if name != member}
            self.assertNotEqual(self.render(store, "without", self.view("without", **without)).read_bytes(), reference, member)
        open_cut = dict(members, section=dict(members["section"], caps=False))
        self.assertNotEqual(self.render(store, "without", self.view("without", **open_cut)).read_bytes(), reference, "caps")

    def test_hidden_parts_are_in_no_layer_and_a_shown_one_alone(self):
        model, store = self.path("plant.obj"), self.path("plant.quarry")
        self.must("quarry-scene", "plant", "--triangles", 20000, "-o", model, "--quiet")
        self.must("quarry-preprocess", model, "-o", store, "--quiet")
        names = self.info(store)["parts"]
        camera = {"eye": [-190, -150, 120], "at": [10, 10, 40], "up": [0, 0, 1], "fov": 50}

        def seen(**members):
            view = self.view("v", mode="raycast", size=[320, 240], aov=["part"], camera=camera, **members)
            rows = read_exr(self.render(store, "p", view)).rows["part.id"]
            return {names[part] for row in rows for part in row if part != NONE}

        everything = seen()
        self.assertIn("roof", everything)
        self.assertNotIn("roof", seen(hide=["roof"]))
        self.assertEqual(seen(only=["roof"]), {"roof"})
        self.assertEqual(seen(only=["roof", "ground"], hide=["ground"]), {"roof"})
        self.assertTrue(all("wall" not in name for name in seen(hide=["*wall*"])))


class Caps(Inside):
    """A cut at half the height, seen from above by parallel rays: the cap's pixels times a pixel's area."""

    def capped_area(self, store, pixels=600, height=6.0):
        view = self.view("cut", mode="raycast", size=[pixels, pixels], aov=["depth", "normal", "part"],
                         camera={"eye": [0, 0, 10], "at": [0, 0, 0], "up": [0, 1, 0], "ortho": height},
                         section={"planes": [{"point": [0, 0, 0.5], "normal": [0, 0, 1]}]})
        rows = read_exr(self.render(store, "cut", view)).rows
        count = sum(1 for depths, normals in zip(rows["depth.Z"], rows["normal.Z"])
                    for depth, z in zip(depths, normals) if abs(depth - 9.5) < 1e-5 and z == 1)
        return count * (height / pixels) ** 2

    def made(self, lines, name="model", extension="obj"):
        model, store = self.path(f"{name}.{extension}"), self.path(name + ".quarry")
        pathlib.Path(model).write_text("\n".join(lines) + "\n")
        self.must("quarry-preprocess", model, "-o", store, "--quiet", "--force")
        return store

    def assertArea(self, store, area):
        self.assertLess(abs(self.capped_area(store) - area), 0.005 * area)

    def test_a_cube_a_bored_block_and_nested_pipes(self):
        square = 2 * math.sqrt(2)
        for inverted in (False, True):
            with self.subTest("bored block", inverted=inverted):
                lines, _ = prism(square, square / 2, 1, 4, 1, inverted)
                self.assertArea(self.made(lines), ring_area(square, square / 2, 4))
        with self.subTest("nested pipes"):
            outer, count = prism(2, 1.6, 1, 64, 1)
            inner, _ = prism(1.2, 0.7, 1, 64, 1 + count, inverted=True)
            self.assertArea(self.made(["g outer"] + outer + ["g inner"] + inner), ring_area(2, 1.6, 64) + ring_area(1.2, 0.7, 64))
        with self.subTest("cube"):
            corners = [f"v {2 * x - 1} {2 * y - 1} {z}" for z in (0, 1) for y in (0, 1) for x in (0, 1)]
            faces = ["f 1 3 4 2", "f 5 6 8 7", "f 1 2 6 5", "f 3 7 8 4", "f 1 5 7 3", "f 2 4 8 6"]
            self.assertArea(self.made(corners + faces), 4)
            with self.subTest("without its floor"):
                self.assertEqual(self.capped_area(self.made(corners + faces[1:])), 0)

    def test_an_open_sheet_has_none(self):
        lines = [f"v {x / 10 - 2} {y / 10 - 2} {0.8 * math.sin(x / 5) * math.cos(y / 4) + 0.5}" for y in range(41) for x in range(41)]
        lines += [f"f {i} {i + 1} {i + 42} {i + 41}" for y in range(40) for i in range(41 * y + 1, 41 * y + 41)]
        self.assertEqual(self.capped_area(self.made(lines)), 0)


    def test_a_scan_has_none(self):
        scan = pathlib.Path(__file__).parents[4] / "shared/scenes/bunny/bun_zipper.ply"
        if not scan.exists():
            self.skipTest("../shared/scenes is not there")
        store = self.path("scan.quarry")
        self.must("quarry-preprocess", scan, "-o", store, "--scale", 20, "--quiet")
        self.assertEqual(self.capped_area(store), 0)


class Refused(Inside):
    def test_what_cannot_be_gets_one_sentence(self):
        store = self.store("plant", 20000)
        for sentence, members in ((r"no part is named `nowhere`; the nearest is ", {"hide": ["nowhere"]}),
                                  (r"only: is empty: nothing would be shown", {"only": []}),
                                  (r"the section's box is empty: its lower z is not below its upper z", {"section": {"box": [[0, 0, 0], [1, 1, 0]]}}),
                                  (r"plane 1 of the section has no direction", {"section": {"planes": [{"point": [0, 0, 0], "normal": [0, 0, 0]}]}}),
                                  (r"has 13 planes, and at most 12 are possible", {"section": {"planes": 13 * [{"point": [0, 0, 0], "normal": [0, 0, 1]}]}}),
                                  (r"'hidden' is not known", {"hidden": ["a"]})):
            with self.subTest(sentence):
                view = self.view("bad", **members)
                output = self.path("bad.png")
                done = self.run_program("quarry", "render", store, "-o", output, "--quiet", "--view", view)
                self.assertEqual(done.returncode, 1, done.stderr)
                self.assertRegex(done.stderr.strip().splitlines()[-1], sentence)
                self.assertFalse(pathlib.Path(output).exists())


if __name__ == "__main__":
    main()

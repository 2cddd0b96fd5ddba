"""Small models that people reported, the second collection: ../shared/cases-2, rows whose issue is `files`. One row a case; more than a picture from
above has a test of its own."""
import concurrent.futures
import copy
import math
import os
import pathlib
import shutil
import struct
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.cases.model_cases import BACKGROUND, GREEN, RED, SQUARE, Model, ModelCase, Sentence, colored, is_color, pixels_of
from tests.integration.exr import read_exr
from tests.integration.programs import main
from tests.support.models.textured_scene import png

CASES = pathlib.Path(__file__).parents[4] / "shared/cases-2"
BLUE, YELLOW, NONE = (0, 0, 255), (255, 255, 0), BACKGROUND
PLACES = ((0.25, 0.75), (0.75, 0.75), (0.25, 0.25), (0.75, 0.25))  # of the quarters, the upper left first


def quarters(*colors, **more):
    return Model(**{**SQUARE, "pixels": dict(zip(PLACES, colors)), **more})


def halves(left, right):
    return quarters(left, right, left, right)


PICTURE = quarters(RED, GREEN, BLUE, YELLOW)  # t.png of most cases
PLAIN = Model(**SQUARE)
SQUARE_OF_128 = colored((128, 64, 192))


def moved(place):
    """KHR_texture_transform of the case, by the extension's formula: turned by a quarter, then moved by (0.25, 0.125)."""
    u, v = place[0], 1 - place[1]  # glTF's v runs down
    u, v = v + 0.25, -u + 0.125
    return PICTURE.pixels[(math.floor(u * 2) % 2 * 0.5 + 0.25, 0.75 - math.floor(v * 2) % 2 * 0.5)]


def texels(path):
    """The middle of each texel of a PNG on the unit square, and its colour."""
    rows = pixels_of(path)
    return {((x + 0.5) / len(row), 1 - (y + 0.5) / len(rows)): color for y, row in enumerate(rows) for x, color in enumerate(row)}


# Files of a case, each with its right outcomes, of which one must be met.
TABLE = {
    "3mf_colour_group": {"object.3mf": [colored(RED)], "triangle.3mf": [colored(RED)], "plain_group.3mf": [Model(**SQUARE, warns="colours")]},
    "3mf_thumbnail": {"q.3mf": [Model()]},
    "alpha_cutoff_default": {"q.gltf": [halves(NONE, GREEN)]},
    "alpha_opaque_ignores": {"q.gltf": [colored(GREEN)]},
    "alpha_vertex_colour": {"q.gltf": [Sentence("cut all 2 out")]},
    "basisu_with_fallback": {"q.gltf": [PICTURE]},
    "dae_texture_paths": {f"{name}.dae": [PICTURE] for name in "abcde"},
    "gltf_sparse_no_view": {"q.gltf": [PLAIN]},
    "jpg_cmyk_adobe": {"q.obj": [PICTURE]},
    "jpg_grey_gltf": {"q.glb": [colored((128, 128, 128))]},
    "khr_texture_transform": {"q.gltf": [Model(**SQUARE, pixels={p: moved(p) for p in ((x / 16, y / 16) for x in (1, 5, 9, 13) for y in (3, 7, 11, 15))})]},
    "map_d_same_file": {"q.obj": [halves(NONE, (0, 0, 128))]},
    "map_d_shape_in_alpha": {"q.obj": [halves(NONE, GREEN)]},
    "mime_mismatch": {"q0.glb": [colored((255, 127, 0))], "q1.glb": [colored((255, 127, 0))]},
    "mtl_absolute_windows": {"q.obj": [PICTURE]},
    "mtl_gbk_names": {"q.obj": [quarters(RED, GREEN, BLUE, YELLOW, warns=r"\\xb4\\xf3")]},
    "mtl_opts_after_name": {"q.obj": [quarters(RED, GREEN, BLUE, YELLOW, silent=True)]},
    "mtl_opts_before": {"q.obj": [quarters(GREEN, RED, YELLOW, BLUE)]},
    "mtl_texres_backslash": {"q.obj": [PICTURE]},
    "obj_vt_2d_3d_and_missing": {"q.obj": [Model(warns="texture coordinate")]},
    "obj_with_newmtl_inside": {"q.obj": [Model()]},
    "ply_list_colours": {"q.ply": [Model()]},
    "ply_texturefile": {"q.ply": [PICTURE]},
    "png_16bit": {"q.gltf": [SQUARE_OF_128]},
    "png_gama_1": {"q.gltf": [SQUARE_OF_128]},
    "png_grey_alpha": {"q.gltf": [halves(NONE, (128, 128, 128))]},
    "png_palette_trns": {"q.gltf": [halves(NONE, GREEN)]},
    "texcoord_1": {"q.gltf": [quarters(BLUE, YELLOW, RED, GREEN)]},
    "tga_rle_bottom_left": {"q.obj": [PICTURE]},
    "tga_rle_bottom_right": {"q.obj": [PICTURE]},
    "tga_rle_top_left": {"q.obj": [PICTURE]},
    "tga_rle_top_right": {"q.obj": [PICTURE]},
    "wrap_default_repeat": {"q.gltf": [PICTURE]},
}
# Cases with a test of their own below, and one whose file is not in the collection.
OWN = {"double_faces", "exr_crop_windows", "exr_layers_for_others", "gltf_camera_ortho_and_fov", "gltf_parent_mirror_normals", "images_broken",
       "many_materials_one_image", "many_stl_parts", "normal_map_green_up_gltf", "normal_map_mirrored_uv", "obj_zero_vn", "png_says_srgb",
       "stl_zero_and_nan_normals", "texture_16k", "texture_not_power_of_two", "texture_two_uses", "tiny_and_huge_extents", "up_axis_of_exports"}
ABSENT = {"real_TextureTransformTest"}


@unittest.skipUnless(CASES.is_dir(), "../shared/cases-2 is not there")
class FileCases(ModelCase):
    def store_of(self, case, file, *options):
        done = self.must("quarry-preprocess", CASES / case / file, "-o", self.path("x.quarry"), "--threads", 1, "--force", *options)
        return self.path("x.quarry"), done.stderr

    def seen(self, store, *options, size="64x64", output="x.png", mode="raycast"):
        """A picture of the unit square from above; `options` come last."""
        self.must("quarry", "render", store, "-o", self.path(output), "--size", size, "--mode", mode, "--quiet", "--force",
                  *(() if output.endswith(".exr") else ("--exposure", 0)), "--workers", 1, "--threads", 1, *(options or ("--ortho", 1, "--eye", "0.5,0.5,3", "--at", "0.5,0.5,0", "--up", "0,1,0")))
        return pixels_of(self.path(output)) if output.endswith(".png") else read_exr(self.path(output))

    def normals(self, case, file, z=3):
        store, _ = self.store_of(case, file)
        exr = self.seen(store, "--aov", "normal", "--ortho", 1, "--eye", f"0.5,0.5,{z}", "--at", "0.5,0.5,0", "--up", "0,1,0", size="8x8", output="n.exr")
        return exr.at(("normal.X", "normal.Y", "normal.Z"), 4, 3)

    def assert_near(self, found, wanted, delta):
        for a, b in zip(found, wanted, strict=True):
            self.assertAlmostEqual(a, b, delta=delta)

    def complaint(self, case, file):
        own = copy.copy(self)
        own.folder = self.folder / f"{case}-{file}"
        own.folder.mkdir()
        try:
            done = self.run_program("quarry-preprocess", CASES / case / file, "-o", own.path("x.quarry"), "--threads", 1)
            own.check_one_of(TABLE[case][file], done, file)
        except Exception as error:
            return str(error)
        return None

    def test_each_is_read_right_or_refused_with_a_sentence(self):
        rows = (line.split("\t") for line in (CASES / "README.tsv").read_text().splitlines()[1:])
        self.assertEqual({row[0] for row in rows if row[1] == "files"} ^ (TABLE.keys() | OWN | ABSENT), set(), "without a row, or no case")
        names = [(case, file) for case in TABLE for file in TABLE[case]]
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            for (case, file), complaint in zip(names, pool.map(self.complaint, *zip(*names))):
                with self.subTest(case=case, file=file):
                    self.assertIsNone(complaint)

    def test_texture_not_power_of_two(self):
        store, _ = self.store_of("texture_not_power_of_two", "q.gltf")
        rows = self.seen(store, size="165x165")
        for (x, y), color in texels(CASES / "texture_not_power_of_two/t.png").items():
            seen = rows[int((1 - y) * 165)][int(x * 165)]
            self.assertTrue(all(abs(a - b) <= 6 for a, b in zip(seen, color)), f"{seen} at {x},{y}, not {color}")

    def test_texture_two_uses(self):
        store, _ = self.store_of("texture_two_uses", "q.gltf")
        self.assertTrue(is_color(self.seen(store)[32][32], (128, 128, 0)))
        self.assertEqual([[use["use"] for use in texture["uses"]] for texture in self.info(store)["textures"]], [["diffuse"], ["metal and roughness"]])

    def test_double_faces(self):
        pictures = []
        for file in "q.obj", "single.obj":
            store, _ = self.store_of("double_faces", file)
            pictures.append([self.seen(store, mode=mode) for mode in ("ao", "whitted")])
        for twice, once in zip(*pictures):
            self.assertLess(max(abs(a - b) for rows in zip(twice, once) for pair in zip(*rows) for a, b in zip(*pair)), 8)

    def test_exr_crop_windows(self):
        store, _ = self.store_of("exr_crop_windows", "q.gltf")
        whole = self.seen(store, size="64x48", output="whole.exr")
        part = self.seen(store, "--crop", "16,8,32,24", "--ortho", 1, "--eye", "0.5,0.5,3", "--at", "0.5,0.5,0", "--up", "0,1,0", size="64x48", output="part.exr")
        self.assertEqual((part.window("dataWindow"), part.window("displayWindow")), ((16, 8, 47, 31), (0, 0, 63, 47)))
        for channel in "RGB":
            self.assertEqual(part.rows[channel], [row[16:48] for row in whole.rows[channel][8:32]])

    def test_exr_layers_for_others(self):
        store, _ = self.store_of("exr_layers_for_others", "q.gltf")
        exr = self.seen(store, "--aov", "depth,normal,uv,primitive,material,part,voxel,albedo", "--ortho", 1, "--eye", "0.5,0.5,3", "--at", "0.5,0.5,0",
                        "--up", "0,1,0", output="n.exr")
        self.assertLessEqual({"R", "G", "B", "Z", "N.X", "N.Y", "N.Z", "normal.X", "uv.U", "uv.V", "albedo.R", "primitive.id"}, exr.types.keys())
        self.assertEqual({channel: kind for channel, kind in exr.types.items() if channel.endswith(".id")},
                         {name + ".id": 0 for name in ("primitive", "material", "part", "voxel")})
        self.assert_near(exr.at(("Z", "depth.Z", "N.X", "N.Y", "N.Z"), 32, 32), (3, 3, 0, 0, 1), 1e-5)

    def test_gltf_camera_ortho_and_fov(self):
        store, _ = self.store_of("gltf_camera_ortho_and_fov", "q.gltf")
        for camera in "o", "p":
            rows = self.seen(store, "--camera", camera)
            for (x, y), color in {(4, 4): RED, (59, 4): GREEN, (4, 59): BLUE, (59, 59): YELLOW, (29, 29): RED, (34, 34): YELLOW}.items():
                self.assertTrue(is_color(rows[y][x], color), f"camera {camera}: {rows[y][x]} at {x},{y}")

    def test_normals(self):
        self.assert_near(self.normals("gltf_parent_mirror_normals", "q0.gltf", -3), (0, 0, -1), 1e-5)
        self.assert_near(self.normals("gltf_parent_mirror_normals", "q1.gltf"), (0, 0, 1), 1e-5)
        self.assert_near(self.normals("normal_map_green_up_gltf", "q.gltf"), (0, math.sqrt(0.5), math.sqrt(0.5)), 0.02)
        self.assert_near(self.normals("normal_map_mirrored_uv", "q.gltf"), (-math.sqrt(0.5), 0, math.sqrt(0.5)), 0.02)
        for file in "ind.obj", "nan.obj", "tiny.obj", "zero.obj":
            self.assert_near(self.normals("obj_zero_vn", file), (0, 0, 1), 1e-5)
        for file in "nan.stl", "wrong.stl", "zero.stl":
            self.assert_near(self.normals("stl_zero_and_nan_normals", file), (0, 0, 1), 1e-5)

    def test_images_broken(self):
        """Each gives one warning that names it, and the model is read. The last ends too early: it is read up to there, or left out."""
        folder = self.folder / "broken"
        shutil.copytree(CASES / "images_broken", folder)
        jpeg = (CASES / "jpg_cmyk_adobe/q.jpg").read_bytes()
        (folder / "torn.jpg").write_bytes(jpeg[:len(jpeg) // 2])
        for image in sorted(p.name for p in folder.iterdir() if p.suffix in (".png", ".jpg", ".tga")):
            with self.subTest(image=image):
                (folder / "q.mtl").write_text(f"newmtl m\nKd 1 1 1\nmap_Kd {image}\n")
                done = self.must("quarry-preprocess", folder / "q.obj", "-o", self.path("x.quarry"), "--force", "--threads", 1)
                warnings = [line for line in done.stderr.splitlines() if line.startswith("warning:")]
                self.assertEqual(len(warnings), 1, done.stderr)
                self.assertIn(image, warnings[0])
                self.assertEqual(self.info(self.path("x.quarry"))["input_triangles"], 2)

    def test_many_materials_one_image(self):
        (self.folder / "a.png").write_bytes(png(512, 512, lambda y: bytes((x * 7 + y * 13) % 251 for x in range(1536))))
        (self.folder / "q.mtl").write_text("".join(f"newmtl m{i}\nmap_Kd a.png\n" for i in range(400)))
        (self.folder / "q.obj").write_text("mtllib q.mtl\nvt 0 0\nvt 1 0\nvt 0 1\n" + "".join(
            f"v {i} 0 0\nv {i + 1} 0 0\nv {i} 1 0\nusemtl m{i}\nf -3/1 -2/2 -1/3\n" for i in range(400)))
        self.must("quarry-preprocess", self.path("q.obj"), "-o", self.path("x.quarry"))
        info = self.info(self.path("x.quarry"))
        self.assertEqual((len(info["materials"]), len(info["textures"])), (400, 1))

    def test_many_stl_parts(self):
        files = []
        for i in range(2000):
            x, y = i % 50, i // 50
            files.append(self.folder / f"Bauteil {i:04} Träger.stl")
            facet = lambda *corners: struct.pack("<12fH", 0, 0, 1, *(c for corner in corners for c in corner), 0)
            files[-1].write_bytes(bytes(80) + struct.pack("<I", 2) + facet((x, y, 0), (x + 1, y, 0), (x, y + 1, 0)) +
                                  facet((x + 1, y, 0), (x + 1, y + 1, 0), (x, y + 1, 0)))
        self.must("quarry-preprocess", *files, "-o", self.path("x.quarry"))
        info = self.info(self.path("x.quarry"))
        self.assertEqual((info["input_triangles"], info["parts"][:2], len(info["parts"])), (4000, ["Bauteil 0000 Träger.stl", "Bauteil 0001 Träger.stl"], 2000))

    def test_png_says_srgb(self):
        store, _ = self.store_of("png_says_srgb", "q.gltf")
        self.seen(store)
        data = pathlib.Path(self.path("x.png")).read_bytes()
        self.assertEqual(data[24:26], bytes([8, 2]))
        self.assertTrue(b"sRGB" in data or (b"gAMA" in data and b"cHRM" in data))

    def test_texture_16k(self):
        """16,384 texels a side by QUARRY_CASES_WHOLE, else 2,048: the large one takes a minute."""
        side = 16384 if os.environ.get("QUARRY_CASES_WHOLE") == "1" else 2048
        row = bytes((200, 100, 50)) * side
        (self.folder / "t.png").write_bytes(png(side, side, lambda y: row))
        (self.folder / "q.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd t.png\n")
        (self.folder / "q.obj").write_text("mtllib q.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n")
        self.must("quarry-preprocess", self.path("q.obj"), "-o", self.path("x.quarry"), "--memory", "256M")
        self.assertTrue(is_color(self.seen(self.path("x.quarry"))[32][32], (200, 100, 50)))

    def test_tiny_and_huge_extents(self):
        """The same part in three sizes gives the same picture."""
        pictures = []
        for file in "one.stl", "tiny.stl", "huge.stl":
            store, _ = self.store_of("tiny_and_huge_extents", file)
            self.must("quarry", "render", store, "-o", self.path("x.png"), "--size", "64x64", "--quiet", "--force", "--workers", 1)
            pictures.append(pixels_of(self.path("x.png")))
        self.assertGreater(len({pixel for row in pictures[0] for pixel in row}), 5)
        for other in pictures[1:]:
            differing = sum(max(abs(a - b) for a, b in zip(*pair)) > 8 for rows in zip(pictures[0], other) for pair in zip(*rows))
            self.assertLess(differing, 64 * 64 // 50)

    def test_up_axis_of_exports(self):
        for file, axis in ("house_z.stl", "z"), ("house_y.obj", "y"):
            store, told = self.store_of("up_axis_of_exports", file)
            self.assertEqual(self.info(store)["up_axis"], axis, told)


if __name__ == "__main__":
    main()

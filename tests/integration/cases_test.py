"""Small models that people reported of programs that open or render meshes: ../shared/cases. One row a case; a new report is a new row."""
import dataclasses
import math
import pathlib
import re
import struct
import unittest
import zlib

from programs import Case

CASES = pathlib.Path(__file__).parents[3] / "shared/cases"
SIDE = 40  # pixels of a picture

RED, GREEN = (255, 0, 0), (0, 255, 0)
BACKGROUND = (196, 211, 231)
SQUARE = dict(lower=(0, 0, 0), upper=(1, 1, 0))


@dataclasses.dataclass
class Model:
    """A model that is read. `pixels`: colours at places x,y seen from +z, full or dimmed by the default albedo (0.8);
    `area`: what its picture covers; `warns`: what standard error says."""
    triangles: int = 2
    lower: tuple = None
    upper: tuple = None
    extent: tuple = None
    within: float = 1e-6
    dropped: int = 0
    materials: list = None
    parts: list = None
    warns: str = None
    pixels: dict = None
    not_black: bool = False
    area: float = None
    mode: str = "raycast"


@dataclasses.dataclass
class Sentence:
    """A model that is refused: status 1, one sentence that names the file once and matches."""
    says: str = "."


@dataclasses.dataclass
class Like:
    """The picture of the file with `old` replaced by `new`."""
    old: str
    new: str
    mode: str = "whitted"


def colored(color, **more):
    return Model(**{**SQUARE, "pixels": {(0.75, 0.25): color, (0.25, 0.75): color}, **more})


LFS = Sentence("Git LFS")
ONE = Model(1)
PAIR = colored(None, pixels={(0.75, 0.25): RED, (0.25, 0.75): GREEN})
UTM = Model(200, extent=(0.1, 0.1, 0.016), within=5e-5)
UNPACK = Sentence("window.*zstd -d --long=")
GREY = colored((115, 115, 115))
# Either of several right values in a list; standard input for those cases that say so.
TABLE = {
    "obj_umlaut": colored(RED, parts=["Straße"]),
    "dae_inch.dae": [Model(upper=(0.0254, 0.0254, 0)), Model(**SQUARE)],
    "dae_transp_half": colored((220, 174, 187), mode="whitted"),
    "dae_transp_rgbzero_pixel": Like('<transparent opaque="RGB_ZERO"><color>0 0 0 1</color></transparent>', ""),
    "dae_vertex_color.dae": colored(RED),
    "dae_vertex_color_pixel": colored(RED),
    "glb_json_null_pad": Model(**SQUARE),
    "glb_trailing": Model(**SQUARE),
    "glb_truncated": Sentence(),
    "gltf_bom": Model(**SQUARE),
    "gltf_cjk": Model(**SQUARE, materials=["你好"], parts=["节点"]),
    "gltf_color0_linear": colored((188, 137, 255)),
    "gltf_datauri_percent": [Model(**SQUARE), Sentence()],
    "gltf_default_metal": Model(**SQUARE, not_black=True),
    "gltf_default_metal_whitted": Model(**SQUARE, not_black=True, mode="whitted"),
    "gltf_instancing_required": [Model(10, (0, 0, 0), (5, 3, 0)), Sentence("EXT_mesh_gpu_instancing")],
    "gltf_instancing_used": [Model(10, (0, 0, 0), (5, 3, 0)), Model(2, warns="EXT_mesh_gpu_instancing"), Sentence("EXT_mesh_gpu_instancing")],
    "gltf_metal_half_rough": Model(**SQUARE, not_black=True),
    "gltf_morph_weight": [Model(lower=(0, 0, 1), upper=(1, 1, 1)), Model(**SQUARE)],
    "gltf_negative_scale": Model(not_black=True),
    "gltf_node_invisible": [Model(), Model(4)],
    "gltf_quantized": Model(**SQUARE),
    "gltf_required_EXT_meshopt_compression": Sentence("EXT_meshopt_compression"),
    "gltf_required_KHR_animation_pointer": [Sentence("KHR_animation_pointer"), Model(**SQUARE)],
    "gltf_required_KHR_materials_diffuse_transmission": [Sentence("KHR_materials_diffuse_transmission"), Model(**SQUARE)],
    "gltf_required_KHR_materials_dispersion": [Sentence("KHR_materials_dispersion"), Model(**SQUARE)],
    "gltf_scene1": Model(lower=(10, 0, 0), upper=(11, 1, 0)),
    "gltf_skin_joint_scaled": Model(lower=(3, 0, 0), upper=(3.01, 0.01, 0)),
    "gltf_skin_node_moved": Model(**SQUARE),
    "gltf_unlit": colored((188, 137, 255)),
    "gltf_uri_literal_20": [Model(**SQUARE), Sentence()],
    "gltf_uri_missing": Sentence(r"nothere\.bin"),
    "gltf_uri_raw_percent": Model(**SQUARE),
    "gltf_uri_raw_space": Model(**SQUARE),
    "gltf_utm_after_marker": Model(4),
    "gltf_utm_node": Model(extent=(0.01, 0.01, 0), within=5e-5),
    "lfs_pointer_obj": LFS,
    "lfs_pointer_ply": LFS,
    "lfs_pointer_stl": LFS,
    "m_basematerial.3mf": colored(RED),
    "m_basematerial_pixel": colored(RED),
    "m_item_transform.3mf": Model(lower=(10, 0, 0), upper=(11, 1, 0)),
    "m_two_items.3mf": Model(4, (0, 0, 0), (11, 1, 0)),
    "obj_2d": [Model(**SQUARE), Sentence("line 1: ")],
    "obj_bom": Model(**SQUARE),
    "obj_stdin": Model(**SQUARE),
    "obj_color_255": colored((255, 128, 0)),
    "obj_color_rgba": colored(RED),
    "obj_color_srgb": GREY,
    "obj_comment_backslash": Model(**SQUARE),
    "obj_concave_L": Model(4, (0, 0, 0), (2, 2, 0), area=3, pixels={(1.5, 1.5): BACKGROUND, (0.5, 1.5): (231, 231, 231)}),
    "obj_concave_kernel": Model(4, (0, 0, 0), (2, 2, 0), area=3),
    "obj_cont_trailing_blank": Model(**SQUARE),
    "obj_cr": Model(**SQUARE),
    "obj_crlf_continuation": Model(**SQUARE),
    # The file is a material library; the model beside it names it.
    "obj_d1_Tr1": colored(RED, mode="whitted", pixels={(0.5, 0.5): (242, 0, 0)}),
    "obj_mrgb": [colored(RED), Model(warns="MRGB")],
    "obj_mtllib_case": [colored(RED), Model(warns="obj_case.mtl")],
    "obj_mtllib_spaces": colored(None, materials=["Red", "Green"], pixels={(0.75, 0.25): RED, (0.25, 0.75): GREEN}),
    "obj_trailing_nul": [Model(**SQUARE), Sentence("zero byte")],
    "obj_utm": UTM,
    "obj_utm_stray_first": UTM,
    "off_coff": colored(RED),
    "off_modelnet": Model(**SQUARE),
    "off_no_edges": Model(**SQUARE),
    "off_noff_4": Model(**SQUARE),
    "off_same_line": Model(**SQUARE),
    "off_stdin": Model(**SQUARE),
    "off_split_face": Model(**SQUARE),
    "off_split_vertex": [Model(**SQUARE), Sentence()],
    "off_vertex_color_no_c": Model(**SQUARE),
    "off_vertex_color_no_c_pixel": colored(RED),
    "p.obj.xz": Sentence("xz"),
    "p_members.obj.gz": Model(**SQUARE),
    "p_trunc.obj.gz": Sentence("ends too early"),
    "ply_ascii_extra_column": [Model(**SQUARE), Sentence()],
    "ply_body_comment": [Model(**SQUARE), Sentence("comment")],
    "ply_color_srgb": GREY,
    "ply_cr_ascii": Model(**SQUARE),
    "ply_crlf_binary": Model(**SQUARE),
    "ply_face_color": PAIR,
    "ply_face_extra_column": [Model(4), Sentence()],
    "ply_faces_first": Model(**SQUARE),
    "ply_float_color": colored(RED),
    "ply_int64": [Model(**SQUARE), Sentence("int64")],
    "ply_points": Sentence("point cloud"),
    "ply_rgb_short": colored(RED),
    "ply_splat": Sentence("no faces"),
    "ply_tristrips": Model(**SQUARE),
    "ply_uint_double_quad": Model(**SQUARE),
    "stl_ascii_bom": Model(**SQUARE),
    "stl_attr_garbage": Model(**SQUARE),
    "stl_attr_payload": Model(**SQUARE),
    "stl_color_viscam": PAIR,
    "stl_comma": Sentence('line 4: .*"0,000000e\\+00"'),
    "stl_count_ffff": [Model(**SQUARE), Sentence()],
    "stl_count_less": [Model(1, warns="left out"), Model(**SQUARE)],
    "stl_count_zero": [Model(**SQUARE), Sentence("count")],
    "stl_count_zero_stdin": [Model(**SQUARE), Sentence("count")],
    "stl_cr": Model(**SQUARE),
    "stl_end_loop_space": Model(**SQUARE),
    "stl_facet_color": Model(**SQUARE),
    "stl_leading_comment": Model(**SQUARE),
    "stl_binary_stdin": Model(**SQUARE),
    "stl_binary_gz": Model(**SQUARE),
    "stl_scientific": Model(**SQUARE),
    "stl_several_solids": Model(4, (0, 0, 0), (2, 2, 0), parts=["a", "b"]),
    "stl_trunc": [Model(1, warns="."), Sentence()],
    "stl_upper_tabs": Model(**SQUARE),
    "x.abc": Sentence("Alembic"),
    "x.blend": Sentence("Blender"),
    "x.dae": Sentence(),
    "x.las": Sentence("point cloud"),
    "x.usdz": Sentence("USD"),
    "x.vtp": Sentence("VTK"),
    "x.vtu": Sentence("VTK"),
    "x.wrl": [ONE, Sentence("VRML")],
    "x.x3d": [ONE, Sentence("X3D")],
    "x.zip": Sentence("zip.*unpack"),
    "x_obj_zipped.obj": Sentence("zip.*unpack"),
    "zstd_long27": [ONE, UNPACK],
    "zstd_long28": [ONE, UNPACK],
}
MODELS = {"obj_d1_Tr1.mtl": "obj_d1_Tr1.obj"}


def cases():
    """Name and file of each row."""
    rows = (line.split("\t") for line in (CASES / "README.tsv").read_text().splitlines()[1:])
    return {row[1]: MODELS.get(row[0], row[0]) for row in rows if len(row) == 3}


def unfiltered(row, before, step, kind):
    """A row of a PNG as pixels: its filter undone."""
    for x in range(len(row)):
        a, b, c = (row[x - step], before[x], before[x - step]) if x >= step else (0, before[x], 0)
        nearest = min((a, b, c), key=lambda value: abs(a + b - c - value))
        row[x] = (row[x] + (0, a, b, (a + b) // 2, nearest)[kind]) & 255
    return row


def pixels_of(path):
    """Rows of the (r, g, b) of a PNG of 8 bits."""
    data, packed, at = pathlib.Path(path).read_bytes(), b"", 8
    width, height = struct.unpack(">II", data[16:24])
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        packed += data[at + 8:at + 8 + size] if kind == b"IDAT" else b""
        at += 12 + size
    raw, stride, rows = zlib.decompress(packed), 3 * width, [bytearray(3 * width)]
    for y in range(height):
        start = y * (stride + 1)
        rows.append(unfiltered(bytearray(raw[start + 1:start + 1 + stride]), rows[-1], 3, raw[start]))
    return [[tuple(row[3 * x:3 * x + 3]) for x in range(width)] for row in rows[1:]]


def as_srgb(share):
    return 255 * (12.92 * share if share <= 0.0031308 else 1.055 * share ** (1 / 2.4) - 0.055)


def as_linear(value):
    share = value / 255
    return share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4


def is_color(seen, wanted):
    """That colour, or that under the albedo of the default material."""
    return any(all(abs(a - as_srgb(albedo * as_linear(b))) <= 6 for a, b in zip(seen, wanted)) for albedo in (1, 0.8))


class Cases(Case):
    def setUp(self):
        super().setUp()
        if not CASES.is_dir():
            self.skipTest("../shared/cases is not there")

    def picture(self, model, mode, lower, upper):
        """Seen from +z, and where a place of the model lies in it."""
        side = 1.25 * max(upper[0] - lower[0], upper[1] - lower[1])
        x, y = (lower[0] + upper[0]) / 2, (lower[1] + upper[1]) / 2
        self.must("quarry", "render", model, "-o", self.path("x.png"), "--size", f"{SIDE}x{SIDE}", "--mode", mode, "--quiet", "--force",
                  "--eye", f"{x},{y},{upper[2] + 5 * side}", "--at", f"{x},{y},{upper[2]}", "--up", "0,1,0", "--ortho", side,
                  "--workers", 1, "--threads", 1)
        rows = pixels_of(self.path("x.png"))
        return side, rows, lambda p: rows[math.floor((0.5 - (p[1] - y) / side) * SIDE)][math.floor((0.5 + (p[0] - x) / side) * SIDE)]

    def check_picture(self, wanted, info):
        side, rows, at = self.picture(self.path("x.quarry"), wanted.mode, info["bounds_lower"], info["bounds_upper"])
        for place, color in (wanted.pixels or {}).items():
            self.assertTrue(is_color(at(place), color), f"{at(place)} at {place}, not {color}")
        covered = [pixel for row in rows for pixel in row if not is_color(pixel, BACKGROUND)]
        if wanted.area is not None:
            self.assertAlmostEqual(len(covered) * (side / SIDE) ** 2, wanted.area, delta=0.05 * wanted.area)
        if wanted.not_black:
            self.assertGreater(min(max(pixel) for pixel in covered), 20)

    def check_model(self, wanted, done):
        self.assertEqual(done.returncode, 0, done.stderr)
        if wanted.warns:
            self.assertRegex(done.stderr, "warning: .*(" + wanted.warns + ")")
        info = self.info(self.path("x.quarry"))
        self.assertEqual(info["input_triangles"], wanted.triangles)
        self.assertEqual(info["dropped_degenerate_triangles"] + info["dropped_not_finite_triangles"], wanted.dropped)
        lower, upper = info["bounds_lower"], info["bounds_upper"]
        extent = [b - a for a, b in zip(lower, upper)]
        for found, right in ((lower, wanted.lower), (upper, wanted.upper), (extent, wanted.extent)):
            for a, b in zip(found, right or ()):
                self.assertAlmostEqual(a, b, delta=wanted.within)
        for found in ("materials", "parts"):
            if getattr(wanted, found) is not None:
                self.assertEqual(info[found], getattr(wanted, found))
        if wanted.pixels or wanted.not_black or wanted.area is not None:
            self.check_picture(wanted, info)

    def check_sentence(self, wanted, done, file):
        self.assertEqual(done.returncode, 1, done.stderr)
        last = done.stderr.splitlines()[-1]
        self.assertRegex(last, wanted.says)
        self.assertEqual(len(re.findall(re.escape(file) if file else "standard input", last)), 1, last)
        self.assertEqual([p.name for p in self.folder.iterdir() if p.name.startswith("x.quarry")], [])

    def check_likeness(self, wanted, file):
        text = (CASES / file).read_text()
        self.assertIn(wanted.old, text)
        (self.folder / file).write_text(text.replace(wanted.old, wanted.new))
        square = (wanted.mode, (0, 0, 0), (1, 1, 0))
        self.assertEqual(self.picture(CASES / file, *square)[1], self.picture(self.folder / file, *square)[1])

    def check(self, name, file):
        rights = TABLE[name] if isinstance(TABLE[name], list) else [TABLE[name]]
        if isinstance(rights[0], Like):
            return self.check_likeness(rights[0], file)
        piped = name.endswith("_stdin")
        store = ("-o", self.path("x.quarry"), "--threads", 1)
        if piped:
            with open(CASES / file, "rb") as model:
                done = self.run_program("quarry-preprocess", "-", *store, stdin=model)
        else:
            done = self.run_program("quarry-preprocess", CASES / file, *store)
        told = []
        for right in rights:
            try:
                if isinstance(right, Model):
                    return self.check_model(right, done)
                return self.check_sentence(right, done, None if piped else file)
            except AssertionError as error:
                told.append(str(error))
        self.fail("\n".join(told))

    def test_each_is_read_right_or_refused_with_a_sentence(self):
        self.assertEqual(sorted(cases().keys() - TABLE.keys()), [], "without a row in the table")
        for name, file in cases().items():
            with self.subTest(case=name, file=file):
                self.check(name, file)
            for left in self.folder.glob("x.*"):
                left.unlink()


if __name__ == "__main__":
    unittest.main(verbosity=2)

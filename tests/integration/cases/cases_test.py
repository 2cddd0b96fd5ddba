"""Small models that people reported of programs that open or render meshes: ../shared/cases. One row a case; a new report is a new row."""
import dataclasses
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.cases.model_cases import BACKGROUND, GREEN, RED, SQUARE, Model, ModelCase, Sentence, colored
from tests.integration.programs import main

CASES = pathlib.Path(__file__).parents[4] / "shared/cases"


@dataclasses.dataclass
class Like:
    """The picture of the file with `old` replaced by `new`."""
    old: str
    new: str
    mode: str = "whitted"


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
    # Reported when the extension was refused. The file names it as required and compresses nothing, so it is a plain square.
    "gltf_required_EXT_meshopt_compression": Model(**SQUARE),
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


class Cases(ModelCase):
    def setUp(self):
        super().setUp()
        if not CASES.is_dir():
            self.skipTest("../shared/cases is not there")

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
        self.check_one_of(rights, done, None if piped else file)

    def test_each_is_read_right_or_refused_with_a_sentence(self):
        self.assertEqual(sorted(cases().keys() - TABLE.keys()), [], "without a row in the table")
        for name, file in cases().items():
            with self.subTest(case=name, file=file):
                self.check(name, file)
            for left in self.folder.glob("x.*"):
                left.unlink()


if __name__ == "__main__":
    main()

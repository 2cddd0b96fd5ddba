"""Small models of the kinds reported for programs that open meshes, written here. One row a case: cases_test.py has the reported files themselves."""
import base64
import bz2
import concurrent.futures
import copy
import gzip
import io
import json
import lzma
import pathlib
import struct
import sys
import tarfile
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.cases.model_cases import BACKGROUND, GREEN, RED, SQUARE, Model, ModelCase, Sentence, colored
from tests.integration.programs import main

ROWS = []


def row(file, content, *rights, **beside):
    """A model `file` and its right outcomes; `beside`: other files by name, with a dot for each double underscore."""
    as_bytes = lambda text: text.encode() if isinstance(text, str) else text
    ROWS.append((file, as_bytes(content), rights, {name.replace("__", "."): as_bytes(text) for name, text in beside.items()}))


SHAPE = Model(**SQUARE)
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
V = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
OBJ = V + "f 1 2 3 4\n"


# OBJ and MTL.
def obj(name, content, *rights, **beside):
    row(f"obj_{name}.obj", content, *(rights or [SHAPE]), **beside)


def mtl(name, content, *rights, use="m"):
    obj("mtl_" + name, f"mtllib my.mtl\n{V}usemtl {use}\nf 1 2 3 4\n", *rights, my__mtl=content)


obj("negative", "o a\n" + V + "f -4 -3 -2 -1\no b\nv 2 0 0\nv 3 0 0\nv 3 1 0\nv 2 1 0\nf -4 -3 -2 -1\n", Model(4, (0, 0, 0), (3, 1, 0), parts=["a", "b"]))
obj("mixed_corners", V + "vt 0 0\nvn 0 0 1\nf 1//1 2/1 3/1/1 4\n")
obj("uv_of_1_and_3", V + "vt 0.5\nvt 1 0 0\nvt 1 1 0\nvt 0 1 0\nf 1/1 2/2 3/3 4/4\n")
obj("w", V.replace("0\n", "0 1.0\n") + "f 1 2 3 4\n")
obj("corner_twice", V + "f 1 2 2 3 4\n", Model(3, **SQUARE, dropped=1), SHAPE)
obj("corner_closes", V + "f 1 2 3 4 1\n", Model(3, **SQUARE, dropped=1), SHAPE)
obj("usemtl_first", "usemtl m\nmtllib my.mtl\n" + OBJ, colored(RED), my__mtl="newmtl m\nKd 1 0 0\n")
obj("mtllib_last", V + "usemtl m\nf 1 2 3 4\nmtllib my.mtl\n", colored(RED), Model(warns="before|not defined"), my__mtl="newmtl m\nKd 1 0 0\n")
obj("two_libraries", "mtllib a.mtl my.mtl\n" + V + "usemtl m\nf 1 2 3 4\n", colored(RED), a__mtl="newmtl x\n", my__mtl="newmtl m\nKd 1 0 0\n")
obj("quoted_library", 'mtllib "my.mtl"\n' + V + "usemtl m\nf 1 2 3 4\n", colored(RED), my__mtl="newmtl m\nKd 1 0 0\n")
obj("windows_library", "mtllib C:\\Users\\me\\my.mtl\n" + V + "usemtl m\nf 1 2 3 4\n", colored(RED), my__mtl="newmtl m\nKd 1 0 0\n")
obj("dot_library", "mtllib ./my.mtl\n" + V + "usemtl m\nf 1 2 3 4\n", colored(RED), my__mtl="newmtl m\nKd 1 0 0\n")
obj("library_without_keyword_case", "MTLLIB my.mtl\n" + V + "USEMTL m\nf 1 2 3 4\n", colored(RED), my__mtl="newmtl m\nKd 1 0 0\n")
obj("upper_case", OBJ.upper())
obj("own_library_first", "newmtl m\nKa 0 0 0\nKd 1 0 0\n\nusemtl m\n" + OBJ, colored(RED))
obj("own_library_first_after_comments", "# Blender\n\n  newmtl m\nmap_Kx a.png\nKd 1 0 0\n" + V + "usemtl m\nf 1 2 3 4\n", colored(RED))
obj("own_library_last", V + "usemtl m\nf 1 2 3 4\nnewmtl m\nKd 1 0 0\n", Model(**SQUARE, warns="not defined"))
obj("library_in_another_encoding", b"mtllib \xb4\xf3.mtl\n" + V.encode() + b"usemtl m\nf 1 2 3 4\n", colored(RED, warns=r"\\xb4\\xf3.*only one beside"), my__mtl="newmtl m\nKd 1 0 0\n")
obj("library_in_another_encoding_of_two", b"mtllib \xb4\xf3.mtl\n" + V.encode() + b"f 1 2 3 4\n", Model(**SQUARE, warns=r"\\xb4\\xf3.* is not there"), my__mtl="newmtl m\n", other__mtl="newmtl m\n")
obj("library_missing_with_another_beside", "mtllib a.mtl\n" + OBJ, Model(**SQUARE, warns='"a.mtl" is not there'), my__mtl="newmtl m\nKd 1 0 0\n")
obj("material_spaces", "mtllib my.mtl\n" + V + "usemtl my red  \nf 1 2 3 4\n", colored(RED), my__mtl="newmtl my red\nKd 1 0 0\n")
obj("material_quoted_latin1", b"mtllib my.mtl\n" + V.encode() + b"usemtl Stra\xdfe\nf 1 2 3 4\n", colored(RED), my__mtl=b"newmtl Stra\xdfe\nKd 1 0 0\n")
obj("lines_and_points", V + "p 1 2\nl 1 2 3\nf 1 2 3 4\n")
obj("lines_alone", V + "l 1 2 3\np 1\n", Sentence("lines|points"))
obj("free_form", V + "vp 0 0\ncstype bezier\ndeg 1 1\nsurf 0 1 0 1 1 2 4 3\nparm u 0 1\nparm v 0 1\nend\n", Sentence("free-form"))
obj("free_form_too", OBJ + "cstype bezier\ndeg 1 1\nsurf 0 1 0 1 1 2 4 3\nparm u 0 1\nparm v 0 1\nend\n", Model(**SQUARE, warns="free-form"))
obj("no_newline", OBJ.rstrip())
obj("numbers", "v 0. -0 .0\nv +1 0e0 0\nv 1e0 1.0E+00 0\nv -.0 +1. 0.\nf +1 2 3 4\n")
obj("decimal_comma", OBJ.replace("v 1 0 0", "v 1,0 0,0 0,0"), Sentence('line 2: .*"1,0"'))
obj("nan", "v nan 0 0\n" + OBJ.replace("f 1 2 3 4", "f 2 3 4 5\nf 1 2 3"), Model(3, **SQUARE, dropped=1))
obj("inf", "v 1.#INF -inf 0\n" + OBJ.replace("f 1 2 3 4", "f 2 3 4 5\nf 1 2 3"), Model(3, **SQUARE, dropped=1))
obj("comments", "# a\n" + OBJ.replace("\n", " # about C:\\temp\\\n") + "  # at the end \\")
obj("indented_comment_backslash", "  # C:\\temp\\\n\t#\\\n" + OBJ)
obj("tabs", OBJ.replace(" ", "\t"))
obj("form_feeds", OBJ.replace("\n", "\f\n").replace(" ", " \v"))
obj("utf16", b"\xff\xfe" + OBJ.encode("utf-16-le"), Sentence("UTF-16"), SHAPE)
obj("utf16_big", b"\xfe\xff" + OBJ.encode("utf-16-be"), Sentence("UTF-16"), SHAPE)
obj("utf16_without_mark", OBJ.encode("utf-16-le"), Sentence("UTF-16|zero byte"), SHAPE)
obj("nul_within", OBJ.replace("v 1 0 0", "v 1 0\0 0"), Sentence("zero byte|number"))
obj("nul_names", OBJ + "g a\0b\n", Sentence("zero byte"), SHAPE)
obj("long_line", V + "f 1 2 3 4#" + "x" * 300000 + "\n")
obj("empty_face", V + "f\nf 1\nf 1 2\nf 1 2 3 4\n", Model(**SQUARE, warns="3 faces of fewer"))
obj("zero_index", V + "f 0 1 2\n", Sentence("counts from 1"))
obj("beyond", V + "f 1 2 9\n", Sentence("vertex 9"))
obj("faces_first", "f 1 2 3 4\n" + V)
obj("keyhole", "v 0 0 0\nv 3 0 0\nv 3 3 0\nv 0 3 0\nv 1 1 0\nv 1 2 0\nv 2 2 0\nv 2 1 0\nf 1 2 3 4 1 5 6 7 8 5\n", Model(8, (0, 0, 0), (3, 3, 0), area=8, pixels={(1.5, 1.5): BACKGROUND}))
obj("concave_dart", "v 0 0 0\nv 2 0 0\nv 1 .5 0\nv 1 2 0\nf 1 2 3 4\nf 2 3 4\n", Model(3, (0, 0, 0), (2, 2, 0)))
obj("nonplanar", "v 0 0 0\nv 1 0 0.2\nv 1 1 0\nv 0 1 0.2\nf 1 2 3 4\n", Model(2, (0, 0, 0), (1, 1, 0.2)))
obj("group_names", "g a b\n" + V + "f 1 2 3\ng\nf 1 3 4\n", SHAPE)
obj("smoothing", V + "s off\nf 1 2 3\ns 1\nf 1 3 4\n")
obj("html", "<!DOCTYPE html>\n<html><body>404</body></html>\n", Sentence("web page"))
obj("html_comment", "<!-- saved -->\n<HTML><body>404</body></HTML>\n", Sentence("web page"))
obj("xml_error", '<?xml version="1.0"?>\n<Error><Code>NoSuchKey</Code></Error>', Sentence("XML"))
obj("json_error", '{"message": "Not Found", "status": "404"}', Sentence("JSON"))
obj("text_error", "404: Not Found", Sentence("no line of a vertex"))
obj("blanks", "\n\n  \n", Sentence("holds no|neither|empty"))
obj("empty", "", Sentence("empty"))
obj("annex", "/annex/objects/SHA256E-s123--0123456789abcdef.obj\n", Sentence("git-annex"))
obj("binary_stl", b"x" * 80 + struct.pack("<I12fH", 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 1, 0, 0), Model(1, **SQUARE))
obj("color_alpha_bytes", "\n".join(f"v {x} {y} {z} 255 0 0 255" for x, y, z in CORNERS) + "\nf 1 2 3 4\n", colored(RED))
obj("mrgb", OBJ + "#MRGB ffff0000ffff0000ffff0000ffff0000\n", colored(RED), Model(warns="MRGB"))
obj("mrgb_before", V + "#MRGB ffff0000ffff0000\n#MRGB ffff0000ffff0000\nf 1 2 3 4\n", colored(RED), Model(warns="MRGB"))

mtl("plain", "newmtl m\nKd 1 0 0\n", colored(RED))
mtl("crlf", "newmtl m\r\n\tKd 1 0 0\r\n", colored(RED))
mtl("bom", "\ufeffnewmtl m\nKd 1 0 0\n", colored(RED))
mtl("cr", "newmtl m\rKd 1 0 0\r", colored(RED))
mtl("upper", "NEWMTL m\nKD 1 0 0\n", colored(RED))
mtl("one_number", "newmtl m\nKd 1\n", colored((255, 255, 255)))
mtl("comment", "newmtl m # red\nKd 1 0 0 # red\n", colored(RED))
mtl("halo", "newmtl m\nKd 1 0 0\nd -halo 1\n", colored(RED))
mtl("spectral", "newmtl m\nKd spectral my.rfl 1\n", Model(**SQUARE, warns="spectral"))
mtl("xyz", "newmtl m\nKd xyz 0.4124 0.2126 0.0193\n", colored(RED), Model(**SQUARE, warns="xyz"))
mtl("twice", "newmtl m\nKd 1 0 0\nnewmtl m\nKd 0 1 0\n", colored(RED), colored(GREEN))
mtl("commas", "newmtl m\nKd 1,0 0,0 0,0\n", Model(**SQUARE, warns="my.mtl, line 2"))
mtl("no_material", "Kd 1 0 0\n", Model(**SQUARE, warns="not defined"))
mtl("lfs", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", Model(**SQUARE, warns="LFS"))
mtl("html", "<!DOCTYPE html><html></html>\n", Model(**SQUARE, warns="web page|not defined"))
mtl("utf16", b"\xff\xfe" + "newmtl m\nKd 1 0 0\n".encode("utf-16-le"), Model(**SQUARE, warns="UTF-16|zero"))
mtl("nan", "newmtl m\nKd nan 0 0\n", Model(**SQUARE, not_black=False))
mtl("percent", "newmtl m\nKd 255 0 0\n", colored(RED))
mtl("case", "newmtl M\nKd 1 0 0\n", colored(RED), Model(**SQUARE, warns='"m"'))
mtl("tr_1_alone", "newmtl m\nKd 1 0 0\nTr 1.000000\n", colored(RED, warns="Tr 1.*opaque"))
mtl("tr_half_alone", "newmtl m\nKd 1 0 0\nTr 0.5\n", Model(**SQUARE))
mtl("opaque_d_tr", "newmtl m\nKd 1 0 0\nd 1.0\nTr 1.0\n", colored(RED))
mtl("tr", "newmtl m\nKd 1 0 0\nTr 0.0\n", colored(RED))
mtl("map_missing", "newmtl m\nKd 1 0 0\nmap_Kd -s 1 1 1 -o 0 0 0 my tex.png\n", Model(**SQUARE, warns='my tex.png'))
mtl("map_windows", "newmtl m\nmap_Kd D:\\a b\\tex.png\n", Model(**SQUARE, warns='tex.png'))


# PLY.
def ply(name, header, body, *rights, kind="ascii", **beside):
    encoding = {"ascii": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[kind]
    text = f"ply\nformat {encoding} 1.0\n{header}end_header\n"
    row(f"ply_{name}.ply", text.encode() + (body.encode() if isinstance(body, str) else body), *(rights or [SHAPE]), **beside)


XYZ = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\n"
POINTS = "".join("%d %d %d\n" % p for p in CORNERS)
QUAD = "4 0 1 2 3\n"


def colors(values, end=""):
    return "".join("%d %d %d" % p + f" {values}\n" for p in CORNERS) + end


ply("big_endian", XYZ + FACE, b"".join(struct.pack(">3f", *p) for p in CORNERS) + struct.pack(">B4i", 4, 0, 1, 2, 3), kind=">")
for count, index in ("uchar", "uchar"), ("char", "char"), ("ushort", "ushort"), ("short", "short"), ("int", "uint"), ("uint", "int"), ("uint8", "uint16"):
    code = dict(uchar="B", char="b", ushort="H", short="h", int="i", uint="I", uint8="B", uint16="H")
    ply(f"list_{count}_{index}", XYZ + f"element face 1\nproperty list {count} {index} vertex_index\n",
        b"".join(struct.pack(">3f", *p) for p in CORNERS) + struct.pack(">" + code[count] + 4 * code[index], 4, 0, 1, 2, 3), kind=">")
ply("list_float", XYZ + "element face 1\nproperty list uchar float vertex_indices\n", POINTS + QUAD, SHAPE, Sentence("integer"))
ply("float_indices", XYZ + FACE, POINTS + "4 0.0 1.0 2.0 3.0\n", SHAPE, Sentence("integer"))
ply("obj_info", "comment a\nobj_info b c\n" + XYZ + "comment end_header\n" + FACE, POINTS + QUAD)
for kind in "double", "float":
    ply(f"color_{kind}", XYZ + "".join(f"property {kind} {c}\n" for c in ("red", "green", "blue")) + FACE, colors("1.0 0.0 0.0", QUAD), colored(RED))
    ply(f"color_{kind}_255", XYZ + "".join(f"property {kind} {c}\n" for c in ("red", "green", "blue")) + FACE, colors("128.0 0.0 255.0", QUAD), colored((128, 0, 255)))
for kind, most in ("uchar", 255), ("ushort", 65535), ("int", 255), ("uint", 255), ("short", 255):
    ply(f"color_{kind}", XYZ + "".join(f"property {kind} {c}\n" for c in ("red", "green", "blue", "alpha")) + FACE, colors(f"{most} 0 0 {most}", QUAD), colored(RED))
ply("color_ushort_255", XYZ + "".join(f"property ushort {c}\n" for c in ("red", "green", "blue")) + FACE, colors("255 0 0", QUAD), colored(RED), colored((1, 0, 0)))
ply("color_diffuse", XYZ + "".join(f"property uchar diffuse_{c}\n" for c in ("red", "green", "blue")) + FACE, colors("255 0 0", QUAD), colored(RED))
ply("color_ambient_too", XYZ + "".join(f"property uchar {k}_{c}\n" for k in ("ambient", "diffuse", "specular") for c in ("red", "green", "blue")) + FACE,
    colors("0 0 0 255 0 0 0 0 0", QUAD), colored(RED))
ply("color_upper", XYZ + "".join(f"property uchar {c}\n" for c in ("Red", "Green", "Blue")) + FACE, colors("255 0 0", QUAD), colored(RED), SHAPE)
ply("face_color", XYZ + FACE.replace(" 1", " 2") + "".join(f"property uchar {c}\n" for c in ("red", "green", "blue")), POINTS + "3 0 1 2 255 0 0\n3 0 2 3 0 255 0\n",
    colored(None, pixels={(0.75, 0.25): RED, (0.25, 0.75): GREEN}))
ply("face_color_float_255", XYZ + FACE + "".join(f"property float {c}\n" for c in ("red", "green", "blue")), POINTS + "4 0 1 2 3 255 0 0\n", colored(RED))
ply("normals_uv", XYZ + "".join(f"property float {c}\n" for c in ("nx", "ny", "nz", "texture_u", "texture_v", "confidence")) + FACE, colors("0 0 1 0 0 0.5", QUAD))
ply("edges", XYZ + FACE + "element edge 1\nproperty int vertex1\nproperty int vertex2\n", POINTS + QUAD + "0 1\n")
ply("strips", XYZ + "element tristrips 1\nproperty list int int vertex_indices\n", POINTS + "8 0 1 3 -1 1 2 3 -1\n")
ply("strip_alternates", XYZ + "element tristrips 1\nproperty list int int vertex_indices\n", POINTS + "4 0 1 3 2\n")
ply("wedge_uv", XYZ + FACE + "property list uchar float texcoord\nproperty int texnumber\n", POINTS + "4 0 1 2 3 8 0 0 1 0 1 1 0 1 0\n", SHAPE)
ply("texture_file_without_uv", "comment TextureFile my.png\n" + XYZ + FACE, POINTS + QUAD, Model(**SQUARE, warns="my.png.*no texture coordinates"), my__png="")
BLUE, YELLOW = (0, 0, 255), (255, 255, 0)
QUARTERS = b"P6 16 16 255\n" + bytes(RED * 8 + GREEN * 8) * 8 + bytes(BLUE * 8 + YELLOW * 8) * 8  # the upper row is the first
TEXTURED = colored(None, pixels={(0.25, 0.75): RED, (0.75, 0.75): GREEN, (0.25, 0.25): BLUE, (0.75, 0.25): YELLOW}, silent=True)
UV = "".join(f"property float {c}\n" for c in "st")
WEDGES = FACE + "property list uchar float texcoord\n"
UV_OBJ = V + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3 4/4\n"
obj("options_behind_image", "mtllib my.mtl\n" + UV_OBJ, TEXTURED, my__mtl="newmtl m\nmap_Kd my.ppm -clamp on -s 1 1 1\n", my__ppm=QUARTERS)
obj("options_behind_image_count", "mtllib my.mtl\n" + UV_OBJ, colored(None, pixels={(0.25, 0.75): GREEN, (0.25, 0.25): YELLOW}, silent=True),
    my__mtl="newmtl m\nmap_Kd my.ppm -o 0.5 0\n", my__ppm=QUARTERS)
obj("image_name_like_options", "mtllib my.mtl\n" + UV_OBJ, Model(**SQUARE, warns="my -bm.ppm"), my__mtl="newmtl m\nmap_Kd my -bm.ppm\n", my__ppm=QUARTERS)
obj("image_in_another_encoding", "mtllib my.mtl\n" + UV_OBJ, colored(None, pixels=TEXTURED.pixels, warns=r"\\xb4\\xf3.*only one beside"), my__mtl=b"newmtl m\nmap_Kd \xb4\xf3.ppm\n",
    my__png=QUARTERS)
CORNER_UVS = "8 0 0 1 0 1 1 0 1"
ply("texture_of_vertices", "comment TextureFile my.ppm\n" + XYZ + UV + FACE, "".join("%d %d %d %d %d\n" % (*p, *p[:2]) for p in CORNERS) + QUAD, TEXTURED, my__ppm=QUARTERS)
ply("texture_of_corners", "comment TextureFile my.ppm\n" + XYZ + WEDGES, POINTS + f"4 0 1 2 3 {CORNER_UVS}\n", TEXTURED, my__ppm=QUARTERS)
ply("texture_of_corners_beside_vertices", "comment TextureFile my.ppm\n" + XYZ + UV + WEDGES, "".join("%d %d %d 9 9\n" % p for p in CORNERS) + f"4 0 1 2 3 {CORNER_UVS}\n", TEXTURED, my__ppm=QUARTERS)
ply("texture_of_corners_binary", "comment TextureFile my.ppm\n" + XYZ + WEDGES, b"".join(struct.pack("<3f", *p) for p in CORNERS) + struct.pack("<B4iB8f", 4, 0, 1, 2, 3, 8, 0, 0, 1, 0, 1, 1, 0, 1),
    TEXTURED, kind="<", my__ppm=QUARTERS)
ply("texture_of_two", "comment TextureFile a.ppm\ncomment TextureFile my.ppm\n" + XYZ + WEDGES + "property int texnumber\n", POINTS + f"4 0 1 2 3 {CORNER_UVS} 1\n", TEXTURED,
    a__ppm=b"P6 1 1 255\nabc", my__ppm=QUARTERS)
ply("texture_number_of_none", "comment TextureFile my.ppm\n" + XYZ + WEDGES + "property int texnumber\n", POINTS + f"4 0 1 2 3 {CORNER_UVS} -1\n", Model(**SQUARE, silent=True), my__ppm=QUARTERS)
ply("texture_of_some_corners", "comment TextureFile my.ppm\n" + XYZ + WEDGES, POINTS + "4 0 1 2 3 0\n", Model(**SQUARE, warns="no vertex has texture coordinates"), my__ppm=QUARTERS)
ply("texture_missing", "comment TextureFile my.ppm\n" + XYZ + WEDGES, POINTS + f"4 0 1 2 3 {CORNER_UVS}\n", Model(**SQUARE, warns="my.ppm.*is not there"))
ply("texture_list_cut", "comment TextureFile my.ppm\n" + XYZ + WEDGES, POINTS + "4 0 1 2 3 8 0 0 1\n", Sentence("face 0"), my__ppm=QUARTERS)
ply("texture_list_negative", "comment TextureFile my.ppm\n" + XYZ + WEDGES.replace("list uchar float", "list int float"), POINTS + "4 0 1 2 3 -8\n", Sentence("-8 texture coordinates"), my__ppm=QUARTERS)
ply("elements_around", "element camera 1\nproperty float view_px\nelement nothing 0\nproperty list uchar int a\n" + XYZ + FACE + "element multi_texture_face 1\nproperty uchar tx\nproperty list uchar float uv\n",
    "7\n" + POINTS + QUAD + "0 2 0 1\n")
ply("trailing", XYZ + FACE, POINTS + QUAD + "\n\nmore\n")
ply("trailing_binary", XYZ + FACE, b"".join(struct.pack("<3f", *p) for p in CORNERS) + struct.pack("<B4i", 4, 0, 1, 2, 3) + b"junk", kind="<")
ply("truncated", XYZ + FACE, POINTS + "4 0 1\n", Sentence("face 0"))
ply("truncated_binary", XYZ + FACE, b"".join(struct.pack("<3f", *p) for p in CORNERS)[:-2], Sentence("vertex|rows"), kind="<")
row("ply_no_end.ply", "ply\nformat ascii 1.0\n" + XYZ + FACE, Sentence("end_header"))
row("ply_cut_header.ply", "ply\nformat ascii 1.0\nelement ver", Sentence("end_header|count"))
row("ply_upper.ply", "PLY\nformat ascii 1.0\n" + XYZ + FACE + "end_header\n" + POINTS + QUAD, SHAPE, Sentence("ply"))
row("ply_blank_ends.ply", "ply \nformat ascii 1.0 \n" + (XYZ + FACE).replace("\n", " \n") + "end_header \n" + POINTS + QUAD, SHAPE)
row("ply_bom.ply", "\ufeffply\nformat ascii 1.0\n" + XYZ + FACE + "end_header\n" + POINTS + QUAD, SHAPE)
row("ply_crlf.ply", ("ply\nformat ascii 1.0\n" + XYZ + FACE + "end_header\n" + POINTS + QUAD).replace("\n", "\r\n"), SHAPE)
row("ply_as.obj", "ply\nformat ascii 1.0\n" + XYZ + FACE + "end_header\n" + POINTS + QUAD, SHAPE)
ply("concave", XYZ.replace("4", "6") + FACE, "0 0 0\n2 0 0\n2 1 0\n1 1 0\n1 2 0\n0 2 0\n6 0 1 2 3 4 5\n", Model(4, (0, 0, 0), (2, 2, 0), area=3))
ply("short_faces", XYZ + FACE.replace(" 1", " 4"), POINTS + "0\n1 0\n2 0 1\n" + QUAD, Model(**SQUARE, warns="fewer than 3"))
ply("negative", XYZ + FACE, POINTS + "3 0 1 -1\n", Sentence("-1"))
ply("beyond", XYZ + FACE, POINTS + "3 0 1 4\n", Sentence("vertex 4"))
ply("two_lists", XYZ + FACE + "property list uchar int neighbours\n", POINTS + "4 0 1 2 3 2 7 8\n")
ply("no_faces", XYZ, POINTS, Sentence("point cloud"))
ply("faces_0", XYZ + FACE.replace(" 1", " 0"), POINTS, Sentence("point cloud"))
ply("list_other_name", XYZ + FACE.replace("vertex_indices", "vertex_list"), POINTS + QUAD, SHAPE, Sentence("vertex_indices"))
ply("polygon_other_name", XYZ + FACE.replace("element face", "element polygon"), POINTS + QUAD, SHAPE, Sentence("polygon|face"))
ply("two_dimensions", XYZ.replace("property float z\n", "") + FACE, "0 0\n1 0\n1 1\n0 1\n" + QUAD, SHAPE, Sentence("lacks"))
ply("int_vertices", XYZ.replace("float", "int") + FACE, POINTS + QUAD)
ply("scientific", XYZ + FACE, POINTS.replace("1", "1.0e+00") + QUAD)
ply("comma", XYZ + FACE, POINTS.replace("1 0 0", "1,0 0,0 0,0") + QUAD, Sentence('"1,0"'))


# STL.
def stl(name, content, *rights, **beside):
    row(f"stl_{name}.stl", content, *(rights or [SHAPE]), **beside)


TRIANGLES = [(0, 1, 2), (0, 2, 3)]


def facet(t, word="facet normal 0 0 1"):
    return word + "\nouter loop\n" + "".join("vertex %d %d %d\n" % CORNERS[i] for i in t) + "endloop\nendfacet\n"


def binary_facet(t, attributes=0, normal=(0, 0, 1)):
    return struct.pack("<12fH", *normal, *(x for i in t for x in CORNERS[i]), attributes)


FACETS = "".join(map(facet, TRIANGLES))
BINARY = b"".join(map(binary_facet, TRIANGLES))


def binary(header=b"", count=2, facets=BINARY):
    return header.ljust(80, b" ") + struct.pack("<I", count) + facets


stl("lower", "solid a\n" + FACETS + "endsolid a\n")
stl("upper", ("solid a\n" + FACETS + "endsolid a\n").upper())
stl("unnamed", "solid\n" + FACETS + "endsolid\n")
stl("utf8", "solid Größe 1 mm\n" + FACETS + "endsolid Größe 1 mm\n", Model(**SQUARE, parts=["Größe 1 mm"]))
stl("latin1", "solid Größe\n".encode("latin1") + FACETS.encode() + b"endsolid\n")
stl("tabs_cr", ("solid a\n" + FACETS + "endsolid a\n").replace(" ", "\t").replace("\n", "\r\n"))
stl("no_normal", "solid a\n" + "".join(facet(t, "facet") for t in TRIANGLES) + "endsolid a\n")
stl("nan_normal", "solid a\n" + "".join(facet(t, "facet normal -nan(ind) nan nan") for t in TRIANGLES) + "endsolid a\n")
stl("empty_solid", "solid a\nendsolid a\n", Sentence("no triangles"))
stl("no_endsolid", "solid a\n" + FACETS)
stl("cut", ("solid a\n" + FACETS)[:-30], Sentence("ends within|corners"), Model(1, warns="."))
stl("cut_behind_solid", "solid a\nfacet normal", Sentence("ends within|no triangles"))
stl("solid_binary", binary(b"solid binary"))
stl("solid_binary_extra", binary(b"solid binary") + b"more", Model(**SQUARE, warns="left out"))
stl("count_more", binary(count=3), Sentence("284|facets|would need"), Model(warns="count"))
stl("count_less", binary(count=1), Model(1, warns="left out"), SHAPE)
stl("none", binary(count=0, facets=b""), Sentence("no triangles|holds no"))
stl("nan_normals", binary(facets=b"".join(binary_facet(t, normal=(float("nan"),) * 3) for t in TRIANGLES)))
stl("gz.stl", gzip.compress(binary(b"solid x")), SHAPE)
stl("short", b"abc", Sentence("84|bytes|neither"))
stl("header_only", binary(facets=b"", count=5), Sentence("334|bytes"))
stl("magics", binary(b"COLOR=\x00\x00\xff\xff,MATERIAL=", facets=binary_facet((0, 1, 2), 31) + binary_facet((0, 2, 3), 31 << 5)),
    colored(None, pixels={(0.75, 0.25): RED, (0.25, 0.75): GREEN}))
stl("magics_all", binary(b"COLOR=\xff\x00\x00\xff", facets=binary_facet((0, 1, 2), 0x8000) + binary_facet((0, 2, 3), 0x8000)), colored(RED))
stl("viscam", binary(facets=binary_facet((0, 1, 2), 0x8000 | 31 << 10) + binary_facet((0, 2, 3), 0x8000 | 31 << 5)),
    colored(None, pixels={(0.75, 0.25): RED, (0.25, 0.75): GREEN}))
stl("one_line", "solid a " + FACETS.replace("\n", " ") + "endsolid a\n", Model(**SQUARE, parts=["a"]))
stl("one_line_upper", ("solid a " + FACETS.replace("\n", " ") + "endsolid a\n").upper(), Model(**SQUARE, parts=["A"]))
stl("no_solid", FACETS)
stl("nul_name", "solid a\0\0\n" + FACETS + "endsolid a\n")
stl("dos_end", "solid a\n" + FACETS + "endsolid a\n\x1a")
stl("quads", "solid a\nfacet normal 0 0 1\nouter loop\n" + "".join("vertex %d %d %d\n" % p for p in CORNERS) + "endloop\nendfacet\nendsolid\n")
stl("utf16", b"\xff\xfe" + ("solid a\n" + FACETS + "endsolid\n").encode("utf-16-le"), Sentence("UTF-16"), SHAPE)
stl("html", "<html><head></head></html>" + " " * 100, Sentence("web page"))


# OFF.
def off(name, content, *rights):
    row(f"off_{name}.off", content, *(rights or [SHAPE]))


O4 = "4 1 0\n"
off("plain", "OFF\n" + O4 + POINTS + QUAD)
off("lower", "off\n" + O4 + POINTS + QUAD, SHAPE, Sentence("OFF"))
off("comments", "# a\nOFF # b\n# c\n4 1 0 # d\n\n" + POINTS.replace("\n", " # v\n\n") + "\n# f\n4 0 1 2 3 # g\n")
off("coff_alpha", "COFF\n" + O4 + colors("1.0 0.0 0.0 1.0") + QUAD, colored(RED))
off("coff_bytes", "COFF\n" + O4 + colors("255 0 0 255") + QUAD, colored(RED))
off("noff", "NOFF\n" + O4 + colors("0 0 1") + QUAD)
off("cnoff", "CNOFF\n" + O4 + colors("0 0 1 255 0 0 255") + QUAD, colored(RED))
off("ncoff", "NCOFF\n" + O4 + colors("0 0 1 255 0 0 255") + QUAD, colored(RED), Sentence("."))
off("stoff", "STOFF\n" + O4 + colors("0 0") + QUAD)
off("stcnoff", "STCNOFF\n" + O4 + colors("0 0 1 255 0 0 0 0") + QUAD, colored(RED))
off("4off", "4OFF\n" + O4 + colors("1") + QUAD, SHAPE, Sentence("dimension"))
off("noff_n", "nOFF\n3\n" + O4 + POINTS + QUAD, SHAPE, Sentence("dimension"))
off("binary", b"OFF BINARY\n" + struct.pack(">3i", 4, 1, 0) + b"".join(struct.pack(">3f", *p) for p in CORNERS) + struct.pack(">5i", 4, 0, 1, 2, 3) + struct.pack(">i", 0),
    SHAPE, Sentence("binary OFF"))
off("face_index", "OFF\n" + O4 + POINTS + "4 0 1 2 3 5\n")
off("face_bytes", "OFF\n" + O4 + POINTS + "4 0 1 2 3 255 0 0\n", colored(RED))
off("face_floats", "OFF\n" + O4 + POINTS + "4 0 1 2 3 1.0 0.0 0.0\n", colored(RED))
off("face_alpha", "OFF\n" + O4 + POINTS + "4  0 1 2 3  1 0 0 1\n", colored(RED), SHAPE)
off("face_bytes_alpha", "OFF\n" + O4 + POINTS + "4  0 1 2 3  255 0 0 128\n", colored(RED))
off("concave", "OFF\n6 1 0\n0 0 0\n2 0 0\n2 1 0\n1 1 0\n1 2 0\n0 2 0\n6 0 1 2 3 4 5\n", Model(4, (0, 0, 0), (2, 2, 0), area=3))
off("glued", "OFF4 1 0\n" + POINTS + QUAD)
off("negative", "OFF\n" + O4 + POINTS + "4 0 1 2 -3\n", Sentence("-3"))
off("negative_count", "OFF\n-4 1 0\n" + POINTS + QUAD, Sentence("numbers of vertices"))
off("truncated", "OFF\n" + O4 + POINTS, Sentence("face 0"))
off("one_line", "OFF 4 1 0 " + (POINTS + QUAD).replace("\n", " "), SHAPE, Sentence("."))
off("crlf", ("OFF\n" + O4 + POINTS + QUAD).replace("\n", "\r\n"))
off("bom", "\ufeffOFF\n" + O4 + POINTS + QUAD)
off("lfs", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", Sentence("LFS"))
off("utf16", b"\xff\xfe" + ("OFF\n" + O4 + POINTS + QUAD).encode("utf-16-le"), Sentence("UTF-16"), SHAPE)
off("points", "OFF\n4 0 0\n" + POINTS, Sentence("point cloud"))


# glTF.
class Gltf:
    """A unit square, in one buffer; `parts` are added to the square's members."""

    def __init__(self, indices=struct.pack("<6H", 0, 1, 2, 0, 2, 3), kind=5123, count=6):
        self.blob = b""
        self.json = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "bufferViews": [], "accessors": []}
        primitive = {"attributes": {"POSITION": self.add(b"".join(struct.pack("<3f", *p) for p in CORNERS), 5126, "VEC3", 4)}}
        if indices:
            primitive["indices"] = self.add(indices, kind, "SCALAR", count)
        self.json["meshes"] = [{"primitives": [primitive]}]

    @property
    def primitive(self):
        return self.json["meshes"][0]["primitives"][0]

    @property
    def node(self):
        return self.json["nodes"][0]

    def add(self, values, kind, shape, count, **more):
        self.blob += b"\0" * (-len(self.blob) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(values)})
        self.blob += values
        self.json["accessors"].append({"bufferView": len(self.json["bufferViews"]) - 1, "componentType": kind, "type": shape, "count": count, **more})
        return len(self.json["accessors"]) - 1

    def text(self):
        self.json["buffers"] = [{"byteLength": len(self.blob), "uri": "data:application/octet-stream;base64," + base64.b64encode(self.blob).decode()}]
        return json.dumps(self.json)

    def glb(self, version=2, pad=b" ", size=None):
        self.json["buffers"] = [{"byteLength": len(self.blob)}]
        text = json.dumps(self.json).encode()
        text += pad * (-len(text) % 4) if pad else b""
        blob = self.blob + b"\0" * (-len(self.blob) % 4)
        all_ = 12 + 8 + len(text) + 8 + len(blob)
        return struct.pack("<4sII", b"glTF", version, all_ if size is None else size) + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob


def gltf(name, *rights, like=None, extension="gltf", text=None, **beside):
    """`like` changes the square."""
    square = Gltf()
    changed = like(square) if like else None
    square = changed if isinstance(changed, Gltf) else square
    content = text or (square.glb() if extension == "glb" else square.text())
    row(f"gltf_{name}.{extension}", content, *(rights or [SHAPE]), **beside)


def put(path, value):
    """A change of the square: the member at `path` becomes `value`."""
    def change(square):
        at = square.json
        for key in path[:-1]:
            at = at.setdefault(key, {}) if isinstance(at, dict) else at[key]
        at[path[-1]] = value
    return change


def both(*changes):
    def change(square):
        for one in changes:
            one(square)
    return change


PRIMITIVE = ("meshes", 0, "primitives", 0)
NODE = ("nodes", 0)
gltf("plain")
gltf("plain_glb", extension="glb")
gltf("named_glb_but_gltf", text=Gltf().glb())
gltf("glb_wrong_size", text=Gltf().glb(size=17), extension="glb")
gltf("glb_unpadded", text=Gltf().glb(pad=b""), extension="glb")
gltf("glb_version_1", Sentence("version 1"), text=Gltf().glb(version=1), extension="glb")
gltf("glb_cut", Sentence("ends within"), text=Gltf().glb()[:10], extension="glb")
gltf("glb_other_chunk", text=Gltf().glb().replace(struct.pack("<I4s", 60, b"BIN\0"), struct.pack("<I4s4sI4s", 4, b"XTRA", b"abcd", 60, b"BIN\0")), extension="glb")
gltf("version_number", like=put(("asset", "version"), 2.0))
gltf("version_needed", Sentence("minVersion"), like=put(("asset", "minVersion"), "3.0"))
gltf("buffer_on_the_web", Sentence("download"), text=json.dumps({**json.loads(Gltf().text()), "buffers": [{"byteLength": 60, "uri": "https://example.com/a.bin"}]}))
gltf("version_1", Sentence("glTF 2"), text='{"asset": {"version": "1.0"}, "meshes": {}}')
gltf("no_asset", Sentence("glTF"), text='{"a": 1}')
gltf("other_json", Sentence("JSON"), text='[1, 2]')
gltf("broken_json", Sentence("JSON|parse|line"), text='{"asset": {"version": "2.0"},')
gltf("ubyte_indices", like=lambda g: Gltf(bytes([0, 1, 2, 0, 2, 3]), 5121))
gltf("no_indices", Model(1), like=lambda g: Gltf(None))
gltf("strip", like=lambda g: both(put((*PRIMITIVE, "mode"), 5))(s := Gltf(struct.pack("<4H", 0, 1, 3, 2), count=4)) or s)
gltf("fan", like=lambda g: both(put((*PRIMITIVE, "mode"), 6))(s := Gltf(struct.pack("<4H", 0, 1, 2, 3), count=4)) or s)
gltf("points", Sentence("points|lines"), like=put((*PRIMITIVE, "mode"), 0))
gltf("lines_too", Model(**SQUARE, warns="left out"), like=lambda g: g.json["meshes"][0]["primitives"].append({**g.primitive, "mode": 1}))
gltf("float_counts", like=lambda g: g.json["accessors"][0].update(count=4.0, byteOffset=0.0))
gltf("matrix", Model(lower=(5, 0, 0), upper=(7, 1, 0)), like=put((*NODE, "matrix"), [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]))
gltf("negative_scale", Model(lower=(-1, 0, 0), upper=(0, 1, 0), not_black=True), like=put((*NODE, "scale"), [-1, 1, 1]))
gltf("zero_scale", Sentence("degenerate"), like=put((*NODE, "scale"), [0, 0, 0]))
gltf("rotation_not_unit", Model(lower=(-1, 0, 0), upper=(0, 1, 0)), like=put((*NODE, "rotation"), [0, 0, 2, 2]))
gltf("rotation_zero", SHAPE, like=put((*NODE, "rotation"), [0, 0, 0, 0]))
gltf("no_scene", like=lambda g: (g.json.pop("scene"), g.json.pop("scenes"))[0] and None)
gltf("no_default_scene", like=lambda g: (g.json.pop("scene"), None)[1])
gltf("shared_mesh", Model(4, (0, 0, 0), (3, 1, 0)), like=lambda g: (g.json["nodes"].append({"mesh": 0, "translation": [2, 0, 0]}), g.json["scenes"][0].update(nodes=[0, 1]), None)[2])
gltf("cycle", Sentence("child|itself"), like=lambda g: put((*NODE, "children"), [0])(g))
gltf("deep", Model(upper=(1001, 1, 0)), like=lambda g: g.json.update(nodes=[{"children": [i + 1], "translation": [1, 0, 0]} for i in range(1000)] + [{"mesh": 0}]))
gltf("scene_beyond", Sentence(r"scenes\[3\]"), like=put(("scene",), 3))
gltf("accessor_beyond", Sentence(r"accessors\[9\]"), like=put((*PRIMITIVE, "indices"), 9))
gltf("index_beyond", Sentence("vertex 7"), like=lambda g: Gltf(struct.pack("<3H", 0, 1, 7), count=3))
gltf("material_beyond", Sentence(r"materials\[2\]"), like=put((*PRIMITIVE, "material"), 2))
gltf("short_buffer", Sentence("go beyond"), like=lambda g: g.json["accessors"][0].update(count=400))
gltf("sparse", Model(upper=(1, 1, 5)), like=lambda g: (g.add(struct.pack("<2H", 2, 3), 5123, "SCALAR", 2), g.add(struct.pack("<6f", 1, 1, 5, 0, 1, 5), 5126, "VEC3", 2),
     g.json["accessors"][0].update(sparse={"count": 2, "indices": {"bufferView": 2, "componentType": 5123}, "values": {"bufferView": 3}}), None)[3])
gltf("draco_required", Model(**SQUARE), like=put(("extensionsRequired",), ["KHR_draco_mesh_compression"]))
gltf("draco_fallback", Model(**SQUARE), like=both(put(("extensionsUsed",), ["KHR_draco_mesh_compression"]), put((*PRIMITIVE, "extensions"), {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}})))
gltf("quantized", Model(upper=(1, 1, 0)), like=lambda g: (g.json.update(extensionsRequired=["KHR_mesh_quantization"]), g.primitive["attributes"].update(
    POSITION=g.add(b"".join(struct.pack("<3Bx", *(255 * x for x in p)) for p in CORNERS), 5121, "VEC3", 4, normalized=True)), g.json["bufferViews"][-1].update(byteStride=4), None)[3])
for name, expected in (("KHR_materials_clearcoat", "clearcoat"), ("KHR_materials_sheen", "sheen"), ("KHR_materials_variants", "variants"), ("KHR_xmp_json_ld", "xmp"), ("KHR_materials_iridescence", "iridescence"),
                       ("VENDOR_unknown", "VENDOR")):
    gltf("used_" + name, Model(**SQUARE, warns=expected), like=put(("extensionsUsed",), [name]))
for name in "KHR_materials_unlit", "KHR_texture_transform", "KHR_lights_punctual", "KHR_materials_ior", "KHR_materials_volume", "KHR_materials_transmission":
    gltf("required_" + name, like=put(("extensionsRequired",), [name]))


def instanced(translation=True, rotation=None, scale=None):
    def change(g):
        attributes = {"TRANSLATION": g.add(struct.pack("<6f", 0, 0, 0, 2, 0, 0), 5126, "VEC3", 2)}
        if rotation:
            attributes["ROTATION"] = g.add(struct.pack("<8b", *rotation, *rotation), 5120, "VEC4", 2, normalized=True)
        if scale:
            attributes["SCALE"] = g.add(struct.pack("<6f", *(2 * [scale] * 3)), 5126, "VEC3", 2)
        g.json["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
        g.node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    return change


gltf("instances", Model(4, (0, 0, 0), (3, 1, 0)), like=instanced())
gltf("instances_scaled", Model(4, (0, 0, 0), (2.5, 0.5, 0)), like=instanced(scale=0.5))
gltf("instances_rotated", Model(4, (-1, 0, 0), (2, 1, 0)), like=instanced(rotation=(0, 0, 90, 90)))
gltf("instances_moved_node", Model(4, (0, 0, 3), (3, 1, 3)), like=both(instanced(), put((*NODE, "translation"), [0, 0, 3])))


def skinned(inverse=False, **more):
    def change(g):
        g.primitive["attributes"]["JOINTS_0"] = g.add(bytes(16), 5121, "VEC4", 4)
        g.primitive["attributes"]["WEIGHTS_0"] = g.add(struct.pack("<16f", *([1, 0, 0, 0] * 4)), 5126, "VEC4", 4)
        g.json["skins"] = [{"joints": [1], **more}]
        g.node["skin"] = 0
        g.json["nodes"].append({"translation": [0, 0, 4]})
        g.json["scenes"][0]["nodes"] = [0, 1]
        if inverse:
            g.json["skins"][0]["inverseBindMatrices"] = g.add(struct.pack("<16f", 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -4, 1), 5126, "MAT4", 1)
    return change


gltf("skin_no_matrices", Model(lower=(0, 0, 4), upper=(1, 1, 4)), like=skinned())
gltf("skin_at_rest", like=skinned(True))
gltf("skin_skeleton", like=skinned(True, skeleton=1))
gltf("morph_default", like=lambda g: g.primitive.update(targets=[{"POSITION": 0}]))
gltf("morph_mesh_weight", Model(upper=(2, 2, 0)), like=lambda g: (g.primitive.update(targets=[{"POSITION": 0}]), g.json["meshes"][0].update(weights=[1]), None)[2])


def material(**members):
    return lambda g: (g.json.update(materials=[members]), g.primitive.update(material=0), None)[2]


UNLIT = {"KHR_materials_unlit": {}}
gltf("red", colored(RED), like=material(pbrMetallicRoughness={"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 0}, extensions=UNLIT))
gltf("mask_below", Model(**SQUARE), like=material(alphaMode="MASK", pbrMetallicRoughness={"baseColorFactor": [1, 0, 0, 0.2]}))
gltf("blend", Model(**SQUARE, not_black=True), like=material(alphaMode="BLEND", doubleSided=True, pbrMetallicRoughness={"baseColorFactor": [1, 0, 0, 0.5]}))
gltf("emissive", Model(**SQUARE, not_black=True), like=material(emissiveFactor=[1, 1, 1], pbrMetallicRoughness={"baseColorFactor": [0, 0, 0, 1]}))
gltf("glossiness", colored(None, pixels={}), like=material(extensions={"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 0, 0, 1], "specularFactor": [0, 0, 0]}}))
gltf("null_members", like=lambda g: (g.json.update(extensionsUsed=[], animations=[], materials=[]), g.node.update(name=None), None)[2])
gltf("camera", like=lambda g: (g.json.update(cameras=[{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]), g.json["nodes"].append({"camera": 0}), g.json["scenes"][0].update(nodes=[0, 1]), None)[3])
gltf("buffer_lfs", Sentence("LFS"), text=json.dumps({**json.loads(Gltf().text()), "buffers": [{"byteLength": 60, "uri": "my.bin"}]}),
     my__bin="version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
gltf("lfs", Sentence("LFS"), text="version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
gltf("lfs_glb", Sentence("LFS"), text="version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", extension="glb")
gltf("utf16", Sentence("UTF-16"), SHAPE, text=b"\xff\xfe" + Gltf().text().encode("utf-16-le"))
row("gltf_packed.gltf.gz", gzip.compress(Gltf().text().encode()), Sentence("not packed|unpack"), SHAPE)


# Files that are no models.
def foreign(file, content, *says):
    row(file, content, Sentence(says[0]))


def archive(kind):
    out = io.BytesIO()
    if kind == "zip":
        with zipfile.ZipFile(out, "w") as into:
            into.writestr("a.obj", OBJ)
    else:
        with tarfile.open(fileobj=out, mode=kind) as into:
            info = tarfile.TarInfo("a.obj")
            info.size = len(OBJ)
            into.addfile(info, io.BytesIO(OBJ.encode()))
    return out.getvalue()


foreign("a.zip", archive("zip"), "zip.*unpack")
foreign("a.glb", archive("zip"), "zip.*unpack")
foreign("a.tar", archive("w"), "tar archive.*unpack")
foreign("a.tar.gz", archive("w:gz"), "tar archive.*unpack")
foreign("a.tgz", archive("w:gz"), "tar archive.*unpack")
foreign("a.obj.bz2", bz2.compress(OBJ.encode()), "bzip2")
foreign("a.stl.xz", lzma.compress(OBJ.encode()), "xz -d")
foreign("a.ply.lzma", lzma.compress(OBJ.encode(), format=lzma.FORMAT_ALONE), "LZMA")
foreign("a.obj.Z", b"\x1f\x9d\x90" + bytes(100), "compress")
foreign("a.rar", b"Rar!\x1a\x07\x01\0" + bytes(50), "RAR")
foreign("a.7z", b"7z\xbc\xaf\x27\x1c\0\4" + bytes(50), "7z")
foreign("a.lz4", b"\x04\x22\x4d\x18" + bytes(50), "LZ4")
row("double.obj.gz.gz", gzip.compress(gzip.compress(OBJ.encode())), Sentence("twice"), SHAPE)
row("tail.obj.gz", gzip.compress(OBJ.encode()) + bytes(512), SHAPE)
row("junk.obj.gz", gzip.compress(OBJ.encode()) + b"junk at the end", SHAPE, Sentence("gzip"))
row("cut.obj.gz", gzip.compress((OBJ * 500).encode())[:-20], Sentence("too early"))
def zstd(content, window_log):
    """One raw block of Zstandard, in a frame that wants such a window."""
    return b"\x28\xb5\x2f\xfd\0" + bytes([(window_log - 10) << 3]) + (len(content) << 3 | 1).to_bytes(3, "little") + content


row("window_27.obj.zst", zstd(OBJ.encode(), 27), SHAPE)
row("window_28.obj.zst", zstd(OBJ.encode(), 28), Sentence("window.*zstd -d --long=28"))
row("cut.obj.zst", zstd(OBJ.encode(), 20)[:-9], Sentence("too early"))
row("twice.obj.zst.gz", gzip.compress(zstd(OBJ.encode(), 20)), Sentence("twice"), SHAPE)
row("not.obj.gz", OBJ, SHAPE)
for name, magic in ("b3dm", b"b3dm"), ("i3dm", b"i3dm"), ("pnts", b"pnts"), ("cmpt", b"cmpt"):
    foreign("a." + name, magic + struct.pack("<I", 1) + bytes(60), "3D Tiles")
foreign("tileset.json", '{"asset": {"version": "1.0"}, "geometricError": 500, "root": {}}', "3D Tiles|JSON")
foreign("a.pcd", "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n", "point cloud")
foreign("b.pcd", "VERSION 0.7\nFIELDS x y z\n", "point cloud")
foreign("a.e57", b"ASTM-E57" + bytes(100), "point cloud")
foreign("a.laz", b"LASF" + bytes(100), "point cloud")
foreign("a.xyz", "0 0 0\n1 0 0\n0 1 0\n", "point cloud")
foreign("a.pts", "3\n0 0 0 10 255 0 0\n1 0 0 10 255 0 0\n0 1 0 10 255 0 0\n", "point cloud")
foreign("a.asc", "0.5 0.25 0.1\n1.5 0 0\n", "point cloud|[Gg]rid")
foreign("a.csv", "x,y,z\n0,0,0\n1,0,0\n", "point cloud|table")
foreign("a.ptx", "2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n", "point cloud")
foreign("a.splat", bytes(range(64)), "splat")
foreign("a.ksplat", bytes(64), "splat")
foreign("a.spz", gzip.compress(b"NGSP" + bytes(60)), "splat")
foreign("a.usda", "#usda 1.0\n", "USD.*Blender")
foreign("a.usdc", b"PXR-USDC" + bytes(80), "USD")
foreign("a.usd", b"PXR-USDC" + bytes(80), "USD")
foreign("long_header.ifc", "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('" + "x" * 3000 + "'),'2;1');\nFILE_SCHEMA(('IFC4'));\nENDSEC;\n", "IFC.*IfcConvert")
foreign("a.jt", b"Version 10.0 JT  DM 1.0.0.0".ljust(80) + bytes(20), "JT.*STEP")
foreign("a.x_b", b"PS\0\0\0" + bytes(60), "Parasolid.*STEP")
foreign("a.ifczip", archive("zip"), "IFC.*IfcConvert")
foreign("a.step", "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\n", "STEP")
foreign("a.ifc", "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC2X3'));\nENDSEC;\n", "IFC.*IfcConvert")
foreign("a.igs", " " * 72 + "S      1\n" + "1H,,1H;,4Hpart".ljust(72) + "G      1\n", "IGES")
foreign("a.iges", "A part from a program".ljust(72) + "S0000001\n", "IGES")
foreign("a.vtk", "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\n", "VTK")
foreign("a.vti", '<?xml version="1.0"?>\n<VTKFile type="ImageData">\n', "VTK")
foreign("a.abc", b"Ogawa\xff\0\1" + bytes(50), "Alembic")
foreign("a.h5", b"\x89HDF\r\n\x1a\n" + bytes(50), "HDF5")
foreign("a.blend", b"BLENDER-v300" + bytes(50), "Blender")
foreign("a.blend.gz", gzip.compress(b"BLENDER-v300" + bytes(50)), "Blender")
foreign("a.max", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "3ds Max|SolidWorks")
foreign("a.c4d", b"QC4DC4D6" + bytes(50), "Cinema 4D")
foreign("a.skp", b"\xff\xfe\xff\x0eS\0k\0e\0t\0c\0h\0U\0p\0 \0M\0o\0d\0e\0l\0" + bytes(50), "SketchUp")
foreign("a.rvt", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "Revit")
foreign("a.prt", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "3ds Max|SolidWorks")
foreign("a.f3d", archive("zip"), "Fusion")
foreign("a.fcstd", archive("zip"), "FreeCAD")
foreign("a.kmz", archive("zip"), "unpack")
foreign("a.dae.gz", gzip.compress(b'<?xml version="1.0"?><COLLADA/>'), "unpack it first")
foreign("a.dwg", b"AC1032" + bytes(100), "DWG")
foreign("a.dgn", b"\x08\x09\xfe\x02" + bytes(100), "DGN|MicroStation")
foreign("a.3dm", b"3D Geometry File Format        70" + bytes(20), "Rhino")
foreign("a.x_t", "**ABCDEFGHIJKLMNOPQRSTUVWXYZ[\\]^_`abcdefghijklmnopqrstuvwxyz{|}~0123456789*\n**PARASOLID\n", "Parasolid")
foreign("a.sat", "700 0 1 0\n@8 FreeCAD 6 ACIS 7 24 Mon\n", "ACIS")
foreign("a.brep", "DBRep_DrawableShape\n\nCASCADE Topology V1\n", "BREP|exact")
foreign("a.ma", "//Maya ASCII 2020 scene\n", "Maya")
foreign("a.mb", b"FOR8" + bytes(12) + b"MAYA" + bytes(40), "Maya")
foreign("a.scad", "cube([1,1,1]);\n", "OpenSCAD|neither")
foreign("a.drc", b"DRACO\2\2\1\1" + bytes(50), "Draco")
foreign("a.msh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", "Gmsh")
foreign("a.mesh", "MeshVersionFormatted 2\nDimension 3\n", "Medit")
foreign("a.vdb", b" BDV\0\0\0\0" + bytes(50), "OpenVDB")
foreign("a.uasset", b"\xc1\x83\x2a\x9e" + bytes(50), "Unreal")
foreign("a.unity", "%YAML 1.1\n%TAG !u! tag:unity3d.com,2011:\n", "Unity")
foreign("a.png", b"\x89PNG\r\n\x1a\n" + bytes(50), "PNG")
foreign("b.obj", b"\xff\xd8\xff\xe0" + bytes(50), "JPEG")
foreign("exr.ply", b"\x76\x2f\x31\x01" + bytes(50), "EXR")
foreign("hdr.obj", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", "image")
foreign("a.tif", b"II*\0" + bytes(50), "TIFF")
foreign("a.webp", b"RIFF\0\0\0\0WEBPVP8 " + bytes(50), "WebP")
foreign("a.gif", b"GIF89a" + bytes(50), "GIF")
foreign("a.mp4", b"\0\0\0\x20ftypisom" + bytes(50), "film|video")
foreign("a.exe", b"MZ\x90\0" + bytes(100), "program")
foreign("a.so", b"\x7fELF\2\1\1" + bytes(100), "program")
foreign("a.npy", b"\x93NUMPY\1\0" + bytes(100), "NumPy")
foreign("a.dcm", bytes(128) + b"DICM" + bytes(50), "DICOM")
foreign("a.nii", struct.pack("<I", 348) + bytes(340) + b"n+1\0" + bytes(50), "NIfTI")
foreign("a.u3d", b"U3D\0" + bytes(50), "U3D")
foreign("a.pdf", "%PDF-1.7\n", "PDF")
foreign("a.mtl", "# Blender MTL\nnewmtl a\nKd 1 0 0\n", "material library")
foreign("a.ctm", b"OCTM\5\0\0\0" + bytes(50), "OpenCTM|neither|Assimp")
foreign("a.bin", bytes(range(256)), "none of the formats that are read: PLY, OBJ")
foreign("zeros.ply", bytes(1000), "zero|PLY|ply")
foreign("zeros.obj", bytes(1000), "zero")
foreign("zeros.stl", bytes(1000), "zero|count|facets")
foreign("zeros.glb", bytes(1000), "zero|glTF|GLB|JSON")
foreign("zeros.off", bytes(1000), "zero|numbers")


# Models by Assimp.
def dae(name, *rights, up="Y_UP", unit=1, node="", colors_=False, effect='<diffuse><color>1 0 0 1</color></diffuse>', twice=""):
    floats = lambda values: f'<float_array id="{{0}}a" count="{len(values)}">{" ".join(map(str, values))}</float_array>'
    positions = [x for p in CORNERS for x in p]
    source = f'<source id="p"><float_array id="pa" count="12">{" ".join(map(str, positions))}</float_array><technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
    row(f"dae_{name}.dae", f'''<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="u" meter="{unit}"/><up_axis>{up}</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert>{effect}</lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m" name="Red"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>{source}<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2" material="s"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 0 2 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node id="n" name="Square">{node}<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="s" target="#m"/></technique_common></bind_material></instance_geometry></node>{twice}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>''', *(rights or [SHAPE]))


dae("plain", colored(RED, materials=["Red"]))
dae("z_up", Model(lower=(0, 0, -1), upper=(1, 0, 0)), SHAPE, up="Z_UP")
dae("moved", Model(lower=(2, 0, 0), upper=(3, 1, 0)), node="<translate>2 0 0</translate>")
dae("twice", Model(4, (0, 0, 0), (4, 1, 0)), twice='<node id="k"><translate>3 0 0</translate><instance_geometry url="#g"/></node>')
row("dae_broken.dae", "<?xml version='1.0'?><COLLADA>", Sentence("Assimp|COLLADA"))
row("dae_html.dae", "<html><body>404</body></html>", Sentence("web page"))
row("fbx_cut.fbx", b"Kaydara FBX Binary  \0\x1a\0" + struct.pack("<I", 7400) + bytes(20), Sentence("Assimp|FBX"))
row("a.3ds", b"MM" + struct.pack("<I", 500) + bytes(10), Sentence("Assimp|3DS"))
row("cut.3mf", archive("zip")[:-30], Sentence("3MF"))
row("other.3mf", archive("zip"), Sentence("3MF"))


def three_mf(model, extension="3mf", name="3D/3dmodel.model"):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as into:
        into.writestr("[Content_Types].xml", '<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types"><Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>')
        into.writestr("_rels/.rels", f'<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Target="/{name}" Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>')
        into.writestr(name, model)
    return out.getvalue()


def mf(name, *rights, unit="millimeter", resources="", face="", build='<item objectid="1"/>', objects=""):
    vertices = "".join('<vertex x="%d" y="%d" z="%d"/>' % p for p in CORNERS)
    row(f"mf_{name}.3mf", three_mf(f'<?xml version="1.0"?><model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>{resources}<object id="1" type="model"{face}><mesh><vertices>{vertices}</vertices><triangles><triangle v1="0" v2="1" v3="2"/><triangle v1="0" v2="2" v3="3"/></triangles></mesh></object>{objects}</resources><build>{build}</build></model>'), *(rights or [SHAPE]))


mf("plain")
mf("grey", colored((128, 128, 128)), resources='<basematerials id="5"><base name="Grey" displaycolor="#808080"/></basematerials>', face=' pid="5" pindex="0"')
mf("components", Model(4, (0, 0, 0), (4, 1, 0)), objects='<object id="2" type="model"><components><component objectid="1"/><component objectid="1" transform="1 0 0 0 1 0 0 0 1 3 0 0"/></components></object>', build='<item objectid="2"/>')
row("amf.amf", '<?xml version="1.0"?><amf unit="millimeter"><object id="0"><mesh><vertices>' + "".join(f"<vertex><coordinates><x>{x}</x><y>{y}</y><z>{z}</z></coordinates></vertex>" for x, y, z in CORNERS)
    + "</vertices><volume><triangle><v1>0</v1><v2>1</v2><v3>2</v3></triangle><triangle><v1>0</v1><v2>2</v2><v3>3</v3></triangle></volume></mesh></object></amf>", SHAPE)
row("x3d.x3d", '<?xml version="1.0"?><X3D version="3.0"><Scene><Shape><IndexedFaceSet coordIndex="0 1 2 3 -1"><Coordinate point="0 0 0 1 0 0 1 1 0 0 1 0"/></IndexedFaceSet></Shape></Scene></X3D>', SHAPE, Sentence("X3D"))
row("dxf.dxf", "0\nSECTION\n2\nENTITIES\n0\n3DFACE\n8\n0\n10\n0\n20\n0\n30\n0\n11\n1\n21\n0\n31\n0\n12\n1\n22\n1\n32\n0\n13\n0\n23\n1\n33\n0\n0\nENDSEC\n0\nEOF\n", Model(lower=(0, 0, -1), upper=(1, 0, 0)))


# Far from the origin, and names of files.
def far(name, file, content):
    row(f"far_{name}.{file}", content, Model(extent=(0.5, 0.5, 0), within=1e-4))


def near(x):
    return (x[0] * 0.5 + 452345.25, x[1] * 0.5 + 5411234.75, x[2] + 300.5)


far("utm", "obj", "".join("v %.3f %.3f %.3f\n" % near(p) for p in CORNERS) + "f 1 2 3 4\n")
far("utm", "off", "OFF\n" + O4 + "".join("%.3f %.3f %.3f\n" % near(p) for p in CORNERS) + QUAD)
far("utm_double", "ply", "ply\nformat ascii 1.0\n" + XYZ.replace("float", "double") + FACE + "end_header\n" + "".join("%.3f %.3f %.3f\n" % near(p) for p in CORNERS) + QUAD)
far("utm_ascii", "stl", "solid a\n" + "".join("facet normal 0 0 1\nouter loop\n" + "".join("vertex %.3f %.3f %.3f\n" % near(CORNERS[i]) for i in t) + "endloop\nendfacet\n" for t in TRIANGLES) + "endsolid\n")
for name in "a b.obj", "a#b.obj", "a%20b.obj", "a?b.obj", "-a.obj", "größe 你好.obj", "a'b\"c.obj", "a\\b.obj", ".obj", "obj", "a.OBJ", "a.obj.txt":
    row(name, OBJ, SHAPE)
for name in "sp ace", "per%20cent", "ha#sh", "umläut":
    g = Gltf()
    g.text()
    g.json["buffers"] = [{"byteLength": len(g.blob), "uri": name.replace("%", "%25").replace("#", "%23").replace(" ", "%20") + ".bin"}]
    row(f"gltf_buffer_{name}.gltf", json.dumps(g.json), SHAPE, **{name + "__bin": g.blob})


row("far_coarse.obj", "".join("v %.3f %.3f %.3f\n" % (0.05 * x + far, 0.05 * y, z) for far in (0, 400000) for x, y, z in CORNERS) + "f 1 2 3 4\nf 5 6 7 8\n", Model(4, warns="are kept to"), Model(4, warns="kept to", dropped=2))
row("far_millimetres.obj", "".join("v %.3f %.3f %.3f\n" % (1.2 * x + far, 1.3 * y, z) for far in (0, 20000) for x, y, z in CORNERS) + "f 1 2 3 4\nf 5 6 7 8\n", Model(4, silent=True))
mf("without_items", Model(warns="build shows no object", **SQUARE), build='')


class MoreCases(ModelCase):
    def complaint(self, number):
        """The fault of a row's outcome, in a folder of its own; None: no fault."""
        file, content, rights, beside = ROWS[number]
        own = copy.copy(self)
        own.number = number
        own.folder = self.folder / str(number)
        own.folder.mkdir()
        for name, bytes_ in {**beside, file: content}.items():
            (own.folder / name).write_bytes(bytes_)
        model = ["--", file] if file.startswith("-") else [own.path(file)]
        try:
            done = self.run_program("quarry-preprocess", "-o", own.path("x.quarry"), "--threads", 1, *model, cwd=own.folder)
            own.check_one_of(rights, done, file)
        except Exception as error:
            return str(error)
        return None

    def test_each_is_read_right_or_refused_with_a_sentence(self):
        self.assertEqual(len(ROWS), len({file for file, *_ in ROWS}), "a name twice")
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            for (file, *_), complaint in zip(ROWS, pool.map(self.complaint, range(len(ROWS)))):
                with self.subTest(file=file):
                    self.assertIsNone(complaint)


if __name__ == "__main__":
    main()

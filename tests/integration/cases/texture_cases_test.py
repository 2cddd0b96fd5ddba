"""Kinds of textures, of their coordinates and of their files' names, in models that are written here: one row a case. The texture has four quarters, red
and green above blue and yellow; most rows say that this picture is seen."""
import itertools
import os
import pathlib
import random
import struct
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.cases import more_cases_test as more
from tests.integration.cases.model_cases import BACKGROUND, GREEN, RED, SQUARE, Model, Sentence, colored
from tests.integration.cases.more_cases_test import BLUE, CORNERS, UV_OBJ, XYZ, YELLOW, Gltf, gltf, put, row
from tests.integration.programs import main
from tests.support.models import textured_scene

more.ROWS.clear()  # the rows of the other file, whose writers this file shares

WHOLE = os.environ.get("QUARRY_CASES_WHOLE") == "1"
SIDE = 16
ROWS = [(RED, GREEN)] * 8 + [(BLUE, YELLOW)] * 8  # of halves
PIXELS = [[half for half in halves for _ in range(8)] for halves in ROWS]
PLACES = ((0.25, 0.75), (0.75, 0.75), (0.25, 0.25), (0.75, 0.25))  # of the quarters in the square, the upper left first
NONE = BACKGROUND


def quarters(*colors, **options):
    return Model(**{**SQUARE, "pixels": dict(zip(PLACES, colors)), **options})


PICTURE = quarters(RED, GREEN, BLUE, YELLOW, silent=True)
CUT = quarters(NONE, GREEN, NONE, YELLOW)  # the left half has no opacity


# Images.
def png(kind, depth, rows, *before):
    return textured_scene.png(SIDE, len(rows), lambda y: rows[y], depth=depth, kind=kind, before=before)


def each(of_pixel, rows=PIXELS):
    return [b"".join(of_pixel(p) for p in r) for r in rows]


INDEX = {RED: 0, GREEN: 1, BLUE: 2, YELLOW: 3}
PALETTE = b"".join(bytes(c) for c in INDEX)
WITH_ALPHA = each(lambda p: bytes((*p, 0 if p in (RED, BLUE) else 255)))
IMAGES = {
    "rgb.png": png(2, 8, each(bytes)),
    "rgba.png": png(6, 8, each(lambda p: bytes((*p, 255)))),
    "rgb16.png": png(2, 16, each(lambda p: b"".join(bytes((c, c)) for c in p))),
    "rgba16.png": png(6, 16, each(lambda p: b"".join(bytes((c, c)) for c in (*p, 255)))),
    "palette8.png": png(3, 8, each(lambda p: bytes((INDEX[p],))), (b"PLTE", PALETTE)),
    "palette4.png": png(3, 4, [bytes(a << 4 | b for a, b in zip(r[::2], r[1::2])) for r in [[INDEX[p] for p in r] for r in PIXELS]], (b"PLTE", PALETTE)),
    "palette2.png": png(3, 2, [bytes(r[i] << 6 | r[i + 1] << 4 | r[i + 2] << 2 | r[i + 3] for i in range(0, SIDE, 4)) for r in [[INDEX[p] for p in r] for r in PIXELS]], (b"PLTE", PALETTE)),
    "gamma1.png": png(2, 8, each(bytes), (b"gAMA", struct.pack(">I", 100000))),
    "gamma045.png": png(2, 8, each(bytes), (b"gAMA", struct.pack(">I", 45455))),
    "srgb.png": png(2, 8, each(bytes), (b"sRGB", b"\0")),
    "density.png": png(2, 8, each(bytes), (b"pHYs", struct.pack(">IIB", 1, 300, 1))),
    "ascii.ppm": f"P3 {SIDE} {SIDE} 255\n" + "\n".join(" ".join("%d %d %d" % p for p in r) for r in PIXELS) + "\n",
    "comment.ppm": f"P6\n# a comment\n{SIDE} {SIDE}\n255\n".encode() + b"".join(each(bytes)),
}


def tga(kind, depth, right, top, of_pixel, header_more=b"\0" * 5, palette=b""):
    """`right`, `top`: whether the first pixel is there. Packed kinds repeat runs of eight."""
    rows = PIXELS if top else PIXELS[::-1]
    rows = [r[::-1] for r in rows] if right else rows
    data = b"".join(of_pixel(p) for r in rows for p in r)
    if kind >= 9:
        data = b"".join(bytes((0x80 | 7,)) + of_pixel(r[i]) for r in rows for i in (0, 8))
    return bytes((0, bool(palette), kind)) + header_more + struct.pack("<HHHHBB", 0, 0, SIDE, SIDE, depth, top << 5 | right << 4 | (8 if depth == 32 else 0)) + palette + data


bgr = lambda p: bytes(p[::-1])
for right, top in itertools.product((0, 1), (0, 1)):
    for kind in 2, 10:
        IMAGES[f"t{kind}_24_{right}{top}.tga"] = tga(kind, 24, right, top, bgr)
    IMAGES[f"t2_32_{right}{top}.tga"] = tga(2, 32, right, top, lambda p: bgr(p) + b"\xff")
for kind in 1, 9:
    IMAGES[f"t{kind}_palette.tga"] = tga(kind, 8, 0, 1, lambda p: bytes((INDEX[p],)), struct.pack("<HHB", 0, 4, 24), b"".join(bgr(c) for c in INDEX))


def bmp(depth, down, rows, palette=b""):
    body = b"".join(r + b"\0" * (-len(r) % 4) for r in (rows if down else rows[::-1]))
    begin = 54 + len(palette)
    return (b"BM" + struct.pack("<IHHI", begin + len(body), 0, 0, begin)
            + struct.pack("<IiiHHIIiiII", 40, SIDE, -SIDE if down else SIDE, 1, depth, 0, len(body), 2835, 2835, len(palette) // 4, 0) + palette + body)


IMAGES["up24.bmp"] = bmp(24, False, each(bgr))
IMAGES["up32.bmp"] = bmp(32, False, each(lambda p: bgr(p) + b"\xff"))
IMAGES["down24.bmp"] = bmp(24, True, each(bgr))
IMAGES["palette.bmp"] = bmp(8, False, each(lambda p: bytes((INDEX[p],))), b"".join(bgr(c) + b"\0" for c in INDEX))


def obj(name, mtl, *rights, content="mtllib my.mtl\n" + UV_OBJ, **beside):
    row(f"{name}.obj", content, *(rights or [PICTURE]), my__mtl=mtl, **beside)


RGB = IMAGES["rgb.png"]
HOLES = png(6, 8, WITH_ALPHA)
for name, image in IMAGES.items():
    obj("image_" + name.replace(".", "_"), f"newmtl m\nmap_Kd {name}\n", **{name.replace(".", "__"): image})

# Names of images.
for number, name in enumerate(("./t.png", ".\\t.png", "T.PNG", "t.png ", '"t.png"', "C:\\plant\\textures\\t.png", "C:/plant/t.png", "/home/other/t.png", "../gone/t.png", "..\\..\\t.png", "\\\\server\\share\\t.png")):
    obj(f"name_{number}_" + "".join(c if c.isalnum() else "_" for c in name), f"newmtl m\nmap_Kd {name}\n", t__png=RGB)
obj("name_blanks", "newmtl m\nmap_Kd my big  tex.png\n", **{"my big  tex__png": RGB})
obj("name_umlaut", "newmtl m\nmap_Kd größe.png\n", größe__png=RGB)
obj("name_hash", "newmtl m\nmap_Kd a#1.png\n", **{"a#1__png": RGB})
for option in "-s 1 1 1", "-o 0 0 0", "-clamp on", "-clamp off", "-blendu off", "-blendv on", "-mm 0 1", "-texres 64", "-boost 2", "-cc on", "-type sphere", "-s 1", "-o 1 1", "-s -1 -1":
    turned = quarters(YELLOW, BLUE, GREEN, RED) if option == "-s -1 -1" else PICTURE
    for where, line in ("before", f"{option} t.png"), ("behind", f"t.png {option}"):
        obj(f"option_{where}_{''.join(c if c.isalnum() else '_' for c in option)}", f"newmtl m\nmap_Kd {line}\n", turned, t__png=RGB)

# Alpha of the colour's image.
obj("alpha_in_color_alone", "newmtl m\nmap_Kd t.png\n", CUT, t__png=HOLES)
obj("alpha_in_palette_alone", "newmtl m\nmap_Kd t.png\n", CUT, t__png=png(3, 8, each(lambda p: bytes((INDEX[p],))), (b"PLTE", PALETTE), (b"tRNS", bytes((0, 255, 0, 255)))))
obj("alpha_in_tga_alone", "newmtl m\nmap_Kd t.tga\n", CUT, t__tga=tga(2, 32, 0, 1, lambda p: bgr(p) + (b"\0" if p in (RED, BLUE) else b"\xff")))
obj("alpha_of_another_image", "newmtl m\nmap_Kd t.png\nmap_d white.png\n", PICTURE, t__png=HOLES, white__png=png(0, 8, [b"\xff" * SIDE] * SIDE))
obj("alpha_and_dissolve", "newmtl m\nd 1\nmap_Kd t.png\n", CUT, t__png=HOLES)
obj("alpha_of_one_channel", "newmtl m\nmap_Kd -imfchan r t.png\n", quarters((255, 255, 255), (0, 0, 0), (0, 0, 0), (255, 255, 255)), t__png=HOLES)


# glTF: sets of coordinates, wraps, transforms, alpha of vertices.
UNLIT = {"KHR_materials_unlit": {}}
UP = [(x, 1 - y) for x, y, _ in CORNERS]  # glTF's v runs down
TURNED = [(1 - u, 1 - v) for u, v in UP]


def pairs(values):
    return struct.pack("<8f", *(x for pair in values for x in pair))


def textured(base, sets, extensions=UNLIT, sampler=None, **material):
    """A square with the texture; `sets`: coordinates by number."""
    def change(g):
        for number, uvs in sets.items():
            g.primitive["attributes"][f"TEXCOORD_{number}"] = g.add(pairs(uvs), 5126, "VEC2", 4)
        g.json.update(images=[{"uri": "t.png"}], textures=[{"source": 0, **({"sampler": 0} if sampler else {})}], extensionsUsed=["KHR_materials_unlit", "KHR_texture_transform"],
                      materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **base}}, "extensions": extensions, **material}])
        if sampler:
            g.json["samplers"] = [sampler]
        g.primitive["material"] = 0
    return change


def seen(name, change, *rights, image=RGB):
    gltf(name, *(rights or [PICTURE]), like=change, t__png=image)


seen("set_0", textured({}, {0: UP}))
for number in 1, 2, 7:
    seen(f"set_{number}", textured({"texCoord": number}, {number: UP}))
    seen(f"set_{number}_of_two", textured({"texCoord": number}, {0: TURNED, number: UP}), quarters(RED, GREEN, BLUE, YELLOW, warns='attributes "TEXCOORD_0"'))
seen("set_by_transform", textured({"texCoord": 0, "extensions": {"KHR_texture_transform": {"texCoord": 1}}}, {1: UP}))
seen("set_that_is_not_there", textured({"texCoord": 3}, {0: UP}), Model(**SQUARE))
seen("set_below_zero", textured({"texCoord": -1}, {0: UP}), Model(**SQUARE))
seen("sets_mixed", textured({"texCoord": 1}, {0: TURNED, 1: UP}, emissiveTexture={"index": 0, "texCoord": 0}), quarters(RED, GREEN, BLUE, YELLOW, warns="more than one set.*TEXCOORD_1"))
seen("set_of_the_emission_alone", lambda g: (textured({}, {1: UP}, {}, emissiveFactor=[1, 1, 1], emissiveTexture={"index": 0, "texCoord": 1})(g),
     g.json["materials"][0].update(pbrMetallicRoughness={"baseColorFactor": [0, 0, 0, 1]}))[0], Model(**SQUARE, not_black=False))
WRAPS = {10497: lambda x: x % 1, 33071: lambda x: min(max(x, 0), 1), 33648: lambda x: abs((x + 1) % 2 - 1)}
for s, t in itertools.product(WRAPS, WRAPS):
    color = lambda p: PICTURE.pixels[(0.25 if WRAPS[s](p[0] + 1) < 0.5 else 0.75, 0.75 if WRAPS[t](2 - p[1]) < 0.5 else 0.25)]
    seen(f"wrap_{s}_{t}", textured({}, {0: [(u + 1, v + 1) for u, v in UP]}, sampler={"wrapS": s, "wrapT": t}), quarters(*(color(p) for p in PLACES)))
for name, transform, right in (("offset", {"offset": [0.5, 0]}, (GREEN, RED, YELLOW, BLUE)), ("scale", {"scale": [-1, 1]}, (GREEN, RED, YELLOW, BLUE)),
                               ("half_turn", {"rotation": 3.14159265, "offset": [1, 1]}, (YELLOW, BLUE, GREEN, RED)), ("none", {}, (RED, GREEN, BLUE, YELLOW))):
    seen("transform_" + name, textured({"extensions": {"KHR_texture_transform": transform}}, {0: UP}), quarters(*right))


def vertex_alpha(kind, alphas, **material):
    """Colours of the vertices: white, with these alphas."""
    pack = {5121: ("4B", 255), 5123: ("4H", 65535), 5126: ("4f", 1)}[kind]
    def change(g):
        scaled = lambda x: x * pack[1] if kind == 5126 else round(x * pack[1])
        g.primitive["attributes"]["COLOR_0"] = g.add(b"".join(struct.pack("<" + pack[0], *(scaled(c) for c in (1, 1, 1, a))) for a in alphas), kind, "VEC4", 4, normalized=kind != 5126)
        g.json.update(materials=[{"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}, "extensions": UNLIT, **material}], extensionsUsed=["KHR_materials_unlit"])
        g.primitive["material"] = 0
    return change


GONE = Sentence("cut all 2 out")
for kind in 5121, 5123, 5126:
    gltf(f"vertex_alpha_{kind}_opaque", colored(GREEN), like=vertex_alpha(kind, [0.3] * 4))
    gltf(f"vertex_alpha_{kind}_mask", GONE, Model(**SQUARE), like=vertex_alpha(kind, [0.3] * 4, alphaMode="MASK"))
    gltf(f"vertex_alpha_{kind}_mask_passes", colored(GREEN), like=vertex_alpha(kind, [0.3] * 4, alphaMode="MASK", alphaCutoff=0.25))
    gltf(f"vertex_alpha_{kind}_one", colored(GREEN, materials=["material 0"]), like=vertex_alpha(kind, [1] * 4, alphaMode="BLEND"))
    gltf(f"vertex_alpha_{kind}_blend", Model(**SQUARE, materials=["material 0"] + [f"material 0, alpha {i}/16" for i in range(16)]), like=vertex_alpha(kind, [0.5] * 4, alphaMode="BLEND"))


# COLLADA: bindings of coordinates.
def dae(name, *rights, texcoord="UV", bound='<bind_vertex_input semantic="UV" input_semantic="TEXCOORD" input_set="0"/>', sets=(0,), file="t.png"):
    floats = lambda key, values, names: (f'<source id="{key}"><float_array id="{key}a" count="{len(values)}">{" ".join(map(str, values))}</float_array><technique_common><accessor source="#{key}a" '
                                         f'count="4" stride="{len(names)}">' + "".join(f'<param name="{n}" type="float"/>' for n in names) + "</accessor></technique_common></source>")
    right, wrong = [x for x, y, _ in CORNERS for x in (x, y)], [x for x, y, _ in CORNERS for x in (1 - x, 1 - y)]
    inputs = "".join(f'<input semantic="TEXCOORD" source="#u{n}" offset="0" set="{n}"/>' for n in sets)
    sources = "".join(floats(f"u{n}", right if n == sets[-1] else wrong, "ST") for n in sets)
    row(f"dae_{name}.dae", f'''<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="1"/><up_axis>Y_UP</up_axis></asset>
<library_images><image id="i"><init_from>{file}</init_from></image></library_images><library_effects><effect id="e"><profile_COMMON><newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="p"><sampler2D><source>s</source></sampler2D></newparam><technique sid="c"><lambert><diffuse><texture texture="p" texcoord="{texcoord}"/></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m" name="Wood"><instance_effect url="#e"/></material></library_materials><library_geometries><geometry id="g"><mesh>{floats("p", [c for p in CORNERS for c in p], "XYZ")}{sources}
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="2" material="x"><input semantic="VERTEX" source="#v" offset="0"/>{inputs}<p>0 1 2 0 2 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node id="n"><instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="x" target="#m">{bound}</instance_material></technique_common></bind_material>
</instance_geometry></node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>''', *(rights or [PICTURE]), t__png=RGB)


def binding(semantic, number):
    return f'<bind_vertex_input semantic="{semantic}" input_semantic="TEXCOORD" input_set="{number}"/>'


dae("bound_to_0")
for semantic in "CHANNEL1", "CHANNEL0", "UVSET1", "TEX2", "map1":
    dae(f"{semantic}_bound_to_0", texcoord=semantic, bound=binding(semantic, 0))
    dae(f"{semantic}_bound_to_1", texcoord=semantic, bound=binding(semantic, 1), sets=(0, 1))
dae("numbered_from_1", bound=binding("UV", 1), sets=(1,))
dae("unbound", bound="")
dae("bound_to_nothing", bound=binding("OTHER", 1))
for name in "./t.png", "file://t.png", "file:///C:/plant/t.png", "C:\\plant\\t.png", "../gone/t.png":
    dae("image_" + "".join(c if c.isalnum() else "_" for c in name), quarters(RED, GREEN, BLUE, YELLOW), file=name)


# PLY.
def ply(name, *rights, file="t.png", uv="st", info=""):
    header = f"ply\nformat ascii 1.0\ncomment TextureFile {file}\n" + XYZ + "".join(f"property float {c}\n" for c in (uv if isinstance(uv, tuple) else tuple(uv))) + more.FACE + "end_header\n"
    row(f"ply_texture_{name}.ply", header + "".join("%d %d %d %d %d\n" % (*p, *p[:2]) for p in CORNERS) + more.QUAD, *(rights or [PICTURE]), t__png=RGB)


for uv in "st", "uv", ("texture_u", "texture_v"), ("texture_s", "texture_t"):
    ply("by_" + "".join(uv), uv=uv)
for name in "./t.png", "C:\\scans\\t.png", "/scans/2020/t.png", "T.png", "../scan/t.png":
    ply("name_" + "".join(c if c.isalnum() else "_" for c in name), file=name)


# Fields that are not carried are named, once for each kind.
def told(field):
    return Model(**SQUARE, warns=f"left out, since they are not read: .*{field}")


row("fields_vertex.ply", "ply\nformat ascii 1.0\n" + XYZ + "property float confidence\nproperty uchar label\n" + more.FACE + "end_header\n" + more.colors("1 2", more.QUAD), told('vertex properties "confidence", "label"'))
row("fields_face.ply", "ply\nformat ascii 1.0\n" + XYZ + more.FACE + "property int group\nend_header\n" + more.POINTS + "4 0 1 2 3 7\n", told('face properties "group"'))
row("fields_element.ply", "ply\nformat ascii 1.0\n" + XYZ + more.FACE + "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n" + more.POINTS + more.QUAD + "0 1\n", told('elements "edge"'))
row("fields_none.ply", "ply\nformat ascii 1.0\n" + XYZ + more.FACE + "element edge 0\nproperty int vertex1\nend_header\n" + more.POINTS + more.QUAD, Model(**SQUARE, silent=True))
row("fields_lines.obj", more.V + "l 1 2 3\np 1\nf 1 2 3 4\nl 2 3\n", told('statements "l", "p"'))
row("fields_lod.obj", more.V + "lod 3\nshadow_obj a.obj\nf 1 2 3 4\n", told('statements "lod", "shadow_obj"'))
row("fields_none.obj", "# a\no a\ng b\ns 1\n" + more.OBJ, Model(**SQUARE, silent=True))
obj("fields_mtl", "newmtl m\nKa 1 1 1\nPc 0.5\nmap_Ns t.png\nKd 1 0 0\n", told('MTL statements "Pc", "map_Ns"'))
obj("fields_mtl_none", "newmtl m\nKa 1 1 1\nillum 2\nNs 10\nNi 1.5\nd 1\nKd 1 0 0\n", Model(**SQUARE, silent=True))
gltf("fields_tangent", told('attributes "TANGENT"'), like=lambda g: g.primitive["attributes"].update(TANGENT=g.add(struct.pack("<16f", *[1, 0, 0, 1] * 4), 5126, "VEC4", 4)))
gltf("fields_own_attribute", told('attributes "_ID"'), like=lambda g: g.primitive["attributes"].update(_ID=g.add(struct.pack("<4f", 1, 2, 3, 4), 5126, "SCALAR", 4)))
gltf("fields_occlusion", told('material members "occlusionTexture"'), like=more.material(occlusionTexture={"index": 0}))
gltf("fields_animations", told('members "animations"'), like=put(("animations",), [{"channels": [], "samplers": []}]))
gltf("fields_none", Model(**SQUARE, silent=True), like=more.material(name="a", doubleSided=True, alphaMode="OPAQUE", extras={"a": 1}))


class TextureCases(more.MoreCases):
    """The rows above by the test of MoreCases, and images named outside the model's folder. Every row is read; without QUARRY_CASES_WHOLE only every
    third picture is checked."""

    def check_picture(self, wanted, info):
        if WHOLE or getattr(self, "number", 0) % 3 == 0:
            super().check_picture(wanted, info)

    def write(self, name, content):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    def must_be(self, right, model, says=None):
        done = self.run_program("quarry-preprocess", model, "-o", self.path("x.quarry"), "--force", "--threads", 1)
        self.check_model(right, done)
        self.assertEqual("outside the model's folder; it is read" in done.stderr, says == "outside", done.stderr)

    def test_images_of_a_robot_package_are_read_with_a_warning(self):
        """meshes/a.dae names ../materials/textures/t.png: read, and told of, but for glTF."""
        self.write("materials/textures/t.png", RGB)
        name = "../materials/textures/t.png"
        picture = quarters(RED, GREEN, BLUE, YELLOW)
        for file, content, *_ in [r for r in more.ROWS if r[0] in ("dae_bound_to_0.dae", "ply_texture_by_st.ply")]:
            self.must_be(picture, self.write("meshes/" + file, content.replace(b"t.png", name.encode())), "outside")
        self.write("meshes/my.mtl", f"newmtl m\nmap_Kd {name}\n")
        self.must_be(picture, self.write("meshes/a.obj", "mtllib my.mtl\n" + UV_OBJ), "outside")
        square = Gltf()
        textured({}, {0: UP})(square)
        square.json["images"][0]["uri"] = name
        self.must_be(Model(**SQUARE, warns="outside the model's folder; the material does without"), self.write("meshes/a.gltf", square.text()))

    def test_a_model_behind_a_symbolic_link_finds_its_files(self):
        square = Gltf()
        textured({}, {0: UP})(square)
        text = square.text().replace(square.json["buffers"][0]["uri"], "my.bin")
        files = {"a.obj": "mtllib my.mtl\n" + UV_OBJ, "a.gltf": text, **{file: content for file, content, *_ in more.ROWS if file in ("dae_bound_to_0.dae", "ply_texture_by_st.ply")}}
        self.write("shelf/my.mtl", "newmtl m\nmap_Kd t.png\n")
        self.write("shelf/my.bin", square.blob)
        self.write("shelf/t.png", RGB)
        os.mkdir(self.folder / "desk")
        for file, content in files.items():
            with self.subTest(file=file):
                self.write("shelf/" + file, content)
                link = self.folder / "desk" / ("link" + pathlib.Path(file).suffix)
                link.symlink_to(f"../shelf/{file}")
                self.must_be(PICTURE, link)

    def test_levels_of_alpha_are_the_same_for_memory_and_threads_and_after_kills(self):
        side, chance = 250, random.Random(4)
        corner = lambda x, y: y * (side + 1) + x  # noqa: E731
        square = Gltf(b"".join(struct.pack("<6I", corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y), corner(x + 1, y + 1), corner(x, y + 1))
                               for y in range(side) for x in range(side)), 5125, 6 * side * side)
        count = (side + 1) ** 2
        square.primitive["attributes"] = {
            "POSITION": square.add(b"".join(struct.pack("<3f", x, y, chance.random()) for y in range(side + 1) for x in range(side + 1)), 5126, "VEC3", count),
            "COLOR_0": square.add(b"".join(bytes((255, 255, 255, chance.randrange(256))) for _ in range(count)), 5121, "VEC4", count, normalized=True)}
        square.json.update(materials=[{"alphaMode": "BLEND"}])
        square.primitive["material"] = 0
        square.json["meshes"][0]["primitives"] *= 3  # checkpoints lie between them
        model = self.write("a.gltf", square.text())
        whole = None
        for options in ((), ("--threads", 1), ("--memory", "64M")):
            self.must("quarry-preprocess", model, "-o", self.path("x.quarry"), "--force", *options)
            made = pathlib.Path(self.path("x.quarry")).read_bytes()
            self.assertTrue(made == (whole or made), options)
            whole = made
        self.assertEqual(len(self.info(self.path("x.quarry"))["materials"]), 17)
        self.assertTrue(self.made_in_spite_of_kills((0.1, 0.2, 0.3), model, "--checkpoint", "0.02") == whole, "other bytes after kills")

    def test_images_without_alpha_are_not_decoded_for_it(self):
        for image, read in ((RGB, False), (HOLES, True)):
            self.write("my.mtl", "newmtl m\nmap_Kd t.png\n")
            self.write("t.png", image)
            done = self.must("quarry-preprocess", self.write("a.obj", "mtllib my.mtl\n" + UV_OBJ), "-o", self.path("x.quarry"), "--force")
            self.assertEqual("reading the opacity of 1 images" in done.stderr, read, done.stderr)

    def test_a_link_in_the_model_s_own_folder(self):
        """The only material file beside it is found once, not twice."""
        self.write("a.obj", b"mtllib \xb4\xf3.mtl\n" + UV_OBJ.encode())
        self.write("my.mtl", "newmtl m\nmap_Kd t.png\n")
        self.write("t.png", RGB)
        (self.folder / "b.obj").symlink_to("a.obj")
        self.must_be(quarters(RED, GREEN, BLUE, YELLOW, warns="only one beside"), self.folder / "b.obj")

    def test_there_are_a_hundred_and_fifty(self):
        self.assertGreaterEqual(len(more.ROWS), 150)


if __name__ == "__main__":
    main()

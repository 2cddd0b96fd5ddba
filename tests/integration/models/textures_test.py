"""Images that models name, in the store: their sources, their faults, the same bytes always."""
import base64
import json
import os
import pathlib
import random
import shutil
import struct
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, Case, main
from tests.support.models.textured_scene import Glb, png, sheet

SCENES = pathlib.Path(__file__).parents[4] / "shared/scenes"


def noise(width, height, seed, channels=3):
    chance = random.Random(seed)
    return png(width, height, lambda y: chance.randbytes(width * channels), channels)


def smooth(width, height, channels=3):
    return png(width, height, lambda y: bytes((x + y * 3 + c * 50) % 256 for x in range(width) for c in range(channels)), channels)


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"


def glb(columns, images, materials, textures):
    """A grid of columns squared squares; `images` are bytes (put into the buffer) or uri strings."""

    def place(u, v):
        x, y = round(u * columns), round(v * columns)
        return x, y, (x * y) % 7 / 10

    made = Glb()
    made.add(sheet(columns, columns, place), 0)
    made.images = [{"uri": i} if isinstance(i, str) else {"bufferView": made.view(i), "mimeType": "image/png"} for i in images]
    made.materials, made.textures = materials, textures
    return made.content()


def data_uri(content):
    return "data:image/png;base64," + base64.b64encode(content).decode()


class Stores(Case):
    """Preprocesses, and keeps the printed text."""

    def preprocess(self, model, name, *arguments):
        store = self.path(name)
        done = self.must("quarry-preprocess", model, "-o", store, "--stats", self.path("stats.json"), *arguments)
        self.must("quarry", "verify", store)
        self.statistics = json.loads(pathlib.Path(self.path("stats.json")).read_text())
        self.told = done.stderr
        return pathlib.Path(store).read_bytes()

    def same_bytes_always(self, model):
        stores = {self.preprocess(model, "s.quarry", "--threads", threads, "--memory", memory)
                  for threads in (1, 2) for memory in ("128M", "1G")}
        self.assertEqual(len(stores), 1)
        return stores.pop()

    def planned_and_made(self, model, *arguments):
        """Decoded bytes of textures as --plan counts them, and as they are."""
        planned = self.path("plan.json")
        self.must("quarry-preprocess", model, "-o", self.path("x.quarry"), "--plan", "--quiet", "--stats", planned, *arguments)
        self.preprocess(model, "x.quarry", *arguments)
        return (json.loads(pathlib.Path(planned).read_text())["texture_decoded_bytes"], self.statistics["texture_decoded_bytes"])


class Textures(Stores):
    def write_obj(self):
        (self.folder / "maps").mkdir()
        (self.folder / "maps/wood floor.png").write_bytes(smooth(300, 133))
        (self.folder / "maps/mask.png").write_bytes(smooth(65, 64, 2))
        (self.folder / "glow.png").write_bytes(noise(70, 10, 1))
        (self.folder / "s.mtl").write_text(
            "newmtl floor\nKd 1 0.5 0.5\nmap_Kd -s 2 2 maps\\wood floor.png\nmap_d maps/mask.png\nbump -bm 0.5 maps/wood floor.png\n"
            "newmtl lamp\nmap_Ke glow.png\nmap_Kd gone.png\n")
        (self.folder / "s.obj").write_text("mtllib s.mtl\n" + SQUARE + "usemtl floor\nf 1/1 2/2 3/3\nusemtl lamp\nf 1/1 3/3 4/4\n")
        return self.path("s.obj")

    def test_an_obj(self):
        model = self.write_obj()
        self.same_bytes_always(model)
        self.assertEqual(self.statistics["warnings"], 1)
        self.assertIn('s.mtl, line 8: the image "gone.png" is not there; the material does without', self.told)
        info = self.info(self.path("s.quarry"))
        # 300 x 133: 5 x 3 pages, 150 x 66: 3 x 2, 75 x 33: 2 x 1, the rest in one.
        found = [(t["name"], t["width"], t["height"], t["channels"], t["format"], t["pages"]) for t in info["textures"]]
        self.assertEqual(found, [("maps\\wood floor.png", 300, 133, 3, "srgb8", 24),
                                 ("maps/mask.png", 65, 64, 1, "linear8", 3),
                                 ("maps/wood floor.png", 300, 133, 3, "linear8", 24),
                                 ("glow.png", 70, 10, 3, "srgb8", 3)])
        self.assertEqual(info["texture_pages"], self.statistics["texture_pages"])

    def test_info_lists_textures(self):
        self.preprocess(self.write_obj(), "s.quarry")
        told = json.loads(self.must("quarry", "info", self.path("s.quarry"), "--textures", "--json").stdout)
        self.assertEqual(told, self.info(self.path("s.quarry"))["textures"])
        self.assertEqual([t["levels"] for t in told], [9, 7, 9, 7])
        self.assertEqual([[(u["material"], u["name"], u["use"]) for u in t["uses"]] for t in told],
                         [[(0, "floor", "diffuse")], [(0, "floor", "opacity")], [(0, "floor", "bump")], [(1, "lamp", "emission")]])
        self.assertEqual(sum(t["stored_bytes"] for t in told), self.statistics["texture_stored_bytes"])
        self.assertEqual(sum(t["decoded_bytes"] for t in told), self.statistics["texture_decoded_bytes"])
        text = self.must("quarry", "info", self.path("s.quarry"), "--textures").stdout
        self.assertRegex(text, r"texture 3 glow\.png\n  70 x 10, 7 levels, 3 channels, srgb8; 3 pages, \S+ \S+ stored, \S+ \S+ once decoded\n"
                               r"  emission of material 1 lamp\n")
        self.must_fail(2, r"--parts", "quarry", "info", self.path("s.quarry"), "--textures", "--parts")

    def test_the_store_does_not_depend_on_where_models_lie(self):
        here = self.preprocess(self.write_obj(), "here.quarry")
        (self.folder / "elsewhere").mkdir()
        for name in ("s.obj", "s.mtl", "glow.png", "maps"):
            shutil.move(self.path(name), self.path("elsewhere/" + name))
        self.assertEqual(here, self.preprocess(self.path("elsewhere/s.obj"), "there.quarry"))

    def test_a_glb(self):
        (self.folder / "a b.png").write_bytes(smooth(80, 80, 4))
        both = {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
        materials = [{"name": "m", "alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": both, "metallicRoughnessTexture": {"index": 1}},
                      "emissiveTexture": {"index": 2}, "emissiveFactor": [1, 1, 1], "normalTexture": {"index": 1}}]
        model = self.folder / "m.glb"
        model.write_bytes(glb(8, ["a%20b.png", noise(33, 65, 5), data_uri(noise(9, 5, 6))], materials,
                              [{"source": 0}, {"source": 1}, {"source": 2}]))
        self.same_bytes_always(model)
        info = self.info(self.path("s.quarry"))
        self.assertEqual([(t["name"], t["width"], t["channels"], t["format"]) for t in info["textures"]],
                         [("a b.png", 80, 4, "srgb8"), ("images[2]", 9, 3, "srgb8"), ("images[1]", 33, 3, "linear8")])
        self.assertEqual(self.statistics["warnings"], 0)
        self.assertEqual([p.name for p in self.folder.iterdir() if "work" in p.name], [])

    def test_images_that_materials_share(self):
        """One picture in three files, of which two are equal, and embedded twice: one texture."""
        row = lambda y: bytes((x * 7 + y * y) % 256 for x in range(600))
        picture = png(200, 90, row)
        for name in ("a.png", "b.png"):
            (self.folder / name).write_bytes(picture)
        (self.folder / "c.png").write_bytes(png(200, 90, row, level=9))
        self.assertNotEqual((self.folder / "c.png").read_bytes(), picture)
        images = ["a.png", "b.png", picture, data_uri(picture), "c.png", noise(200, 90, 4)]
        materials = [{"name": f"m{i}", "pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(len(images))]
        model = self.folder / "m.glb"
        model.write_bytes(glb(8, images, materials, [{"source": i} for i in range(len(images))]))
        self.same_bytes_always(model)
        self.assertEqual(self.statistics["textures"], 2)
        self.assertEqual(self.statistics["images_left_out"], 0)
        self.assertEqual([t["name"] for t in self.info(self.path("s.quarry"))["textures"]], ["a.png", "images[5]"])

    def test_without_textures(self):
        model = self.write_obj()
        without = self.preprocess(model, "without.quarry", "--no-textures")
        self.assertEqual(self.statistics["warnings"], 0)
        self.assertEqual(self.info(self.path("without.quarry"))["textures"], [])
        lines = (self.folder / "s.mtl").read_text().splitlines()
        (self.folder / "s.mtl").write_text("".join(line + "\n" for line in lines if "map_" not in line and "bump" not in line))
        self.assertEqual(without, self.preprocess(model, "never.quarry"))


    def test_an_image_that_cannot_be_read_is_left_out(self):
        model = self.write_obj()
        whole = (self.folder / "maps/wood floor.png").read_bytes()
        cut = noise(600, 600, 3)
        for content in (b"", b"no image at all", whole[:40], cut[:len(cut) // 2], whole[:16] + struct.pack(">II", 90000, 90000) + whole[24:]):
            (self.folder / "maps/wood floor.png").write_bytes(content)
            self.preprocess(model, "s.quarry")
            self.assertEqual(self.statistics["images_left_out"], 2)  # as colour, and as heights
            self.assertEqual(self.statistics["warnings"], 3)
            self.assertRegex(self.told, r"warning: \S*maps/wood floor.png \(of \S*s.mtl\): cannot be read as an image: .*; materials do without")
            self.assertEqual([t["name"] for t in self.info(self.path("s.quarry"))["textures"]], ["maps/mask.png", "glow.png"])

    def test_an_image_larger_than_memory(self):
        """192 MiB of texels."""
        (self.folder / "large.png").write_bytes(png(16384, 4096, lambda y: bytes((y % 256, 7, 9)) * 16384))
        (self.folder / "s.mtl").write_text("newmtl m\nmap_Kd large.png\n")
        (self.folder / "s.obj").write_text("mtllib s.mtl\n" + SQUARE + "usemtl m\nf 1/1 2/2 3/3\n")
        planned, made = self.planned_and_made(self.path("s.obj"), "--memory", "64M", "--threads", 2)
        self.assertEqual(self.statistics["textures"], 1)
        self.assertGreater(self.statistics["texture_decoded_bytes"], 192 << 20)
        if PATIENCE == 1:  # sanitizers take memory of their own
            self.assertLess(self.statistics["peak_rss_bytes"], (64 + 44) << 20)
        self.assertEqual(planned, made)

    def test_a_plan_counts_images(self):
        model = self.write_obj()
        (self.folder / "maps/wood floor.png").write_bytes(smooth(1000, 700))
        self.must("quarry-preprocess", model, "-o", self.path("x.quarry"), "--plan", "--quiet", "--stats", self.path("plan.json"))
        plan = json.loads(pathlib.Path(self.path("plan.json")).read_text())
        self.assertEqual(list(self.folder.glob("quarry-images-*")), [])
        self.assertGreater(plan["texture_decoded_bytes"], 1000 * 700 * 3)
        self.assertGreater(plan["store_bytes_most"], plan["texture_decoded_bytes"])

    def test_a_plan_of_many_images(self):
        """Images that shrink and images that do not. The header of one is whole, but its texels are cut off."""
        for images in (20, 60):
            materials = ""
            for i in range(images):
                image = noise(300, 200, i) if i % 3 == 0 else smooth(500, 100 + 400 // images * i)
                if i == 7:
                    image = image[:len(image) // 2]
                (self.folder / f"{i}.png").write_bytes(image)
                materials += f"newmtl m{i}\nmap_Kd {i}.png\n"
            (self.folder / "m.mtl").write_text(materials)
            model = self.folder / "m.obj"
            model.write_text("mtllib m.mtl\n" + SQUARE + "".join(f"usemtl m{i}\nf 1/1 2/2 3/3\n" for i in range(images)))
            with self.subTest(images=images):
                planned, made = self.planned_and_made(model)
                self.assertEqual(self.statistics["textures"], images - 1)
                height = 100 + 400 // images * 7
                self.assertEqual(planned - made, sum(3 * max(500 >> level, 1) * max(height >> level, 1) for level in range(9)))

    def test_a_real_model(self):
        model = SCENES / "sibenik/sibenik.obj"
        if not model.exists():
            self.skipTest("../shared/scenes is not there")
        self.preprocess(model, "sibenik.quarry")
        self.assertEqual(self.statistics["textures"], 5)
        self.assertEqual(self.statistics["warnings"], 0)


# An image inside of a model, in a format that Assimp reads.
FBX = r"""; FBX 7.3.0 project file
FBXHeaderExtension:  {
  FBXHeaderVersion: 1003
  FBXVersion: 7300
}
Objects:  {
  Geometry: 1000, "Geometry::g", "Mesh" {
    Vertices: *9 {
      a: 0,0,0,1,0,0,0,1,0
    }
    PolygonVertexIndex: *3 {
      a: 0,1,-3
    }
    GeometryVersion: 124
    LayerElementUV: 0 {
      Version: 101
      Name: "UV"
      MappingInformationType: "ByPolygonVertex"
      ReferenceInformationType: "IndexToDirect"
      UV: *6 {
        a: 0,0,1,0,0,1
      }
      UVIndex: *3 {
        a: 0,1,2
      }
    }
    LayerElementMaterial: 0 {
      Version: 101
      Name: ""
      MappingInformationType: "AllSame"
      ReferenceInformationType: "IndexToDirect"
      Materials: *1 {
        a: 0
      }
    }
    Layer: 0 {
      Version: 100
      LayerElement:  {
        Type: "LayerElementMaterial"
        TypedIndex: 0
      }
      LayerElement:  {
        Type: "LayerElementUV"
        TypedIndex: 0
      }
    }
  }
  Model: 2000, "Model::m", "Mesh" {
    Version: 232
  }
  Material: 3000, "Material::wood", "" {
    Version: 102
    ShadingModel: "phong"
    MultiLayer: 0
  }
  Video: 5000, "Video::v", "Clip" {
    Type: "Clip"
    UseMipMap: 0
    Filename: "C:\maps\wood.png"
    RelativeFilename: "wood.png"
    Content: ,
      "%s"
  }
  Texture: 4000, "Texture::t", "" {
    Type: "TextureVideoClip"
    Version: 202
    TextureName: "Texture::t"
    Media: "Video::v"
    FileName: "C:\maps\wood.png"
    RelativeFilename: "wood.png"
  }
}
Connections:  {
  C: "OO",2000,0
  C: "OO",1000,2000
  C: "OO",3000,2000
  C: "OP",4000,3000, "DiffuseColor"
  C: "OO",5000,4000
}
"""


class Named(Stores):
    """Images that other formats name."""

    PLY = ("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float u\nproperty float v\n"
           "element face 1\nproperty list uchar int vertex_indices\nproperty int material_index\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2 0\n")
    DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><up_axis>Y_UP</up_axis></asset>
<library_images><image id="i"><init_from>%s</init_from></image></library_images>
<library_effects><effect id="fx"><profile_COMMON><newparam sid="surface"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="sampler"><sampler2D><source>surface</source></sampler2D></newparam><technique sid="t"><lambert><diffuse>
<texture texture="sampler" texcoord="UV"/></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="red" name="red"><instance_effect url="#fx"/></material></library_materials>
<library_geometries><geometry id="g" name="quad"><mesh><source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 1 0</float_array>
<technique_common><accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source><source id="t"><float_array id="ta" count="6">0 0 1 0 0 1</float_array>
<technique_common><accessor source="#ta" count="3" stride="2"><param name="S" type="float"/><param name="T" type="float"/></accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles material="m" count="1"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="TEXCOORD" source="#t" offset="1" set="0"/>
<p>0 0 1 1 2 2</p></triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node id="n" name="n">
<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="m" target="#red">
<bind_vertex_input semantic="UV" input_semantic="TEXCOORD" input_set="0"/></instance_material></technique_common></bind_material></instance_geometry>
</node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""

    def textures(self):
        return [(t["name"], t["width"], [u["use"] for u in t["uses"]]) for t in self.info(self.path("s.quarry"))["textures"]]

    def test_a_material_file_beside_a_ply(self):
        (self.folder / "wood.png").write_bytes(smooth(40, 30))
        (self.folder / "m.ply").write_text(self.PLY)
        outside = self.folder.parent / (self.folder.name + "-outside.png")
        outside.write_bytes(smooth(8, 8))
        self.addCleanup(outside.unlink)
        textures = [{"use": "diffuse", "file": "wood.png", "wrap_s": "clamp"}, {"use": "emission", "file": "../" + outside.name},
                    {"use": "specular", "file": str(outside)}, {"use": "normal", "file": "gone.png"},
                    {"use": "bump", "file": "wood.png", "coordinates": 1}, {"use": "opacity", "file": "wood.png", "coordinates": 1}]
        (self.folder / "m.materials.json").write_text(json.dumps({"materials": [{"name": "m", "textures": textures}]}))
        self.same_bytes_always(self.path("m.ply"))
        self.assertEqual(self.textures(), [("wood.png", 40, ["diffuse"]), (str(outside), 8, ["specular", "emission"])])
        self.assertEqual(self.statistics["warnings"], 4)
        self.assertEqual(self.told.count("uses more than one set of texture coordinates"), 1)
        self.assertEqual(self.told.count("outside the model's folder; it is read"), 2)
        self.assertEqual(self.told.count('"gone.png" is not there; the material does without'), 1)

    def need_assimp(self):
        if not (BIN / "quarry-import-assimp").exists():
            self.skipTest("quarry-import-assimp was not built: Assimp is not there")

    def test_a_collada_model(self):
        self.need_assimp()
        (self.folder / "maps").mkdir()
        (self.folder / "maps/wood.png").write_bytes(smooth(40, 30))
        for name in ("maps/wood.png", "./maps/wood.png"):
            (self.folder / "m.dae").write_text(self.DAE % name)
            self.same_bytes_always(self.path("m.dae"))
            self.assertEqual([(width, uses) for _, width, uses in self.textures()], [(40, ["diffuse"])])
            self.assertEqual(self.statistics["warnings"], 0)
        (self.folder / "m.dae").write_text(self.DAE % "gone.png")
        self.preprocess(self.path("m.dae"), "s.quarry")
        self.assertEqual(self.textures(), [])
        self.assertEqual(self.told.count('"gone.png" is not there; the material does without'), 1)


    def test_an_image_inside_of_a_foreign_model(self):
        """It lies in the work folder while the run lasts, and nothing of it is left behind."""
        self.need_assimp()
        (self.folder / "m.fbx").write_text(FBX % base64.b64encode(smooth(40, 30)).decode())
        self.same_bytes_always(self.path("m.fbx"))
        self.assertEqual(self.textures(), [("wood.png", 40, ["diffuse"])])
        self.assertEqual(self.statistics["warnings"], 0)
        self.assertFalse([i for i in self.statistics["inputs"] if "image-" in i["file"]])
        planned, made = self.planned_and_made(self.path("m.fbx"))
        self.assertLess(abs(planned - made), 10)
        self.assertEqual(sorted(p.name for p in self.folder.iterdir()), ["m.fbx", "plan.json", "s.quarry", "stats.json", "x.quarry"])


class CutOuts(Stores):
    """Triangles with a texture of opacity."""

    def leaf(self, columns, visible, mode="MASK"):
        """A grid of columns squared squares, 4 to a texel each way, of which the columns of texels that `visible` names can be seen."""
        side = columns // 4
        row = b"".join(b"\x40\x80\x20" + (b"\xff" if visible(x) else b"\0") for x in range(side))
        base = {"baseColorTexture": {"index": 0}}
        model = self.folder / "leaf.glb"
        model.write_bytes(glb(columns, [png(side, side, lambda y: row, 4)], [{"name": "leaf", "alphaMode": mode, "pbrMetallicRoughness": base}],
                              [{"source": 0}]))
        return model

    def seen(self, columns, visible):
        """Columns of squares of which some lookup, nearest or bilinear, can meet a texel that is seen. The image repeats."""
        side = columns // 4
        # Lookups at x touch the texels whose centres are less than 1 away; of those just 1 away nothing is asked here.
        return [c for c in range(columns) if any(visible((x + side) % side) for x in range(-1, side + 1)
                                                 if c / 4 < x + 1.5 + 0.01 and (c + 1) / 4 > x - 0.5 - 0.01)]

    def test_triangles_cut_out_completely_are_dropped_and_counted_once(self):
        """Enough triangles for regions, whose borders some triangles cross."""
        columns = 380
        for mode in ("MASK", "BLEND"):
            model = self.leaf(columns, lambda x: 40 <= x, mode)
            self.same_bytes_always(model)
            kept = 2 * columns * len(self.seen(columns, lambda x: 40 <= x))
            info = self.info(self.path("s.quarry"))
            self.assertEqual(info["input_triangles"], 2 * columns * columns)
            self.assertEqual(info["dropped_transparent_triangles"], 2 * columns * columns - kept)
            self.assertEqual(self.statistics["dropped_transparent_triangles"], 2 * columns * columns - kept)
            self.assertTrue(info["opacity_masks"])
            self.assertIn("that opacity textures cut out completely", self.told)
            # Ids are still the input's.
            self.assertGreaterEqual(info["stored_triangle_references"], kept)

    def test_opaque_textures_drop_nothing_and_stay_the_former_format(self):
        model = self.leaf(40, lambda x: True)
        masked = self.preprocess(model, "s.quarry")
        self.assertEqual(self.statistics["dropped_transparent_triangles"], 0)
        self.assertEqual(struct.unpack_from("<I", masked, 8)[0], 12)
        model = self.leaf(40, lambda x: True, "OPAQUE")
        plain = self.preprocess(model, "s.quarry")
        self.assertFalse(self.statistics["opacity_masks"])
        self.assertLess(struct.unpack_from("<I", plain, 8)[0], 12)

    def test_a_model_cut_out_completely_is_refused(self):
        model = self.leaf(40, lambda x: False)
        self.must_fail(1, r"no triangle is left: opacity textures cut all 3200 out", "quarry-preprocess", model, "-o",
                       self.path("s.quarry"))

    def test_without_textures_nothing_is_cut_out(self):
        self.preprocess(self.leaf(40, lambda x: x < 5), "s.quarry", "--no-textures")
        self.assertEqual(self.statistics["dropped_transparent_triangles"], 0)
        self.assertFalse(self.statistics["opacity_masks"])


class Resumed(Case):
    """Runs that end while they carry images."""

    def setUp(self):
        super().setUp()
        self.model, self.store = self.path("m.glb"), self.path("m.quarry")
        names = []
        for i in range(6):
            names.append(f"{i}.png")
            (self.folder / names[-1]).write_bytes(noise(1500, 1500, i, 4 if i == 0 else 3))
        # The first cuts out of all triangles some.
        images = [names[0], data_uri(noise(700, 700, 10)), *names[1:3], data_uri(noise(700, 700, 11)), *names[3:]]
        materials = [{"name": f"m{i}", "pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(len(images))]
        materials[0]["alphaMode"] = "MASK"
        pathlib.Path(self.model).write_bytes(glb(380, images, materials, [{"source": i} for i in range(len(images))]))

    def killed(self, after):
        run = subprocess.Popen([str(BIN / "quarry-preprocess"), self.model, "-o", self.store, "--memory", "64M"],
                               stderr=subprocess.PIPE, text=True)
        self.addCleanup(run.stderr.close)
        self.addCleanup(run.wait)
        self.addCleanup(run.kill)
        for line in run.stderr:
            if after in line:
                break
        else:
            self.fail(f"never says {after!r}")
        run.kill()
        run.wait()
        self.assertTrue(pathlib.Path(self.store + ".work").is_dir())

    def test_killed_and_resumed(self):
        self.must("quarry-preprocess", self.model, "-o", self.path("whole.quarry"), "--quiet")
        whole = pathlib.Path(self.path("whole.quarry")).read_bytes()
        for after in ("building voxels", "carrying 8 images: 60 %", "carrying 8 images: 80 %", "carrying 8 images: 90 %"):
            with self.subTest(after=after):
                self.killed(after)
                again = self.must("quarry-preprocess", self.model, "-o", self.store, "--memory", "64M", "--resume")
                self.assertIn("continuing", again.stderr)
                self.assertTrue(pathlib.Path(self.store).read_bytes() == whole)
                self.assertEqual([p.name for p in self.folder.iterdir() if "work" in p.name or "lock" in p.name], [])
                pathlib.Path(self.store).unlink()

    def test_recorded_images_are_not_imported_again(self):
        # So large that notes, one a second, come long before the end: at 3500 a side all was done within a second.
        for i in range(6):
            (self.folder / f"{i}.png").write_bytes(self.large(i))
        run = subprocess.Popen([str(BIN / "quarry-preprocess"), self.model, "-o", self.store, "--memory", "64M", "--threads", "1"],
                               stderr=subprocess.PIPE, text=True)
        self.addCleanup(run.stderr.close)
        self.addCleanup(run.wait)
        self.addCleanup(run.kill)
        # The first note comes after a second or more, and has the first file, however slow or fast the build is.
        self.assertTrue(any("carrying 8 images" in line for line in run.stderr))
        journal = pathlib.Path(self.store + ".work/journal")
        before = journal.stat().st_size
        while not self.whole(journal.read_bytes()[before:]):
            self.assertIsNone(run.poll(), "it has ended without a note")
            time.sleep(0.01)
        run.kill()
        run.wait()
        # Images that the notes call done are not read again: the file has other content, with the same name, size and time.
        path = self.folder / "0.png"
        told, content = path.stat(), path.read_bytes()
        other = self.large(77)[:len(content)].ljust(len(content), b"\0")
        path.write_bytes(other)
        os.utime(path, ns=(told.st_atime_ns, told.st_mtime_ns))
        self.must("quarry-preprocess", self.model, "-o", self.store, "--memory", "64M", "--resume")
        path.write_bytes(content)
        self.must("quarry-preprocess", self.model, "-o", self.path("whole.quarry"), "--quiet")
        self.assertTrue(pathlib.Path(self.store).read_bytes() == pathlib.Path(self.path("whole.quarry")).read_bytes())

    @staticmethod
    def whole(note):
        """A note of 100 KiB and more is seen to grow; a run that is killed meanwhile has not made it."""
        return len(note) >= 16 and len(note) >= 16 + struct.unpack_from("<I", note, 4)[0]

    @staticmethod
    def large(seed, side=7000):
        base = random.Random(seed).randbytes(8 * side)
        return png(side, side, lambda y: base[y % side:y % side + 3 * side])

    def test_a_changed_image_is_not_continued(self):
        self.killed("carrying 8 images: 60 %")
        os.utime(self.path("5.png"), (1, 1))
        self.must_fail(1, r"5\.png: has changed since the run began", "quarry-preprocess", self.model, "-o", self.store,
                       "--memory", "64M", "--resume")
        self.must_fail(1, r"was begun with .*--no-textures", "quarry-preprocess", self.model, "-o",
                       self.store, "--memory", "64M", "--resume", "--no-textures")


if __name__ == "__main__":
    main()

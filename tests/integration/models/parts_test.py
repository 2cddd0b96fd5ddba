"""Parts of models: their paths, boxes and surfaces, as `quarry info --parts` shows them."""
import base64
import ctypes
import hashlib
import json
import pathlib
import struct
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import Case, main

# The corners of a cube are numbered by x + 2 y + 4 z.
SIDES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


def corners(at, side=1):
    return [tuple(at[a] + side * (i >> a & 1) for a in range(3)) for i in range(8)]


def cube(at=(0, 0, 0), side=1, inverted=False):
    """The triangles of a cube, seen counter-clockwise from outside."""
    points = corners(at, side)
    triangles = [tuple(points[i] for i in half) for a, b, c, d in SIDES for half in ((a, b, c), (a, c, d))]
    return [(a, c, b) for a, b, c in triangles] if inverted else triangles


def stl(name, triangles):
    facets = "".join("facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in t) + "endloop\nendfacet\n" for t in triangles)
    return f"solid {name}\n{facets}endsolid {name}\n"


def obj_cube(first, at):
    points = "".join("v {} {} {}\n".format(*p) for p in corners(at))
    return points + "".join("f " + " ".join(str(first + i) for i in side) + "\n" for side in SIDES)


def gltf():
    """Nodes of one name below one parent, escapes, and a node without a mesh."""
    data = b"".join(struct.pack("<3f", *p) for p in corners((0, 0, 0)))
    indices = struct.pack("<36H", *(i for a, b, c, d in SIDES for i in (a, b, c, a, c, d)))
    uri = "data:application/octet-stream;base64," + base64.b64encode(data + indices).decode()
    return json.dumps({
        "asset": {"version": "2.0"},
        "buffers": [{"uri": uri, "byteLength": len(data + indices)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}, {"buffer": 0, "byteOffset": len(data), "byteLength": len(indices)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
                      {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"name": "plant", "children": [1, 2, 3]},
                  {"name": "valve", "mesh": 0},
                  {"name": "valve", "mesh": 0, "translation": [2, 0, 0], "scale": [-1, 1, 1]},
                  {"name": "hall 1/2", "children": [4]},
                  {"name": "a*b\\c", "mesh": 0, "translation": [0, 0, 5]}],
        "scenes": [{"nodes": [0]}]})


class Parts(Case):
    def store(self, *models, name="s.quarry", options=()):
        self.must("quarry-preprocess", *models, "-o", self.path(name), "--quiet", *options)
        return self.path(name)

    def written(self, name, text):
        pathlib.Path(self.path(name)).write_text(text)
        return self.path(name)

    def lines(self, store, *options):
        return [line for line in self.must("quarry", "info", store, "--parts", *options).stdout.splitlines() if line.startswith("part ")]

    def parts(self, store, *options):
        return json.loads(self.must("quarry", "info", store, "--parts", "--json", *options).stdout)

    def test_nodes_of_gltf_are_a_tree(self):
        store = self.store(self.written("m.gltf", gltf()), options=("--up-axis", "z"))
        self.assertEqual(self.lines(store), [
            "part 0 36 group 2x1x6 plant",
            "part 1 12 closed 1x1x1 plant/valve",
            "part 2 12 closed 1x1x1 plant/valve #2",
            r"part 3 12 group 1x1x1 plant/hall 1\/2",
            r"part 4 12 closed 1x1x1 plant/hall 1\/2/a\*b\\c"])
        plant, _, second, hall, last = self.parts(store)
        self.assertEqual((plant["parent"], plant["children"], plant["triangles"], plant["own_triangles"], plant["closed"]), (None, 3, 36, 0, None))
        self.assertEqual(plant["box"], [[0, 0, 0], [2, 1, 6]])
        self.assertEqual((second["path"], second["name"], second["closed"], second["inside_out"]), ("plant/valve #2", "valve #2", True, False))
        self.assertEqual((last["path"], last["name"], last["parent"], hall["name"]), (r"plant/hall 1\/2/a\*b\\c", "a*b\\c", 3, "hall 1/2"))
        self.assertEqual(self.info(store)["parts"], [part["path"] for part in self.parts(store)])
        self.must("quarry", "verify", store)

    def test_extras_of_gltf_are_attributes(self):
        model = json.loads(gltf())
        model["nodes"][1]["extras"] = {"tag": "V-101", "mass": {"kg": 2.5}, "höhe": "3 m"}
        model["nodes"][3]["extras"] = {"long": "x" * 20000}
        model["nodes"][4]["extras"] = [1, 2]
        path = self.written("m.gltf", json.dumps(model))
        result = self.must("quarry-preprocess", path, "-o", self.path("s.quarry"))
        self.assertIn("attributes of part \"hall 1/2\" are left out: they have more than 16384 bytes", result.stderr)
        self.must("quarry", "verify", self.path("s.quarry"))
        self.assertEqual({part["id"]: part["attributes"] for part in self.parts(self.path("s.quarry")) if "attributes" in part},
                         {1: {"tag": "V-101", "mass": {"kg": 2.5}, "höhe": "3 m"}, 4: {"extras": [1, 2]}})
        del model["nodes"][1]["extras"]
        other = self.store(self.written("n.gltf", json.dumps(model)), name="n.quarry")
        self.assertNotEqual(self.info(other)["scene_id"], self.info(self.path("s.quarry"))["scene_id"])

    def test_parts_are_found_by_pieces_of_names_and_paths(self):
        store = self.store(self.written("m.gltf", gltf()))
        numbers = lambda text: [part["id"] for part in self.parts(store, "--find", text)]
        self.assertEqual(numbers("VALVE"), [1, 2])
        self.assertEqual(numbers("plant/v"), [1, 2])
        self.assertEqual(numbers(r"hall 1\/2/"), [4])
        self.assertEqual(numbers("nothing"), [])
        self.assertEqual(len(self.lines(store, "--find", "#2")), 1)
        self.assertNotIn("material", self.must("quarry", "info", store, "--parts", "--find", "valve").stdout)
        self.must_fail(2, "--find.*--parts", "quarry", "info", store, "--find", "valve")

    def test_groups_lie_in_objects(self):
        text = "o hall\n" + obj_cube(1, (0, 0, 0)) + "g rack\n" + obj_cube(9, (5, 0, 0)) + "o\ng rack\n" + obj_cube(17, (0, 5, 0))
        store = self.store(self.written("m.obj", text))
        self.assertEqual(self.lines(store), ["part 0 24 closed 6x1x1 hall", "part 1 12 closed 1x1x1 hall/rack", "part 2 12 closed 1x1x1 rack"])

    def test_files_are_the_roots_of_several_models(self):
        for folder in ("a", "b"):
            pathlib.Path(self.path(folder)).mkdir()
        models = [self.written("a/m.stl", stl("valve", cube())), self.written("b/m.stl", stl("", cube((3, 0, 0)))), self.written("n.obj", obj_cube(1, (6, 0, 0)))]
        store = self.store(*models)
        self.assertEqual(self.lines(store), ["part 0 12 group 1x1x1 m.stl", "part 1 12 closed 1x1x1 m.stl/valve", "part 2 12 closed 1x1x1 m.stl #2",
                                             "part 3 12 closed 1x1x1 n.obj"])

    def test_surfaces_are_closed_open_or_inverted(self):
        text = (stl("outward", cube()) + stl("inward", cube((3, 0, 0), 2, True)) + stl("sheet", cube((9, 0, 0))[:2]) + stl("holed", cube((12, 0, 0))[1:]) +
                stl("one turned", cube((15, 0, 0))[1:] + [cube((15, 0, 0), 1, True)[0]]) + stl("two", cube((20, 0, 0)) + cube((23, 0, 0))))
        lines = self.lines(self.store(self.written("m.stl", text)))
        self.assertEqual([line.split(" ", 5)[2:] for line in lines], [
            ["12", "closed", "1x1x1", "outward"], ["12", "inverted", "2x2x2", "inward"], ["2", "open", "1x1x0", "sheet"],
            ["11", "open", "1x1x1", "holed"], ["12", "open", "1x1x1", "one turned"], ["24", "closed", "4x1x1", "two"]])

    def test_facts_depend_on_neither_threads_nor_memory(self):
        plant = self.path("plant.obj")
        self.must("quarry-scene", "plant", "--triangles", 300000, "-o", plant, "--quiet")
        made = [pathlib.Path(self.store(plant, name=f"{threads}.quarry", options=("--threads", threads, "--memory", memory))).read_bytes()
                for threads, memory in ((1, "64M"), (2, "1G"))]
        self.assertEqual(*(hashlib.sha256(store).hexdigest() for store in made))
        parts = self.parts(self.path("1.quarry"))
        self.assertEqual(sum(part["own_triangles"] for part in parts), self.info(self.path("1.quarry"))["input_triangles"])
        self.assertTrue(any(part["closed"] for part in parts))

    def test_a_store_of_before_opens(self):
        """Without the sections PTRE, VPRT and PATT, which older programs do not write."""
        store = self.store(self.written("m.gltf", gltf()))
        data = bytearray(pathlib.Path(store).read_bytes())
        count = struct.unpack_from("<I", data, 12)[0]
        for entry in range(64, 64 + 40 * count, 40):
            if data[entry:entry + 4] in (b"PTRE", b"VPRT", b"PATT"):
                data[entry:entry + 1] = b"?"  # a type that no program knows
        xxh3 = ctypes.CDLL("libxxhash.so.0").XXH3_64bits
        xxh3.restype, xxh3.argtypes = ctypes.c_uint64, (ctypes.c_char_p, ctypes.c_size_t)
        digest = lambda part: xxh3(part, len(part))
        struct.pack_into("<Q", data, 48, digest(bytes(data[64:64 + 40 * count])))
        struct.pack_into("<Q", data, 56, digest(bytes(data[:56])))
        pathlib.Path(self.path("old.quarry")).write_bytes(data)
        self.must("quarry", "verify", self.path("old.quarry"))
        self.assertEqual(self.lines(self.path("old.quarry"))[1], "part 1 - - - valve")


if __name__ == "__main__":
    main()

"""Guesses from a file's content, without an extension that helps: the format, and whether colours run to 1 or to 255. They are metamorphic tests: the
same model is written otherwise (faces doubled, turned, in another order, comments first, in another scale, with a stray point), and the guess stays."""
import pathlib
import random
import struct
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.cases.model_cases import RED, Model, ModelCase, is_color
from tests.integration.cases.more_cases_test import Gltf, three_mf
from tests.integration.programs import main

CUBE = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]


class Mesh:
    def __init__(self, points=CUBE, faces=FACES, comments=0):
        self.points, self.faces, self.comments = list(points), list(faces), comments

    def note(self, mark="#"):
        return "".join(f"{mark} a line of a person, {i}: vertex 1 2 3, ply, solid, OFF\n" for i in range(self.comments))


def shuffled(faces):
    faces = list(faces)
    random.Random(7).shuffle(faces)
    return faces


METAMORPHOSES = {
    "as it is": Mesh(),
    "doubled": Mesh(faces=FACES + FACES),
    "turned": Mesh(faces=[face[::-1] for face in FACES]),
    "both": Mesh(faces=FACES + [face[::-1] for face in FACES]),
    "another order": Mesh(faces=shuffled(FACES)),
    "comments first": Mesh(comments=5),
    "many comments first": Mesh(comments=200),
    "a thousandth": Mesh([tuple(c / 1000 for c in p) for p in CUBE]),
    "a million times": Mesh([tuple(c * 1e6 for c in p) for p in CUBE]),
    "a stray point": Mesh(CUBE + [(1e5, -1e5, 1e5)]),
    "below zero": Mesh([tuple(c - 5 for c in p) for p in CUBE]),
}


def obj(m, color=""):
    return m.note() + "".join("v %g %g %g%s\n" % (*p, color) for p in m.points) + "".join("f %d %d %d\n" % tuple(i + 1 for i in f) for f in m.faces)


def off(m):
    return m.note() + "OFF\n" + f"{len(m.points)} {len(m.faces)} 0\n" + "".join("%g %g %g\n" % p for p in m.points) + "".join("3 %d %d %d\n" % f for f in m.faces)


def ply(m, color="", kind="float"):
    colors = "".join(f"property {kind} {c}\n" for c in ("red", "green", "blue")) if color else ""
    return ("ply\nformat ascii 1.0\n" + m.note("comment") + f"element vertex {len(m.points)}\nproperty float x\nproperty float y\nproperty float z\n{colors}element face {len(m.faces)}\n"
            "property list uchar int vertex_indices\nend_header\n" + "".join("%g %g %g%s\n" % (*p, color) for p in m.points) + "".join("3 %d %d %d\n" % f for f in m.faces))


def stl(m):
    return m.note() + "solid a\n" + "".join("facet normal 0 0 0\nouter loop\n" + "".join("vertex %g %g %g\n" % m.points[i] for i in f) + "endloop\nendfacet\n" for f in m.faces) + "endsolid a\n"


def binary_stl(m):
    header = m.note("solid")[:80].encode().ljust(80)
    return header + struct.pack("<I", len(m.faces)) + b"".join(struct.pack("<12fH", 0, 0, 0, *(c for i in f for c in m.points[i]), 0) for f in m.faces)


def nff(m):
    return m.note() + "v\nfrom 3 3 3\nat 0 0 0\nup 0 0 1\nangle 40\nhither 1\nresolution 100 100\nb 0 0 1\nf 1 0 0 1 0 0 0 0\n" + "".join(
        "p 3\n" + "".join("%g %g %g\n" % m.points[i] for i in f) for f in m.faces)


def gltf(m):
    g = Gltf(struct.pack(f"<{3 * len(m.faces)}H", *(i for f in m.faces for i in f)), count=3 * len(m.faces))
    g.primitive["attributes"]["POSITION"] = g.add(b"".join(struct.pack("<3f", *p) for p in m.points), 5126, "VEC3", len(m.points))
    g.json["asset"]["copyright"] = m.note()
    return g


def mf(m):
    return three_mf('<?xml version="1.0"?>' + "".join(f"<!-- {line} -->\n" for line in m.note().splitlines()) + '<model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
                    '<resources><object id="1"><mesh><vertices>' + "".join('<vertex x="%g" y="%g" z="%g"/>' % p for p in m.points) + "</vertices><triangles>"
                    + "".join('<triangle v1="%d" v2="%d" v3="%d"/>' % f for f in m.faces) + '</triangles></mesh></object></resources><build><item objectid="1"/></build></model>')


FORMATS = {"OBJ": obj, "OFF": off, "PLY": ply, "STL": stl, "binary STL": binary_stl, "NFF": nff, "glTF": lambda m: gltf(m).text(), "GLB": lambda m: gltf(m).glb(), "3MF": mf}


class ContentGuesses(ModelCase):
    def read(self, content, name="model"):
        path = self.folder / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return self.run_program("quarry-preprocess", path, "-o", self.path("x.quarry"), "--force", "--threads", 1)

    def test_the_format_is_guessed_alike(self):
        for kind, write in FORMATS.items():
            for name, mesh in METAMORPHOSES.items():
                with self.subTest(format=kind, metamorphosis=name):
                    scale = max(c for p in mesh.points[:8] for c in p) - min(c for p in mesh.points[:8] for c in p)
                    self.check_model(Model(len(mesh.faces), extent=[scale] * 3, within=1e-3 * scale), self.read(write(mesh)))

    def test_the_scale_of_colours_is_guessed_alike(self):
        for name in "as it is", "doubled", "both", "comments first", "a million times":
            mesh = METAMORPHOSES[name]
            for kind, text in (("1", " 1 0 0"), ("255", " 255 0 0")):
                for written in (obj(mesh, text), ply(mesh, text)):
                    with self.subTest(metamorphosis=name, most=kind):
                        self.assertEqual(self.read(written).returncode, 0)
                        info = self.info(self.path("x.quarry"))
                        lower, upper = info["bounds_lower"], info["bounds_upper"]
                        rows = self.picture(self.path("x.quarry"), "raycast", lower, upper)[1]
                        self.assertTrue(is_color(rows[len(rows) // 2][len(rows) // 2], RED), rows[len(rows) // 2][len(rows) // 2])


if __name__ == "__main__":
    main()

"""3MF as programs write it: kinds of archives, colours, several parts; damaged ones; memory, threads and resumed runs."""
import gzip
import io
import json
import pathlib
import random
import shutil
import sys
import unittest.mock
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.cases.model_cases import RED, SQUARE, Model, ModelCase, Sentence, colored
from tests.integration.programs import main

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
RELATIONSHIPS = ('<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship '
                 'Target="/3D/3dmodel.model" Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>')
OVER_MEMORY = 44 << 20  # memory that --memory does not count, as README.md of preprocess/ states


def document(resources, build, unit="millimeter"):
    return (f'<?xml version="1.0"?><model unit="{unit}" xmlns="{CORE}" xmlns:m="{MATERIAL}" xmlns:p="{PRODUCTION}"><resources>{resources}'
            f'</resources><build>{build}</build></model>')


def mesh(vertices, triangles):
    return ("<mesh><vertices>" + "".join('<vertex x="%.10g" y="%.10g" z="%.10g"/>' % v for v in vertices) + "</vertices><triangles>"
            + "".join('<triangle v1="%d" v2="%d" v3="%d"/>' % t for t in triangles) + "</triangles></mesh>")


def grid(side):
    """A mesh of 2 side^2 triangles over the square from 0 to side."""
    chance = random.Random(side)
    vertices = [(x, y, chance.random()) for y in range(side + 1) for x in range(side + 1)]
    corner = lambda x, y: y * (side + 1) + x
    triangles = [t for y in range(side) for x in range(side)
                 for t in ((corner(x, y), corner(x + 1, y), corner(x + 1, y + 1)), (corner(x, y), corner(x + 1, y + 1), corner(x, y + 1)))]
    return mesh(vertices, triangles)


SQUARE_MESH = mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
PLAIN = document(f'<object id="1">{SQUARE_MESH}</object>', '<item objectid="1"/>')


class Unseekable(io.RawIOBase):
    """A pipe's end, for which zipfile writes sizes after the data."""

    def __init__(self):
        self.bytes = bytearray()

    def writable(self):
        return True

    def write(self, data):
        self.bytes += data
        return len(data)


def archive(parts, method=zipfile.ZIP_DEFLATED, zip64=False, into=None):
    out = into or io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as file:
        for name, text in {"[Content_Types].xml": "<Types/>", "_rels/.rels": RELATIONSHIPS, **parts}.items():
            with file.open(name, "w", force_zip64=zip64) as part:
                part.write(text.encode() if isinstance(text, str) else text)
    return bytes(out.bytes) if into else out.getvalue()


def model(text=PLAIN, **options):
    return archive({"3D/3dmodel.model": text}, **options)


def kinds():
    """Archives of one model as they are written by various programs."""
    thumbnail = {"Metadata/thumbnail.png": bytes(range(256)) * 50, "Metadata/plate_1.json": "{}", "3D/3dmodel.model": PLAIN}
    yield "stored", model(method=zipfile.ZIP_STORED)
    yield "deflated", model()
    yield "zip64_parts", model(zip64=True)
    with unittest.mock.patch("zipfile.ZIP64_LIMIT", 10):
        yield "zip64_directory", model(zip64=True)
    yield "streamed", model(into=Unseekable())
    yield "streamed_stored", model(method=zipfile.ZIP_STORED, into=Unseekable())
    yield "streamed_zip64", model(zip64=True, into=Unseekable())
    yield "thumbnail", archive(thumbnail)
    yield "byte_order_mark", model("\ufeff" + PLAIN)
    yield "utf16", model(PLAIN.encode("utf-16"))
    yield "no_namespace", model(PLAIN.replace(f' xmlns="{CORE}"', ""))


class ThreeMf(ModelCase):
    def write(self, name, content):
        (self.folder / name).write_bytes(content)
        return self.path(name)

    def preprocess(self, path, *more):
        return self.run_program("quarry-preprocess", path, "-o", self.path("x.quarry"), "--force", "--threads", 1, *more)

    def refused(self, sentence, content, *more):
        path = self.write("x.3mf", content)
        self.check_one_of([Sentence(sentence)], self.preprocess(path, *more), "x.3mf")
        self.assertEqual([p.name for p in self.folder.iterdir() if p.name.startswith("x.quarry")], [])

    def test_kinds_of_archives(self):
        for name, content in kinds():
            with self.subTest(kind=name):
                self.check_one_of([Model(silent=True, **SQUARE)], self.preprocess(self.write("x.3mf", content)), "x.3mf")
                self.assertEqual(self.info(self.path("x.quarry"))["up_axis"], "z")

    def test_parts_of_the_production_extension(self):
        child = document(f'<object id="4" name="Würfel">{SQUARE_MESH}</object>', "")
        root = document('<object id="1"><components><component p:path="/3D/Objects/object_1.model" objectid="4"/><component '
                        'p:path="/3D/Objects/object_1.model" objectid="4" transform="1 0 0 0 1 0 0 0 1 3 0 0"/></components></object>',
                        '<item objectid="1"/>')
        done = self.preprocess(self.write("x.3mf", archive({"3D/3dmodel.model": root, "3D/Objects/object_1.model": child})))
        self.check_one_of([Model(4, (0, 0, 0), (4, 1, 0), parts=["Würfel"], silent=True)], done, "x.3mf")

    def test_colours_of_corners(self):
        group = '<m:colorgroup id="5"><m:color color="#FF0000"/><m:color color="#00FF00"/></m:colorgroup>'
        one = SQUARE_MESH.replace('v3="2"', 'v3="2" pid="5" p1="0" p2="0" p3="0"').replace('v3="3"', 'v3="3" pid="5" p1="1"')
        done = self.preprocess(self.write("x.3mf", model(document(f'{group}<object id="1">{one}</object>', '<item objectid="1"/>'))))
        self.check_one_of([Model(pixels={(0.75, 0.25): RED, (0.25, 0.75): (0, 255, 0)}, silent=True, **SQUARE)], done, "x.3mf")

    def test_refused_files(self):
        self.refused("3MF.*Not a zip archive|Not a zip", b"no archive")
        self.refused("DOCTYPE", model(PLAIN.replace("<model", '<!DOCTYPE m [<!ENTITY a "a">]><model')))
        self.refused("unpacks to more than .*--unpack-limit", model(), "--unpack-limit", 500)
        self.refused("unpacks to more than .*which no model does", model(PLAIN.replace("<resources>", " " * (300 << 20) + "<resources>")))
        locked = bytearray(model())
        for signature, at in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
            start = -1
            while (start := locked.find(signature, start + 1)) >= 0:
                locked[start + at] |= 1
        self.refused("encrypted", bytes(locked))

    def test_bombs_of_components(self):
        objects = f'<object id="1">{SQUARE_MESH}</object>' + "".join(
            f'<object id="{i}"><components>' + f'<component objectid="{i - 1}"/>' * 10 + "</components></object>" for i in range(2, 12))
        self.refused("10000000000 times", model(document(objects, '<item objectid="11"/>')))

    def test_packed_again_and_through_a_pipe(self):
        self.check_one_of([Sentence("packed once more")], self.preprocess(self.write("x.3mf.gz", gzip.compress(model()))), "x.3mf.gz")
        path = self.write("x.3mf", model())
        for piped in (False, True):
            with open(path, "rb") as file:
                options = {"input": file.read().decode("latin-1"), "encoding": "latin-1"} if piped else {"stdin": file}
                done = self.run_program("quarry-preprocess", "-", "-o", self.path("x.quarry"), **options)
                self.check_one_of([Sentence("not by a pipe")], done, None)

    def large(self):
        """Objects of which some are shown more than once, one of them too large to be held: 420,000 triangles."""
        resources = f'<object id="1">{grid(300)}</object><object id="2" name="Plate">{grid(100)}</object>'
        resources += "".join(f'<object id="{i}"><components><component objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 {i}"/></components></object>' for i in range(3, 5))
        build = "".join(f'<item objectid="{o}" transform="1 0 0 0 1 0 0 0 1 {x} 0 0"/>' for o, x in ((1, 0), (1, 400), (2, 800), (3, 800), (4, 900)))
        return self.write("large.3mf", model(document(resources, build)))

    def made(self, path, store, *more):
        self.must("quarry-preprocess", path, "-o", self.path(store), "--quiet", "--stats", self.path("s.json"), *more)
        return (self.folder / store).read_bytes()

    def test_the_same_store_whatever_the_memory_and_the_threads(self):
        path = self.large()
        whole = self.made(path, "a.quarry", "--threads", 2)
        self.assertEqual(json.loads((self.folder / "s.json").read_text())["input_triangles"], 2 * 180000 + 3 * 20000)
        small = self.made(path, "b.quarry", "--threads", 1, "--memory", "64M")
        self.assertTrue(whole == small, "another store with less memory")
        self.assertLess(json.loads((self.folder / "s.json").read_text())["peak_rss_bytes"], (64 << 20) + OVER_MEMORY)

    def test_a_killed_run_continues(self):
        path, second = self.large(), self.write("second.3mf", model())
        whole = self.made(path, "a.quarry", second)
        chance = random.Random(5)
        killed = self.made_in_spite_of_kills([chance.uniform(0.1, 1.5) for _ in range(11)], path, second, "--checkpoint", "0.02")
        self.assertTrue(killed == whole, "another store than that of a run without kills")


if __name__ == "__main__":
    main()

"""Shared by tables of small models: the right outcome of a model, and the checks of it."""
import dataclasses
import math
import pathlib
import re
import struct
import zlib

from tests.integration.programs import Case

SIDE = 40  # pixels of a picture

RED, GREEN = (255, 0, 0), (0, 255, 0)
BACKGROUND = (232, 236, 241)
SQUARE = dict(lower=(0, 0, 0), upper=(1, 1, 0))


@dataclasses.dataclass
class Model:
    """A model that is read. `pixels`: colours at places x,y seen from +z, full or dimmed by the default albedo (0.8);
    `area`: square units that its picture covers; `warns`: text of standard error."""
    triangles: int = 2
    lower: tuple = None
    upper: tuple = None
    extent: tuple = None
    within: float = 1e-6
    dropped: int = 0
    materials: list = None
    parts: list = None
    warns: str = None
    silent: bool = False  # nothing is warned of
    pixels: dict = None
    not_black: bool = False
    area: float = None
    mode: str = "raycast"


@dataclasses.dataclass
class Sentence:
    """A model that is refused: status 1, one sentence that names the file once and matches."""
    says: str = "."


def colored(color, **more):
    return Model(**{**SQUARE, "pixels": {(0.75, 0.25): color, (0.25, 0.75): color}, **more})


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


class ModelCase(Case):
    def picture(self, model, mode, lower, upper):
        """Seen from +z, and where a place of the model lies in it."""
        side = 1.25 * max(upper[0] - lower[0], upper[1] - lower[1])
        x, y = (lower[0] + upper[0]) / 2, (lower[1] + upper[1]) / 2
        self.must("quarry", "render", model, "-o", self.path("x.png"), "--size", f"{SIDE}x{SIDE}", "--mode", mode, "--quiet", "--force",
                  "--exposure", 0, "--eye", f"{x},{y},{upper[2] + 5 * side}", "--at", f"{x},{y},{upper[2]}", "--up", "0,1,0", "--ortho", side,
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
        if wanted.silent:
            self.assertNotIn("warning:", done.stderr)
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

    def check_one_of(self, rights, done, file):
        """Checks that the outcome of `file` (None: of standard input) is one of `rights`."""
        told = []
        for right in rights:
            try:
                if isinstance(right, Model):
                    return self.check_model(right, done)
                return self.check_sentence(right, done, file)
            except AssertionError as error:
                told.append(str(error))
        self.fail("\n".join(told))

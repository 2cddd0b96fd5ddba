"""What reaches the film: depth of field, nothing behind the model, layers that are means over samples. The same bits on any cluster."""
import json
import math
import pathlib
import struct
import sys
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.exr import read_exr
from tests.integration.programs import Case, main

CAMERA = ["--eye=0,0,0", "--at=0,1,0", "--up=0,0,1", "--fov", 45, "--size", "100x60"]
PIXEL = 2 * math.tan(math.radians(22.5)) / 60


def disc_beyond(s):
    """The share of a disc of radius 1 that lies beyond s."""
    s = max(-1, min(1, s))
    return (math.acos(s) - s * math.sqrt(1 - s * s)) / math.pi


def png_pixels(path):
    """Channels of each pixel of a PNG whose rows are not interlaced, with filters 0 to 2."""
    data = pathlib.Path(path).read_bytes()
    width, height, bits, kind = struct.unpack(">IIBB", data[16:26])
    assert bits == 8
    channels, at, packed = {2: 3, 6: 4}[kind], 8, b""
    while at < len(data):
        size = struct.unpack(">I", data[at:at + 4])[0]
        if data[at + 4:at + 8] == b"IDAT":
            packed += data[at + 8:at + 8 + size]
        at += 12 + size
    raw, rows, stride = zlib.decompress(packed), [], width * channels
    before = bytes(stride)
    for y in range(height):
        filtered, line = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        assert filtered in (0, 2), filtered
        if filtered == 2:
            line = bytearray((a + b) & 255 for a, b in zip(line, before))
        rows.append([tuple(line[x:x + channels]) for x in range(0, stride, channels)])
        before = line
    return rows


class Film(Case):
    def wall(self, name, distance):
        """A wall that fills the left half of what the camera sees."""
        obj = self.path(name + ".obj")
        pathlib.Path(obj).write_text(f"v -100 {distance} -100\nv 0 {distance} -100\nv 0 {distance} 100\nv -100 {distance} 100\nf 1 2 3 4\n")
        self.must("quarry-preprocess", obj, "-o", self.path(name), "--quiet")
        return self.path(name)

    def render(self, name, *arguments):
        output = self.path(name)
        self.must("quarry", "render", "-o", output, "--quiet", *arguments)
        return output

    def test_an_edge_out_of_focus_is_as_wide_as_the_lens_says(self):
        for distance, focus, aperture in ((20, 10, 1), (5, 10, 1), (10, 10, 1), (20, 10, 0)):
            with self.subTest(distance=distance, focus=focus, aperture=aperture):
                scene = self.wall(f"w{distance}-{aperture}", distance)
                lens = ["--aperture", aperture, "--focus", focus] if aperture else []
                exr = read_exr(self.render("e.exr", scene, *CAMERA, "--mode", "raycast", "--spp", 256, *lens))
                blur = aperture / 2 * abs(1 / focus - 1 / distance)  # half of it, at distance 1
                for x in range(100):
                    places = [(x + (i + 0.5) / 64 - 50) * PIXEL for i in range(64)]
                    expected = sum(disc_beyond(p / blur) if blur > 0 else p < 0 for p in places) / 64
                    mean = sum(exr.rows["A"][y][x] for y in range(60)) / 60
                    self.assertAlmostEqual(mean, expected, delta=0.01, msg=x)
        # Without --focus, what the camera looks at is sharp.
        scene = self.wall("sharp", 7)
        pictures = [pathlib.Path(self.render("s.exr", scene, *CAMERA[:1], "--at=0,7,0", *CAMERA[2:], "--mode", "raycast", "--spp", 4, "--aperture", 1, *more)).read_bytes()
                    for more in ([], ["--focus", 7], ["--focus", 8])]
        self.assertEqual(pictures[0], pictures[1])
        self.assertNotEqual(pictures[0], pictures[2])

    def test_a_lens_is_the_same_on_any_cluster(self):
        scene = self.store("plant", 20000)
        largest = self.info(scene)["largest_decoded_bytes"]
        for lens in (["--aperture", 4], ["--aperture", 4, "--ortho", 60]):
            view = [scene, "--size", "128x96", "--mode", "path", "--spp", 8, "--bounces", 2, *lens, "--view", "iso"]
            reference = pathlib.Path(self.render("r.exr", *view, "--threads", 1)).read_bytes()
            self.assertNotEqual(reference, pathlib.Path(self.render("p.exr", *view[:-4 if len(lens) == 2 else -6], *lens[2:], "--view", "iso")).read_bytes())
            for more in (["--workers", 2, "--threads", 2], ["--cache", largest]):
                self.assertEqual(pathlib.Path(self.render("c.exr", *view, *more)).read_bytes(), reference, more)
            self.render("v.exr", *view, "--write-view", self.path("v.json"))
            self.assertEqual(pathlib.Path(self.render("f.exr", scene, "--view", self.path("v.json"))).read_bytes(), reference)

    def test_nothing_is_behind_a_transparent_picture(self):
        scene = self.wall("t", 10)
        for light in (["--sky", 3, "--sun=0.2,-1,0.5"], ["--atmosphere", 3, "--sun=0.2,-1,0.5"], ["--mode", "ao"], ["--mode", "whitted", "--lights", self.path("lights.json")]):
            with self.subTest(light=light):
                pathlib.Path(self.path("lights.json")).write_text('{"lights": [], "ambient": [1, 1, 1], "background": [3, 2, 1]}')
                view = [scene, *CAMERA, "--spp", 16, "--transparent", "--up-axis", "z", "--exposure", 0, *(["--mode", "path"] if "--mode" not in light else []), *light]
                exr = read_exr(self.render("t.exr", *[v for v in view if v not in ("--exposure", 0)]))
                self.assertEqual(exr.at("RGBA", 80, 30), (0, 0, 0, 0))
                self.assertEqual(exr.at("A", 20, 30), (1,))
                pixels = png_pixels(self.render("t.png", *view))
                self.assertEqual(pixels[30][80], (0, 0, 0, 0))
                self.assertEqual(pixels[30][20][3], 255)
                self.assertGreater(pixels[30][20][0], 20)
        # At the wall's edge a colour is that of the wall, whatever its alpha.
        scene = self.store("plant", 2000)
        view = [scene, "--size", "64x48", "--mode", "raycast", "--spp", 16, "--transparent"]
        exr, pixels = read_exr(self.render("e.exr", *view)), png_pixels(self.render("e.png", *view, "--exposure", 0))
        partly = 0
        for y in range(48):
            for x in range(64):
                *color, alpha = exr.at("RGBA", x, y)
                self.assertEqual(pixels[y][x][3], math.floor(alpha * 255 + 0.5))
                if not 0 < alpha < 1:
                    continue
                partly += 1
                for value, shown in zip(color, pixels[y][x]):
                    linear = min(value / alpha, 1)
                    srgb = 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055
                    self.assertAlmostEqual(shown, srgb * 255, delta=0.6)
        self.assertGreater(partly, 50)

    def test_normals_and_albedos_are_means(self):
        scene = self.wall("a", 10)
        view = [scene, "--size", "99x60", *CAMERA[:-2], "--mode", "raycast", "--spp", 64]
        layers = ["normal.X", "normal.Y", "normal.Z", "albedo.R", "albedo.G", "albedo.B"]
        exr = read_exr(self.render("a.exr", *view, "--aov", "normal,albedo,depth"))
        inside = exr.at(layers, 10, 30)
        self.assertEqual(inside[:3], (0, -1, 0))
        for y in range(60):
            for x in range(99):
                share, = exr.at("A", x, y)
                for value, whole in zip(exr.at(layers, x, y), inside):
                    self.assertAlmostEqual(value, whole * share, delta=1e-6)
        self.assertGreater(exr.at("A", 49, 30)[0], 0.4)
        self.assertLess(exr.at("A", 49, 30)[0], 0.6)
        # The master puts them together where samples come in ranges.
        ranges = read_exr(self.render("r.exr", *view, "--aov", "normal,albedo,depth,samples", "--noise", 0.0001))
        counted = [(x, y) for y in range(60) for x in range(99) if ranges.at(["samples.n"], x, y) == (64,)]
        self.assertGreater(len(counted), 900)
        for x, y in counted:
            self.assertEqual(ranges.at([*layers, "depth.Z", "R", "A"], x, y), exr.at([*layers, "depth.Z", "R", "A"], x, y))

    def test_an_evening_is_seen(self):
        """The sky of an atmosphere stands behind the model; a low sun is red, and the sky over it bright."""
        scene = self.wall("s", 10)
        view = [scene, *CAMERA, "--mode", "path", "--spp", 16, "--up-axis", "z"]
        noon, evening, dusk = (read_exr(self.render(f"{name}.exr", *view, "--atmosphere", 3, f"--sun={sun}"))
                               for name, sun in (("noon", "0,-1,1"), ("evening", "0.2,-1,0.03"), ("dusk", "0,1,-0.05")))
        for exr in (noon, evening, dusk):
            self.assertEqual(exr.at("A", 80, 5), (1,))
            self.assertGreater(min(exr.at("RGB", 80, 5)), 0)
            self.assertGreater(min(exr.at("RGB", 80, 55)), 0)  # the ground below the horizon
        red, _, blue = (a / b for a, b in zip(evening.at("RGB", 20, 30), noon.at("RGB", 20, 30)))
        self.assertGreater(red, 1.4 * blue)
        self.assertGreater(noon.at("B", 80, 5)[0], noon.at("R", 80, 5)[0])
        # Behind the wall the sun has set: there the horizon is red, and all is darker.
        self.assertGreater(dusk.at("R", 80, 27)[0], dusk.at("B", 80, 27)[0])
        self.assertLess(dusk.at("G", 80, 5)[0], 0.1 * noon.at("G", 80, 5)[0])
        # However dim the sun, no light is clamped.
        for haze, sun in ((3, "0,1,0"), (3, "0,-1,0.0044"), (5, "0,-1,0.0175"), (10, "0,-1,0.035"), (10, "0,-1,0.052")):
            self.render("low.exr", *view, "--atmosphere", haze, f"--sun={sun}", "--stats", self.path("low.json"))
            self.assertEqual(json.loads(pathlib.Path(self.path("low.json")).read_text())["saturated_terms"], 0)
        self.must_fail(2, "6 degrees", "quarry", "render", "-o", self.path("s.png"), *view, "--atmosphere", 3, "--sun=0,-1,-0.2")
        self.must_fail(2, "two skies", "quarry", "render", "-o", self.path("s.png"), *view, "--atmosphere", 3, "--sun=0,-1,1", "--sky", 3)
        for haze in ("0", "-1", "11", "nan", "thick"):
            self.must_fail(2, "--atmosphere", "quarry", "render", scene, "-o", self.path("s.png"), "--mode", "path", "--sun=0,-1,1", f"--atmosphere={haze}")
        pathlib.Path(self.path("v.json")).write_text('{"mode": "path", "sky": {"atmosphere": 0.5}}')
        self.must_fail(1, "sky.atmosphere", "quarry", "render", scene, "-o", self.path("s.png"), "--view", self.path("v.json"))

    def test_bad_input(self):
        scene = self.wall("b", 10)
        self.must_fail(2, "--focus needs a lens", "quarry", "render", scene, "-o", self.path("b.png"), "--focus", 3)
        for option, value in (("--aperture", "-1"), ("--aperture", "nan"), ("--focus", "-2"), ("--focus", "inf")):
            with self.subTest(option=option, value=value):
                self.must_fail(2, option, "quarry", "render", scene, "-o", self.path("b.png"), f"{option}={value}")
        for member in ('"aperture": -1', '"focus": -1', '"aperture": "wide"'):
            with self.subTest(member):
                pathlib.Path(self.path("v.json")).write_text('{"camera": {"eye": [0, 0, 0], "at": [0, 1, 0], %s}}' % member)
                self.must_fail(1, member.split('"')[1], "quarry", "render", scene, "-o", self.path("b.png"), "--view", self.path("v.json"))


if __name__ == "__main__":
    main()

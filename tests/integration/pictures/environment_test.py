"""Pictures under a photographed sky: the same bits for all workers, threads, caches and faults; bad input."""
import json
import math
import os
import pathlib
import signal
import struct
import subprocess
import sys
import time
import unittest
import unittest.mock

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, Case, end, main

VIEW = ["--mode", "path", "--spp", 8, "--bounces", 3]


def hdr(width, height, color):
    """An image of radiance in Ward's format: `color` of each pixel."""
    out = [b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width)]
    for y in range(height):
        for x in range(width):
            values = color(x, y)
            exponent = math.frexp(max(values))[1] if max(values) > 0 else -128
            out.append(bytes([*(int(v * 2.0 ** (8 - exponent)) for v in values), exponent + 128]))
    return b"".join(out)


def exr(width, height, value):
    """An EXR of one float channel without compression: `value` of each pixel."""
    def attribute(name, kind, content):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(content)) + content
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = (attribute("channels", "chlist", b"Y\0" + struct.pack("<iB3xii", 2, 0, 1, 1) + b"\0") +
              attribute("compression", "compression", b"\0") + attribute("dataWindow", "box2i", window) +
              attribute("displayWindow", "box2i", window) + attribute("lineOrder", "lineOrder", b"\0") +
              attribute("pixelAspectRatio", "float", struct.pack("<f", 1)) +
              attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)) +
              attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0")
    start = 8 + len(header) + 8 * height
    lines = [struct.pack("<iI", y, 4 * width) + b"".join(struct.pack("<f", value(x, y)) for x in range(width)) for y in range(height)]
    table = b"".join(struct.pack("<Q", start + y * len(lines[0])) for y in range(height))
    return struct.pack("<II", 20000630, 2) + header + table + b"".join(lines)


def evening(x, y):
    """A sky of 512x256: blue above, dark below, and a sun of two pixels."""
    if y == 100 and x in (200, 201):
        return 20000, 15000, 9000
    return (0.2 + x / 1000, 0.4, 0.9 - y / 300) if y < 128 else (0.05, 0.04, 0.03)


class Environments(Case):
    def setUp(self):
        super().setUp()
        self.sky = self.path("evening.hdr")
        pathlib.Path(self.sky).write_bytes(hdr(512, 256, evening))

    def render(self, name, *arguments, size="128x96"):
        output = self.path(name + ".exr")
        self.must("quarry", "render", "-o", output, "--quiet", "--size", size, *VIEW, *arguments)
        return pathlib.Path(output).read_bytes()

    def test_the_same_picture(self):
        scene, sky = self.store("plant", 20000), self.path("evening.quarry")
        self.must("quarry-preprocess", self.sky, "-o", sky, "--quiet")
        info = self.info(scene)
        decoded = info["hot_decoded_bytes"] + info["shading_decoded_bytes"]
        under = [scene, "--environment", sky, "--environment-turn", 30]
        reference = self.render("reference", *under, "--workers", 1, "--threads", 1)
        self.assertNotEqual(reference, self.render("o", scene, "--environment", sky, "--workers", 1))
        for workers, threads, cache in ((1, 2, "256M"), (2, 2, "256M"), (1, 1, info["largest_decoded_bytes"]),
                                        (2, 1, decoded // 4)):
            with self.subTest(workers=workers, threads=threads, cache=cache):
                self.assertEqual(self.render("w", *under, "--workers", workers, "--threads", threads, "--cache", cache), reference)
        for isa in ("scalar", "avx2"):
            with self.subTest(isa=isa), unittest.mock.patch.dict(os.environ, QUARRY_ISA=isa):
                self.assertEqual(self.render("i", *under), reference)
        with self.subTest("the image itself, and its kept store"):
            for _ in range(2):
                self.assertEqual(self.render("k", scene, "--environment", self.sky, "--environment-turn", 30), reference)
        with self.subTest("a view in a file"):
            view = self.path("v.json")
            self.render("f", *under, "--write-view", view)
            self.assertEqual(json.loads(pathlib.Path(view).read_text())["environment"], {"name": sky, "turn": 30.0})
            self.assertEqual(self.render("f", scene, "--view", view), reference)
        with self.subTest("a master's environment by its name, and a killed worker"):
            address = self.start_master(scene, "--environment", sky)[1]
            victim = self.start_worker(address, "--threads", 1, "--cache", "32M")
            self.assertEqual(self.render("m", "--master", address, "--environment", "evening", "--environment-turn", 30), reference)
            output = self.path("killed.exr")
            client = subprocess.Popen([str(BIN / "quarry"), "render", "-o", output, "--master", address, "--environment", "evening", "--quiet",
                                       *map(str, VIEW), "--size", "512x384"], stderr=subprocess.PIPE, text=True)
            self.addCleanup(end, client)
            time.sleep(0.5)
            self.assertIsNone(client.poll(), "the job was over before the worker was killed")
            victim.send_signal(signal.SIGKILL)
            self.start_worker(address, "--threads", 2)
            self.assertEqual(client.wait(timeout=60), 0, client.stderr.read())
            whole = self.render("whole", scene, "--environment", sky, size="512x384")
            self.assertEqual(pathlib.Path(output).read_bytes(), whole)
            self.must_fail(1, "no environment 'noon', but 'evening'", "quarry", "render", "-o", self.path("n.exr"), "--master", address,
                           *VIEW, "--environment", "noon")

    def test_a_store_of_an_image_is_whole_and_says_what_it_is(self):
        sky = self.path("evening.quarry")
        self.must("quarry-preprocess", self.sky, "-o", sky, "--stats", self.path("s.json"), "--quiet")
        facts = json.loads(pathlib.Path(self.path("s.json")).read_text())
        self.assertEqual((facts["textures"], facts["texture_pages"], facts["input_triangles"]), (1, 43, 0))
        self.assertEqual(facts["inputs"][0]["file"], self.sky)
        environment = self.info(sky)["environment"]
        self.assertEqual((environment["width"], environment["height"]), (512, 256))
        self.assertAlmostEqual(environment["brightest"], 20000, delta=100)
        self.assertIn("environment", self.must("quarry", "info", sky).stdout)
        self.must("quarry", "verify", sky)
        self.must("quarry-preprocess", self.sky, "-o", self.path("again.quarry"), "--threads", 1, "--quiet")
        self.assertEqual(pathlib.Path(self.path("again.quarry")).read_bytes(), pathlib.Path(sky).read_bytes())

    def test_a_little_below_black_is_black(self):
        """Lossy compression leaves values below 0 beside bright pixels."""
        scene, pictures = self.store("plant", 2000), set()
        for dark in (-0.02, 0):
            image = self.path("below.exr")
            pathlib.Path(image).write_bytes(exr(64, 32, lambda x, y: dark if (x, y) == (7, 3) else 1))
            self.must("quarry", "render", scene, "-o", self.path("below.png"), *VIEW, "--environment", image, "--force")
            pictures.add(pathlib.Path(self.path("below.png")).read_bytes())
        self.assertEqual(len(pictures), 1)

    def test_bad_input(self):
        scene = self.store("plant", 2000)
        images = {
            "text.hdr": (b"no image at all\n", "text.hdr: cannot be read as an image"),
            "empty.hdr": (b"", "empty.hdr: cannot be read as an image"),
            "cut.hdr": (hdr(64, 32, lambda x, y: (1, 1, 1))[:4000], "cut.hdr"),
            "square.hdr": (hdr(32, 32, lambda x, y: (1, 1, 1)), "square.hdr: is 32 x 32 pixels large.*twice as wide as high"),
            "black.hdr": (hdr(64, 32, lambda x, y: (0, 0, 0)), "black.hdr: is black all over"),
            "negative.exr": (exr(64, 32, lambda x, y: -0.5 if (x, y) == (7, 3) else 1), r"negative.exr: its pixel \(7, 3\) is negative"),
            "nan.exr": (exr(64, 32, lambda x, y: math.nan if (x, y) == (9, 30) else 1), r"nan.exr: its pixel \(9, 30\) is no number"),
        }
        for name, (content, sentence) in images.items():
            with self.subTest(name):
                image, store = self.path(name), self.path(name + ".quarry")
                pathlib.Path(image).write_bytes(content)
                self.must_fail(2, sentence, "quarry-preprocess", image, "-o", store, "--quiet")
                self.must_fail(2, sentence, "quarry", "render", scene, "-o", self.path("x.png"), *VIEW, "--environment", image)
                self.assertFalse(pathlib.Path(store).exists())
        good, sky = self.path("good.exr"), self.path("good.quarry")
        pathlib.Path(good).write_bytes(exr(64, 32, lambda x, y: 1 + x / 64))
        self.must("quarry-preprocess", good, "-o", sky, "--quiet")
        png = ["-o", self.path("x.png")]
        render = ["quarry", "render", scene, *png, *VIEW, "--environment"]
        for sentence, command in (
                ("no such file|No such file", [*render, self.path("absent.hdr")]),
                ("is neither an image of radiance", [*render, self.path("plant.ply")]),
                ("is a scene's store", [*render, scene]),
                ("is an environment, which --environment names", ["quarry", "render", sky, *png]),
                ("two skies", [*render, sky, "--sky", "3"]),
                ("--environment-strength", [*render, sky, "--environment-strength", "0"]),
                ("--environment has no effect in --mode ao", ["quarry", "render", scene, *png, "--environment", sky]),
                ("is an image, which makes an environment", ["quarry-preprocess", good, self.path("plant.ply"), "-o", self.path("y.quarry")]),
                ("--plan has no effect on an image", ["quarry-preprocess", good, "--plan"]),
                ("is a scene's store", ["quarry-master", scene, "--environment", scene]),
                ("another environment has this name", ["quarry-master", scene, "--environment", sky, "--environment", sky])):
            with self.subTest(sentence):
                status = 1 if "absent" in command[-1] else 2
                self.must_fail(status, sentence, *command)
        self.assertFalse(pathlib.Path(self.path("x.png")).exists())


if __name__ == "__main__":
    main()

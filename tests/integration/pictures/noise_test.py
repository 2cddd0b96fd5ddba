"""Pictures that end by their noise: the rule's samples and errors, the same bits for all workers, threads, caches and faults; bad input."""
import json
import math
import os
import pathlib
import signal
import subprocess
import sys
import time
import unittest
import unittest.mock

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.exr import read_exr
from tests.integration.programs import BIN, Case, end, main

VIEW = ["--mode", "path", "--bounces", 3]
SIZE, COLUMNS, ROWS, LIMIT, WISH = "120x72", 8, 5, 128, 0.1
LIGHT = ["--sky", 3, "--sun=1,-1,2"]


class Noise(Case):
    def render(self, name, *arguments, size=SIZE):
        output = self.path(name + ".exr")
        self.must("quarry", "render", "-o", output, "--quiet", "--size", size, *VIEW, *arguments)
        return pathlib.Path(output).read_bytes()

    def test_the_rule(self):
        """Of each block the noise is what pictures of all samples say, and it ends where it should."""
        scene = [self.store("plant", 2000), *LIGHT]
        self.render("n", *scene, "--spp", LIMIT, "--noise", WISH, "--aov", "noise,samples", "--stats", self.path("s.json"))
        picture = read_exr(self.path("n.exr"))
        wholes = {}
        for samples in (8, 16, 32, 64, 128):
            self.render(f"w{samples}", *scene, "--spp", samples)
            wholes[samples] = read_exr(self.path(f"w{samples}.exr"))
        # The exposure of its PNG is the one that dark pixels are judged by.
        self.must("quarry", "render", *scene, "-o", self.path("n.png"), "--quiet", "--size", SIZE, *VIEW, "--spp", LIMIT, "--noise", WISH,
                  "--stats", self.path("p.json"))
        darkest = 0.3 / 16 * 2 ** -json.loads(pathlib.Path(self.path("p.json")).read_text())["frames"][0]["exposure_ev"]

        def error(column, row, samples):
            squares, pixels = 0, 0
            for y in range(row * 16, min(row * 16 + 16, 72)):
                for x in range(column * 16, min(column * 16 + 16, 120)):
                    half, whole = (wholes[n].at("RGB", x, y) for n in (samples // 2, samples))
                    square = sum((2 * h - 2 * w) ** 2 for h, w in zip(half, whole)) / 3 / 4
                    squares += square / max(sum(whole) / 3, darkest) ** 2
                    pixels += 1
            return math.sqrt(squares / pixels)

        blocks = [(c, r) for r in range(ROWS) for c in range(COLUMNS)]
        samples_of = {b: picture.at(["samples.n"], b[0] * 16, b[1] * 16)[0] for b in blocks}
        self.assertGreater(len(set(samples_of.values())), 2, samples_of)
        for y in range(72):
            for x in range(120):
                samples, = picture.at(["samples.n"], x, y)
                self.assertEqual(samples, samples_of[x // 16, y // 16])
                self.assertEqual(picture.at("RGBA", x, y), wholes[samples].at("RGBA", x, y), (x, y, samples))
        errors = {(b, n): error(*b, n) for b in blocks for n in (16, 32, 64, 128)}
        for (c, r), samples in samples_of.items():
            self.assertAlmostEqual(picture.at(["noise.E"], c * 16, r * 16)[0], errors[(c, r), samples], delta=1e-4)
            around = [(x, y) for x, y in blocks if abs(x - c) <= 1 and abs(y - r) <= 1]
            stop = 16
            while stop < LIMIT and not all(samples_of[b] < stop or errors[b, stop] < WISH for b in around):
                stop *= 2
            self.assertEqual(samples, stop, (c, r))
        frame = json.loads(pathlib.Path(self.path("s.json")).read_text())["frames"][0]
        self.assertAlmostEqual(frame["noise"], max(errors[b, n] for b, n in samples_of.items()), delta=1e-4)
        pixels = {b: min(16, 120 - b[0] * 16) * min(16, 72 - b[1] * 16) for b in blocks}
        self.assertAlmostEqual(frame["mean_samples"], sum(samples_of[b] * pixels[b] for b in blocks) / (120 * 72), delta=1e-6)

    def test_the_same_picture(self):
        scene = self.store("plant", 20000)
        info = self.info(scene)
        decoded = info["hot_decoded_bytes"] + info["shading_decoded_bytes"]
        wish = ["--noise", WISH, "--spp", LIMIT, *LIGHT]
        reference = self.render("reference", scene, *wish, "--workers", 1, "--threads", 1)
        self.assertNotEqual(reference, self.render("all", scene, *wish[2:]))
        for workers, threads, cache in ((1, 2, "256M"), (2, 2, "256M"), (1, 1, info["largest_decoded_bytes"]), (2, 1, decoded // 4)):
            with self.subTest(workers=workers, threads=threads, cache=cache):
                self.assertEqual(self.render("w", scene, *wish, "--workers", workers, "--threads", threads, "--cache", cache), reference)
        with self.subTest("scalar"), unittest.mock.patch.dict(os.environ, QUARRY_ISA="scalar"):
            self.assertEqual(self.render("i", scene, *wish), reference)
        with self.subTest("a view in a file"):
            view = self.path("v.json")
            self.render("f", scene, *wish, "--write-view", view)
            self.assertEqual(json.loads(pathlib.Path(view).read_text())["noise"], WISH)
            self.assertEqual(self.render("f", scene, "--view", view), reference)
        with self.subTest("a picture with an exposure of its own"):
            pictures = []
            for more in ([], ["--exposure", "5"]):
                self.must("quarry", "render", scene, "-o", self.path("e.png"), "--quiet", "--size", SIZE, *VIEW, *wish, *more, "--stats", self.path("e.json"))
                pictures.append(json.loads(pathlib.Path(self.path("e.json")).read_text())["frames"][0]["mean_samples"])
            self.assertEqual(*pictures)
        with self.subTest("killed workers"):
            address = self.start_master(scene)[1]
            victim = self.start_worker(address, "--threads", 1, "--cache", "32M")
            output = self.path("killed.exr")
            client = subprocess.Popen([str(BIN / "quarry"), "render", "-o", output, "--master", address, "--quiet", *map(str, VIEW + wish),
                                       "--size", "480x288"], stderr=subprocess.PIPE, text=True)
            self.addCleanup(end, client)
            for _ in range(2):
                time.sleep(1)
                self.assertIsNone(client.poll(), "the job was over before the worker was killed")
                victim.send_signal(signal.SIGKILL)
                victim = self.start_worker(address, "--threads", 2)
            self.assertEqual(client.wait(timeout=60), 0, client.stderr.read())
            self.assertEqual(pathlib.Path(output).read_bytes(), self.render("whole", scene, *wish, size="480x288"))

    def test_other_modes_and_few_samples(self):
        scene = self.store("plant", 2000)
        output = self.path("a.exr")
        for more in (["--mode", "ao", "--spp", 64, "--noise", 0.3], ["--mode", "raycast", "--spp", 17, "--noise", 0.5]):
            with self.subTest(more=more):
                self.must("quarry", "render", scene, "-o", output, "--quiet", "--size", "64x48", *more, "--aov", "depth,samples,noise")
                samples = {n for row in read_exr(output).rows["samples.n"] for n in row}
                self.assertLessEqual(samples, {16, 17, 32, 64})
        self.must("quarry", "render", scene, "-o", output, "--quiet", "--size", "64x48", "--spp", 1, "--aov", "samples")
        self.assertEqual({n for row in read_exr(output).rows["samples.n"] for n in row}, {1})
        said = self.must("quarry", "render", scene, "-o", output, "--size", "64x48", *VIEW, "--noise", 0.2).stderr
        self.assertRegex(said, r"up to 4096 samples a pixel, to a noise of 0.2 \(reached: 0\.\d+, with \d+ samples a pixel on the mean\)")

    def test_bad_input(self):
        scene, output = self.store("plant", 2000), self.path("x.exr")
        for noise in ("0", "-1", "2", "nan", "inf", "much", "1e-9"):
            with self.subTest(noise):
                self.must_fail(2, "--noise", "quarry", "render", scene, "-o", output, *VIEW, f"--noise={noise}")
        self.must_fail(2, "--noise needs at least 17 samples a pixel", "quarry", "render", scene, "-o", output, "--spp", 16, "--noise", 0.1)
        self.must_fail(2, "the layer noise needs at least 2 samples", "quarry", "render", scene, "-o", output, "--spp", 1, "--aov", "noise")
        for value in ("0", "2", '"low"', "[]"):
            with self.subTest(value):
                pathlib.Path(self.path("v.json")).write_text('{"noise": %s}' % value)
                self.must_fail(1, "v.json: noise: ", "quarry", "render", scene, "-o", output, "--view", self.path("v.json"))
        self.assertFalse(pathlib.Path(output).exists())


if __name__ == "__main__":
    main()

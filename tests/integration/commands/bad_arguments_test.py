"""Bad arguments of every kind on command lines: JSON files, numbers. Each gets one sentence, before any work."""
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.commands.bad_input_test import CUBE
from tests.integration.programs import BIN, Case, main


class BadJson(Case):
    """Camera paths and lights: one sentence with file and key, before any work."""

    def setUp(self):
        super().setUp()
        self.scene = self.path("cube.ply")
        pathlib.Path(self.scene).write_text(CUBE)

    def refuse(self, option, text, sentence):
        path = self.path("given.json")
        pathlib.Path(path).write_text(text)
        with self.subTest(option=option, text=text[:60]):
            self.must_fail(1, r"given\.json: .*" + sentence, "quarry", "render", self.scene, "-o", self.path("x.png"), option, path)
            self.assertEqual(sorted(os.listdir(self.folder)), ["cube.ply", "given.json"])

    def test_camera_paths(self):
        for text, sentence in (
                ("", "byte 1"), ("{", "byte"), ("[]", "must be an object"), ("{}", "'frames' is missing"), ('{"frames": 3}', "frames: must be a list"),
                ('{"frames": []}', "frames: has no frame"), ('{"frames": [3]}', r"frames\[0\]: must be an object"),
                ('{"frames": [{"eye": [0, 0, 1]}]}', r"frames\[0\]: 'at' is missing"),
                ('{"frames": [{"eye": [0, 0, 1e999], "at": [0, 0, 0]}]}', r"frames\[0\]\.eye\[2\] is the number 1e999"),
                ('{"frames": [{"eye": [0, 0, "1"], "at": [0, 0, 0]}]}', r"frames\[0\]\.eye: must be three numbers, like \[1, 2, 3\]"),
                ('{"frames": [{"eye": {"x": 1}, "at": [0, 0, 0]}]}', r"frames\[0\]\.eye: must be three numbers"),
                ('{"frames": [{"eye": [0, 0, 1], "at": [0, 0, 0], "fov": true}]}', r"frames\[0\]\.fov: must be a number"),
                ('{"frames": [{"eye": [0, 0, 1], "at": [0, 0, 0], "fov": 1e308}]}', r"frames\[0\]\.fov: must lie between"),
                ("[" * 400000, "deeper than 64"), ('{"frames":' * 400000, "deeper than 64"),
                ("[" + "0," * 5000000 + "0]", "more than 4194304 values"), ('"\\ud800"', "byte")):
            self.refuse("--camera-path", text, sentence)

    def test_lights(self):
        for text, sentence in (
                ("{}", "'lights' is missing"), ('{"lights": {}}', "lights: must be a list"), ('{"lights": [7]}', r"lights\[0\]: must be an object"),
                ('{"lights": [{"type": 7}]}', r"lights\[0\]\.type: must be a text"), ('{"lights": [{"type": "moon"}]}', "must be sun, point or rectangle"),
                ('{"lights": [{"type": "sun", "direction": [0, 0, 1]}]}', r"lights\[0\]: 'radiance' is missing"),
                ('{"lights": [{"type": "sun", "direction": [0, 0, 1], "radiance": [1e39, 0, 0]}]}', r"lights\[0\]\.radiance: must be three numbers from 0 to 3.4e\+38"),
                ('{"lights": [], "ambient": [1, 1, 1e999]}', r"ambient\[2\] is the number 1e999"),
                ('{"lights": [], "background": "blue"}', "background: must be three numbers")):
            self.refuse("--lights", text, sentence)

    def test_files_that_block_a_reader(self):
        os.mkfifo(self.path("fifo"))
        for option in ("--camera-path", "--lights"):
            self.must_fail(1, "fifo: is not a regular file", "quarry", "render", self.scene, "-o", self.path("x.png"), option,
                           self.path("fifo"))
        for scene in (self.path("fifo"), "/dev/zero", str(self.folder)):
            self.must_fail(1, "is not a regular file|is a folder", "quarry", "render", scene, "-o", self.path("x.png"))
            self.must_fail(1, "is not a regular file", "quarry-preprocess", scene, "-o", self.path("x.quarry"))


class BadBenchArguments(Case):
    def test_every_benchmark_refuses_unknown_options(self):
        benches = sorted(path.name.removeprefix("quarry-bench-") for path in BIN.glob("quarry-bench-*"))
        self.assertGreater(len(benches), 8, benches)
        for bench in benches:
            with self.subTest(bench=bench):
                done = self.run_program("quarry", "bench", bench, "--no-such-option")
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertIn("Run with --help", done.stderr)
                self.assertIn("--help", self.must("quarry", "bench", bench, "--help").stdout)


class BadNumbers(Case):
    def test_invalid_numbers(self):
        model = self.folder / "cube.ply"
        model.write_text(CUBE)
        store = self.path("cube.quarry")
        self.must("quarry-preprocess", model, "-o", store, "--quiet")
        path = self.folder / "path.json"
        path.write_text('{"frames": [{"eye": [3, 3, 3], "at": [0, 0, 0]}]}')
        render = ["quarry", "render", store, "-o", self.path("x.png")]
        wrong = [(render, option, value) for option, values in {
            "--size": ["4294967297x64", "64x4294967297", "-5x-5", "64x", "64x64x64", "+64x64", "0x0", "64 x64", "1e2x1e2"],
            "--crop": ["-1,0,8,8", "0,0,4294967304,8", "0,0,8", "0,0,0,8", "4294967296,0,8,8"],
            "--spp": ["-1", "0", "4294967297", "1.5", "010", "65537"], "--seed": ["-1", "18446744073709551616", "x"],
            "--workers": ["-1", "0", "257", "4294967297"], "--threads": ["-1", "0", "4294967297"],
            "--fov": ["nan", "0", "-1", "180", "1e999"], "--ortho": ["-1", "nan", "inf"], "--exposure": ["nan", "1e999"],
            "--retry": ["nan", "-1", "inf"], "--cache": ["-1", "nan", "1e30", "99999999999G"]}.items() for value in values]
        wrong += [([*render, "--camera-path", str(path)], "--frames", value)
                  for value in ("0-4294967296", "4294967296", "4294967296-4294967296", "-1", "0--1", "1-0", "0-0-0", "+0", "0x0")]
        wrong += [(["quarry-preprocess", str(model), "-o", self.path("y.quarry")], option, value) for option, values in {
            "--threads": ["-1", "0", "4294967297"], "--scale": ["nan", "0", "-1", "1e999"], "--checkpoint": ["nan", "-1"],
            "--memory": ["-1", "nan"], "--voxel-size": ["4294967296K", "-4K"], "--unpack-limit": ["-1", "0", "nan"]}.items()
            for value in values]
        wrong += [(["quarry-worker", "--master", "127.0.0.1:1"], option, value) for option, values in {
            "--threads": ["-1", "4294967297"], "--retry": ["nan", "-1"], "--cache": ["-1"]}.items() for value in values]
        wrong += [(["quarry-scene", "city", "-o", self.path("c.ply")], "--triangles", value) for value in ("-1", "18446744073709552616", "1e4")]
        wrong += [(["quarry-scene", "city", "--triangles", "1000", "-o", self.path("c.ply")], "--seed", value)
                  for value in ("-1", "18446744073709551616")]
        wrong += [(["quarry-master", store], "--listen", f"127.0.0.1:{port}") for port in ("65536", "-1", "4294967297")]
        for program, option, value in wrong:
            with self.subTest(program=program[0], option=option, value=value):
                done = self.run_program(*program, f"{option}={value}")
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertTrue(done.stderr.strip())
        self.assertEqual(sorted(os.listdir(self.folder)), ["cube.ply", "cube.quarry", "path.json"])


if __name__ == "__main__":
    main()

"""Odd and malformed files of other projects' parser tests, through the program; quarry-unit-tests "[odd]" checks their content."""
import os
import pathlib
import subprocess
import sys
import threading

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, TIMEOUT_S, Case, main

ODD = pathlib.Path(__file__).parents[4] / "shared/scenes/odd"
MODELS = {".ply", ".obj", ".stl", ".off", ".gltf", ".glb", ".3mf", ".amf"}


class Odd(Case):
    def test_each_is_read_or_refused_with_a_sentence_within_its_memory(self):
        if not ODD.is_dir():
            self.skipTest("../shared/scenes/odd is not there")
        models = sorted(path for path in ODD.rglob("*") if path.suffix.lower() in MODELS)
        self.assertGreater(len(models), 100)
        refused = 0
        for model in models:
            with self.subTest(model=str(model.relative_to(ODD))):
                run = subprocess.Popen([BIN / "quarry-preprocess", model, "-o", self.path("x.quarry"), "--memory", "128M", "--quiet"],
                                       stderr=subprocess.PIPE, text=True)
                hangs = threading.Timer(TIMEOUT_S, run.kill)
                hangs.start()
                told = run.stderr.read()
                _, status, used = os.wait4(run.pid, 0)
                run.returncode = os.waitstatus_to_exitcode(status)
                hangs.cancel()
                run.stderr.close()
                self.assertIn(run.returncode, (0, 1), told)
                self.assertEqual(pathlib.Path(self.path("x.quarry")).exists(), run.returncode == 0)
                self.assertEqual([p.name for p in self.folder.iterdir() if p.name not in ("x.quarry", "cache")], [])
                if run.returncode == 0:
                    self.assertGreater(self.info(self.path("x.quarry"))["input_triangles"], 0)
                    pathlib.Path(self.path("x.quarry")).unlink()
                else:
                    refused += 1
                    self.assertIn(model.name, told.splitlines()[-1])
                if PATIENCE == 1:  # sanitizers take memory of their own
                    self.assertLess(used.ru_maxrss << 10, (128 + 44) << 20)
        self.assertGreater(refused, 10)


if __name__ == "__main__":
    main()

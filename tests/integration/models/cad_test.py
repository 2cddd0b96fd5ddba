"""STEP and IGES by Open CASCADE: names, colours, volumes, units; damaged files and helpers that fail; memory, threads and resumed runs."""
import gzip
import json
import math
import os
import pathlib
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, Case, main

DATA = pathlib.Path("/usr/share/opencascade/data")
WHOLE = os.environ.get("QUARRY_CAD_WHOLE") == "1"
BYTES_A_BYTE = 24  # memory over a file's bytes, as the page of cad/ states
HEADER = ("ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
          "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n")


def setUpModule():
    if not (BIN / "quarry-import-cad").exists():
        raise unittest.SkipTest("quarry-import-cad was not built: Open CASCADE is not there")


class Cad(Case):
    def written(self, name, parts, shapes, unit="MM"):
        """Lets Open CASCADE write an assembly. Returns its path and its content."""
        made = self.must("quarry-test-cad", "write", self.path(name), parts, shapes, unit)
        return self.path(name), json.loads(made.stdout.splitlines()[-1])

    def read(self, model, *deflection):
        return json.loads(self.must("quarry-test-cad", "read", model, *deflection).stdout)

    def sample(self, name):
        if not (DATA / name).exists():
            self.skipTest(f"{name} is not there: Debian's occt-misc is not installed (deploy/install --tests)")
        return str(DATA / name)

    def made(self, model, *options):
        self.must("quarry-preprocess", model, "-o", self.path("s.quarry"), "--force", "--quiet", *options)
        return pathlib.Path(self.path("s.quarry")).read_bytes()

    def refused(self, sentence, model, *options, **more):
        done = self.must_fail(1, sentence, "quarry-preprocess", model, "-o", self.path("no.quarry"), "--quiet", *options, **more)
        self.assertEqual([p.name for p in self.folder.iterdir() if p.name.startswith("no.quarry") and not p.name.endswith(".lock")], [])
        return done

    def check_assembly(self, wanted, got, most=0.01):
        """Names, colours, and volumes to within `most`."""
        parts = {part["path"]: part for part in got["parts"]}
        self.assertEqual(sorted(parts), sorted(part["path"] for part in wanted))
        for part in wanted:
            with self.subTest(part=part["path"]):
                self.assertEqual(parts[part["path"]]["colors"], part["colors"])
                self.assertAlmostEqual(parts[part["path"]]["volume"] / part["volume"], 1, delta=most)


class Content(Cad):
    def test_files_that_an_assembly_names_are_not_read(self):
        """A STEP file of a stranger names files of this machine, which are there."""
        self.must("quarry-test-cad", "write", self.path("apart.step"), 6, 3, "MM", "apart")
        text = (self.folder / "apart.step").read_text()
        names = set(re.findall(r"DOCUMENT_FILE\('([^']*\.stp)'", text))
        self.assertEqual({p.name for p in self.folder.glob("*.stp")}, names)
        done = self.run_program("quarry-preprocess", self.path("apart.step"), "-o", self.path("no.quarry"))
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r"warning: .*has parts in 3 other files")
        for outside in (f"{self.folder}/", f"../../..{self.folder}/", "../"):
            (self.folder / "named.step").write_text(re.sub(r"'([^']*\.stp)'", rf"'{outside}\1'", text))
            self.must_fail(1, "outside the model's folder, which is not read", "quarry-preprocess", self.path("named.step"), "-o", self.path("no.quarry"), "--quiet")
        self.assertFalse((self.folder / "no.quarry").exists())

    def test_names_colours_and_volumes(self):
        model, wanted = self.written("a.step", 60, 20)
        got = self.read(model)
        self.assertEqual(got["warnings"], [])
        self.check_assembly(wanted, got)
        self.assertGreater(got["least_cosine"], math.cos(math.radians(20)))  # normals are on the triangles' side

    def test_a_smaller_deflection_comes_closer(self):
        model, wanted = self.written("a.step", 10, 10)
        self.check_assembly(wanted, self.read(model, 0.01, 4), 0.0015)

    def test_coordinates_keep_the_unit(self):
        for unit, name in (("INCH", "in"), ("M", "m")):
            with self.subTest(unit=unit):
                model, wanted = self.written("a.step", 5, 5, unit)
                got = self.read(model)
                self.assertRegex(got["notes"][0], f"a.step: coordinates in {name}; triangles within .* {name} of the surfaces")
                self.check_assembly(wanted, got)

    def test_a_unit_that_is_not_named(self):
        model, wanted = self.written("a.step", 5, 5)
        text = pathlib.Path(model).read_text()
        text, changed = re.subn(r"= \( GEOMETRIC_REPRESENTATION_CONTEXT\(3\)\s+GLOBAL_UNCERTAINTY[^;]*;", "= GEOMETRIC_REPRESENTATION_CONTEXT('','3D',3);", text)
        self.assertGreater(changed, 0)
        pathlib.Path(model).write_text(text)
        got = self.read(model)
        self.assertRegex(got["warnings"][0], r"a\.step: names no unit of length; its coordinates are taken as millimetres")
        self.check_assembly(wanted, got)

    def test_iges_of_the_library(self):
        model, wanted = self.written("a.iges", 5, 5, "INCH")
        got = self.read(model)
        self.assertRegex(got["notes"][0], "coordinates in in;")
        (part,) = got["parts"]  # the library writes surfaces side by side, and not all of their colours
        self.assertEqual(part["path"], "hall")
        self.assertTrue(set(part["colors"]) & {color for part in wanted for color in part["colors"]})
        self.assertGreater(got["least_cosine"], math.cos(math.radians(20)))

    def test_samples_of_the_library(self):
        for name, least in (("step/linkrods.step", 5000), ("step/screw.step", 500), ("iges/bearing.iges", 10000), ("iges/hammer.iges", 5000)):
            with self.subTest(name=name):
                got = self.read(self.sample(name))
                self.assertEqual(got["warnings"], [])
                self.assertGreater(sum(part["triangles"] for part in got["parts"]), least)

    def test_packed_files_and_pipes(self):
        model, _ = self.written("a.step", 10, 10)
        plain = self.made(model)
        text = pathlib.Path(model).read_bytes()
        for name in ("a.stpz", "a.step.gz"):
            pathlib.Path(self.path(name)).write_bytes(gzip.compress(text))
            self.made(self.path(name))
        piped = subprocess.run([BIN / "quarry-preprocess", "-", "-o", self.path("p.quarry"), "--quiet", "--up-axis", "y"], input=text, capture_output=True,
                               timeout=60 * PATIENCE)
        self.assertEqual(piped.returncode, 0, piped.stderr)
        self.assertEqual(self.info(self.path("s.quarry"))["input_triangles"], self.info(self.path("p.quarry"))["input_triangles"])
        self.assertTrue(plain)


class Options(Cad):
    def test_deflection_is_stated_and_part_of_the_kept_store(self):
        model, _ = self.written("a.step", 5, 5)
        done = self.run_program("quarry-preprocess", model, "-o", self.path("a.quarry"), "--deflection", "0.5,20")
        self.assertRegex(done.stderr, r"a\.step: coordinates in mm; triangles within 0\.5 mm of the surfaces, and 20 degrees of each other")
        coarse, fine = self.path("c.png"), self.path("f.png")
        small = ("--size", "64x64", "--quiet")
        self.must("quarry", "render", model, "-o", coarse, "--deflection", "2,60", *small)
        self.must("quarry", "render", model, "-o", fine, *small)
        self.assertNotEqual(pathlib.Path(coarse).read_bytes(), pathlib.Path(fine).read_bytes())
        self.must_fail(2, r"--deflection is for models that are preprocessed", "quarry", "render", self.path("a.quarry"), "-o", coarse, "--deflection", "1")
        for wrong in ("0", "-1", "x", "1,0", "1,91", "1,10,3", "1e99"):
            self.must_fail(2, "--deflection", "quarry-preprocess", model, "-o", self.path("b.quarry"), f"--deflection={wrong}")


class Sameness(Cad):
    def test_one_store_for_memory_and_threads(self):
        model, _ = self.written("a.step", 60, 20)
        whole = self.made(model)
        for options in (("--memory", "64M"), ("--threads", 1), ("--threads", 3, "--memory", "256M")):
            with self.subTest(options=options):
                self.assertTrue(self.made(model, *options) == whole, "other bytes")

    def test_a_killed_run_continues_between_files(self):
        models = [self.written(f"{name}.step", 30, 10)[0] for name in "ab"] + [self.sample("step/screw.step")]
        self.must("quarry-preprocess", *models, "-o", self.path("s.quarry"), "--quiet", "--memory", "64M")
        killed = self.made_in_spite_of_kills((0.3, 0.6, 0.9), *models, "--memory", "64M", "--checkpoint", "0")
        self.assertTrue(killed == pathlib.Path(self.path("s.quarry")).read_bytes(), "other bytes after kills")


class Failures(Cad):
    def test_a_file_too_large_for_memory_is_refused_before_the_work(self):
        model, _ = self.written("a.step", 10, 10)
        with open(model, "ab") as file:
            file.write(b"\n" * (4 << 20))
        started = time.monotonic()
        self.refused(rf"a\.step: Open CASCADE takes up to {BYTES_A_BYTE} times its 5 MiB of memory: give it --memory \d+M, or export", model, "--memory", "64M")
        self.assertLess(time.monotonic() - started, 5 * PATIENCE)

    def test_damaged_files_give_a_model_or_one_sentence(self):
        model, _ = self.written("a.step", 5, 5)
        sound = pathlib.Path(model).read_bytes()
        chance = random.Random(53)
        for trial in range(16):
            bad = bytearray(sound)
            if trial % 4 == 0:
                del bad[chance.randrange(200, len(bad)):]
            else:
                for _ in range(1 << trial % 8):
                    bad[chance.randrange(len(bad))] = chance.choice(b"#0123456789,()'$*.ET ")
            pathlib.Path(self.path("bad.step")).write_bytes(bad)
            done = self.run_program("quarry-preprocess", self.path("bad.step"), "-o", self.path("bad.quarry"), "--quiet", "--force")
            with self.subTest(trial=trial):
                self.assertIn(done.returncode, (0, 1), done.stderr)
                if done.returncode == 1:
                    self.assertEqual(len([line for line in done.stderr.splitlines() if not line.startswith("warning")]), 1, done.stderr)

    def test_empty_files(self):
        pathlib.Path(self.path("e.step")).write_text(HEADER + "ENDSEC;\nEND-ISO-10303-21;\n")
        self.refused(r"e\.step: .*Open CASCADE.*; export triangles", self.path("e.step"))

    def helper(self, script):
        """A folder of programs with another helper in it."""
        folder = self.folder / "programs"
        folder.mkdir(exist_ok=True)
        shutil.copy(BIN / "quarry-preprocess", folder)
        (folder / "quarry-import-cad").write_text("#!/usr/bin/env python3\nimport os, signal, struct, sys\n"
                                                  "def say(kind, content=b''):\n  sys.stdout.buffer.write(struct.pack('<II', kind, len(content)) + content)\n"
                                                  "  sys.stdout.buffer.flush()\n"
                                                  "facts = struct.pack('<5d', 0, 0, 0, 1, 1) + b'mm'\n" + script)
        (folder / "quarry-import-cad").chmod(0o755)
        return folder / "quarry-preprocess"

    def test_helpers_that_fail(self):
        model, _ = self.written("a.step", 5, 5)
        begun = "say(3, facts); say(5, b'cart\\0wheel\\0'); say(6, struct.pack('<I', 0xFFFFFFFF)); say(7, bytes(72));"
        lies = "gives an invalid answer"
        for script, sentence in (
                ("os.kill(os.getpid(), signal.SIGKILL)", "ended by signal 9"),
                (begun + "signal.signal(signal.SIGSEGV, signal.SIG_DFL); os.kill(os.getpid(), signal.SIGSEGV)", r"has crashed on it \(in \"cart/wheel\"\): .*export triangles"),
                ("os.kill(os.getpid(), signal.SIGXCPU)", "no progress with it in ten minutes"),
                ("sys.exit(127)", "lacks shared libraries: install Open CASCADE"),
                (begun + "sys.exit(0)", "has ended before its answer"),
                ("sys.stdout.buffer.write(b'abc')", "has ended before its answer"),
                ("say(12)", "needs more memory than --memory allows"),
                ("say(11, b'it is odd')", "it is odd; export triangles"),
                ("say(99)", lies), ("say(7, bytes(24))", lies), ("say(3, b'short')", lies),
                ("sys.stdout.buffer.write(struct.pack('<II', 7, 1 << 30)); sys.stdout.flush()", lies),
                (begun + "say(9, struct.pack('<III', 0, 1, 3))", lies),
                ("say(3, facts); say(5, b'wheel')", lies), (begun + "say(8, bytes(36))", lies),
                (begun + "say(6, struct.pack('<I', 0))", lies),
                ("say(3, struct.pack('<5d', 0, 0, 0, -1, float('nan')) + b'mm')", lies),
                (begun + "say(10, struct.pack('<QQ', 1, 2))", lies),
                (begun + "say(10, struct.pack('<QQ', 1, 1))", "holds no triangles")):
            with self.subTest(script=script):
                done = subprocess.run([self.helper(script), model, "-o", self.path("no.quarry"), "--quiet"], capture_output=True, text=True, timeout=60)
                self.assertEqual(done.returncode, 1)
                self.assertRegex(done.stderr, rf"^quarry-preprocess: {model}: .*{sentence}.*\n$")
                self.assertFalse(pathlib.Path(self.path("no.quarry")).exists())

    def test_without_the_helper_the_package_is_named(self):
        model, _ = self.written("a.step", 5, 5)
        program = self.helper("")
        (self.folder / "programs/quarry-import-cad").unlink()
        done = subprocess.run([program, model, "-o", self.path("no.quarry"), "--quiet"], capture_output=True, text=True, timeout=60)
        self.assertRegex(done.stderr, r"^quarry-preprocess: \S+a\.step: is a STEP file, of exact surfaces; install quarry-import-cad, which reads it \(the package quarry-cad\)")


if WHOLE:
    class Large(Cad):
        """Minutes: ctest -L slow."""

        def test_2000_parts_within_1g(self):
            model, wanted = self.written("a.step", 2000, 2000)
            self.assertGreater(pathlib.Path(model).stat().st_size, 17e6)
            self.check_assembly(wanted, self.read(model))
            self.made(model, "--memory", "1G", "--deflection", "1,40")


if __name__ == "__main__":
    main()

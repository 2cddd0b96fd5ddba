#!/usr/bin/env python3
"""The papers' laboratory, as a user runs it on small scenes: `quarry bench stream` and `quarry bench papers`, their tables, JSON and pictures,
and one sentence for each impossible request.
Usage: tests/integration/commands/laboratory_test.py   QUARRY_BIN: the programs, else build/release/bin"""
import json
import pathlib
import shutil
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, Case, main

# Under valgrind libhwy executes RDTSCP at start, which some virtual processors lack.
VALGRIND = shutil.which("valgrind") and " rdtscp " in pathlib.Path("/proc/cpuinfo").read_text()
SMALL = ("--size", 96, "--path-size", 48, "--quiet")


class Laboratory(Case):
    def stream(self, store, *options):
        return self.must("quarry", "bench", "stream", store, *SMALL, *options).stdout

    @unittest.skipUnless(VALGRIND, "valgrind is not installed, or the processor lacks RDTSCP: instructions are not counted")
    def test_instructions_are_counted(self):
        figures = self.folder / "counted.json"
        text = self.stream(self.store("cornell", 3000), "--structure", "backtrack", "--tree", "theirs", "--no-check", "--count-size", 16, "--json", figures)
        self.assertNotIn("not counted", text)
        for row in json.loads(figures.read_text())["renderers"]:
            self.assertGreater(row["instructions"]["up"]["body"], 5, row["renderer"])

    def test_the_machine_makes_the_papers_tables_and_figures(self):
        store = self.store("cornell", 3000)
        for structure in ("grid", "restart", "push-down", "backtrack", "ropes"):
            figures = self.folder / f"{structure}.json"
            options = ["--plots", self.folder] if structure == "grid" else []
            if structure != "grid" or not VALGRIND:
                options.append("--no-instructions")
            text = self.stream(store, "--structure", structure, "--cells", 16, "--json", figures, *options)
            for heading in ("Table 1", "Table 2", "Figure 6", "Figure 7", "Figures 8 and 9", "Table 3"):
                self.assertIn(heading, text)
            study = json.loads(figures.read_text())
            for row in study["oracles"]:
                self.assertGreaterEqual(row["structure_passes"], row["least_structure_passes"], row)
            for row in study["renderers"]:
                self.assertTrue(row["same_schedules"], row["renderer"])
                if row["renderer"] != "path":
                    self.assertTrue(row["same_as_render"], row["renderer"])
                for count in ("rays", "steps", "tests", "shaded"):
                    self.assertEqual(row["multipass"][count], row[count], row["renderer"])
            self.check_shade_kernels(text, study)
            tests = study["renderers"][0]["tests"]
            self.assertEqual(tests, study["multipass"]["tests"])
            self.assertEqual(tests, study["tiled"]["tests"])
            self.assertLess(sum(study["unrolled"]["bytes"].values()), sum(study["multipass"]["bytes"].values()))
        if VALGRIND:
            instructions = json.loads((self.folder / "grid.json").read_text())["renderers"][0]["instructions"]
            self.assertTrue(20 < instructions["traverse"]["body"] < 1000, instructions)
            self.assertTrue((self.folder / "cornell-figure-7.png").exists())
        for figure in (6, 8, 9):
            picture = (self.folder / f"cornell-figure-{figure}.png").read_bytes()
            self.assertTrue(picture.startswith(b"\x89PNG"))
            self.assertGreater(len(picture), 5000)

    def check_shade_kernels(self, text, study):
        """Table 1 has the shade kernels of each renderer, and its words of a run equal the JSON's."""
        kernels = {cells[0]: cells for cells in ([cell.strip() for cell in line.split("|")[1:-1]] for line in text.split("## Table 2")[0].splitlines()
                                                 if line.startswith("| ")) if cells}
        self.assertNotIn("shadow", kernels)
        for row in study["renderers"][1:]:
            for kernel in ("color", "shadow"):
                cells = kernels[f"{kernel}, {row['renderer']}"]
                self.assertEqual(len(cells), 9)
                for run, first in ((row["multipass"], 2), (row, 6)):
                    counts = run["kernels"][kernel]
                    for place, words in enumerate(("words_read", "words_written", "words_fetched")):
                        self.assertAlmostEqual(float(cells[first + place]), counts[words] / counts["runs"], delta=0.0501, msg=(cells, words))
                self.assertGreater(float(cells[2]), 10, cells)

    def test_a_larger_cache_of_more_ways_reads_less(self):
        store = self.store("forest", 20000)

        def cached(*options):
            figures = self.folder / "cache.json"
            self.stream(store, "--cells", 24, "--no-instructions", "--no-check", "--json", figures, *options)
            return sum(json.loads(figures.read_text())["renderers"][0]["cached_bytes"].values())
        self.assertLess(cached("--cache", 1 << 20, "--ways", 4), cached("--cache", 16384))

    def test_foleys_tables(self):
        figures = self.folder / "papers.json"
        stores = self.store("cornell", 3000), self.store("forest", 20000)
        text = self.must("quarry", "bench", "papers", *stores, "--size", 64, "--repetitions", 1, "--json", figures).stdout
        self.assertIn("Table 1", text)
        self.assertIn("Table 2", text)
        for scene in json.loads(figures.read_text())["scenes"]:
            for name, tree in scene["trees"].items():
                stack, restart, backtrack = tree["stack"], tree["restart"], tree["backtrack"]
                for of in (restart, backtrack):
                    self.assertEqual((stack["lists"], stack["empty_lists"], stack["tests"]), (of["lists"], of["empty_lists"], of["tests"]), name)
                # The pseudocode searches the split again that it resumes at.
                self.assertEqual(backtrack["down"], stack["down"] + backtrack["resumes"])
                self.assertGreaterEqual(restart["down"], backtrack["down"])

    def test_foleys_first_table_on_an_emulated_gpu(self):
        figures = self.folder / "gpu.json"
        pathlib.Path(self.store("cornell", 3000)).rename(self.folder / "frame-cornell.quarry")
        text = self.must("quarry-emulated-bench-papers", "--folder", self.folder, "--size", 32, "--repetitions", 2, "--no-brute-force",
                         "--json", figures).stdout
        self.assertIn("Table 1 on a GPU, emulated warps", text)
        self.assertNotIn("Nothing is measured on a GPU", text)
        results = json.loads(figures.read_text())
        self.assertEqual(results["gpu"]["name"], "emulated warps")
        scene = results["scenes"][0]
        ways = [way + of for of in ("", ", ours") for way in ("restart", "backtrack", "push-down", "ropes")]
        self.assertEqual(sorted(scene["gpu_seconds"]), sorted(["grid", *ways]))
        for name, seconds in scene["gpu_seconds"].items():
            self.assertEqual(len(seconds), 20, name)
        self.assertNotIn("brute", scene["seconds"])
        table = text[text.index("Table 1 on a GPU"):text.index("Table 2")].splitlines()
        for begin in ("| scene |", "|---|", "| Cornell Box | - |", "| the paper's | 23 | 63 | 80 | 84 |"):
            row = next(line for line in table if line.startswith(begin))
            self.assertEqual(row.count("|"), 15, row)

    def test_errors_are_one_sentence(self):
        store = self.store("cornell", 3000)
        for options, words in ((["--line", 3], "line"), (["--structure", "octree"], "octree"), (["--oracle", "delphi"], "delphi"),
                               (["--json", self.folder / "none" / "x.json"], "none")):
            done = self.must_fail(2, rf"{words}|--help", "quarry", "bench", "stream", store, *SMALL, *options)
            self.assertIn(words, done.stderr)
            self.assertEqual(done.stdout, "")
        (self.folder / "no.quarry").write_bytes(b"no store")
        done = self.must_fail(1, r"no\.quarry", "quarry", "bench", "stream", self.folder / "no.quarry", "--quiet")
        self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)
        (self.folder / "empty.quarry").write_bytes(b"")
        for what in ("stream", "papers"):
            self.must_fail(1, r"empty\.quarry", "quarry", "bench", what, self.folder / "empty.quarry")
        self.must_fail(2, "multiple of 8", "quarry", "bench", "papers", store, "--size", 12)
        self.must_fail(2, "none of the paper's scenes", "quarry", "bench", "papers", "--folder", self.folder)
        self.must_fail(2, "no JSON object", "quarry", "bench", "papers", store, "--instructions", self.folder / "empty.quarry")
        # Before the first is measured, which takes minutes.
        self.must_fail(1, r"absent\.quarry", "quarry", "bench", "papers", store, self.folder / "absent.quarry", "--size", 4096)
        for what, options in (("papers", [str(store)] * 5 + ["--size", 64, "--repetitions", 1]), ("stream", [*SMALL, "--no-instructions", "--no-check"])):
            with open("/dev/full", "w", encoding="ascii") as full:
                done = subprocess.run([str(BIN / "quarry"), "bench", what, str(store), *map(str, options)], stdout=full, stderr=subprocess.PIPE,
                                      text=True, check=False)
            self.assertEqual(done.returncode, 1, what)
            self.assertIn("standard output cannot be written: No space left on device", done.stderr)


if __name__ == "__main__":
    main()

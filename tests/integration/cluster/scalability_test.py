"""The experiments of tests/scalability, small: they run to their end and their counts are right."""
import csv
import json
import pathlib
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, end, main
from tests.scalability.cluster import path_of_frames
from tests.scalability.place import why_not

SCRIPTS = pathlib.Path(__file__).parents[2] / "scalability"

FRAMES = 6


class Scalability(Case):
    def setUp(self):
        super().setUp()
        self.scene = self.store("plant", 50000, voxel_size="16K")
        self.walk = self.path("plant.path.json")

    def experiment(self, name, *arguments):
        """The rows of the CSV file that the experiment wrote."""
        table = self.path(name + ".csv")
        done = subprocess.run([str(SCRIPTS / name), self.scene, self.walk, "--size", "96x64", "--csv", table,
                               *map(str, arguments)], capture_output=True, text=True, timeout=2 * TIMEOUT_S)
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(table, newline="") as file:
            return list(csv.DictReader(file))

    def test_affinity_loads_all_touched_blocks_under_every_policy(self):
        rows = self.experiment("affinity", "--workers", 2, "--frames", FRAMES)
        self.assertEqual([(r["path"], r["policy"]) for r in rows],
                         [(path, policy) for path in ("slow", "fast") for policy in ("random", "last-owner", "footprint")])
        for row in rows:
            self.assertGreater(float(row["megabytes_touched"]), 0)
            self.assertEqual(int(row["frames"]), FRAMES if row["path"] == "slow" else 2)

    def test_small_caches_finish_and_decode_more(self):
        rows = self.experiment("caches", "--parts", "100,4", "--frames", "0-5:2", "--repetitions", 1)
        self.assertEqual([r["percent"] for r in rows], ["100", "4"])
        self.assertGreater(float(rows[1]["megabytes_decoded"]), float(rows[0]["megabytes_decoded"]))

    @unittest.skipIf(why_not(), f"{why_not()}")
    def test_speedup_in_separate_namespaces(self):
        plot, frames_plot, frames_csv = self.path("speedup.png"), self.path("frames.png"), self.path("frames.csv")
        rows = self.experiment("speedup", "--workers", "1,2", "--modes", "raycast", "--setups", "1,2p", "--frames", FRAMES,
                               "--plot", plot, "--frames-plot", frames_plot, "--frames-csv", frames_csv)
        self.assertEqual([(r["servers"], r["workers"], r["caches"]) for r in rows],
                         [(s, w, c) for s in "12" for w in "12" for c in ("cold", "warm")])
        for row in rows:
            if row["caches"] == "cold":
                self.assertGreater(float(row["megabytes_loaded"]), 0)
        for path in (plot, frames_plot):
            self.assertEqual(pathlib.Path(path).read_bytes()[:4], b"\x89PNG")
        with open(frames_csv, newline="") as file:
            frames = list(csv.DictReader(file))
        for row in rows:
            of = [f for f in frames if all(f[key] == row[key] for key in ("servers", "peers", "workers", "caches"))]
            self.assertEqual([int(f["frame"]) for f in of], list(range(FRAMES)))
            self.assertAlmostEqual(float(of[-1]["done_s"]), float(row["seconds"]), delta=0.0056)  # as they are rounded
            self.assertAlmostEqual(sum(float(f["megabytes_received"]) for f in of), float(row["megabytes_loaded"]),
                                   delta=0.056)

    def test_a_traced_walk_is_simulated(self):
        trace, table = self.path("walk.trace"), self.path("simulated.json")
        master, address = self.start_master(self.scene, "--trace", trace)
        self.start_worker(address, "--cache", "256M", "--quiet")
        frames = path_of_frames(self.walk, range(FRAMES), self.path("frames.json"))
        self.must("quarry", "render", self.scene, "-o", self.path("f.png"), "--master", address, "--camera-path", frames,
                  "--size", "96x64", "--quiet")
        end(master)
        self.must("quarry", "bench", "simulate", self.scene, trace, "--workers", "1,2", "--cache", "256M", "--json", table)
        rows = json.loads(pathlib.Path(table).read_text())
        self.assertEqual([r["workers"] for r in rows], [1, 2])
        for row in rows:
            self.assertGreaterEqual(row["voxel_bytes_received"], row["touched_bytes"])
            self.assertGreater(row["seconds"], 0)
        # One whose cache holds everything loads everything once, under any policy.
        self.must("quarry", "bench", "simulate", self.scene, trace, "--workers", "1", "--cache", "256M", "--schedule", "random",
                  "--json", table)
        row = json.loads(pathlib.Path(table).read_text())[0]
        self.assertEqual(row["voxel_bytes_received"], row["touched_bytes"])

    def test_suspending_waiting_and_mapping_load_the_same_walk(self):
        table = self.path("loading.json")
        frames = path_of_frames(self.walk, range(FRAMES), self.path("frames.json"))
        said = self.must("quarry", "bench", "loading", self.scene, frames, "--mbit", "800", "--latency-ms", "0.1", "--json", table)
        rows = {row["loading"]: row for row in json.loads(pathlib.Path(table).read_text())}
        # Each touched voxel is loaded once, however many rays wait for it; of a mapped file the decoded bytes count.
        self.assertGreater(rows["suspend"]["bytes"], 0)
        self.assertEqual(rows["suspend"]["bytes"], rows["wait"]["bytes"])
        if "skipped: userfaultfd" not in said.stdout:
            self.assertGreater(rows["map"]["bytes"], rows["wait"]["bytes"])

    def test_a_damaged_trace_is_refused_with_its_line(self):
        trace = self.folder / "walk.trace"
        for text, sentence in (('{"frame": 0}\n', r"walk\.trace:1: not what quarry-master --trace writes"),
                               ("nothing\n{}\n", r"walk\.trace:1: not what"), ("", r"walk\.trace: has no frames"),
                               ('{"frame": 0, "tile": 0, "compute_us": 1, "depths": [], "blocks": []}\n',
                                r"walk\.trace: frame 0 has no camera")):
            trace.write_text(text)
            self.must_fail(1, sentence, "quarry", "bench", "simulate", self.scene, trace)


if __name__ == "__main__":
    main()

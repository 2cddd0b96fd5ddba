"""The plant of two million triangles, from PLY to picture, within the promises of memory, size and tree; larger plants by hand:
tests/bench/stores/preprocess."""
import json
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import TIMEOUT_S, Case, main

TRIANGLES = 2_000_000
POSITIONS_PLY = 20.18  # bytes a triangle of the plant's indexed binary PLY, positions only
OVER_MEMORY = 44 << 20
PER_VOXEL, WORKER, PER_THREAD = 400, 24 << 20, 4 << 20
FORESIGHT = 16 << 20  # over --foresight: its thread, the blocks that it decodes, its forecasts; more pictures at once


class TwoMillion(Case):
    def statistics(self, name):
        return json.loads(pathlib.Path(self.path(name)).read_text())

    def test_from_model_to_picture(self):
        model, store = self.path("plant.ply"), self.path("plant.quarry")
        self.must("quarry-scene", "plant", "--triangles", TRIANGLES, "--no-colors", "-o", model, "--quiet")
        stores = set()
        for memory, bytes_of_it, threads in (("128M", 128 << 20, 1), ("1G", 1 << 30, 2)):
            self.must("quarry-preprocess", model, "-o", store, "--memory", memory, "--threads", threads, "--quiet", "--stats", self.path("p.json"))
            made = self.statistics("p.json")
            self.assertLess(made["peak_rss_bytes"], bytes_of_it + OVER_MEMORY)
            self.assertEqual(made["input_triangles"], TRIANGLES)
            self.assertLess(made["store_bytes"], 0.6 * POSITIONS_PLY * TRIANGLES)
            self.assertLess(made["replication"], 1.25)
            stores.add(pathlib.Path(store).read_bytes())
        self.assertEqual(len(stores), 1)
        self.must("quarry", "bench", "stores", "--one-level", store, "--json", self.path("stores.json"))
        trees = self.statistics("stores.json")[0]
        self.assertLess(trees["sah_two_level"] / trees["sah_one_level"], 1.05)
        self.must("quarry", "render", store, "-o", self.path("plant.png"), "--size", "1024x768", "--mode", "shadow", "--workers", 2, "--threads", 1,
                  "--cache", "512M", "--camera-path", self.path("plant.path.json"), "--frames", 0, "--quiet", "--stats", self.path("r.json"))
        workers = self.statistics("r.json")["frames"][0]["workers"]
        self.assertEqual(len(workers), 2)
        for worker in workers:
            self.assertLess(worker["peak_rss_bytes"], (512 << 20) + WORKER + PER_THREAD + PER_VOXEL * made["voxels"])
        self.assertGreater(sum(w["voxel_bytes_loaded"] for w in workers), made["store_bytes"] // 20)
        self.assertGreater((self.folder / "plant.0000.png").stat().st_size, 30000)
        self.memory_of_a_cluster(store, made["voxels"])
        self.record(store)

    def record(self, store):
        """The bench of the record, small: it finishes within its memory, with the same bits for each cache."""
        bench = pathlib.Path(__file__).parents[2] / "bench/record"
        done = subprocess.run([str(bench), str(self.folder / "record"), "--store", store, "--size", "64x48", "--spp", "2", "--caches-size", "48x36",
                               "--caches-spp", "2"], capture_output=True, text=True, timeout=TIMEOUT_S)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        told = json.loads((self.folder / "record/record.json").read_text())
        self.assertTrue(told["same_bits"])
        self.assertEqual([figures["finished"] for figures in told["pictures"] + told["caches"]], [True] * 6)
        for figures in told["pictures"]:
            self.assertGreater(figures["largest_bytes"], 10 << 20)
            self.assertGreater(figures["rays"], 64 * 48 * 2)
        self.assertLess(told["caches"][3]["cache_bytes"], told["caches"][1]["cache_bytes"] // 9)

    def memory_of_a_cluster(self, store, voxels):
        """Workers that have their cache from the beginning, and a master that looks ahead through few voxels, or not at all."""
        pictures, masters = [], []
        for foresight in ("0", "4M"):
            _, address = self.start_master(store, "--foresight", foresight)
            for _ in range(2):
                self.start_worker(address, "--threads", 1, "--cache", "32M", "--pretouch", "--quiet")
            self.must("quarry", "render", store, "-o", self.path("walk.png"), "--master", address, "--size", "320x240", "--mode", "shadow",
                      "--camera-path", self.path("plant.path.json"), "--frames", "0-23", "--quiet", "--stats", self.path("walk.json"))
            last = self.statistics("walk.json")["frames"][-1]
            self.assertEqual(len(last["workers"]), 2)
            for worker in last["workers"]:
                self.assertGreater(worker["peak_rss_bytes"], 32 << 20)
                self.assertLess(worker["peak_rss_bytes"], (32 << 20) + WORKER + PER_THREAD + PER_VOXEL * voxels)
            masters.append(last["master_peak_rss_bytes"])
            pictures.append([path.read_bytes() for path in sorted(self.folder.glob("walk.*.png"))])
        self.assertEqual(len(pictures[0]), 24)
        self.assertEqual(pictures[0], pictures[1])
        self.assertLess(masters[1], masters[0] + (4 << 20) + FORESIGHT)


if __name__ == "__main__":
    main()

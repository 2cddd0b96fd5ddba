"""Programs that are told to end (SIGTERM): workers that leave, and masters that keep their jobs."""
import json
import math
import pathlib
import re
import signal
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, TIMEOUT_S, Case, end, main

VIEW = ["--mode", "whitted", "--size", "512x384", "--eye", "6,6,14", "--at", "30,30,16", "--fov", "70"]
TILES = 16 * 12  # of that picture


class Leaving(Case):
    def setUp(self):
        super().setUp()
        self.scene = self.store("plant", 200000)
        # Costs a hundred times what a master guesses of a mode's samples: the first tiles do not come in short ranges.
        lights = {"lights": [{"type": "sun", "direction": [math.cos(i), math.sin(i), 0.2 + i / 100], "radiance": [0.01] * 3} for i in range(256)]}
        pathlib.Path(self.path("lights.json")).write_text(json.dumps(lights))
        self.long = ["--mode", "shadow", "--lights", self.path("lights.json"), *VIEW[2:]]

    def render(self, name, *arguments, view=VIEW):
        output = self.path(name + ".exr")
        self.must("quarry", "render", self.scene, "-o", output, "--quiet", *view, *arguments)
        return pathlib.Path(output).read_bytes()

    def client(self, address, name, *arguments, view=VIEW):
        output = self.path(name)
        client = subprocess.Popen([str(BIN / "quarry"), "render", self.scene, "-o", output, "--master", address, "--stats", self.path("stats.json"),
                                   "--force", *map(str, [*view, *arguments])], stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, client)
        return client, output

    def frame(self):
        return json.loads(pathlib.Path(self.path("stats.json")).read_text())["frames"][0]

    def leave(self, worker):
        """Sends SIGTERM; the seconds that the worker took to end, and its log."""
        began = time.monotonic()
        worker.send_signal(signal.SIGTERM)
        status = worker.wait(timeout=TIMEOUT_S)
        took, log = time.monotonic() - began, worker.stderr.read()
        self.assertEqual(status, 0, log)
        return took, log

    def at_work(self, worker):
        """Waits until a worker is given tiles."""
        for line in worker.stderr:
            if "is given work" in line:
                return
        self.fail("the worker has ended")

    def test_a_worker_that_leaves_loses_no_tile_that_it_can_finish(self):
        picture = ("--spp", 48)
        reference = self.render("reference", "--workers", 1, "--threads", 2, *picture)
        in_the_middle = 0
        for run in range(5):
            _, address = self.start_master(self.scene)
            leaver = self.start_worker(address, "--threads", 1)
            client, output = self.client(address, "left.exr", *picture, "--quiet")
            self.at_work(leaver)
            time.sleep((0.1 + 0.1 * run) * PATIENCE)
            took, log = self.leave(leaver)
            tiles = int(re.search(r"leaves; (\d+) tiles so far", log).group(1))
            in_the_middle += 0 < tiles < TILES
            self.assertLess(took, 1.2 * PATIENCE)
            self.start_worker(address, "--threads", 2)
            self.assertEqual(client.wait(timeout=TIMEOUT_S), 0, client.stderr.read())
            self.assertEqual(pathlib.Path(output).read_bytes(), reference)
            # Where programs are slow a tile may take longer than a worker has.
            self.assertLessEqual(self.frame()["leases_lost"], 0 if PATIENCE == 1 else 1)
        self.assertGreater(in_the_middle, 2, "the workers had done nothing, or all, when they were told to leave")

    def test_a_tile_of_many_samples_loses_none(self):
        """It comes in ranges, each of which a worker can finish."""
        picture = ("--spp", 10000, "--crop", "224,160,32,32")
        _, address = self.start_master(self.scene)
        leaver = self.start_worker(address, "--threads", 1)
        client, output = self.client(address, "long.exr", *picture, "--quiet")
        self.at_work(leaver)
        time.sleep(0.6 * PATIENCE)
        self.assertLess(self.leave(leaver)[0], 1.2 * PATIENCE)
        self.assertIsNone(client.poll(), "the tile was done before the worker left")
        self.start_worker(address, "--threads", 2)
        self.assertEqual(client.wait(timeout=TIMEOUT_S), 0, client.stderr.read())
        # Where programs are slow a range may take longer than a worker has.
        self.assertLessEqual(self.frame()["leases_lost"], 0 if PATIENCE == 1 else 1)
        self.assertEqual(pathlib.Path(output).read_bytes(), self.render("reference", "--workers", 1, "--threads", 2, *picture))

    def test_a_tile_that_takes_long_is_given_up_within_a_second(self):
        _, address = self.start_master(self.scene)
        leaver = self.start_worker(address, "--threads", 1)
        picture = ("--spp", 100, "--crop", "224,160,32,32")
        client, output = self.client(address, "long.exr", *picture, "--quiet", view=self.long)
        self.at_work(leaver)
        time.sleep(0.2)
        took, _ = self.leave(leaver)
        self.assertGreater(took, 0.7, "the tile was under way")
        self.assertLess(took, 1.2 * PATIENCE)
        self.start_worker(address, "--threads", 2)
        self.assertEqual(client.wait(timeout=TIMEOUT_S), 0, client.stderr.read())
        self.assertEqual(self.frame()["leases_lost"], 1)
        self.assertEqual(pathlib.Path(output).read_bytes(), self.render("reference", "--workers", 1, "--threads", 2, *picture, view=self.long))

    def test_a_second_signal_ends_a_worker_at_once(self):
        """Signals that come together are one. A worker leaves after 0.8 s: where this machine is slow, another attempt is made."""
        for _ in range(5):
            _, address = self.start_master(self.scene)
            worker = self.start_worker(address, "--threads", 1)
            self.client(address, "long.exr", "--spp", 400, "--crop", "224,160,64,32", "--quiet", view=self.long)
            time.sleep(1.2 * PATIENCE)
            for _ in range(3):
                worker.send_signal(signal.SIGTERM)
            time.sleep(0.55)
            if worker.poll() is None:
                worker.send_signal(signal.SIGTERM)
            if worker.wait(timeout=TIMEOUT_S) == 1:
                break
        self.assertEqual(worker.returncode, 1)
        self.assertIn("interrupted; its tiles are given to other workers", worker.stderr.read())

    def test_a_worker_without_a_master_ends_at_once(self):
        worker = self.start_worker("127.0.0.1:1")
        time.sleep(0.5 * PATIENCE)
        self.assertLess(self.leave(worker)[0], 1 * PATIENCE)

    def test_a_master_with_a_spool_keeps_frames_and_tells_its_peers(self):
        """Four times, more often than a job may end its master (Spool::kMostTries)."""
        path = self.path("walk.path.json")
        frames = [{"eye": [6 + 0.1 * i, 6, 14], "at": [30, 30, 16], "fov": 70} for i in range(6)]
        pathlib.Path(path).write_text(json.dumps({"frames": frames}))
        spool, picture = self.path("spool"), ("--camera-path", path, "--spp", "48")
        size = ("--mode", "whitted", "--size", "512x384")
        self.must("quarry", "render", self.scene, "-o", self.path("alone.exr"), "--quiet", *size, *picture)
        master, address = self.start_master(self.scene, "--spool", spool)
        port = address.rpartition(":")[2]
        worker = self.start_worker(address, "--threads", 2)
        client = subprocess.Popen([str(BIN / "quarry"), "render", self.scene, "-o", self.path("walk.exr"), "--master", address, *size, *picture],
                                  stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, client)
        for _ in range(4):
            time.sleep(0.4 * PATIENCE)
            master.send_signal(signal.SIGTERM)
            self.assertEqual(master.wait(timeout=TIMEOUT_S), 0, master.stderr.read())
            master = subprocess.Popen([str(BIN / "quarry-master"), self.scene, "--listen", f"127.0.0.1:{port}", "--spool", spool, "--quiet"],
                                      stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            self.addCleanup(end, master)
            time.sleep(0.4 * PATIENCE)
        self.assertEqual(client.wait(timeout=TIMEOUT_S), 0)
        words = client.stderr.read()
        self.assertGreater(words.count("it was stopped, and continues its jobs when it is started again"), 2, words)
        for i in range(len(frames)):
            self.assertEqual(pathlib.Path(self.path(f"walk.{i:04}.exr")).read_bytes(), pathlib.Path(self.path(f"alone.{i:04}.exr")).read_bytes())
        worker.kill()
        self.assertIn("it was stopped", worker.stderr.read())


if __name__ == "__main__":
    main()

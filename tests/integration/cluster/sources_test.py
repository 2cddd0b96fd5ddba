"""The same picture wherever voxels come from: files, several servers, HTTP, other workers, a disk cache; and while they
fail."""
import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, end, main

VIEW = ["--mode", "shadow", "--size", "320x240"]


class Wire:
    """One connection to a master, by way of this process, which keeps from the master all that the worker says from
    `unheard` on."""

    def __init__(self, address, unheard):
        host, port = address.rsplit(":", 1)
        self._unheard = unheard
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._master = socket.create_connection((host, int(port)))
        self._worker = None
        self.address = "127.0.0.1:%d" % self._listener.getsockname()[1]
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        self._worker, _ = self._listener.accept()
        threading.Thread(target=self._answer, daemon=True).start()
        said, heard = b"", True
        while data := self._read(self._worker):
            said = said[-len(self._unheard):] + data
            heard = heard and self._unheard not in said
            if heard:
                self._master.sendall(data)

    def _answer(self):
        while data := self._read(self._master):
            self._worker.sendall(data)

    @staticmethod
    def _read(side):
        try:
            return side.recv(65536)
        except OSError:
            return b""

    def close(self):
        for side in (self._listener, self._master, self._worker):
            if side:
                side.close()


class Sources(Case):
    def setUp(self):
        super().setUp()
        self.scene = self.store("plant", 200000, voxel_size="64K")
        self.walk = ["--camera-path", self.path("plant.path.json"), "--frames", "0-7"]
        self.must("quarry", "render", self.scene, "-o", self.path("r.png"), "--quiet", *VIEW, *self.walk)
        self.reference = self.frames("r")
        self.assertEqual(len(self.reference), 8)

    def frames(self, name):
        return [path.read_bytes() for path in sorted(self.folder.glob(f"{name}.*.png"))]

    def client(self, address, name):
        client = subprocess.Popen([str(BIN / "quarry"), "render", self.scene, "-o", self.path(name + ".png"), "--master", address,
                                   "--stats", self.path(name + ".json"), "--quiet", *VIEW, *self.walk],
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, client)
        return client

    def await_frame(self, name):
        """Until the walk's first picture is there, so that workers have met their sources; the others are to come."""
        until = time.monotonic() + TIMEOUT_S
        while not self.frames(name):
            self.assertLess(time.monotonic(), until, "no frame")
            time.sleep(0.005)

    def finish(self, client, name):
        """The statistics of the frame that was done last, once all are there and right."""
        self.assertEqual(client.wait(timeout=TIMEOUT_S - 10), 0, client.stderr.read())
        self.assertTrue(self.frames(name) == self.reference, "other pictures than from one local cluster")
        frames = json.loads(pathlib.Path(self.path(name + ".json")).read_text())["frames"]
        # Frames from the spool of an earlier master have no times.
        frames = [frame for frame in frames if not frame.get("from_spool")]
        return max(frames, key=lambda frame: frame["frame_start_s"] + frame["frame_wall_s"])

    def render(self, name, workers, *master_options):
        """With workers of these options each; the sums of their counters."""
        _, address = self.start_master(self.scene, *master_options)
        for options in workers:
            self.start_worker(address, "--threads", 1, "--quiet", *options)
        last = self.finish(self.client(address, name), name)
        return {key: sum(worker[key] for worker in last["workers"]) for key in last["workers"][0] if key != "name"}

    def test_a_file_beside_the_worker(self):
        sums = self.render("f", [["--source", "file:" + self.scene]])
        self.assertGreater(sums["voxel_bytes_from_file"], 0)
        self.assertGreater(sums["decode_s"], 0)
        self.assertEqual(sums["voxel_bytes_from_tcp"], 0)

    def test_another_scene_s_file_is_refused(self):
        other = self.path("other.quarry")
        self.must("quarry-scene", "city", "--triangles", 2000, "-o", self.path("other.ply"), "--quiet")
        self.must("quarry-preprocess", self.path("other.ply"), "-o", other, "--quiet")
        _, address = self.start_master(self.scene)
        self.must_fail(1, r"other\.quarry: is another scene", "quarry-worker", "--master", address, "--source", "file:" + other)

    def damaged(self):
        """A copy whose blocks are wrong, but for some at either end."""
        store = bytearray(pathlib.Path(self.scene).read_bytes())
        for at in range(len(store) // 4, len(store) * 3 // 4, 1000):
            store[at] ^= 1
        path = self.path("damaged.quarry")
        pathlib.Path(path).write_bytes(store)
        return path

    def test_a_damaged_file_is_replaced_by_another_source(self):
        sums = self.render("g", [["--source", "file:" + self.damaged(), "--source", "master"]])
        self.assertGreater(sums["voxel_bytes_from_tcp"], 0)

    def test_a_damaged_file_alone_ends_the_job_with_its_name(self):
        _, address = self.start_master(self.scene)
        worker = self.start_worker(address, "--source", "file:" + self.damaged(), "--quiet")
        self.must_fail(1, r"damaged\.quarry: block \d+ at byte \d+ is damaged", "quarry", "render", self.scene, "-o", self.path("no.png"),
                       "--master", address, "--quiet", *VIEW, *self.walk)
        self.assertEqual(worker.wait(timeout=TIMEOUT_S), 1)
        self.assertRegex(worker.stderr.read(), r"^quarry-worker: .*is damaged \(checksum\); make the store again\n$")

    def test_damage_beyond_the_crop_ends_a_job_that_waits_for_its_exposure(self):
        damaged, corner = self.damaged(), ["--mode", "raycast", "--eye=-300,-250,200", "--at", "20,20,20", "--size", "320x240", "--crop", "0,0,8,8", "--workers", 2, "--threads", 1, "--quiet"]
        self.must("quarry", "render", damaged, "-o", self.path("corner.exr"), *corner)  # the sky needs no block
        self.must_fail(1, r"damaged\.quarry: block \d+ at byte \d+ is damaged", "quarry", "render", damaged, "-o", self.path("corner.png"), *corner)

    def test_a_worker_that_cannot_report_its_failure_still_ends(self):
        _, address = self.start_master(self.scene)
        wire = Wire(address, unheard=b"is damaged")
        worker = self.start_worker(wire.address, "--source", "file:" + self.damaged(), "--quiet")
        self.addCleanup(wire.close)
        client = self.client(address, "unheard")
        self.assertEqual(worker.wait(timeout=TIMEOUT_S / 2), 1)
        self.assertRegex(worker.stderr.read(), r"^quarry-worker: .*is damaged \(checksum\); make the store again\n$")
        self.start_worker(address, "--quiet")
        self.finish(client, "unheard")

    def test_two_servers_share_and_one_may_die(self):
        servers = [self.start_master(self.scene, "--serve-only") for _ in range(2)]
        sources = [option for _, address in servers for option in ("--source", address)]
        sums = self.render("two", [["--cache", "3M"], ["--cache", "3M"]], *sources)
        self.assertGreater(sums["voxel_bytes_from_tcp"], 0)

        _, address = self.start_master(self.scene, *sources)
        self.start_worker(address, "--threads", 1, "--cache", "2M", "--quiet")
        client = self.client(address, "one")
        self.await_frame("one")
        servers[0][0].send_signal(signal.SIGKILL)
        self.finish(client, "one")

    def test_a_server_that_stops_answering(self):
        servers = [self.start_master(self.scene, "--serve-only") for _ in range(2)]
        sources = [option for _, address in servers for option in ("--source", address)]
        _, address = self.start_master(self.scene, *sources)
        self.start_worker(address, "--threads", 1, "--cache", "2M", "--quiet")
        client = self.client(address, "stopped")
        self.await_frame("stopped")
        servers[0][0].send_signal(signal.SIGSTOP)
        last = self.finish(client, "stopped")
        self.assertGreater(last["workers"][0]["source_hedges"] + last["workers"][0]["source_retries"], 0)

    def test_other_workers(self):
        # The second worker starts when the first has all and the server has stopped; small decoded caches keep both asking.
        server, source = self.start_master(self.scene, "--serve-only")
        _, address = self.start_master(self.scene, "--source", source)
        self.start_worker(address, "--threads", 1, "--cache", "64M", "--quiet")
        self.finish(self.client(address, "a"), "a")
        for path in self.folder.glob("a.*"):
            path.unlink()
        server.send_signal(signal.SIGSTOP)
        self.start_worker(address, "--threads", 1, "--cache", "64M", "--quiet")
        time.sleep(1)
        sums = {}
        for attempt in range(5):  # which of the two gets which tile is chance
            last = self.finish(self.client(address, f"b{attempt}"), f"b{attempt}")
            sums = {key: sum(w[key] for w in last["workers"]) for key in ("voxel_bytes_from_peer", "voxel_bytes_from_tcp")}
            if sums["voxel_bytes_from_peer"] > 0:
                return
        self.fail(f"nothing came from the other worker: {sums}")

    def test_a_disk_cache_outlives_its_worker(self):
        cache = ["--disk-cache", self.path("kept") + ":100M"]
        first = self.render("d1", [cache])
        self.assertEqual(first["voxel_bytes_from_disk"], 0)
        second = self.render("d2", [cache])
        self.assertGreater(second["voxel_bytes_from_disk"], 0)
        self.assertLess(second["voxel_bytes_from_tcp"], first["voxel_bytes_from_tcp"] / 4)
        for path in list(pathlib.Path(self.path("kept")).rglob("*"))[::3]:
            if path.is_file() and path.stat().st_size > 10:
                with open(path, "r+b") as file:
                    file.seek(5)
                    file.write(b"damage")
        self.render("d3", [cache])

    def test_nginx_and_a_server_together(self):
        nginx = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
        if not nginx:
            self.skipTest("nginx is not installed")
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        configuration = pathlib.Path(self.path("nginx.conf"))
        configuration.write_text(f"""daemon off; pid {self.path('nginx.pid')}; error_log {self.path('nginx.log')}; user root;
            events {{ }} http {{ access_log off; server {{ listen 127.0.0.1:{port}; root {self.folder};
            if ($http_x_token != "open") {{ return 403; }} }} }}""")
        token = pathlib.Path(self.path("token"))
        token.write_text("X-Token: open\n")
        token.chmod(0o600)
        os.chmod(self.folder, 0o755)
        server = subprocess.Popen([nginx, "-c", str(configuration), "-p", str(self.folder)], stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, server)
        self.addCleanup(server.wait, timeout=30)  # for its own processes to end; killed, it leaves them behind
        self.addCleanup(server.terminate)
        for _ in range(100):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        address = f"http://127.0.0.1:{port}/plant.quarry"
        sums = self.render("h", [["--source", address, "--http-header-file", str(token)]])
        self.assertGreater(sums["voxel_bytes_from_http"], 0)
        self.assertEqual(sums["voxel_bytes_from_tcp"], 0)
        sums = self.render("m", [["--source", address, "--source", "master", "--http-header-file", str(token)]])
        self.assertGreater(sums["voxel_bytes_from_http"], 0)
        self.assertGreater(sums["voxel_bytes_from_tcp"], 0)
        # Without the token the other source has to do.
        sums = self.render("n", [["--source", address, "--source", "master"]])
        self.assertEqual(sums["voxel_bytes_from_http"], 0)


class Membership(Case):
    def setUp(self):
        super().setUp()
        self.scene = self.store("plant", 200000)
        self.walk = ["--camera-path", self.path("plant.path.json"), "--frames", "0-19"]
        self.must("quarry", "render", self.scene, "-o", self.path("r.png"), "--quiet", *VIEW, *self.walk)
        self.reference = Sources.frames(self, "r")

    frames, client, finish = Sources.frames, Sources.client, Sources.finish

    def listen(self, *options):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            address = f"127.0.0.1:{probe.getsockname()[1]}"
        return address, lambda: self.master_at(address, *options)

    def master_at(self, address, *options):
        master = subprocess.Popen([str(BIN / "quarry-master"), self.scene, "--listen", address, "--quiet", *options],
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, master)
        self.assertTrue(master.stdout.readline().startswith("listening"), "the master does not listen")
        return master

    def test_a_killed_master_continues_from_its_spool(self):
        address, start = self.listen("--spool", self.path("spool"))
        master = start()
        workers = [self.start_worker(address, "--threads", 1, "--cache", "8M", "--quiet") for _ in range(2)]
        client = self.client(address, "s")
        for _ in range(2):
            done = len(self.frames("s"))
            while len(self.frames("s")) < done + 3 and client.poll() is None:
                time.sleep(0.01)
            master.send_signal(signal.SIGKILL)
            master.wait()
            master = start()
        self.finish(client, "s")
        for worker in workers:
            self.assertIsNone(worker.poll(), "a worker did not find the master again")
        deadline = time.monotonic() + 10
        while [p for p in pathlib.Path(self.path("spool")).iterdir() if p.is_dir()] and time.monotonic() < deadline:
            time.sleep(0.1)
        self.assertEqual([p.name for p in pathlib.Path(self.path("spool")).iterdir() if p.is_dir()], [])

    def test_a_client_requests_missing_frames_of_a_master_without_a_spool(self):
        address, start = self.listen()
        master = start()
        self.start_worker(address, "--threads", 2, "--quiet")
        client = self.client(address, "n")
        while len(self.frames("n")) < 3:
            time.sleep(0.01)
        master.send_signal(signal.SIGKILL)
        master.wait()
        start()
        self.finish(client, "n")

    def test_a_stopped_worker_is_dropped_and_joins_again(self):
        _, address = self.start_master(self.scene)
        stopped = self.start_worker(address, "--threads", 1, "--cache", "4M", "--quiet")
        self.start_worker(address, "--threads", 1, "--cache", "4M", "--quiet")
        client = self.client(address, "w")
        while not self.frames("w"):
            time.sleep(0.01)
        stopped.send_signal(signal.SIGSTOP)
        self.addCleanup(stopped.send_signal, signal.SIGCONT)
        self.finish(client, "w")
        time.sleep(7)  # the master has dropped it by now
        stopped.send_signal(signal.SIGCONT)
        time.sleep(2)
        for path in self.folder.glob("w.*"):
            path.unlink()
        last = self.finish(self.client(address, "w2"), "w2")
        self.assertEqual(len(last["workers"]), 2)


if __name__ == "__main__":
    main()

"""Bad input of every kind: one clear sentence, the right exit status, nothing partial left behind, nothing hung."""
import os
import pathlib
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, Case, end, main

CUBE = """ply
format ascii 1.0
element vertex 8
property float x
property float y
property float z
element face 6
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
1 1 0
0 1 0
0 0 1
1 0 1
1 1 1
0 1 1
4 0 3 2 1
4 4 5 6 7
4 0 1 5 4
4 1 2 6 5
4 2 3 7 6
4 3 0 4 7
"""


class BadModels(Case):
    def refuse(self, name, content, sentence):
        path = self.folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        out = self.folder / "out"
        out.mkdir(exist_ok=True)
        self.must_fail(1, sentence, "quarry-preprocess", path, "-o", out / "x.quarry", "--quiet")
        self.assertEqual(list(out.iterdir()), [], "something was left behind")

    def test_files_that_are_not_models(self):
        garbage = bytes(range(256)) * 20
        self.refuse("truncated.ply", CUBE[:-30], r"truncated\.ply")
        self.refuse("garbage.ply", garbage, r"garbage\.ply")
        self.refuse("garbage.obj", garbage, r"garbage\.obj")
        self.refuse("garbage.stl", garbage, r"garbage\.stl")
        self.refuse("empty.ply", b"", r"empty\.ply")
        self.refuse("empty.obj", b"", r"empty\.obj")
        self.refuse("none.obj", "v 0 0 0\n", r"none\.obj.*no triangle")
        self.refuse("line.obj", "v 0 0 0\nv 1 x 0\n", r"line\.obj.*2")
        self.refuse("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", r"index\.obj.*4")
        self.refuse("short.stl", struct.pack("<80sI", b"x", 10) + b"\0" * 100, r"short\.stl")
        self.refuse("header.ply", "ply\nformat ascii 1.0\nelement vertex 99999999999999999999\n", r"header\.ply")
        self.refuse("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", r"flat\.obj.*1 degenerate")
        self.refuse("nan.obj", "v nan 0 0\nv 1 0 0\nv 2 1 0\nf 1 2 3\n", r"nan\.obj.*1 with coordinates")

    def test_a_missing_model(self):
        self.must_fail(1, r"nothing\.ply: cannot (be )?open", "quarry-preprocess", self.path("nothing.ply"), "-o",
                       self.path("x.quarry"))
        self.must_fail(1, r"nothing\.ply: cannot (be )?open", "quarry", "render", self.path("nothing.ply"), "-o",
                       self.path("x.png"))

    def test_degenerate_triangles_are_dropped_and_counted(self):
        model = self.folder / "m.obj"
        model.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nv inf 0 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\nf 1 1 3\n")
        self.must("quarry-preprocess", model, "-o", self.path("m.quarry"), "--quiet")
        info = self.info(self.path("m.quarry"))
        self.assertEqual(info["input_triangles"], 4)
        self.assertEqual(info["dropped_degenerate_triangles"], 2)
        self.assertEqual(info["dropped_not_finite_triangles"], 1)


class BadStores(Case):
    def setUp(self):
        super().setUp()
        model = self.folder / "cube.ply"
        model.write_text(CUBE)
        self.good = self.path("cube.quarry")
        self.must("quarry-preprocess", model, "-o", self.good, "--quiet")
        self.bytes = bytearray(pathlib.Path(self.good).read_bytes())

    def write(self, content):
        path = self.path("bad.quarry")
        pathlib.Path(path).write_bytes(content)
        return path

    def test_any_byte_flipped_is_found(self):
        # Every byte through the library is in the unit tests; here every place a person meets the sentence.
        for at in (0, 9, 20, 34, 50, 58, 70, 100, 344, len(self.bytes) // 2, len(self.bytes) - 1):
            flipped = bytearray(self.bytes)
            flipped[at] ^= 0x10
            with self.subTest(byte=at):
                bad = self.write(flipped)
                self.must_fail(1, r"bad\.quarry: ", "quarry", "verify", bad)
                self.must_fail(1, r"bad\.quarry: ", "quarry", "render", bad, "-o", self.path("x.png"), "--quiet",
                               "--size", "64x64")
                self.assertFalse(os.path.exists(self.path("x.png")))

    def test_truncated_extended_and_other_versions(self):
        for content in (self.bytes[:10], self.bytes[:200], self.bytes[:-1], self.bytes + b"x", b""):
            self.must_fail(1, r"bad\.quarry: ", "quarry", "info", self.write(content))
        self.must_fail(1, r"not a Quarry scene store", "quarry", "info", self.write(b"nonsense" * 100))

    def test_an_older_or_newer_format_is_named(self):
        # The header's own checksum must fit for the version to be believed: made by the library in the unit tests
        # (store_test); a version that was merely overwritten is damage.
        other = bytearray(self.bytes)
        other[8] = 99
        self.must_fail(1, r"damaged", "quarry", "info", self.write(other))


class BadPlaces(Case):
    def test_two_preprocessors_on_one_output(self):
        model, store = self.path("m.ply"), self.path("m.quarry")
        self.must("quarry-scene", "plant", "--triangles", 300000, "-o", model, "--quiet")
        first = subprocess.Popen([str(BIN / "quarry-preprocess"), model, "-o", store, "--quiet"])
        self.addCleanup(first.kill)
        while not pathlib.Path(store + ".work").exists():  # made under the lock; the lock's file comes before the lock
            self.assertIsNone(first.poll())
            time.sleep(0.002)
        first.send_signal(signal.SIGSTOP)
        self.must_fail(1, "another quarry-preprocess is writing it", "quarry-preprocess", model, "-o", store, "--quiet")
        # A dead one holds nothing back, though its lock file lies there.
        first.kill()
        first.wait()
        self.must("quarry-preprocess", model, "-o", store, "--quiet")
        self.assertEqual(sorted(p.name for p in self.folder.iterdir() if "lock" in p.name), [])
        self.must("quarry", "verify", store, "--quiet")

    def test_a_reader_that_closes_its_pipe(self):
        self.must("quarry-scene", "plant", "--triangles", 300000, "-o", self.path("m.ply"), "--quiet")
        self.must("quarry-preprocess", self.path("m.ply"), "-o", self.path("m.quarry"), "--quiet")
        told = subprocess.Popen([str(BIN / "quarry"), "info", self.path("m.quarry"), "--json"], stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True)
        told.stdout.close()
        self.assertEqual((told.wait(timeout=30), told.stderr.read()), (0, ""))  # it has seen enough, as `| head` has
        told.stderr.close()

    def test_full_disk(self):
        model = self.folder / "cube.ply"
        model.write_text(CUBE)
        store = self.path("cube.quarry")
        self.must("quarry-preprocess", model, "-o", store, "--quiet")
        if os.geteuid() != 0:
            self.skipTest("a small file system needs root")
        small = self.folder / "small"
        small.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(small)], capture_output=True)
        if mounted.returncode != 0:
            self.skipTest("tmpfs cannot be mounted here")
        try:
            big = self.path("big.ply")
            self.must("quarry-scene", "city", "--triangles", 20000, "-o", big, "--quiet")
            self.must_fail(1, r"No space left|KiB are free", "quarry-preprocess", big, "-o", small / "x.quarry", "--quiet")
            self.must_fail(1, r"No space left|KiB are free", "quarry-preprocess", big, "-o", self.path("y.quarry"), "--tmp", small,
                           "--quiet")
            self.must_fail(1, r"No space left", "quarry", "render", store, "-o", small / "x.exr", "--retry", 0, "--quiet")
            self.must_fail(1, r"[Nn]o space left", "quarry-scene", "city", "--triangles", 20000, "-o", small / "c.ply",
                           "--quiet")
            self.assertEqual(list(small.iterdir()), [])
        finally:
            subprocess.run(["umount", str(small)], check=True)

    def test_unwritable_output(self):
        model = self.folder / "cube.ply"
        model.write_text(CUBE)
        self.must_fail(1, r"cannot write", "quarry-preprocess", model, "-o", self.path("no/such/x.quarry"))
        store = self.path("cube.quarry")
        self.must("quarry-preprocess", model, "-o", store, "--quiet")
        self.must_fail(1, r"cannot write", "quarry", "render", store, "-o", self.path("no/such/x.png"))

    def test_unusable_arguments(self):
        model = self.folder / "cube.ply"
        model.write_text(CUBE)
        store = self.path("cube.quarry")
        self.must("quarry-preprocess", model, "-o", store, "--quiet")
        png = self.path("x.png")
        for arguments in (["render", store], ["render", store, "-o", "x.gif"], ["render", store, "-o", png, "--size", "8"],
                          ["render", store, "-o", png, "--mode", "photon"], ["render", store, "-o", png, "--eye", "1,2"],
                          ["render", store, "-o", png, "--spp", "0"], ["render", store, "-o", png, "--crop", "0,0,9999,9"],
                          ["render", store, "-o", png, "--aov", "depth"], ["render", store, "-o", png, "--frames", "1-2"],
                          ["render", store, "-o", png, "--cache", "12X"], ["render", self.store("city", 5000), "-o", png, "--cache", "1K"],
                          ["render", store, "-o", png, "--eye", "1,1,1", "--at", "1,1,1"], ["nonsense"], []):
            with self.subTest(arguments=arguments):
                done = self.run_program("quarry", *arguments)
                self.assertEqual(done.returncode, 2, done.stderr + done.stdout)
                self.assertTrue(done.stderr.strip())
        self.must_fail(2, r"--memory", "quarry-preprocess", model, "-o", self.path("y.quarry"), "--memory", "lots")
        self.must_fail(2, r"--voxel-size", "quarry-preprocess", model, "-o", self.path("y.quarry"), "--voxel-size", "1")
        self.assertFalse(os.path.exists(png))


class BadPeers(Case):
    def setUp(self):
        super().setUp()
        model = self.folder / "cube.ply"
        model.write_text(CUBE)
        self.scene = self.path("cube.quarry")
        self.must("quarry-preprocess", model, "-o", self.scene, "--quiet")

    def free_port(self):
        with socket.socket() as s:
            s.bind(("127.0.0.1", 0))
            return s.getsockname()[1]

    def test_unreachable_master(self):
        address = f"127.0.0.1:{self.free_port()}"
        self.must_fail(1, r"cannot reach " + address, "quarry-worker", "--master", address, "--retry", "0.5")
        self.must_fail(1, r"cannot reach " + address, "quarry", "render", self.scene, "-o", self.path("x.png"), "--master",
                       address)

    def test_more_memory_than_there_is(self):
        self.must_fail(2, r"--pretouch: the system has no \S+.* of memory for --cache", "quarry-worker", "--master",
                       f"127.0.0.1:{self.free_port()}", "--cache", "900000G", "--pretouch")
        largest = self.info(self.scene)["largest_decoded_bytes"]
        self.must_fail(2, f"--foresight of .* is less than the scene's largest block, {largest} bytes", "quarry-master", self.scene,
                       "--listen", "127.0.0.1:0", "--foresight", largest - 1)

    def test_port_in_use_and_places_that_are_not_loopback(self):
        with socket.socket() as s:
            s.bind(("127.0.0.1", 0))
            s.listen()
            self.must_fail(1, r"cannot listen .*in use", "quarry-master", self.scene, "--listen",
                           f"127.0.0.1:{s.getsockname()[1]}")
        self.must_fail(2, r"loopback", "quarry-master", self.scene, "--listen", "0.0.0.0:0")
        self.must_fail(2, r"HOST:PORT", "quarry-master", self.scene, "--listen", "nowhere")

    def test_another_version_is_named_on_both_sides(self):
        preamble = b"QUARRY\0\0" + struct.pack("<I", 999) + b"9.9.9".ljust(20, b"\0")
        # A worker that meets a master of another version.
        with socket.socket() as server:
            server.bind(("127.0.0.1", 0))
            server.listen()
            worker = self.start_worker(f"127.0.0.1:{server.getsockname()[1]}", "--retry", "0.5")
            peer, _ = server.accept()
            peer.sendall(preamble)
            status = worker.wait(timeout=20)
            peer.close()
        said = worker.stderr.read()
        self.assertEqual(status, 1)
        self.assertRegex(said, r"Quarry 0\.\d+\.\d+ with protocol \d+, the other side is Quarry 9\.9\.9 with protocol 999")
        # A master that meets a worker of another version goes on.
        master, address = self.start_master(self.scene)
        host, port = address.split(":")
        with socket.create_connection((host, int(port))) as peer:
            peer.sendall(preamble)
            self.assertTrue(peer.recv(32).startswith(b"QUARRY"))
        self.start_worker(address)
        self.must("quarry", "render", self.scene, "-o", self.path("x.png"), "--size", "64x64", "--master", address, "--quiet")

    def test_garbage_from_a_peer_harms_nobody(self):
        master, address = self.start_master(self.scene)
        host, port = address.split(":")
        good = b"QUARRY\0\0" + struct.pack("<I", 1) + b"0.1.0".ljust(20, b"\0")
        for junk in (b"GET / HTTP/1.1\r\n\r\n" * 10, good + b"\xff" * 400, good,
                     good + b"QRY1" + struct.pack("<HHQII", 1, 0, 0, 0xFFFFFFFF, 0xFFFFFFFF),
                     good + b"QRY1" + struct.pack("<HHQII", 1, 0, 0, 64, 0) + b"\xee" * 64):
            with socket.create_connection((host, int(port))) as peer:
                peer.sendall(junk)
                time.sleep(0.05)
        self.start_worker(address)
        self.must("quarry", "render", self.scene, "-o", self.path("x.png"), "--size", "64x64", "--master", address, "--quiet")
        self.assertIsNone(master.poll())


class Interrupted(Case):
    def interrupt(self, program, *arguments, after=0.4, sentence="interrupted"):
        child = subprocess.Popen([str(BIN / program), *map(str, arguments)], stderr=subprocess.PIPE, text=True,
                                 stdout=subprocess.DEVNULL)
        self.addCleanup(end, child)
        time.sleep(after)
        child.send_signal(signal.SIGINT)
        self.assertEqual(child.wait(timeout=20), 1)
        told = child.stderr.read()
        self.assertIn(sentence, told)
        return told

    def test_ctrl_c_leaves_nothing_partial(self):
        model = self.path("plant.ply")
        self.must("quarry-scene", "plant", "--triangles", 1000000, "-o", model, "--quiet")
        out = self.folder / "out"
        out.mkdir()
        told = self.interrupt("quarry-preprocess", model, "-o", out / "x.quarry", "--quiet")
        # A sentence names the work that --resume continues with; resume_test tries that.
        self.assertEqual([p.name for p in out.iterdir()], ["x.quarry.work"] if "--resume" in told else [])
        shutil.rmtree(out / "x.quarry.work", ignore_errors=True)
        scene = self.store("plant", 50000)
        self.interrupt("quarry", "render", scene, "-o", out / "x.png", "--size", "4096x4096", "--spp", "64", "--quiet")
        self.assertEqual(list(out.iterdir()), [])
        # One that was only about to begin sees then that its parent is gone.
        running, until = [None], time.monotonic() + 2 * PATIENCE
        while running and time.monotonic() < until:
            time.sleep(0.1)
            running = subprocess.run(["pgrep", "-f", scene], capture_output=True, text=True).stdout.split()
        self.assertEqual(running, [], "processes of the cluster are still there")

    def test_a_killed_preprocessor_leaves_no_store(self):
        model = self.path("plant.ply")
        self.must("quarry-scene", "plant", "--triangles", 1000000, "-o", model, "--quiet")
        child = subprocess.Popen([str(BIN / "quarry-preprocess"), model, "-o", self.path("x.quarry"), "--quiet"])
        self.addCleanup(end, child)
        until = time.monotonic() + 20 * PATIENCE
        while not os.path.exists(self.path("x.quarry.work")):
            self.assertLess(time.monotonic(), until, "no work folder")
            self.assertIsNone(child.poll(), "ended before it could be killed")
            time.sleep(0.01)
        time.sleep(0.1)
        self.assertIsNone(child.poll(), "ended before it could be killed")
        child.kill()
        child.wait()
        self.assertFalse(os.path.exists(self.path("x.quarry")))


if __name__ == "__main__":
    main()

"""The same picture, bit for bit, whatever the workers, threads, caches and faults (design: what must always be true)."""
import json
import os
import pathlib
import signal
import struct
import subprocess
import time
import unittest
import unittest.mock

from programs import BIN, TIMEOUT_S, Case, end

TRIANGLES = int(os.environ.get("QUARRY_TEST_TRIANGLES", "1000000"))
VIEW = ["--mode", "whitted", "--size", "512x384", "--eye", "6,6,14", "--at", "30,30,16", "--fov", "70",
        "--aov", "depth,normal,uv,primitive,material,part,voxel"]


class SameImage(Case):
    def render(self, name, *arguments):
        output = self.path(name + ".exr")
        self.must("quarry", "render", self.scene, "-o", output, "--quiet", *VIEW, *arguments)
        return pathlib.Path(output).read_bytes()

    def test_workers_threads_caches_and_a_killed_worker(self):
        self.scene = self.store("plant", TRIANGLES)
        info = self.info(self.scene)
        decoded = info["hot_decoded_bytes"] + info["shading_decoded_bytes"]
        largest = info["largest_decoded_bytes"]
        reference = self.render("reference", "--workers", 1, "--threads", 1, "--cache", decoded)
        self.assertGreater(len(reference), 100000)
        for workers in (1, 2, 4):
            for threads in (1, 2):
                with self.subTest(workers=workers, threads=threads):
                    self.assertEqual(self.render("w", "--workers", workers, "--threads", threads), reference)
        for workers, threads, cache in ((1, 2, largest), (2, 1, largest), (2, 2, decoded // 20), (1, 2, decoded)):
            with self.subTest(workers=workers, threads=threads, cache=cache):
                self.assertEqual(self.render("c", "--workers", workers, "--threads", threads, "--cache", cache), reference)
        for isa in ("scalar", "avx2"):
            with self.subTest(isa=isa), unittest.mock.patch.dict(os.environ, QUARRY_ISA=isa):
                self.assertEqual(self.render("i", "--workers", 1, "--threads", 2), reference)
        self.kill_one_worker(reference)
        self.worker_that_starts_late(reference)

    def render_with(self, address, name):
        output = self.path(name + ".exr")
        client = subprocess.Popen([str(BIN / "quarry"), "render", self.scene, "-o", output, "--master", address,
                                   "--stats", self.path(name + ".json"), "--quiet", *VIEW],
                                  stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, client)
        return client, output

    def kill_one_worker(self, reference):
        # How fast the machine is decides when the victim has tiles in hand: several moments are tried until the
        # master has counted leases lost. The picture must be right at every one of them.
        for delay in (0.3, 0.15, 0.6, 1.2, 2.4):
            _, address = self.start_master(self.scene)
            victim = self.start_worker(address, "--threads", 1, "--cache", "2M")
            client, output = self.render_with(address, "killed")
            time.sleep(delay)
            victim.send_signal(signal.SIGKILL)
            self.start_worker(address, "--threads", 2)
            self.assertEqual(client.wait(timeout=TIMEOUT_S - 10), 0, client.stderr.read())
            self.assertEqual(pathlib.Path(output).read_bytes(), reference)
            stats = json.loads(pathlib.Path(self.path("killed.json")).read_text())
            if stats["frames"][0]["leases_lost"] > 0:
                return
        self.fail("the worker never held a tile when it was killed")

    def worker_that_starts_late(self, reference):
        _, address = self.start_master(self.scene)
        client, output = self.render_with(address, "late")
        time.sleep(0.5)
        self.start_worker(address, "--threads", 1)
        self.start_worker(address, "--threads", 1)
        self.assertEqual(client.wait(timeout=TIMEOUT_S - 10), 0, client.stderr.read())
        self.assertEqual(pathlib.Path(output).read_bytes(), reference)


class SameStore(Case):
    def test_memory_and_threads_do_not_change_the_store(self):
        model = self.path("m.ply")
        self.must("quarry-scene", "plant", "--triangles", 300000, "-o", model, "--quiet")
        self.expect_one_store(model)

    def test_a_pile_that_no_plane_parts_is_the_same_from_disk_and_from_memory(self):
        """200,000 times one triangle, more than a quarter of the least memory holds; others beside it, with space."""
        vertices = [(0, 0, 0), (3, 2, 1), (1, 3, 2), (90, 90, 90), (91, 90, 90), (90, 91, 91)]
        faces = [(0, 1, 2)] * 200000 + [(3, 4, 5)] * 5
        model = self.path("pile.ply")
        with open(model, "wb") as out:
            out.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\n"
                      f"property float y\nproperty float z\nelement face {len(faces)}\n"
                      "property list uchar int vertex_indices\nend_header\n".encode())
            out.write(b"".join(struct.pack("<3f", *v) for v in vertices))
            out.write(b"".join(struct.pack("<B3i", 3, *f) for f in faces))
        self.expect_one_store(model)

    def expect_one_store(self, model):
        stores = []
        for memory, threads in (("1G", 2), ("64M", 1), ("64M", 2)):
            store = self.path(f"s-{memory}-{threads}.quarry")
            self.must("quarry-preprocess", model, "-o", store, "--memory", memory, "--threads", threads, "--quiet")
            stores.append(pathlib.Path(store).read_bytes())
        self.assertEqual(stores[0], stores[1])
        self.assertEqual(stores[0], stores[2])


if __name__ == "__main__":
    unittest.main(verbosity=2)

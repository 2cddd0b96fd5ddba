"""The same picture, bit for bit, whatever the workers, threads, caches and faults (design: the invariants)."""
import json
import math
import os
import pathlib
import signal
import struct
import subprocess
import sys
import time
import unittest
import unittest.mock

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.exr import read_exr
from tests.integration.programs import BIN, TIMEOUT_S, Case, end, main
from tests.support.models.textured_scene import Glb, noise, sheet, write_scene

TRIANGLES = int(os.environ.get("QUARRY_TEST_TRIANGLES", "1000000"))
VIEW = ["--mode", "whitted", "--size", "512x384", "--eye", "6,6,14", "--at", "30,30,16", "--fov", "70",
        "--aov", "depth,normal,uv,primitive,material,part,voxel"]


def write_ply(path, vertices, faces):
    with open(path, "wb") as out:
        out.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\n"
                  f"property float y\nproperty float z\nelement face {len(faces)}\n"
                  "property list uchar int vertex_indices\nend_header\n".encode())
        out.write(b"".join(struct.pack("<3f", *v) for v in vertices))
        out.write(b"".join(struct.pack("<B3i", 3, *f) for f in faces))


def crossing_bars(bars, layers):
    """Square bars of 1 x 1 x `bars`, every other place empty, each layer across the one below."""
    vertices, faces = [], []
    for layer in range(layers):
        for bar in range(bars // 2):
            first = len(vertices)
            for corner in range(8):
                along, across, up = corner & 1, corner >> 1 & 1, corner >> 2
                x, y = along * bars, 2 * bar + across
                vertices.append((x, y, layer + up) if layer % 2 == 0 else (y, x, layer + up))
            for a, b, c, d in ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)):
                faces += [(first + a, first + b, first + c), (first + a, first + c, first + d)]
    return vertices, faces


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
        self.kill_one_worker()
        self.worker_that_starts_late(reference)

    def render_with(self, address, name, *arguments):
        output = self.path(name + ".exr")
        client = subprocess.Popen([str(BIN / "quarry"), "render", self.scene, "-o", output, "--master", address,
                                   "--stats", self.path(name + ".json"), "--quiet", *VIEW, *map(str, arguments)],
                                  stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, client)
        return client, output

    def kill_one_worker(self):
        # How fast the machine is decides when the victim has tiles in hand: several moments are tried until the
        # master has counted leases lost, of a picture that takes long. It must be right at every one of them.
        samples = ("--spp", 8)
        reference = self.render("reference", "--workers", 1, "--threads", 2, *samples)
        for delay in (0.3, 0.15, 0.6, 1.2, 2.4):
            _, address = self.start_master(self.scene)
            victim = self.start_worker(address, "--threads", 1, "--cache", "2M")
            client, output = self.render_with(address, "killed", *samples)
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


class GlassInShadow(Case):
    def test_shadow_rays_that_pass_a_glass_ball(self):
        """Shadow rays go from surface to surface of the ball, through many small voxels, and wait for each."""
        scene = self.store("cornell", 20000, voxel_size="16K")
        info = self.info(scene)
        decoded, largest = info["hot_decoded_bytes"] + info["shading_decoded_bytes"], info["largest_decoded_bytes"]
        image = self.path("ball.exr")

        def render(isa, workers, threads, cache):
            environment = {} if isa is None else {"QUARRY_ISA": isa}
            with unittest.mock.patch.dict(os.environ, environment):
                self.must("quarry", "render", scene, "-o", image, "--quiet", "--mode", "whitted", "--size", "256x192", "--eye", "1,-2.6,1",
                          "--at", "1,1,0.9", "--sun", "0.2,-1,0.6", "--spp", 2, "--workers", workers, "--threads", threads, "--cache", cache)
            return pathlib.Path(image).read_bytes()

        reference = render(None, 1, 1, decoded)
        for isa, workers, threads, cache in ((None, 1, 1, largest), (None, 1, 2, largest), (None, 2, 1, largest), (None, 2, 2, decoded // 20),
                                             (None, 1, 2, decoded), ("scalar", 1, 2, decoded), ("avx2", 1, 1, largest)):
            with self.subTest(isa=isa, workers=workers, threads=threads, cache=cache):
                self.assertEqual(render(isa, workers, threads, cache), reference)


class Paths(Case):
    def test_path_tracing(self):
        """Mode path, with a clear sky, a disc of a sun, a rectangle and a point: paths of all lengths wait for voxels."""
        scene = self.store("plant", 60000, voxel_size="16K")
        info = self.info(scene)
        decoded, largest = info["hot_decoded_bytes"] + info["shading_decoded_bytes"], info["largest_decoded_bytes"]
        view, image = self.path("path.json"), self.path("path.exr")
        pathlib.Path(view).write_text(json.dumps({
            "mode": "path", "spp": 3, "size": [160, 120], "bounces": 5, "sky": {"turbidity": 3}, "aov": ["depth", "primitive", "albedo"],
            "camera": {"eye": [6, 6, 14], "at": [30, 30, 16], "fov": 70},
            "lights": [{"type": "sun", "direction": [0.4, 0.3, 1], "radiance": [0.9, 0.9, 0.8]},
                       {"type": "point", "position": [20, 20, 20], "radiance": [20, 15, 10]},
                       {"type": "rectangle", "position": [25, 30, 25], "edges": [[0, 4, 0], [4, 0, 0]], "radiance": [9, 9, 9]}]}))

        def render(isa, workers, threads, cache, *crop):
            environment = {} if isa is None else {"QUARRY_ISA": isa}
            with unittest.mock.patch.dict(os.environ, environment):
                self.must("quarry", "render", scene, "-o", image, "--quiet", "--view", view, "--workers", workers, "--threads", threads,
                          "--cache", cache, *crop)
            return pathlib.Path(image).read_bytes()

        reference = render(None, 1, 1, decoded)
        for isa, workers, threads, cache in ((None, 1, 2, largest), (None, 2, 1, decoded // 20), ("scalar", 1, 2, decoded), ("avx2", 2, 2, decoded)):
            with self.subTest(isa=isa, workers=workers, threads=threads, cache=cache):
                self.assertEqual(render(isa, workers, threads, cache), reference)
        whole = read_exr(pathlib.Path(image)).rows
        render(None, 2, 1, decoded, "--crop", "37,21,70,60")
        part = read_exr(pathlib.Path(image)).rows
        for name in whole:
            self.assertEqual([row[37:107] for row in whole[name][21:81]], part[name], name)

    def test_everything_that_paths_meet(self):
        """Cut-outs, a veil, panes, one with a texture, textures, one of which shines, a ball of glass, lamps, one of them hidden, a section through another, and an
        evening sky."""
        pathlib.Path(self.path("more.mtl")).write_text(
            "newmtl lamp\nKd 0 0 0\nKe 30 25 20\nnewmtl ball\nKd 0 0 0\nKs 1 1 1\nTf 0.8 0.9 0.8\nd 0.1\nNi 1.5\nillum 7\n")
        positions, _, triangles = sheet(24, 12, lambda u, v: (4 + 0.8 * math.cos(2 * math.pi * u) * math.sin(math.pi * v),
                                                              1 + 0.8 * math.sin(2 * math.pi * u) * math.sin(math.pi * v), 1.6 - 0.8 * math.cos(math.pi * v)))
        lines = ["mtllib more.mtl", "o ball", "usemtl ball", *(f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in positions),
                 *("f " + " ".join(str(v + 1) for v in t) for t in triangles)]
        for name, x, y in (("lamp", 2, 2), ("hidden lamp", 7, 3), ("cut lamp", 8, 7)):
            lines += [f"o {name}", "usemtl lamp", *(f"v {x + a} {y + b} 4.5" for a, b in ((0, 0), (0, 1), (1, 1), (1, 0))), "f -4 -3 -2", "f -4 -2 -1"]
        pathlib.Path(self.path("more.obj")).write_text("\n".join(lines) + "\n")
        window = Glb()
        stained = window.material(doubleSided=True, extensions={"KHR_materials_transmission": {"transmissionFactor": 1}}, pbrMetallicRoughness={
            "baseColorTexture": {"index": window.image(noise(300, 200, 8))}, "metallicFactor": 0, "roughnessFactor": 0})
        window.add(sheet(2, 2, lambda u, v: (8, 2 + 3 * u, 0.2 + 3 * v)), stained)
        window.write(self.path("window.glb"))
        scene, view, image = self.path("all.quarry"), self.path("all.json"), self.path("all.exr")
        self.must("quarry-preprocess", *write_scene(self.folder, 48), self.path("more.obj"), self.path("window.glb"), "-o", scene,
                  "--voxel-size", "16K", "--up-axis", "z", "--quiet")
        info = self.info(scene)
        self.assertTrue(info["shines"])
        decoded, largest = info["hot_decoded_bytes"] + info["shading_decoded_bytes"] + info["texture_decoded_bytes"], info["largest_decoded_bytes"]
        pathlib.Path(view).write_text(json.dumps({
            "mode": "path", "spp": 4, "size": [128, 96], "bounces": 6, "sky": {"atmosphere": 3}, "hide": ["*hidden lamp"],
            "camera": {"eye": [14, -7, 7], "at": [6, 4, 0.5], "fov": 50}, "aov": ["depth", "primitive"],
            "lights": [{"type": "sun", "direction": [0.9, -0.4, 0.06], "radiance": [0.9, 0.9, 0.9]}], "up_axis": "z",
            "section": {"planes": [{"point": [8.5, 7, 4], "normal": [1, 0.2, 0]}]}}))

        def render(isa, workers, threads, cache, *options):
            with unittest.mock.patch.dict(os.environ, {} if isa is None else {"QUARRY_ISA": isa}):
                self.must("quarry", "render", scene, "-o", image, "--quiet", "--view", view, "--workers", workers, "--threads", threads,
                          "--cache", cache, *options)
            return pathlib.Path(image).read_bytes()

        reference = render(None, 1, 1, decoded)
        for isa, workers, threads, cache in ((None, 1, 2, largest), (None, 2, 1, decoded // 10), ("scalar", 2, 2, decoded), ("avx2", 1, 2, decoded)):
            with self.subTest(isa=isa, workers=workers, threads=threads, cache=cache):
                self.assertEqual(render(isa, workers, threads, cache), reference)
        # Each counts: the hidden lamp would light the scene, and so would the part that is cut off; the pane tints it.
        shown = json.loads(pathlib.Path(view).read_text())
        pathlib.Path(view).write_text(json.dumps(shown | {"hide": ["*hidden lamp", "*window.glb*"]}))
        self.assertNotEqual(render(None, 2, 1, decoded), reference)
        for without in ("hide", "section"):
            pathlib.Path(view).write_text(json.dumps({name: member for name, member in shown.items() if name != without}))
            self.assertNotEqual(render(None, 2, 1, decoded), reference)

    def test_ranges_of_samples_and_a_killed_worker(self):
        """Tiles of many samples come in ranges. A worker that is killed in the middle leaves its tiles' sums to others."""
        scene, trace, stats = self.store("plant", 20000, voxel_size="16K"), self.path("trace.jsonl"), self.path("stats.json")
        view = ["--mode", "path", "--spp", 160, "--size", "64x32", "--eye", "6,6,14", "--at", "30,30,16", "--fov", "70", "--aov", "depth,primitive"]
        alone, together = self.path("alone.exr"), self.path("together.exr")
        self.must("quarry", "render", scene, "-o", alone, "--quiet", *view, "--workers", 1, "--threads", 2)
        _, address = self.start_master(scene, "--trace", trace)
        victim = self.start_worker(address, "--threads", 1)
        client = subprocess.Popen([str(BIN / "quarry"), "render", "--master", address, "-o", together, "--quiet", "--stats", stats, *map(str, view)])
        self.addCleanup(end, client)

        def results():
            return [json.loads(line) for line in pathlib.Path(trace).read_text().splitlines() if '"tile"' in line]

        limit = time.monotonic() + TIMEOUT_S
        while not results():
            self.assertLess(time.monotonic(), limit)
            time.sleep(0.02)
        victim.send_signal(signal.SIGKILL)
        self.start_worker(address, "--threads", 1)
        self.assertEqual(client.wait(TIMEOUT_S), 0)
        lines = results()
        self.assertEqual({line["tile"] for line in lines}, {0, 1})
        self.assertGreaterEqual(len(lines), 4)
        self.assertEqual(len({line["worker"] for line in lines}), 2)
        self.assertEqual(pathlib.Path(together).read_bytes(), pathlib.Path(alone).read_bytes())
        counts = json.loads(pathlib.Path(stats).read_text())
        self.assertEqual((counts["saturated_terms"], counts["nan_terms"], counts["lights"]), (0, 0, ["sun", "sky"]))


class PilesOfVoxels(Case):
    def test_crossing_bars_at_a_cache_of_one_block(self):
        """Layers of crossing bars, in chains of voxels whose boxes overlap: rays wait for one after the other, within one leaf."""
        model, scene = self.path("bars.ply"), self.path("bars.quarry")
        write_ply(model, *crossing_bars(400, 4))
        self.must("quarry-preprocess", model, "-o", scene, "--voxel-size", "8K", "--quiet")
        info = self.info(scene)
        self.assertGreater(info["chained_voxels"], 20)
        images = set()
        for threads, cache in ((1, info["hot_decoded_bytes"]), (1, info["largest_decoded_bytes"]), (2, info["largest_decoded_bytes"])):
            image = self.path("bars.exr")
            self.must("quarry", "render", scene, "-o", image, "--quiet", "--mode", "whitted", "--size", "256x192", "--eye", "-90,-60,90",
                      "--at", "200,200,0", "--aov", "depth,primitive", "--workers", 1, "--threads", threads, "--cache", cache)
            images.add(pathlib.Path(image).read_bytes())
        self.assertEqual(len(images), 1)
        self.assertGreater(len(images.pop()), 50000)


class SameStore(Case):
    def test_memory_and_threads_do_not_change_the_store(self):
        model = self.path("m.ply")
        self.must("quarry-scene", "plant", "--triangles", 300000, "-o", model, "--quiet")
        self.expect_one_store(model)

    def test_an_inseparable_pile_is_the_same_from_disk_and_from_memory(self):
        """200,000 times one triangle, more than a quarter of the least memory holds; others beside it, with space."""
        vertices = [(0, 0, 0), (3, 2, 1), (1, 3, 2), (90, 90, 90), (91, 90, 90), (90, 91, 91)]
        faces = [(0, 1, 2)] * 200000 + [(3, 4, 5)] * 5
        model = self.path("chain.ply")
        write_ply(model, vertices, faces)
        self.expect_one_store(model)
        info = self.info(self.path("s-1G-2.quarry"))
        self.assertEqual(info["chained_voxels"], info["voxels"] - 1)  # all but that of those beside it

    def expect_one_store(self, model):
        stores = []
        for memory, threads in (("1G", 2), ("64M", 1), ("64M", 2)):
            store = self.path(f"s-{memory}-{threads}.quarry")
            self.must("quarry-preprocess", model, "-o", store, "--memory", memory, "--threads", threads, "--quiet")
            stores.append(pathlib.Path(store).read_bytes())
        self.assertEqual(stores[0], stores[1])
        self.assertEqual(stores[0], stores[2])


if __name__ == "__main__":
    main()

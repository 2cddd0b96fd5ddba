"""A cache that is accepted finishes every frame, with the same picture, by real processes."""
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import Case, main
from tests.support.models import hard_models


class SmallCaches(Case):
    def store(self, name, *options):
        self.must("quarry-preprocess", self.path(f"{name}.ply"), "-o", self.path(f"{name}.quarry"), "--quiet", *options)
        return self.path(f"{name}.quarry")

    def scene(self, kind, triangles):
        self.must("quarry-scene", kind, "--triangles", triangles, "-o", self.path(f"{kind}.ply"), "--quiet")
        return self.store(kind)

    def largest(self, store):
        return json.loads(self.must("quarry", "info", store, "--json").stdout)["largest_decoded_bytes"]

    def render(self, store, output, cache, *options):
        """Returns how many blocks were loaded; at most TIMEOUT_S."""
        self.must("quarry", "render", store, "-o", self.path(output), "--cache", cache, "--workers", 1, "--quiet",
                  "--stats", self.path("stats.json"), *options)
        stats = json.loads(pathlib.Path(self.path("stats.json")).read_text())
        return sum(worker["voxel_blocks_loaded"] for worker in stats["frames"][-1]["workers"])

    def assert_same(self, store, caches, *options):
        """The same picture for each cache; returns the loads, with room for all first."""
        def picture(name):  # a frame of a path has its number in its name
            path = next(self.folder.glob(f"{name}*.png"))
            pixels = path.read_bytes()
            path.unlink()
            return pixels

        loads = [self.render(store, "all.png", "1G", *options)]
        expected = picture("all")
        for cache in caches:
            loads.append(self.render(store, "small.png", cache, *options))
            self.assertEqual(picture("small"), expected)
        return loads

    def test_frames_of_a_plant_and_a_city(self):
        # Rays went back and forth between two voxels here, for ever.
        for kind, triangles, frame, caches in (("plant", 1000000, 22, (300000,)), ("city", 300000, 5, (165000, 400000))):
            with self.subTest(kind=kind):
                store = self.scene(kind, triangles)
                largest = self.largest(store)
                all_resident, *small = self.assert_same(
                    store, [largest, *(max(cache, largest) for cache in caches)], "--camera-path", self.path(f"{kind}.path.json"),
                    "--frames", frame, "--size", "320x240", "--mode", "raycast", "--threads", 1)
                # Each is loaded once for the rays of some 16 of the 80 tiles.
                self.assertLess(max(small), 16 * all_resident)

    def test_inseparable_models(self):
        for kind in ("fan", "slivers"):
            with self.subTest(kind=kind):
                hard_models.write(self.path(f"{kind}.ply"), kind, 60000)
                store = self.store(kind, "--voxel-size", "32K")
                facts = json.loads(self.must("quarry", "info", store, "--json").stdout)
                self.assertGreater(facts["chained_voxels"], 50)
                # Planes only copy such triangles: few are taken.
                self.assertLess(facts["stored_triangle_references"], 2 * 60000)
                largest = self.largest(store)
                all_resident, *small = self.assert_same(store, [largest, 4 * largest], "--size", "160x120", "--mode", "raycast",
                                                        "--threads", 2)
                self.assertLess(max(small), 16 * all_resident)

    def test_light_that_bounces_through_a_room(self):
        """Each path goes through many voxels, and waits for each."""
        store = self.scene("plant", 60000)
        largest = self.largest(store)
        self.assert_same(store, [largest, 4 * largest], "--mode", "path", "--spp", 2, "--bounces", 4, "--size", "64x48", "--eye", "6,6,14",
                         "--at", "30,30,16", "--threads", 1)


if __name__ == "__main__":
    main()

"""What all runs share: the scene, an older state of it, a walk through it, and the images that nothing disturbed."""
import json
import os
import pathlib
import subprocess

BIN = pathlib.Path(os.environ.get("QUARRY_BIN", pathlib.Path(__file__).parents[2] / "build/release/bin"))
TRIANGLES, VOXEL_SIZE, CACHE = 120000, "16K", "2M"
FRAMES = range(0, 60, 6)  # of the walk's 60
MODES = ("shadow", "whitted")


class Stage:
    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.bad_worker = BIN / "quarry-test-bad-worker"
        self.store = self._store("scene", 1)
        self.older = self._store("older", 2)
        self.path = str(self.folder / "walk.json")
        walk = json.loads((self.folder / "scene.path.json").read_text())
        walk["frames"] = [walk["frames"][f] for f in FRAMES]
        pathlib.Path(self.path).write_text(json.dumps(walk))
        self.images = {}
        for mode in MODES:
            folder = self.folder / mode
            folder.mkdir()
            self._run("quarry", "render", self.store, *self.render_options(mode), "-o", folder / "f.png", "--workers", 2, "--threads", 1,
                      "--quiet")
            self.images[mode] = {path.name: path.read_bytes() for path in folder.iterdir()}
            assert len(self.images[mode]) == len(FRAMES)

    def render_options(self, mode):
        return ["--camera-path", self.path, "--size", "160x120", "--spp", "4", "--mode", mode]

    def _store(self, name, seed):
        model, store = self.folder / f"{name}.ply", str(self.folder / f"{name}.quarry")
        self._run("quarry-scene", "plant", "--triangles", TRIANGLES, "--seed", seed, "-o", model, "--quiet")
        self._run("quarry-preprocess", model, "-o", store, "--voxel-size", VOXEL_SIZE, "--quiet")
        return store

    @staticmethod
    def _run(program, *arguments):
        subprocess.run([str(BIN / program), *map(str, arguments)], check=True)

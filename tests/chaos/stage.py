"""Shared by all runs: the scene, an older state of it, a walk through it, and the images of the undisturbed walk."""
import json
import os
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[2]))
from tests.support.models.textured_scene import write_scene

BIN = pathlib.Path(os.environ.get("QUARRY_BIN", pathlib.Path(__file__).parents[2] / "build/release/bin"))
TRIANGLES, VOXEL_SIZE, CACHE = 120000, "16K", "2M"
FRAMES = range(0, 60, 6)  # of the walk's 60
MODES = ("shadow", "whitted", "path")
# The view of a walk in modes whitted and path: some parts are hidden, one is coloured, and a cut has caps.
INSIDE = {"hide": ["roof", "*pipe 1*"], "colors": [{"parts": ["chimney*"], "color": [0.8, 0.1, 0.1]}],
          "section": {"planes": [{"point": [0, 0, 33], "normal": [0.2, -0.3, 1]}]}}


class Stage:
    def __init__(self, folder, textured=False):
        self.folder = pathlib.Path(folder)
        self.textured = textured
        self.bad_worker = BIN / "quarry-test-bad-worker"
        self.store = self._store("scene", 1)
        self.older = self._store("older", 2)
        walk = self._walk()
        for mode in MODES:
            shown = {"view": INSIDE} if mode != "shadow" and not textured else {}
            self._path(mode).write_text(json.dumps({**walk, **shown}))
        self.images = {}
        for mode in MODES:
            folder = self.folder / mode
            folder.mkdir()
            self._run("quarry", "render", self.store, *self.render_options(mode), "-o", folder / "f.png", "--workers", 2, "--threads", 1,
                      "--quiet")
            self.images[mode] = {path.name: path.read_bytes() for path in folder.iterdir()}
            assert len(self.images[mode]) == len(FRAMES)

    def render_options(self, mode):
        return ["--camera-path", str(self._path(mode)), "--size", "160x120", "--spp", "4", "--mode", mode, *(("--bounces", "3") if mode == "path" else ())]

    def _path(self, mode):
        return self.folder / f"walk-{mode}.json"

    def _walk(self):
        if self.textured:
            return {"frames": [{"eye": [14 - k, -7 + k / 2, 7 - k / 3], "at": [6, 4, 0.5], "up": [0, 0, 1], "fov": 50}
                               for k in range(len(FRAMES))]}
        walk = json.loads((self.folder / "scene.path.json").read_text())
        return {**walk, "frames": [walk["frames"][f] for f in FRAMES]}

    def _store(self, name, seed):
        if self.textured:
            store, models = str(self.folder / f"{name}.quarry"), self.folder / f"{name}-models"
            models.mkdir()
            self._run("quarry-preprocess", *write_scene(models, 64 + 8 * seed), "-o", store, "--voxel-size", VOXEL_SIZE, "--up-axis", "z", "--quiet")
            return store
        model, store = self.folder / f"{name}.ply", str(self.folder / f"{name}.quarry")
        self._run("quarry-scene", "plant", "--triangles", TRIANGLES, "--seed", seed, "-o", model, "--quiet")
        self._run("quarry-preprocess", model, "-o", store, "--voxel-size", VOXEL_SIZE, "--quiet")
        return store

    @staticmethod
    def _run(program, *arguments):
        subprocess.run([str(BIN / program), *map(str, arguments)], check=True)

"""First pictures: mode ao and exposure are the same whatever the cluster, views come back from files, a master answers questions."""
import json
import os
import pathlib
import statistics
import struct
import sys
import time
import unittest.mock
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.exr import read_exr
from tests.integration.programs import Case, main

SIZE = ("--size", "200x150")


def png(path):
    """The texts and the pixels (rows of bytes, as stored) of a PNG."""
    data, at, texts, pixels = pathlib.Path(path).read_bytes(), 8, {}, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        if kind == b"tEXt":
            key, text = body.split(b"\0", 1)
            texts[key.decode()] = text.decode()
        elif kind == b"IDAT":
            pixels += body
        at += 12 + length
    return texts, zlib.decompress(pixels)


class Pictures(Case):
    def render(self, name, *arguments):
        size = () if "--size" in arguments else SIZE
        self.must("quarry", "render", *arguments, "-o", self.path(name), "--quiet", "--force", *size)
        return pathlib.Path(self.path(name)).read_bytes()

    def test_ao_and_exposure_are_the_same_bytes_for_any_cluster(self):
        scene = self.store("plant", 100000)
        info = self.info(scene)
        reference = self.render("a.png", scene, "--workers", 1, "--threads", 1)
        self.assertRegex(png(self.path("a.png"))[0]["Exposure"], r"^-?\d+(\.\d+)? EV$")
        for workers, threads, cache in ((1, 2, "256M"), (2, 1, "256M"), (3, 2, info["largest_decoded_bytes"])):
            with self.subTest(workers=workers, threads=threads, cache=cache):
                self.assertEqual(self.render("b.png", scene, "--workers", workers, "--threads", threads, "--cache", cache), reference)
        for isa in ("scalar", "avx2"):
            with self.subTest(isa=isa), unittest.mock.patch.dict(os.environ, QUARRY_ISA=isa):
                self.assertEqual(self.render("i.png", scene), reference)

    def test_a_crop_has_the_exposure_of_the_whole_and_samples_are_a_prefix(self):
        scene = self.store("city", 20000)
        self.render("whole.png", scene)
        self.render("crop.png", scene, "--crop", "120,90,16,8")
        whole, crop = png(self.path("whole.png")), png(self.path("crop.png"))
        self.assertEqual(whole[0]["Exposure"], crop[0]["Exposure"])
        self.assertNotEqual(crop[0]["Exposure"], "0 EV")
        self.render("many.png", scene, "--spp", 9, "--ao-samples", 1)
        self.assertEqual(png(self.path("many.png"))[0]["Samples"], "9 a pixel")
        self.render("fixed.png", scene, "--exposure", "-1.5", "--stats", self.path("s.json"))
        self.assertEqual(png(self.path("fixed.png"))[0]["Exposure"], "-1.5 EV")
        self.assertEqual(json.loads(pathlib.Path(self.path("s.json")).read_text())["frames"][0]["exposure_ev"], -1.5)

    def test_files_state_the_scene_and_nothing_of_the_host(self):
        scene = self.store("city", 5000)
        self.render("a.png", scene)
        texts = png(self.path("a.png"))[0]
        self.assertEqual(set(texts), {"Software", "Scene", "Camera", "Mode", "Samples", "Exposure"})
        self.assertEqual(texts["Scene"], self.info(scene)["scene_id"])
        self.assertEqual(texts["Mode"], "ao")

    def test_a_view_file_gives_the_picture_again(self):
        scene = self.store("city", 20000)
        for name, arguments in {"iso": (), "top": ("--view", "top"), "ortho": ("--view", "front", "--ortho", "50"),
                                "whitted": ("--mode", "whitted", "--spp", "2", "--seed", "5", "--sun", "1,2,3"),
                                "ao": ("--ao-samples", "2", "--ao-distance", "3", "--exposure", "0.5"),
                                "crop": ("--crop", "10,20,64,32", "--up-axis", "y")}.items():
            with self.subTest(name):
                picture = self.render("a.png", scene, *arguments, "--write-view", self.path("v.json"))
                again = self.must("quarry", "render", scene, "-o", self.path("b.png"), "--quiet", "--force", "--view", self.path("v.json"))
                self.assertEqual(pathlib.Path(self.path("b.png")).read_bytes(), picture, again.stderr)
        self.must("quarry", "render", scene, "-o", self.path("c.png"), "--quiet", "--view", self.path("v.json"), "--spp", "1", "--size", "64x48",
                  "--crop", "0,0,64,48")
        self.assertEqual(png(self.path("c.png"))[0]["Samples"], "1 a pixel")
        (self.folder / "bad.json").write_text('{"camera": {"eye": [0, 0, 0]}}')
        self.must_fail(1, r"bad\.json: camera: 'at' is missing", "quarry", "render", scene, "-o", self.path("d.png"), "--view", self.path("bad.json"))
        self.must_fail(2, r"--view is one of iso, .*, not 'above'", "quarry", "render", scene, "-o", self.path("d.png"), "--view", "above")
        self.assertFalse((self.folder / "d.png").exists())

    def test_mode_path_has_a_sky_or_the_light_of_the_scene(self):
        def lights(name, text):
            (self.folder / f"{name}.obj").write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0.1\nusemtl m\nf 1 2 3\n")
            (self.folder / "m.mtl").write_text("newmtl m\nKd 0.5 0.5 0.5\n" + text)
            store, view = self.path(f"{name}.quarry"), self.path(f"{name}.json")
            self.must("quarry-preprocess", self.path(f"{name}.obj"), "-o", store, "--quiet", "--up-axis", "z")
            self.must("quarry", "render", store, "-o", self.path("p.png"), "--quiet", "--force", "--mode", "path", "--spp", 1, "--size", "16x16", "--write-view", view)
            members = json.loads(pathlib.Path(view).read_text())
            return members.get("sky"), len(members["lights"])

        self.assertEqual(lights("dark", ""), ({"turbidity": 3.0}, 1))
        self.assertEqual(lights("shining", "Ke 3 2 1\n"), (None, 0))

    def test_mode_path_has_a_lamp_at_the_eye_inside(self):
        scene, stats = self.store("plant", 20000), self.path("stats.json")
        for options, lights in (([], ["sun", "sky"]), (["--view", "inside"], ["sun", "lamp at the eye", "sky"]), (["--view", "inside", "--sun", "0,0,1"], ["sun"])):
            self.render("p.png", scene, "--mode", "path", "--spp", 1, "--size", "32x24", "--stats", stats, *options)
            self.assertEqual(json.loads(pathlib.Path(stats).read_text())["lights"], lights)
        # It lights what the sun and the sky do not.
        view = self.path("lamp.json")
        self.render("r.exr", scene, "--mode", "path", "--spp", 32, "--size", "48x36", "--view", "inside", "--write-view", view)
        without = json.loads(pathlib.Path(view).read_text())
        self.assertEqual(without["lights"].pop()["position"], "eye")
        pathlib.Path(view).write_text(json.dumps(without))
        self.render("w.exr", scene, "--view", view, "--size", "48x36")
        lit, dark = (statistics.median(g for row in read_exr(self.folder / name).rows["G"] for g in row) for name in ("r.exr", "w.exr"))
        self.assertGreater(lit, 2 * dark)

    def test_a_camera_path_may_hold_the_look_of_its_frames(self):
        scene = self.store("city", 20000)
        picture = self.render("a.png", scene, "--mode", "whitted", "--sun", "1,2,3", "--exposure", "0.5", "--write-view", self.path("v.json"))
        view = json.loads(pathlib.Path(self.path("v.json")).read_text())
        other = {**view["camera"], "eye": view["camera"]["at"], "at": view["camera"]["eye"]}
        walk = {"view": {**view, "camera": other}, "frames": [view["camera"], other]}
        pathlib.Path(self.path("walk.json")).write_text(json.dumps(walk))
        command = ["quarry", "render", scene, "-o", self.path("w.png"), "--quiet", "--camera-path", self.path("walk.json")]
        self.must(*command)
        self.assertEqual((self.folder / "w.0000.png").read_bytes(), picture)
        self.assertNotEqual((self.folder / "w.0001.png").read_bytes(), picture)
        self.must(*command, "--force", "--frames", 0, "--spp", 2, "--size", "64x48")
        self.assertEqual(png(self.path("w.0000.png"))[0]["Samples"], "2 a pixel")
        for view in ({"mode": "none"}, [], {"unknown": 1}):
            pathlib.Path(self.path("walk.json")).write_text(json.dumps({**walk, "view": view}))
            self.must_fail(1, r"walk\.json: view", *command, "--force")

    def test_a_turntable_goes_around_the_model(self):
        scene = self.store("city", 5000)
        self.must("quarry", "render", scene, "-o", self.path("t.png"), "--quiet", "--turntable", 4, "--size", "64x48")
        pictures = {(self.folder / f"t.{n:04}.png").read_bytes() for n in range(4)}
        self.assertEqual(len(pictures), 4)
        self.assertFalse((self.folder / "t.0004.png").exists())

    def test_the_up_axis_is_guessed_and_printed(self):
        self.must("quarry-scene", "city", "--triangles", 5000, "-o", self.path("c.obj"), "--quiet")
        told = self.must("quarry-preprocess", self.path("c.obj"), "-o", self.path("c.quarry"))
        self.assertIn("up axis: z, a sure guess (--up-axis y for the other)", told.stderr)
        told = self.must("quarry-preprocess", self.path("c.obj"), "-o", self.path("y.quarry"), "--up-axis", "y")
        self.assertNotIn("guess", told.stderr)
        self.assertEqual(self.info(self.path("y.quarry"))["up_axis"], "y")
        self.assertEqual(self.info(self.path("c.quarry"))["up_axis"], "z")
        self.render("a.png", self.path("c.quarry"), "--up-axis", "y")
        self.render("b.png", self.path("y.quarry"))
        self.assertEqual(png(self.path("a.png"))[1], png(self.path("b.png"))[1])

    def test_a_client_needs_no_store(self):
        scene = self.store("plant", 50000)
        here = self.render("here.png", scene)
        _, address = self.start_master(scene)
        self.start_worker(address)
        self.assertEqual(self.render("there.png", "--master", address), here)
        inside = self.render("here.png", scene, "--view", "inside")
        self.assertEqual(self.render("there.png", "--master", address, "--view", "inside"), inside)
        self.must_fail(2, "name a scene store or a model, or the --master of a scene", "quarry", "render", "-o", self.path("x.png"))

    def test_status_lists_workers_and_jobs(self):
        scene = self.store("city", 5000)
        _, address = self.start_master(scene)
        empty = json.loads(self.must("quarry", "status", "--master", address, "--json").stdout)
        self.assertEqual((empty["workers"], empty["jobs"]), ([], []))
        self.assertEqual(empty["scene_id"], self.info(scene)["scene_id"])
        self.start_worker(address, "--threads", 1)
        until = time.monotonic() + 30
        while not (workers := json.loads(self.must("quarry", "status", "--master", address, "--json").stdout)["workers"]):
            self.assertLess(time.monotonic(), until)
        self.assertEqual(workers[0]["threads"], 1)
        self.assertRegex(self.must("quarry", "status", "--master", address).stdout, r"(?s)^scene [0-9a-f]{32}, .*workers: 1\n.*jobs: 0\n$")
        self.must_fail(1, "refused|closed", "quarry", "status", "--master", "127.0.0.1:1")

    def test_ids_have_names(self):
        self.must("quarry-scene", "plant", "--triangles", 5000, "-o", self.path("p.obj"), "--quiet")
        self.must("quarry-preprocess", self.path("p.obj"), "-o", self.path("p.quarry"), "--quiet")
        lines = self.must("quarry", "info", self.path("p.quarry"), "--parts").stdout.splitlines()
        info = self.info(self.path("p.quarry"))
        parts, materials = [line for line in lines if line.startswith("part ")], lines[len(info["parts"]):]
        self.assertEqual({int(line.split(" ", 5)[1]): line.split(" ", 5)[5] for line in parts}, dict(enumerate(info["parts"])))
        self.assertEqual(materials, [f"material {i} {name}" for i, name in enumerate(info["materials"])])


if __name__ == "__main__":
    main()

"""Outputs never destroy existing files: inputs, files of another kind, devices, links; and after a signal a sentence names the work that is left."""
import hashlib
import os
import pathlib
import random
import signal
import stat
import subprocess
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, Case, end, main

CUBE = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""
SMALL = ["--size", "32x32", "--quiet"]


def seen(path):
    """The parts of a file that must stay the same: kind, inode and content."""
    info = os.lstat(path)
    content = hashlib.sha256(pathlib.Path(path).read_bytes()).hexdigest() if stat.S_ISREG(info.st_mode) else None
    return stat.S_IFMT(info.st_mode), info.st_ino, content


class Outputs(Case):
    def setUp(self):
        super().setUp()
        self.model = self.path("cube.ply")
        pathlib.Path(self.model).write_text(CUBE)
        self.scene = self.path("cube.quarry")
        self.must("quarry-preprocess", self.model, "-o", self.scene, "--quiet")

    def put(self, name, content="a file of somebody's\n"):
        (self.folder / name).write_text(content)
        return self.path(name)

    def refused(self, kept, sentence, program, *arguments):
        """Exit status 2 at once, one sentence, and the files `kept` as they were."""
        before, names, began = [seen(p) for p in kept], sorted(os.listdir(self.folder)), time.monotonic()
        self.must_fail(2, sentence, program, *arguments)
        self.assertEqual([seen(p) for p in kept], before)
        self.assertEqual(sorted(os.listdir(self.folder)), names, "something was made")
        self.assertLess(time.monotonic() - began, 10 * PATIENCE)

    def test_a_file_that_is_replaced_keeps_its_mode(self):
        picture, model = self.path("x.png"), self.path("m.ply")
        programs = ((picture, ["quarry", "render", self.scene, "-o", picture, *SMALL]),
                    (self.scene, ["quarry-preprocess", self.model, "-o", self.scene, "--quiet"]),
                    (model, ["quarry-scene", "plant", "--triangles", "2000", "-o", model, "--quiet"]))
        for output, command in programs:
            self.must(*command)
            for mode in (0o600, 0o640, 0o664):
                os.chmod(output, mode)
                self.must(*command)
                self.assertEqual(stat.S_IMODE(os.stat(output).st_mode), mode, output)

    def test_an_input_is_never_an_output(self):
        model, here = self.model, os.getcwd()
        os.link(model, self.path("hard.ply"))
        os.symlink("cube.ply", self.path("soft.ply"))
        os.symlink("soft.ply", self.path("softer.ply"))
        self.addCleanup(os.chdir, here)
        os.chdir(self.folder)
        for output in (model, "cube.ply", "./cube.ply", "../" + self.folder.name + "/cube.ply", self.path("hard.ply"),
                       self.path("soft.ply"), self.path("softer.ply")):
            for force in ([], ["--force"]):
                with self.subTest(output=output, force=force):
                    self.refused([model], "is an input of this run", "quarry-preprocess", model, "-o", output, *force)
        self.refused([model], "is an input of this run", "quarry-preprocess", model, "-o", "x.quarry", "--stats", "hard.ply",
                     "--force")
        path = self.put("path.json", '{"frames": [{"eye": [1, 1, 1], "at": [0, 0, 0]}]}')
        self.refused([path], "is an input of this run", "quarry", "render", self.scene, "-o", "x.png", "--camera-path", path,
                     "--stats", path, "--force")
        self.refused([self.scene], "is an input of this run", "quarry", "render", self.scene, "-o", "x.png", "--stats", self.scene)
        self.refused([self.scene], "is an input of this run", "quarry-master", self.scene, "--listen", "127.0.0.1:0", "--trace",
                     self.scene)

    def test_an_image_that_the_model_names_is_an_input(self):
        self.must("quarry", "render", self.scene, "-o", self.path("t.png"), *SMALL)
        self.put("m.mtl", "newmtl m\nmap_Kd t.png\n")
        model = self.put("m.obj", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n")
        before = seen(self.path("t.png"))
        self.must_fail(2, "is an input of this run", "quarry", "render", model, "-o", self.path("t.png"), "--force", *SMALL)
        self.assertEqual(seen(self.path("t.png")), before)

    def test_force_does_not_replace_files_of_the_model(self):
        (self.folder / "t.ppm").write_bytes(b"P6 1 1 255\n123")
        self.put("m.mtl", "newmtl m\nmap_Kd t.ppm\n")
        model = self.put("m.obj", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n")
        for named in ("m.mtl", "t.ppm"):
            for arguments in (["-o", self.path(named)], ["-o", self.path("y.quarry"), "--stats", self.path(named)]):
                with self.subTest(arguments=arguments):
                    before = seen(self.path(named))
                    self.must_fail(2, "is an input of this run", "quarry-preprocess", model, *arguments, "--force")
                    self.assertEqual(seen(self.path(named)), before)
        self.assertEqual([p.name for p in self.folder.iterdir() if "work" in p.name or "lock" in p.name or "tmp" in p.name], [])

    def test_a_file_of_another_kind_is_replaced_by_force_only(self):
        photo = self.path("photo.png")
        self.must("quarry", "render", self.scene, "-o", photo, *SMALL)
        self.must("quarry", "render", self.scene, "-o", photo, *SMALL)  # a PNG by a PNG
        notes = self.put("notes.txt")
        for arguments in (["quarry-preprocess", self.model, "-o", photo],
                          ["quarry-preprocess", self.model, "-o", notes],
                          ["quarry-preprocess", self.model, "-o", self.path("y.quarry"), "--stats", notes],
                          ["quarry", "render", self.scene, "-o", self.path("x.png"), "--stats", notes, *SMALL]):
            with self.subTest(arguments=arguments):
                self.refused([photo, notes], "exists and is not .*--force", *arguments)
        os.rename(notes, self.path("notes.png"))
        picture = ["quarry", "render", self.scene, "-o", self.path("notes.png"), *SMALL]
        self.refused([self.path("notes.png")], "exists and is not a PNG image", *picture)
        self.must(*picture, "--force")
        os.rename(self.scene, self.path("store.png"))
        self.refused([self.path("store.png")], "is not a PNG image", "quarry", "render", self.model, "-o", self.path("store.png"))
        self.must("quarry-preprocess", self.model, "-o", photo, "--force", "--quiet")
        self.must("quarry", "verify", photo, "--quiet")
        trace = self.put("trace")
        self.refused([trace], "is not a tile trace", "quarry-master", photo, "--listen", "127.0.0.1:0", "--trace", trace)

    def test_an_empty_file_and_statistics_are_replaced(self):
        open(self.path("new.quarry"), "w").close()
        for _ in range(2):
            self.must("quarry-preprocess", self.model, "-o", self.path("new.quarry"), "--stats", self.path("s.json"), "--quiet")
        self.must("quarry-preprocess", self.model, "-o", self.path("new.quarry"), "--stats", self.path("s.json"), "--quiet", "--plan")
        self.must("quarry", "render", self.scene, "-o", self.path("x.exr"), "--stats", self.path("s.json"), *SMALL)
        self.assertEqual(self.info(self.path("new.quarry")), self.info(self.scene))

    def test_two_outputs_are_two_files(self):
        one = self.path("one.png")
        self.refused([], "is written twice", "quarry", "render", self.scene, "-o", one, "--stats", self.path("./one.png"))

    def test_a_generated_scene_replaces_no_other_file(self):
        for name, sentence in (("c.path.json", "is not a camera path"), ("c.materials.json", "is not a library"),
                               ("c.ply", "is not a PLY model")):
            mine = self.put(name, "mine")
            self.refused([mine], sentence, "quarry-scene", "city", "--triangles", 1000, "-o", self.path("c.ply"))
            os.unlink(mine)
        mine = self.put("c.mtl", "mine")
        self.refused([mine], "is not an MTL library", "quarry-scene", "city", "--triangles", 1000, "-o", self.path("c.obj"))
        for _ in range(2):
            self.must("quarry-scene", "city", "--triangles", 1000, "-o", self.path("c.obj"), "--quiet", "--force")
        self.must("quarry-scene", "city", "--triangles", 1000, "-o", self.path("c.obj"), "--quiet")

    def test_links_are_followed(self):
        there = self.folder / "there"
        there.mkdir()
        for name, target in (("link.quarry", "there/real.quarry"), ("link.png", "there/real.png"), ("link.ply", "there/real.ply"),
                             ("link.json", "there/real.json")):
            os.symlink(target, self.path(name))  # to nothing yet
        for _ in range(2):
            self.must("quarry-scene", "city", "--triangles", 1000, "-o", self.path("link.ply"), "--quiet")
            self.must("quarry-preprocess", self.path("link.ply"), "-o", self.path("link.quarry"), "--quiet")
            self.must("quarry", "render", self.path("link.quarry"), "-o", self.path("link.png"), "--stats", self.path("link.json"),
                      *SMALL)
        self.assertEqual(sorted(p.name for p in there.iterdir()), ["real.json", "real.ply", "real.png", "real.quarry"])
        for name in ("link.quarry", "link.png", "link.ply", "link.json"):
            self.assertTrue(os.path.islink(self.path(name)))
        os.symlink("b.quarry", self.path("a.quarry"))
        os.symlink("a.quarry", self.path("b.quarry"))
        self.refused([], "in a circle", "quarry-preprocess", self.model, "-o", self.path("a.quarry"))

    def test_folders_are_refused_at_once(self):
        folders = [self.path(name) for name in ("d", "d.png", "d.ply", "d.json")]
        for folder in folders:
            os.mkdir(folder)
        self.refused(folders, "is a folder", "quarry-preprocess", self.model, "-o", folders[0])
        self.refused(folders, "is a folder", "quarry-preprocess", self.model, "-o", self.path("n.quarry"), "--stats", folders[3])
        for scene in (self.scene, self.model):
            self.refused(folders, "is a folder", "quarry", "render", scene, "-o", folders[1])
            self.refused(folders, r"\.png or \.exr", "quarry", "render", scene, "-o", folders[0])
        self.refused(folders, "is a folder", "quarry-scene", "city", "--triangles", 1000, "-o", folders[2])
        self.refused(folders, "is not a folder", "quarry-master", self.scene, "--listen", "127.0.0.1:0", "--spool", self.model)
        self.refused(folders, "is not a folder", "quarry-worker", "--master", "127.0.0.1:1", "--disk-cache", self.model + ":1M")

    def special(self):
        """A FIFO, and a device like /dev/null where they can be made."""
        os.mkfifo(self.path("fifo"))
        made = [self.path("fifo")]
        try:
            os.mknod(self.path("null"), stat.S_IFCHR | 0o666, os.makedev(1, 3))
            with open(self.path("null"), "wb") as null:
                null.write(b"x")
            made.append(self.path("null"))
        except OSError:
            pass
        return made

    def test_devices_and_fifos_are_never_renamed_over(self):
        for special in self.special():
            with self.subTest(special=special):
                self.refused([special], "is a device or FIFO", "quarry-preprocess", self.model, "-o", special, "--force")
                os.symlink(special, self.path("s.ply"))
                self.refused([special], "is a device or FIFO", "quarry-scene", "city", "--triangles", 1000, "-o", self.path("s.ply"))
                os.unlink(self.path("s.ply"))
        os.symlink("fifo", self.path("fifo.png"))
        self.refused([self.path("fifo")], "no program reads from this FIFO", "quarry-preprocess", self.model, "-o", self.path("n.quarry"),
                     "--quiet", "--stats", self.path("fifo"))
        for scene in (self.scene, self.model):
            self.refused([self.path("fifo")], "no program reads from this FIFO", "quarry", "render", scene, "-o", self.path("fifo.png"),
                         *SMALL)

    def test_statistics_and_pictures_go_to_fifos_and_devices(self):
        special = self.special()
        os.symlink("fifo", self.path("fifo.png"))
        read = {}

        def reader():
            with open(self.path("fifo"), "rb") as fifo:
                read["bytes"] = fifo.read()

        for arguments, start in ((["quarry-preprocess", self.model, "-o", self.path("n.quarry"), "--stats", self.path("fifo")], b"{"),
                                 (["quarry", "render", self.scene, "-o", self.path("fifo.png"), *SMALL], b"\x89PNG")):
            thread = threading.Thread(target=reader)
            thread.start()
            self.must(*arguments)
            thread.join(timeout=20)
            self.assertTrue(read["bytes"].startswith(start))
        for path in special:
            self.assertFalse(stat.S_ISREG(os.stat(path).st_mode))
        if len(special) > 1:
            self.must("quarry", "render", self.scene, "-o", self.path("x.png"), "--stats", special[1], *SMALL)
            self.assertTrue(stat.S_ISCHR(os.stat(special[1]).st_mode))
        done = self.must("quarry-preprocess", self.model, "-o", self.path("n.quarry"), "--stats", "/dev/stdout", "--quiet")
        self.assertIn('"scene_id"', done.stdout)

    def test_a_foreign_lock_file_is_left_alone(self):
        lock = self.put("package.lock", "{}")
        self.refused([lock], "not a lock file of Quarry", "quarry-preprocess", self.model, "-o", self.path("package"), "--quiet")

    def test_a_spool_leaves_foreign_files_alone(self):
        mine = self.folder / "spool" / "0123456789abcdef"
        mine.mkdir(parents=True)
        (mine / "thesis.txt").write_text("mine")
        master, _ = self.start_master(self.scene, "--spool", self.path("spool"))
        end(master)
        self.assertEqual((mine / "thesis.txt").read_text(), "mine")


class Signals(Case):
    def test_a_signal_at_any_moment_is_reported(self):
        model, out = self.path("plant.ply"), self.folder / "out"
        self.must("quarry-scene", "plant", "--triangles", 400000, "-o", model, "--quiet")
        out.mkdir()
        spill = self.folder / "spill"
        spill.mkdir()
        chance = random.Random(os.environ.get("QUARRY_TEST_SEED", "7"))
        interrupted = kept = 0
        for run in range(40):
            more = (["--tmp", str(spill)] if run % 2 else []) + (["--plan"] if run % 5 == 0 else [])
            child = subprocess.Popen([str(BIN / "quarry-preprocess"), model, "-o", str(out / "x.quarry"), "--quiet", "--memory", "64M",
                                      "--checkpoint", "0.05", *more], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            self.addCleanup(end, child)
            # As soon as there is something, or later.
            until = time.monotonic() + 10 * PATIENCE
            while not list(out.iterdir()) and not list(spill.iterdir()) and child.poll() is None and time.monotonic() < until:
                pass
            time.sleep(chance.choice([0, 0, chance.uniform(0, 0.002), chance.uniform(0, 0.05), chance.uniform(0, 1.0)]))
            child.send_signal(signal.SIGINT)
            told = child.communicate(timeout=60 * PATIENCE)[1]
            left = sorted(p.name for p in out.iterdir()) + sorted(p.name for p in spill.iterdir())
            with self.subTest(run=run, told=told, left=left):
                if child.returncode == 0:  # it was faster
                    self.assertEqual(left, [] if "--plan" in more else ["x.quarry"])
                else:
                    self.assertEqual(child.returncode, 1)
                    self.assertIn("interrupted", told)
                    interrupted += 1
                    work = [name for name in left if name.endswith(".work")]
                    kept += bool(work)
                    self.assertEqual(bool(work), "x.quarry.work: the same command with --resume continues" in told)
                    self.assertEqual([n for n in left if not n.endswith(".work") and n != "x.quarry"], [])
            subprocess.run(["rm", "-rf", *map(str, out.iterdir()), *map(str, spill.iterdir())], check=True)
        self.assertGreater(interrupted, 20)
        self.assertGreater(kept, 0)

    def test_repeated_signals_end_a_program_once(self):
        """As when a terminal's Ctrl-C and the end of the program that started it come together."""
        model = self.path("plant.ply")
        self.must("quarry-scene", "plant", "--triangles", 2000000, "-o", model, "--quiet")
        burst = 1000 * (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        for run in range(60):
            child = subprocess.Popen([str(BIN / "quarry-preprocess"), model, "-o", self.path("x.quarry"), "--quiet"],
                                     stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            self.addCleanup(end, child)
            time.sleep(0.15 + 0.02 * (run % 10))
            for one in burst:
                os.kill(child.pid, one)
            told = child.communicate(timeout=60 * PATIENCE)[1]
            self.assertEqual(told.count("interrupted"), 1, told)


if __name__ == "__main__":
    main()

"""Reports about other programs on names, locales, limits, full disks and killed commands. A case that needs a file takes it from
../shared/cases-2; each is right or ends with one sentence."""
import contextlib
import json
import os
import pathlib
import re
import resource
import shutil
import signal
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, end, main

CASES = pathlib.Path(__file__).parents[4] / "shared/cases-2"
CONTROLS = re.compile(rb"[\x00-\x08\x0b-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80[\x8e\x8f\xa8-\xae]|\xe2\x81[\xa6-\xa9]")
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


class Doors(Case):
    def case_file(self, case, name):
        """A copy of a case's file, since output lies beside it."""
        if not CASES.exists():
            self.skipTest("skipped: ../shared/cases-2 is not there")
        for file in (CASES / case).iterdir():
            shutil.copy(file, self.folder / file.name)
        return self.path(name)

    def write(self, name, text):
        (self.folder / name).write_text(text)
        return self.path(name)

    def test_names_as_long_as_the_file_system_takes(self):
        model = self.write("m.obj", SQUARE)
        for stem, extension in (("a" * 251, ".png"), ("b" * 248, ".quarry"), ("ü" * 124, ".quarry"), ("c" * 251, ".obj")):
            name = stem + extension
            with self.subTest(name=name[:3], bytes=len(name.encode())):
                if extension == ".quarry":
                    self.must("quarry-preprocess", model, "-o", self.path(name), "--quiet")
                    self.must("quarry-preprocess", model, "-o", self.path(name), "--resume", "--tmp", self.folder, "--quiet")
                    self.assertEqual(self.info(self.path(name))["input_triangles"], 2)
                else:
                    source = model
                    if extension == ".obj":  # the kept store's name is as long
                        source = self.write(name, SQUARE)
                    picture = self.path(name.replace(".obj", ".png"))
                    self.must("quarry", "render", source, "-o", picture, "--size", "8x8")
                    self.assertTrue(os.path.getsize(picture))
        left = [p.name[:8] for p in self.folder.iterdir() if ".tmp" in p.name or ".work" in p.name or ".lock" in p.name]
        self.assertEqual(left, [])

    def test_names_of_strangers_are_shown_without_control_codes(self):
        model = self.case_file("names_200_chars_and_controls", "q.obj")
        made = self.must("quarry-preprocess", model, "-o", self.path("s.quarry"))
        shown = [made.stderr] + [self.must("quarry", "info", self.path("s.quarry"), *o).stdout for o in ((), ("--parts",), ("--textures",))]
        for text in shown:
            self.assertNotRegex(text.encode(errors="surrogateescape"), CONTROLS)
        self.assertIn("\\x1b[31mred", shown[2])
        self.assertTrue(any("Assembly" in part for part in self.info(self.path("s.quarry"))["parts"]))

    def test_warnings_have_no_control_codes(self):
        model = self.case_file("obj_names_with_control_codes_in_warnings", "q.obj")
        done = self.must("quarry-preprocess", model, "-o", self.path("s.quarry"))
        self.assertIn("warning", done.stderr)
        self.assertNotRegex(done.stderr.encode(), CONTROLS)

    def test_file_names_with_control_codes(self):
        name = "a\x1b[31m\nred\u202e.obj"
        done = self.must("quarry-preprocess", self.write(name, SQUARE), "-o", self.path("s.quarry"))
        self.assertNotRegex(done.stderr.encode(), CONTROLS)
        done = self.must_fail(1, r"\\x1b\[31m", "quarry", "info", self.path(name))
        self.assertNotRegex(done.stderr.encode(), CONTROLS)

    def test_a_locale_with_decimal_commas(self):
        for name in ("q.obj", "q.dae"):
            model = self.case_file("locale_comma", name)
            plain = self.must("quarry-preprocess", model, "-o", self.path("plain.quarry"), "--quiet")
            self.assertEqual(plain.stderr, "")
            for locale in ("de_DE.UTF-8", "de_DE.utf8", "C.UTF-8"):
                done = self.run_program("quarry-preprocess", model, "-o", self.path("s.quarry"), env={**os.environ, "LC_ALL": locale})
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertNotRegex(done.stderr, r"\d,\d")
                self.assertEqual((self.folder / "s.quarry").read_bytes(), (self.folder / "plain.quarry").read_bytes())

    def test_a_full_spill_disk(self):
        if os.geteuid() != 0:
            self.skipTest("skipped: only root mounts a small disk")
        disk = self.folder / "disk"
        disk.mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(disk)], check=True)
        try:
            self.must("quarry-scene", "plant", "--triangles", 300000, "-o", self.path("big.ply"), "--quiet")
            self.must_fail(1, rf"{disk}.*(room|free|No space left)", "quarry-preprocess", self.path("big.ply"), "-o", self.path("s.quarry"),
                           "--tmp", disk)
            self.assertEqual(list(disk.iterdir()), [])
            self.assertFalse((self.folder / "s.quarry").exists())
        finally:
            subprocess.run(["umount", str(disk)], check=True)

    def test_few_open_files(self):
        models = []
        png = bytes.fromhex("89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8cfc000000301010018dd8db0"
                            "0000000049454e44ae426082")
        for i in range(80):
            (self.folder / f"t{i}.png").write_bytes(png)
            self.write(f"m{i}.mtl", f"newmtl a\nmap_Kd t{i}.png\n")
            models.append(self.write(f"m{i}.obj", f"mtllib m{i}.mtl\nusemtl a\nvt 0 0\nvt 1 0\nvt 0 1\nv {i} 0 0\nv {i} 1 0\nv {i} 0 1\nf 1/1 2/2 3/3\n"))
        done = self.run_program("quarry-preprocess", *models, "-o", self.path("s.quarry"), "--quiet",
                                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (40, 40)))
        if done.returncode == 0:
            self.assertEqual(self.info(self.path("s.quarry"))["input_triangles"], 80)
        else:
            self.assertRegex(done.stderr.splitlines()[-1], r"open files|ulimit -n")

    def test_three_renders_of_a_model_that_nobody_kept(self):
        self.must("quarry-scene", "plant", "--triangles", 20000, "-o", self.path("plant.ply"), "--quiet")
        renders = [subprocess.Popen([str(BIN / "quarry"), "render", self.path("plant.ply"), "-o", self.path(f"{i}.png"), "--size", "32x32"],
                                    stderr=subprocess.PIPE) for i in range(3)]
        for render in renders:
            self.addCleanup(end, render)
            self.assertEqual(render.wait(TIMEOUT_S), 0, render.stderr.read())
        self.assertEqual(len({(self.folder / f"{i}.png").read_bytes() for i in range(3)}), 1)

    def children(self, pid):
        found = []
        for task in pathlib.Path(f"/proc/{pid}/task").glob("*/children"):
            try:
                found += map(int, task.read_text().split())
            except OSError:
                pass
        return found

    def await_children(self, process, count):
        give_up = time.monotonic() + TIMEOUT_S
        while len(self.children(process.pid)) < count and process.poll() is None and time.monotonic() < give_up:
            time.sleep(0.01)
        return self.children(process.pid)

    def test_a_killed_command_leaves_no_processes(self):
        render = subprocess.Popen([str(BIN / "quarry"), "render", self.store(), "-o", self.path("x.png"), "--spp", "4096", "--quiet"],
                                  stderr=subprocess.DEVNULL)
        self.addCleanup(end, render)
        started = self.await_children(render, 2)
        self.assertEqual(len(started), 2)
        render.kill()
        give_up = time.monotonic() + 30
        while any(os.path.exists(f"/proc/{pid}") for pid in started) and time.monotonic() < give_up:
            time.sleep(0.05)
        self.assertEqual([pid for pid in started if os.path.exists(f"/proc/{pid}")], [])

    def test_a_killed_worker_is_started_again_and_named(self):
        store, size = self.store(triangles=50000), ["--size", "640x480", "--spp", "16"]
        self.must("quarry", "render", store, "-o", self.path("right.png"), *size, "--quiet")
        render = subprocess.Popen([str(BIN / "quarry"), "render", store, "-o", self.path("x.png"), *size], stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, render)
        master, worker = sorted(self.await_children(render, 2))
        os.kill(worker, signal.SIGKILL)
        give_up = time.monotonic() + TIMEOUT_S
        while worker in self.children(render.pid) and time.monotonic() < give_up:
            time.sleep(0.01)
        _, told = render.communicate(timeout=TIMEOUT_S)
        self.assertEqual(render.returncode, 0, told)
        self.assertIn("worker local-1 was killed by signal 9, out of memory?; it is started again", told)
        self.assertEqual((self.folder / "x.png").read_bytes(), (self.folder / "right.png").read_bytes())

    def test_a_worker_that_always_dies_ends_a_render_with_the_reason(self):
        render = subprocess.Popen([str(BIN / "quarry"), "render", self.store(), "-o", self.path("x.png"), "--spp", "4096", "--quiet"],
                                  stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, render)
        master = min(self.await_children(render, 2))
        while render.poll() is None:
            for pid in self.children(render.pid):
                if pid != master:
                    with contextlib.suppress(ProcessLookupError):  # it was dead already, and has been waited for since
                        os.kill(pid, signal.SIGKILL)
            time.sleep(0.02)
        self.assertEqual(render.returncode, 1)
        self.assertEqual(render.stderr.read(), "quarry: worker local-1 was killed by signal 9, out of memory?\n")

    def test_a_killed_master_is_named(self):
        render = subprocess.Popen([str(BIN / "quarry"), "render", self.store(), "-o", self.path("x.png"), "--spp", "4096", "--quiet"],
                                  stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, render)
        os.kill(min(self.await_children(render, 2)), signal.SIGKILL)
        self.assertEqual(render.wait(TIMEOUT_S), 1)
        self.assertEqual(render.stderr.read(), "quarry: the master was killed by signal 9, out of memory?\n")

    def test_a_view_survives_all_its_workers(self):
        view = subprocess.Popen([str(BIN / "quarry"), "view", self.store(), "--workers", "2", "--http", "127.0.0.1:0"], stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, view)
        self.assertRegex(view.stdout.readline(), r"^http://127\.0\.0\.1:\d+/")
        started = self.await_children(view, 3)
        for worker in sorted(started)[1:]:
            os.kill(worker, signal.SIGKILL)
        give_up = time.monotonic() + TIMEOUT_S
        while (len(self.children(view.pid)) < 3 or set(self.children(view.pid)) == set(started)) and time.monotonic() < give_up:
            time.sleep(0.02)
        self.assertIsNone(view.poll())
        self.assertEqual(len(self.children(view.pid)), 3)
        view.send_signal(signal.SIGINT)
        _, told = view.communicate(timeout=TIMEOUT_S)
        self.assertEqual(told.count("was killed by signal 9, out of memory?; it is started again"), 2, told)
        self.assertRegex(told, r"the live view has ended; quarry view \S+ --http 127\.0\.0\.1:0 shows it again")

    def test_open_without_a_browser(self):
        view = subprocess.Popen([str(BIN / "quarry"), "view", self.store("cornell", 1000), "--open"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                env={k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")})
        self.addCleanup(end, view)
        self.assertTrue(view.stdout.readline().startswith("http://"))
        told = {view.stderr.readline() for _ in range(2)}  # by two threads
        self.assertIn("no browser could be opened from here; open the address by hand\n", told)

    def test_threads_of_one_processor(self):
        one = min(os.sched_getaffinity(0))
        done = self.run_program("quarry", "render", self.store("cornell", 1000), "-o", self.path("x.png"), "--size", "8x8", "--stats", self.path("s.json"),
                                preexec_fn=lambda: os.sched_setaffinity(0, {one}))
        self.assertEqual(done.returncode, 0, done.stderr)
        workers = json.loads((self.folder / "s.json").read_text())["frames"][0]["workers"]
        self.assertEqual([worker["threads"] for worker in workers], [1])

    def test_commands_that_are_programs(self):
        for command in ("preprocess", "master", "worker", "scene"):
            self.assertEqual(self.must("quarry", command, "--help").stdout, self.must("quarry-" + command, "--help").stdout)
            self.assertRegex(self.must("quarry", "--help").stdout, rf"\n  {command} +\S")
        self.must("quarry", "scene", "cornell", "--triangles", 1000, "-o", self.path("c.ply"), "--quiet")
        self.must("quarry", "preprocess", self.path("c.ply"), "-o", self.path("c.quarry"), "--quiet")
        self.must_fail(2, "^quarry: 'preproces' is not a command; did you mean preprocess", "quarry", "preproces")

    def test_sentences(self):
        model = self.write("m.obj", SQUARE)
        render = ["quarry", "render", model, "-o", self.path("x.png"), "--size", "8x8"]
        self.must(*render, "--mode", "RayCast")
        self.must_fail(2, r"'2' is one argument too many; lists of numbers have no blanks: 1,2,3", *render, "--eye", "1", "2", "3")
        path = self.write("p.json", '{"frames": [{"eye": [1, 2], "at": [0, 0, 0]}]}')
        self.must_fail(1, r"frames\[0\]\.eye: must be three numbers, like \[1, 2, 3\]$", *render, "--camera-path", path)
        for name in ("a.docx", "b"):
            (self.folder / name).write_bytes(bytes(range(256)))
            self.must_fail(1, r"PLY, OBJ, STL, OFF, glTF, GLB", "quarry-preprocess", self.path(name), "-o", self.path("s.quarry"))

    def test_warnings_of_a_kind_are_one(self):
        self.write("m.mtl", "".join(f"newmtl m{i}\nmap_Kd gone{i}.png\n" for i in range(7)))
        model = self.write("m.obj", "mtllib m.mtl\n" + SQUARE.replace("f 1", "") + "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(7)))
        done = self.must("quarry-preprocess", model, "-o", self.path("s.quarry"))
        warnings = [line for line in done.stderr.splitlines() if line.startswith("warning")]
        self.assertEqual(len([w for w in warnings if "is not there" in w]), 2, done.stderr)
        self.assertRegex(warnings[-1] if "more" in warnings[-1] else "\n".join(warnings), r"6 more warnings are like .*gone1\.png.*gone6\.png")

    def test_render_prints_its_facts_at_the_end(self):
        done = self.must("quarry", "render", self.store("cornell", 1000), "-o", self.path("x.png"), "--size", "64x48", "--spp", "2", "--mode", "raycast")
        self.assertRegex(done.stderr, r"x\.png: 64x48, raycast, 2 samples a pixel, exposure [+-]\d+\.\d\d EV\n\d+\.\d million rays, \d+\.\d million a second; "
                                      r"first pixel after \d+\.\d\d s; \d+\.\d\d s in all: start \d+\.\d\d, loading \d+\.\d\d, tracing \d+\.\d\d, writing \d+\.\d\d\n")

    def test_the_quickstart_refuses_a_model_before_it_builds(self):
        quickstart = str(pathlib.Path(__file__).parents[3] / "deploy/quickstart")
        self.write("a.docx", "none")
        self.write("empty.ply", "")
        for model, sentence in (("nosuch.ply", "is not there"), ("a.docx", "of no format that is read"), ("empty.ply", "is empty"), (".", "no file")):
            done = subprocess.run([quickstart, self.path(model)], capture_output=True, text=True, timeout=TIMEOUT_S)
            self.assertEqual((done.returncode, done.stdout), (2, ""))
            self.assertRegex(done.stderr, sentence)


if __name__ == "__main__":
    main()

"""Standard streams that are closed, full or without a reader: a log that cannot be written is lost and nothing else, output that cannot be
written is an error, and no file gets the number of a closed stream."""
import os
import pathlib
import resource
import signal
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, end, main

PROGRAMS = ("quarry", "quarry-master", "quarry-worker", "quarry-preprocess", "quarry-scene")
NAMES = {0: "standard input", 1: "standard output", 2: "standard error"}


class Streams(Case):
    def setUp(self):
        super().setUp()
        self.scene = self.store(triangles=3000)

    def run_with(self, words, closed=(), full=(), gone=(), **options):
        """Runs a program with descriptors closed, on a full disk, or on a pipe whose reader is gone: status, and the output that could be read."""
        def prepare():
            for fd in full:
                os.dup2(os.open("/dev/full", os.O_WRONLY), fd)
            for fd in gone:
                reader, writer = os.pipe()
                os.close(reader)
                os.dup2(writer, fd)
            for fd in closed:
                os.close(fd)
            if "more" in options:
                options["more"]()
        streams = {name: subprocess.PIPE for fd, name in ((1, "stdout"), (2, "stderr")) if fd not in (*closed, *full, *gone)}
        done = subprocess.run([str(BIN / words[0]), *map(str, words[1:])], stdin=subprocess.DEVNULL, timeout=TIMEOUT_S,
                              preexec_fn=prepare, close_fds=True, **streams)
        self.assertGreaterEqual(done.returncode, 0, f"{words} was ended by signal {-done.returncode}")
        return done

    def ways(self):
        yield "closed", lambda fds: {"closed": fds}
        yield "full", lambda fds: {"full": [fd for fd in fds if fd]}
        yield "without a reader", lambda fds: {"gone": [fd for fd in fds if fd]}

    def test_pictures_are_made_with_broken_or_closed_streams(self):
        self.must("quarry", "render", self.scene, "-o", self.path("right.png"), "--size", "64x48")
        right = (self.folder / "right.png").read_bytes()
        for way, options in self.ways():
            for fds in ([0], [1], [2], [0, 1, 2]):
                with self.subTest(way=way, descriptors=fds):
                    picture = self.folder / "x.png"
                    picture.unlink(missing_ok=True)
                    done = self.run_with(["quarry", "render", self.scene, "-o", picture, "--size", "64x48"], **options(fds))
                    self.assertEqual(done.returncode, 0)
                    self.assertEqual(picture.read_bytes(), right)

    def test_stores_and_scenes_too(self):
        self.must("quarry-preprocess", self.path("plant.ply"), "-o", self.path("right.quarry"))
        right = (self.folder / "right.quarry").read_bytes()
        model = (self.folder / "plant.ply").read_bytes()
        for way, options in self.ways():
            with self.subTest(way=way):
                made, copy = self.folder / "x.quarry", self.folder / "x.ply"
                for file in (made, copy):
                    file.unlink(missing_ok=True)
                self.assertEqual(self.run_with(["quarry-preprocess", self.path("plant.ply"), "-o", made], **options([0, 1, 2])).returncode, 0)
                self.assertEqual(made.read_bytes(), right)
                self.assertEqual(self.run_with(["quarry-scene", "plant", "--triangles", 3000, "-o", copy], **options([0, 1, 2])).returncode, 0)
                self.assertEqual(copy.read_bytes(), model)

    def test_a_master_and_a_worker_continue_without_their_logs(self):
        port = 9000 + os.getpid() % 20000
        for way, options in self.ways():
            with self.subTest(way=way):
                port += 1
                fds = {"closed": [], "full": [], "gone": [], **options([2])}

                def prepare():
                    for fd in fds["closed"]:
                        os.close(fd)
                    for fd in fds["full"]:
                        os.dup2(os.open("/dev/full", os.O_WRONLY), fd)
                    for fd in fds["gone"]:
                        reader, writer = os.pipe()
                        os.close(reader)
                        os.dup2(writer, fd)
                started = []
                for words in (["quarry-master", self.scene, "--listen", f"127.0.0.1:{port}"],
                              ["quarry-worker", "--master", f"127.0.0.1:{port}", "--cache", "32M"]):
                    started.append(subprocess.Popen([str(BIN / words[0]), *words[1:]], stdout=subprocess.DEVNULL, preexec_fn=prepare))
                    self.addCleanup(end, started[-1])
                give_up = time.monotonic() + 20
                while self.run_program("quarry", "status", "--master", f"127.0.0.1:{port}").returncode != 0 and time.monotonic() < give_up:
                    time.sleep(0.05)
                self.must("quarry", "render", "-o", self.path("x.png"), "--size", "64x48", "--master", f"127.0.0.1:{port}")
                for process in started:
                    self.assertIsNone(process.poll())
                    process.send_signal(signal.SIGTERM)
                    self.assertGreaterEqual(process.wait(TIMEOUT_S), 0)

    def test_answers_that_cannot_be_written_are_an_error(self):
        info = ["quarry", "info", self.scene]
        asked = [info, [*info, "--json"], [*info, "--parts"], ["quarry-preprocess", "--plan", self.path("plant.ply")], ["quarry", "bench", "--help"]]
        asked += [[program, option] for program in PROGRAMS for option in ("--help", "--version")]
        for words in asked:
            for way, options in (("full", {"full": [1]}), ("closed", {"closed": [1]})):
                with self.subTest(words=words[:3], way=way):
                    done = self.run_with(words, **options)
                    self.assertEqual(done.returncode, 1)
                    self.assertRegex(done.stderr.decode(), r"^quarry[a-z-]*: standard output cannot be written: (No space left on device|Bad file descriptor)\n$")
            with self.subTest(words=words[:3], way="head"):
                done = self.run_with(words, gone=[1])
                self.assertEqual((done.returncode, done.stderr), (0, b""))

    def test_bad_arguments_and_errors_keep_their_status(self):
        for program in PROGRAMS:
            for way, options in self.ways():
                with self.subTest(program=program, way=way):
                    self.assertEqual(self.run_with([program, "--no-such-option"], **options([0, 1, 2])).returncode, 2)
        self.assertEqual(self.run_with(["quarry", "info", "/nowhere.quarry"], full=[2]).returncode, 1)

    def test_a_limit_of_file_size_is_a_sentence(self):
        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        for words in (["quarry", "render", self.scene, "-o", self.path("y.png"), "--retry", "0"],
                      ["quarry-preprocess", self.path("plant.ply"), "-o", self.path("y.quarry")],
                      ["quarry-scene", "plant", "--triangles", 3000, "-o", self.path("y.ply")]):
            with self.subTest(program=words[0]):
                done = self.run_with(words, more=limit)
                self.assertEqual(done.returncode, 1)
                self.assertIn("File too large", done.stderr.decode())
        self.assertEqual(sorted(p.name for p in self.folder.iterdir() if p.name.startswith("y")), [])

    def test_a_refused_thread_is_a_sentence(self):
        if os.geteuid() != 0:
            self.skipTest("skipped: only root can become a user whose processes are counted alone")

        def limit():
            os.setgid(54321)
            os.setuid(54321)
            resource.setrlimit(resource.RLIMIT_NPROC, (1, 1))
        os.chmod(self.folder, 0o755)
        store = self.folder / "plant.quarry"
        done = self.run_with(["quarry-worker", "--master", "127.0.0.1:1", "--retry", "0", "--threads", "4"], more=limit)
        self.assertEqual(done.returncode, 1)
        self.assertNotIn("what()", done.stderr.decode())
        (self.folder / "out").mkdir(mode=0o777)
        os.chmod(self.folder / "out", 0o777)
        done = self.run_with(["quarry", "render", store, "-o", self.folder / "out/x.png"], more=limit)
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr.decode(), r"thread|cannot start")
        self.assertNotIn("what()", done.stderr.decode())

    def test_nohup_keeps_a_program_alive(self):
        master = subprocess.Popen([str(BIN / "quarry-master"), self.scene, "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE,
                                  stderr=subprocess.DEVNULL, preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
        self.addCleanup(end, master)
        self.assertTrue(master.stdout.readline().startswith(b"listening"))
        master.send_signal(signal.SIGHUP)
        with self.assertRaises(subprocess.TimeoutExpired):
            master.wait(0.3)

    def test_started_programs_inherit_no_ignored_signal(self):
        picture = self.path("z.png")
        render = subprocess.Popen([str(BIN / "quarry"), "render", self.scene, "-o", picture, "--spp", "4096", "--quiet"], stderr=subprocess.DEVNULL)
        self.addCleanup(end, render)
        give_up = time.monotonic() + 20
        ignored = {}
        while len(ignored) < 2 and time.monotonic() < give_up:
            for task in pathlib.Path(f"/proc/{render.pid}/task").iterdir():
                try:
                    children = (task / "children").read_text().split()
                except (FileNotFoundError, ProcessLookupError):
                    continue  # the thread has ended
                for child in children:
                    try:
                        status = pathlib.Path(f"/proc/{child}/status").read_text()
                    except (FileNotFoundError, ProcessLookupError):
                        continue  # the process has ended
                    ignored[child] = int(next(line for line in status.splitlines() if line.startswith("SigIgn")).split()[1], 16)
            time.sleep(0.02)
        self.assertEqual(set(ignored.values()), {0})


if __name__ == "__main__":
    main()

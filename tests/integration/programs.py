"""Shared by the integration tests: the programs under test, a temporary folder, and functions that run the programs."""
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest

BIN = pathlib.Path(os.environ.get("QUARRY_BIN", pathlib.Path(__file__).parents[2] / "build/release/bin"))
# For programs that were built to be slow: with sanitizers, say.
PATIENCE = float(os.environ.get("QUARRY_TEST_PATIENCE", "1"))
TIMEOUT_S = 120 * PATIENCE


class Case(unittest.TestCase):
    """A test with a folder of its own."""

    def setUp(self):
        self._folder = tempfile.TemporaryDirectory(prefix="quarry-test-")
        self.folder = pathlib.Path(self._folder.name)
        os.environ["QUARRY_CACHE_DIR"] = str(self.folder / "cache")

    def tearDown(self):
        self._folder.cleanup()

    def path(self, name):
        return str(self.folder / name)

    def run_program(self, program, *arguments, **options):
        return subprocess.run([str(BIN / program), *map(str, arguments)], capture_output=True, text=True,
                              timeout=TIMEOUT_S, errors="replace", **options)

    def must(self, program, *arguments, **options):
        done = self.run_program(program, *arguments, **options)
        self.assertEqual(done.returncode, 0, f"{program} {arguments}: {done.stderr}")
        return done

    def must_fail(self, status, sentence, program, *arguments, **options):
        """Ends with `status`; its last line is one sentence that matches; no signal, no hang."""
        done = self.run_program(program, *arguments, **options)
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        self.assertEqual(done.returncode, status, done.stderr)
        self.assertTrue(lines, "nothing on standard error")
        self.assertRegex(lines[-1], sentence)
        return done

    def store(self, kind="plant", triangles=20000, **options):
        """A store of a generated scene."""
        model, store = self.path(f"{kind}.ply"), self.path(f"{kind}.quarry")
        self.must("quarry-scene", kind, "--triangles", triangles, "-o", model, "--quiet")
        extra = [str(x) for pair in options.items() for x in ("--" + pair[0].replace("_", "-"), pair[1])]
        self.must("quarry-preprocess", model, "-o", store, "--quiet", *extra)
        return store

    def info(self, store):
        return json.loads(self.must("quarry", "info", store, "--json").stdout)

    def made_in_spite_of_kills(self, moments, *arguments):
        """The bytes of the store that quarry-preprocess makes when it is killed after each of `moments`, in seconds, and started again with --resume."""
        store = pathlib.Path(self.path("killed.quarry"))
        command = [str(BIN / "quarry-preprocess"), *map(str, arguments), "-o", str(store), "--resume", "--quiet"]
        for seconds in moments:
            run = subprocess.Popen(command, stderr=subprocess.DEVNULL)
            time.sleep(seconds)
            run.kill()
            self.assertIn(run.wait(), (0, -signal.SIGKILL))
            if store.exists():
                break
        else:
            subprocess.run(command, check=True, timeout=TIMEOUT_S)
        return store.read_bytes()

    def start_master(self, store, *arguments):
        """A master on a free port: the process and its address."""
        master = subprocess.Popen([str(BIN / "quarry-master"), store, "--listen", "127.0.0.1:0", "--quiet", *arguments],
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, master)
        match = re.match(r"listening (\S+)", master.stdout.readline())
        self.assertTrue(match, "the master does not listen")
        return master, match.group(1)

    def start_worker(self, address, *arguments):
        worker = subprocess.Popen([str(BIN / "quarry-worker"), "--master", address, *map(str, arguments)],
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, worker)
        return worker


def main():
    """Runs the file's tests. Exit status 77, which ctest reports as skipped, when some were skipped and none failed."""
    result = unittest.main(module="__main__", verbosity=2, exit=False).result
    sys.exit(1 if not result.wasSuccessful() else 77 if result.skipped else 0)


def end(process):
    """Ends a process that this test started and closes its pipes."""
    if process.poll() is None:
        process.kill()
    process.wait()
    for pipe in (process.stdout, process.stderr):
        if pipe and not pipe.closed:
            pipe.close()

"""Limits of memory, threads and files that a user or a queue of jobs sets (ulimit): all works, or one sentence names the limit to raise."""
import os
import pathlib
import resource
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, TIMEOUT_S, Case, main

VIEW = ["--mode", "whitted", "--size", "160x120", "--quiet"]


def limited(kind, most):
    return lambda: resource.setrlimit(kind, (most, most))


@unittest.skipIf(PATIENCE > 1, "sanitizers take terabytes of address space")
class Limits(Case):
    def works_or_says(self, words, kind, most, program, *arguments):
        """Status 0, or one line that names the limit; no signal, no hang. Returns whether it worked."""
        done = subprocess.run([str(BIN / program), *map(str, arguments)], capture_output=True, text=True, timeout=TIMEOUT_S / 2,
                              preexec_fn=limited(kind, most))
        told = f"{program} {arguments} with {most}: {done.returncode}\n{done.stderr}"
        if done.returncode == 0:
            return True
        self.assertIn(done.returncode, (1, 2), told)
        self.assertRegex(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "", words, told)
        self.assertNotRegex(done.stderr, r"what\(\)|terminate called|Aborted|Segmentation", told)
        return False

    def test_each_limit_of_memory_lets_it_work_or_ends_it_with_a_sentence(self):
        store = self.store("plant", 20000)
        words = r"memory|thread"
        for most in (4_000_000, 1_500_000, 300_000, 60_000):
            for program, arguments in (("quarry", ["render", store, "-o", self.path("x.png"), "--force", *VIEW]), ("quarry", ["info", store]),
                                       ("quarry-preprocess", [self.path("plant.ply"), "-o", self.path("y.quarry"), "--quiet", "--force"])):
                worked = self.works_or_says(words, resource.RLIMIT_AS, most << 10, program, *arguments)
                if most == 4_000_000:
                    self.assertTrue(worked, f"{program} within 4 GB")

    def test_threads_that_are_refused(self):
        """The limit of processes does not hold for root, so that another user runs the programs."""
        if os.geteuid() != 0:
            self.skipTest("only root can run programs as another user here")
        store = self.store("plant", 20000)
        self.folder.chmod(0o777)
        environment = dict(os.environ, HOME=str(self.folder), QUARRY_CACHE_DIR=self.path("their-cache"))

        def as_another(threads):
            def enter():
                resource.setrlimit(resource.RLIMIT_NPROC, (threads, threads))
                os.setgid(54321)
                os.setuid(54321)
            return enter

        refused = 0
        for threads in (1, 4, 8, 14):
            done = subprocess.run([str(BIN / "quarry"), "render", store, "-o", self.path(f"t{threads}.png"), "--threads", "4", *VIEW], capture_output=True,
                                  text=True, timeout=TIMEOUT_S / 2, env=environment, preexec_fn=as_another(threads))
            if done.returncode == 0:
                continue
            refused += 1
            self.assertEqual(done.returncode, 1, f"{threads}: {done.stderr}")
            self.assertRegex(done.stderr.strip().splitlines()[-1], "thread|[Rr]esource temporarily|process", f"{threads}: {done.stderr}")
            self.assertNotIn("what()", done.stderr)
        self.assertGreater(refused, 0, "the limits are small enough to be met")


if __name__ == "__main__":
    main()

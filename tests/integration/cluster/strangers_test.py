"""Attacks of strangers on a master and a worker: memory, descriptors, jobs that are too large, workers that do not answer."""
import os
import pathlib
import re
import resource
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, Case, end, main

VIEW = ["--size", "320x240", "--spp", "16", "--mode", "whitted", "--quiet"]
MIB = 1 << 20
STRANGERS = 100
WORST = "silent,preamble,claim-first,claim,claim-alive,half-job,idle,reads-nothing,mute"
AT_WORKERS = "silent,preamble,claim-first,claim,idle,reads-nothing"


def peak(process):
    """VmHWM, bytes."""
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+) kB", status).group(1)) * 1024


class Strangers(Case):
    def setUp(self):
        super().setUp()
        self.scene = self.store("plant", 200000, voxel_size="64K")

    def master(self, *arguments, files=None):
        """One that logs, with no more than so many files."""
        log = open(self.path("master.log"), "a")
        self.addCleanup(log.close)  # before the master's end: it logs to it by a descriptor of its own
        limit = (lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (files, files))) if files else None
        process = subprocess.Popen([str(BIN / "quarry-master"), self.scene, "--listen", "127.0.0.1:0", *map(str, arguments)],
                                   stdout=subprocess.PIPE, stderr=log, text=True, preexec_fn=limit)
        self.addCleanup(end, process)
        match = re.match(r"listening (\S+)", process.stdout.readline())
        self.assertTrue(match, "the master does not listen")
        return process, match.group(1)

    def log(self):
        return pathlib.Path(self.path("master.log")).read_text()

    def await_log(self, pattern, seconds):
        until = time.monotonic() + seconds
        while not re.search(pattern, self.log()):
            self.assertLess(time.monotonic(), until, self.log()[-3000:])
            time.sleep(0.1)

    def strangers(self, address, count, kinds):
        process = subprocess.Popen([str(BIN / "quarry-test-strangers"), address, str(count), kinds], stdin=subprocess.PIPE,
                                   stdout=subprocess.PIPE, text=True)
        self.addCleanup(end, process)
        self.assertEqual(process.stdout.readline(), "ready\n")
        return process

    def picture(self, name, *arguments):
        output = self.path(name + ".png")
        self.must("quarry", "render", self.scene, "-o", output, *VIEW, *arguments)
        return None if "--camera-path" in arguments else pathlib.Path(output).read_bytes()

    def free_port(self):
        import socket
        with socket.socket() as s:
            s.bind(("127.0.0.1", 0))
            return s.getsockname()[1]

    def cluster(self):
        """A master and a worker that serves others: processes, and both addresses."""
        master, address = self.master("--foresight", 0, "--frame-memory", "64M")
        at = f"127.0.0.1:{self.free_port()}"
        worker = self.start_worker(address, "--threads", 1, "--cache", "16M", "--peers", at, "--quiet")
        return master, worker, address, at

    def test_memory_holds_while_a_hundred_strangers_do_their_worst(self):
        plain = self.picture("plain", "--workers", 1, "--threads", 2)
        master, worker, address, _ = self.cluster()
        for i in range(2):
            self.assertEqual(self.picture(f"alone-{i}", "--master", address), plain)
        alone = peak(master)
        end(master)
        end(worker)
        master, worker, address, at = self.cluster()
        self.picture("first", "--master", address)
        crowd = [self.strangers(address, STRANGERS, WORST), self.strangers(at, STRANGERS, AT_WORKERS)]
        begin = time.monotonic()
        self.assertEqual(self.picture("among-strangers", "--master", address), plain)
        took = time.monotonic() - begin
        time.sleep(max(0, 12 - took))  # their attacks in the meantime count too
        self.assertIsNone(master.poll())
        self.assertIsNone(worker.poll())
        voxels = self.info(self.scene)["voxels"]
        promise = 16 * MIB + 24 * MIB + 4 * MIB + 400 * voxels
        print(f"strangers: master {alone / MIB:.1f} MiB alone, {peak(master) / MIB:.1f} among them; worker {peak(worker) / MIB:.1f} of "
              f"{promise / MIB:.1f} promised; the picture took {took:.1f} s")
        self.assertLessEqual(peak(master), alone + 16 * MIB)
        self.assertLessEqual(peak(worker), promise + 16 * MIB)
        for stranger in crowd:
            stranger.stdin.close()
        self.assertEqual(self.picture("after", "--master", address), plain)

    def test_a_process_without_descriptors_still_accepts_connections(self):
        plain = self.picture("plain", "--workers", 1)
        master, address = self.master(files=64)
        for kinds in ("idle,silent", "idle"):
            self.strangers(address, 200, kinds)
        worker = self.start_worker(address, "--threads", 1, "--quiet")
        self.assertEqual(self.picture("among-strangers", "--master", address), plain)
        self.assertIsNone(master.poll())
        self.assertIsNone(worker.poll())
        said = [line for line in self.log().splitlines() if "its limit; idle ones" in line or "cannot accept" in line]
        self.assertEqual(len(said), 1, said)

    def test_limits_of_files_are_raised(self):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 128), hard))
        self.addCleanup(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        master, address = self.master()
        worker = self.start_worker(address, "--threads", 1, "--quiet")
        time.sleep(0.3)
        for process in (master, worker):
            limits = pathlib.Path(f"/proc/{process.pid}/limits").read_text()
            self.assertRegex(limits, rf"Max open files\s+{hard}\s+{hard}")

    def test_a_picture_that_needs_too_much_memory_is_refused_and_not_kept(self):
        spool = self.path("spool")
        master, address = self.master("--frame-memory", "64M", "--spool", spool)
        self.start_worker(address, "--threads", 1, "--quiet")
        for size in ("65536x65536", "4000x3000"):
            self.must_fail(1, rf"a picture of {size} takes .*iB of the master's memory, and it has 56\.0 MiB", "quarry", "render",
                           self.scene, "-o", self.path("large.png"), "--size", size, "--master", address)
        self.assertEqual([name for name in os.listdir(spool) if name != "jobs.lock"], [])
        self.assertIsNone(master.poll())
        self.picture("small", "--master", address)
        self.must_fail(1, r"a picture of 65536x65536 takes 92\.\d GiB", "quarry", "render", self.scene, "-o", self.path("large.png"), "--size",
                       "65536x65536")

    def test_a_job_that_ends_three_masters_is_set_aside(self):
        spool = self.path("spool")
        client = None
        for attempt in range(3):
            master, address = self.master("--spool", spool)
            if not client:
                client = subprocess.Popen([str(BIN / "quarry"), "render", self.scene, "-o", self.path("x.png"), *VIEW, "--master", address],
                                          stderr=subprocess.DEVNULL)
                self.addCleanup(end, client)
            # A worker that holds the tile when the master ends, and never answers.
            mute = self.strangers(address, 1, "mute")
            until = time.monotonic() + 20
            # The first try is noted before the job; a master that is killed between the two never had the job.
            while not any((p.parent / "job").exists() and p.read_text() == f"{attempt + 1}\n" for p in pathlib.Path(spool).glob("*/tries")):
                self.assertLess(time.monotonic(), until, self.log())
                time.sleep(0.05)
            end(client)
            end(master)
            end(mute)
        master, address = self.master("--spool", spool)
        self.await_log(r"job [0-9a-f]{16} has ended 3 masters: it is set aside as \S+\.set-aside", 10)
        self.must_fail(1, r"has ended the master 3 times and was moved to \S+\.set-aside; remove that", "quarry", "render", self.scene, "-o",
                       self.path("x.png"), *VIEW, "--master", address)

    def test_a_mute_worker_is_found_out(self):
        plain = self.picture("plain", "--workers", 1)
        master, address = self.master("--foresight", 0)
        mute = subprocess.Popen([str(BIN / "quarry-test-bad-worker"), "mute", str(BIN / "quarry-worker"), "--master", address, "--threads",
                                 "8", "--quiet"], stderr=subprocess.DEVNULL)
        self.addCleanup(end, mute)
        self.await_log("has joined with 8 threads", 10)
        self.start_worker(address, "--threads", 1, "--quiet")
        self.await_log("has joined with 1 threads", 10)
        until = time.monotonic() + 60
        begin = time.monotonic()
        self.assertEqual(self.picture("with-mute", "--master", address), plain)
        first = time.monotonic() - begin
        while not re.search(r"has answered nothing for 20 s", self.log()):
            self.assertLess(time.monotonic(), until, self.log()[-2000:])
            self.picture("walk", "--master", address, "--camera-path", self.path("plant.path.json"), "--seed",
                         int(time.monotonic() * 1000) % 100000)
        print(f"strangers: beside a mute worker the first picture took {first:.1f} s; it was dropped after {time.monotonic() - begin:.1f} s")


if __name__ == "__main__":
    main()

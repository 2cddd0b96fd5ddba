"""Clusters as jobs of Slurm, by a Slurm of four nodes on this machine."""
import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, main
from tests.support.cluster import slurm_cluster


FRAMES = 8
REASON = slurm_cluster.why_not()


@unittest.skipIf(REASON, REASON)
class Slurm(Case):
    @classmethod
    def setUpClass(cls):
        import tempfile
        cls.base = tempfile.TemporaryDirectory(prefix="quarry-slurm-")
        cls.slurm = slurm_cluster.SlurmCluster(pathlib.Path(cls.base.name) / "slurm")
        cls.addClassCleanup(cls.base.cleanup)
        cls.addClassCleanup(cls.slurm.stop)
        cls.slurm.start()
        cls.shared = pathlib.Path(cls.base.name) / "shared"
        cls.shared.mkdir()
        frames = [{"eye": [6 + 0.3 * i, 6, 14], "at": [30, 30, 16], "fov": 70} for i in range(FRAMES)]
        (cls.shared / "walk.json").write_text(json.dumps({"frames": frames}))
        for command in (["quarry-scene", "plant", "--triangles", "200000", "-o", "plant.ply", "--quiet"],
                        ["quarry-preprocess", "plant.ply", "-o", "plant.quarry", "--quiet"],
                        ["quarry", "render", "plant.quarry", "-o", "local.exr", *cls.picture(), "--quiet"]):
            subprocess.run([BIN / command[0], *command[1:]], cwd=cls.shared, check=True, timeout=3 * TIMEOUT_S)

    def tearDown(self):
        """Ends the jobs and removes the folders that a failed test has left, so that no other test fails by them."""
        self.slurm.call("scancel", "--user=root")
        deadline = time.monotonic() + TIMEOUT_S / 2
        while self.slurm.call("squeue", "--noheader").stdout and time.monotonic() < deadline:
            time.sleep(0.1)
        for folder in self.shared.iterdir():
            if folder.is_dir():
                shutil.rmtree(folder)

    @staticmethod
    def picture(spp=128, path="walk.json"):
        return ["--camera-path", path, "--mode", "whitted", "--size", "320x240", "--spp", str(spp)]

    def quarry(self, *arguments, status=0):
        done = subprocess.run([BIN / "quarry", *map(str, arguments)], cwd=self.shared, env=self.slurm.environment, capture_output=True, text=True,
                              timeout=TIMEOUT_S)
        self.assertEqual(done.returncode, status, done.stderr)
        return done

    def submit(self, *arguments):
        """The job's number and the output of `quarry cluster`."""
        done = self.quarry("cluster", "--slurm", *arguments)
        match = re.search(r"^job (\d+) ", done.stdout, re.M)
        self.assertTrue(match, done.stdout + done.stderr)
        return match.group(1), done.stdout

    def refused(self, sentence, status, *arguments):
        """One sentence, and no job is left."""
        done = self.quarry("cluster", "--slurm", *arguments, status=status)
        lines = [line for line in done.stderr.splitlines() if line.strip() and not re.search(r"job \d+ (waits|starts)", line)]
        self.assertEqual(len(lines), 1, done.stderr)
        self.assertRegex(lines[0], sentence)
        self.await_end()
        self.nothing_is_left()

    def log(self, job):
        path = self.shared / f"quarry-{job}.log"
        return path.read_text(errors="replace") if path.exists() else ""

    def wait_for(self, condition, what, job):
        deadline = time.monotonic() + TIMEOUT_S / 2
        while not condition():
            self.assertLess(time.monotonic(), deadline, f"no {what}\n{self.log(job)}\n{self.slurm.call('squeue').stdout}")
            time.sleep(0.1)

    def await_end(self, job=None):
        self.wait_for(lambda: not self.slurm.call("squeue", "--noheader").stdout, "end", job)

    def start_again(self, job):
        """Starts a job in its second wait at once; Slurm itself would wait. First all nodes must be idle: a step of the last run that ends later
        would end the next run too."""
        self.wait_for(lambda: self.slurm.states(job) == ["PENDING"], "second wait", job)
        self.wait_for(self.all_idle, "idle nodes", job)
        self.slurm.call("scontrol", "update", f"jobid={job}", "StartTime=now")

    def all_idle(self):
        return self.slurm.call("sinfo", "--noheader", "--states=idle", "--format=%D").stdout.strip() == "4"

    def written(self, name):
        return sorted(p.name for p in self.shared.glob(f"{name}.*.exr"))

    def nothing_is_left(self):
        """No folder of a job, no secret, no process of the programs under test that Slurm has started."""
        self.assertEqual([p.name for p in self.shared.iterdir() if p.is_dir()], [])
        left = []
        for entry in pathlib.Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                environment, line = (entry / "environ").read_bytes(), (entry / "cmdline").read_bytes()
            except OSError:
                continue
            if f"SLURM_CONF={self.slurm.conf}".encode() in environment and re.search(rb"quarry-(master|worker)|quarry\0render", line):
                left.append(line)
        self.assertEqual(left, [])

    def must_be_the_local_pictures(self, name):
        self.assertEqual(len(self.written(name)), FRAMES)
        for i in range(FRAMES):
            self.assertEqual((self.shared / f"{name}.{i:04}.exr").read_bytes(), (self.shared / f"local.{i:04}.exr").read_bytes(), f"frame {i}")

    def test_one_of_four_nodes_dies(self):
        job, _ = self.submit("-N", 4, "--cache", "64M", "plant.quarry", "--", "-o", "killed.exr", *self.picture())
        self.wait_for(lambda: self.written("killed"), "first frame", job)
        self.slurm.kill_node("n3")
        self.assertLess(len(self.written("killed")), FRAMES, "the node died in the middle")
        try:
            self.await_end(job)
        finally:
            self.slurm.start_node("n3")
        self.assertIn("quarry.sbatch: done", self.log(job))
        self.must_be_the_local_pictures("killed")
        self.nothing_is_left()
        self.wait_for(self.all_idle, "fourth node", job)

    def test_a_requeued_job_continues(self):
        job, _ = self.submit("-N", 2, "plant.quarry", "--", "-o", "again.exr", *self.picture())
        self.wait_for(lambda: self.written("again"), "first frame", job)
        self.slurm.call("scontrol", "requeue", job)
        self.wait_for(lambda: "makes room" in self.log(job), "word of the end", job)
        self.assertLess(len(self.written("again")), FRAMES, "it was queued again in the middle")
        self.wait_for(lambda: self.slurm.states(job) == ["PENDING"], "second wait", job)
        self.assertNotIn("interrupted", (self.shared / f"quarry-{job}" / "master.log").read_text(), "the master ended well")
        secret = self.shared / f"quarry-{job}" / "secret"
        self.assertEqual(secret.stat().st_mode & 0o777, 0o600)
        self.start_again(job)
        self.await_end(job)
        log = self.log(job)
        self.assertEqual(log.count("quarry.sbatch: ready"), 2)
        self.assertIn("quarry.sbatch: done", log)
        self.must_be_the_local_pictures("again")
        self.nothing_is_left()

    def test_a_job_that_is_preempted_often_is_not_set_aside(self):
        """A master that is told to end is no victim of its job, however often that happens before a frame is done."""
        job, _ = self.submit("-N", 1, "plant.quarry", "--", "-o", "often.exr", *self.picture(2000))
        for run in range(4):
            self.wait_for(lambda: self.log(job).count("quarry.sbatch: ready") > run, "start", job)
            time.sleep(0.5)
            self.slurm.call("scontrol", "requeue", job)
            self.start_again(job)
        self.wait_for(lambda: self.log(job).count("quarry.sbatch: ready") > 4, "fifth start", job)
        self.assertNotIn("failed", self.log(job))
        self.quarry("cluster", "--stop", job)
        self.nothing_is_left()

    def test_a_requeued_job_is_cancelled_while_it_waits(self):
        job, _ = self.submit("-N", 1, "plant.quarry", "--", "-o", "waits.exr", *self.picture(200))
        self.slurm.call("scontrol", "requeue", job)
        self.wait_for(lambda: self.slurm.states(job) == ["PENDING"], "wait", job)
        self.slurm.call("scancel", job)
        self.await_end(job)
        foreign = self.shared / f"quarry-{job}_mine"
        foreign.mkdir()
        try:
            self.assertIn("its files here are removed", self.quarry("cluster", "--stop", job).stdout)
            self.assertTrue(foreign.is_dir())
        finally:
            foreign.rmdir()
        self.nothing_is_left()

    def test_a_cancelled_job_leaves_nothing(self):
        job, _ = self.submit("-N", 4, "plant.quarry", "--", "-o", "cancelled.exr", *self.picture(200))
        self.slurm.call("scancel", job)
        self.await_end(job)
        self.nothing_is_left()

    def test_a_time_limit(self):
        """The signal comes 15 s after the start, or later: Slurm looks twice a minute. The other frames are rendered after the job is queued again.
        Frames are many and cheap: even a busy machine finishes a frame before the signal, and a fast machine leaves some frames."""
        frames = json.loads((self.shared / "walk.json").read_text())["frames"] * 480
        (self.shared / "long.json").write_text(json.dumps({"frames": frames}))
        job, _ = self.submit("-N", 1, "--time", 1, "--sbatch=--signal=B:TERM@45", "plant.quarry", "--", "-o", "limit.exr", *self.picture(8, "long.json"))
        self.wait_for(lambda: "comes to its time limit" in self.log(job) or "quarry.sbatch: done" in self.log(job), "time limit", job)
        self.assertIn("comes to its time limit", self.log(job))
        self.wait_for(lambda: self.slurm.states(job) == ["PENDING"], "second wait", job)
        self.assertTrue((self.shared / f"quarry-{job}" / "spool").is_dir())
        self.quarry("cluster", "--stop", job)
        self.await_end(job)
        self.nothing_is_left()

    def test_an_array_of_four(self):
        job, _ = self.submit("-N", 1, "--array", 4, "plant.quarry", "--", "-o", "array.exr", *self.picture())
        self.await_end(job)
        self.assertEqual(len(list(self.shared.glob(f"quarry-{job}_*.log"))), 4)
        self.must_be_the_local_pictures("array")
        self.nothing_is_left()

    def test_a_cluster_that_stays(self):
        job, printed = self.submit("-N", 2, "--http", "127.0.0.1:0", "plant.quarry")
        command = re.search(r"^render: (.*)$", printed, re.M).group(1).split()
        self.assertRegex(printed, r"(?m)^live view: ssh -L (\d+):127\.0\.0\.1:\1 \S+, then open http://127\.0\.0\.1:\1/\?token=")
        self.assertNotIn("token", self.log(job))
        command[command.index("picture.png")] = "stays.exr"
        self.quarry(*command[1:], *self.picture())
        self.must_be_the_local_pictures("stays")
        self.assertIn("has ended", self.quarry("cluster", "--stop", job).stdout)
        self.nothing_is_left()
        self.assertRegex(self.quarry("cluster", "--stop", job, status=1).stderr, f"Slurm has no job {job}")

    def test_refused_jobs(self):
        picture = ("--", "-o", "no.exr", *self.picture())
        self.refused("invalid partition specified: nowhere", 1, "-N", 1, "--partition", "nowhere", "plant.quarry", *picture)
        self.refused("Slurm would never start the job \\(Partition(TimeLimit|Config)\\); it is cancelled|Slurm refuses the job: .*time limit", 1, "-N", 1, "--partition",
                     "brief", "--time", 10, "plant.quarry", *picture)
        self.refused("Slurm refuses the job: .*[Nn]ode|would never start", 1, "-N", 2, "--partition", "small", "plant.quarry", *picture)
        self.refused("Slurm refuses the job: .*[Nn]ode|would never start", 1, "-N", 9, "plant.quarry", *picture)
        self.refused("absent.quarry", 1, "-N", 1, "absent.quarry", *picture)
        self.refused("absent.json", 1, "-N", 1, "plant.quarry", "--", "-o", "no.exr", "--camera-path", "absent.json")
        self.refused("--master has no effect", 2, "-N", 1, "plant.quarry", *picture, "--master", "127.0.0.1:1")
        self.refused("no.gif", 2, "-N", 1, "plant.quarry", "--", "-o", "no.gif", *self.picture())
        readable = self.shared / "readable"
        readable.write_text("0123456789abcdef0123456789abcdef")
        readable.chmod(0o644)
        self.refused("readable.*(600|owner)", 2, "-N", 1, "--secret-file", "readable", "plant.quarry", *picture)
        readable.unlink()

    def test_names_with_spaces(self):
        folder = self.shared / "my work & co's (1)"
        folder.mkdir()
        try:
            (folder / "plant v2 (final).quarry").write_bytes((self.shared / "plant.quarry").read_bytes())
            (folder / "my walk.json").write_text((self.shared / "walk.json").read_text())
            done = subprocess.run([BIN / "quarry", "cluster", "--slurm", "-N", "1", "plant v2 (final).quarry", "--", "-o", "out 1.png", *self.picture(1, "my walk.json")],
                                  cwd=folder, env=self.slurm.environment, capture_output=True, text=True, timeout=TIMEOUT_S)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.await_end()
            self.assertIn("quarry.sbatch: done", "".join(log.read_text() for log in folder.glob("quarry-*.log")))
            self.assertEqual(len(list(folder.glob("out 1.*.png"))), FRAMES)
            self.assertEqual([p.name for p in folder.iterdir() if p.is_dir()], [])
        finally:
            shutil.rmtree(folder)
        self.nothing_is_left()

    def test_a_folder_of_another_owner(self):
        """It would have the secret of the cluster, and frames of another's."""
        done = self.quarry("cluster", "--slurm", "-N", 1, "--no-wait", "--sbatch=--hold", "plant.quarry", "--", "-o", "no.exr", *self.picture())
        job = re.search(r"^job (\d+) ", done.stdout, re.M).group(1)
        folder = self.shared / f"quarry-{job}"
        folder.mkdir()
        try:
            (folder / "master.out").write_text("")
            os.chown(folder, 65534, 65534)
            self.slurm.call("scontrol", "release", job)
            self.await_end(job)
            self.assertIn(f"quarry-{job} was made by another", self.log(job))
            self.assertEqual([p.name for p in folder.iterdir()], ["master.out"])
            self.quarry("cluster", "--stop", job, status=1)
            self.assertTrue(folder.is_dir(), "another's folder is not removed")
        finally:
            shutil.rmtree(folder)
        self.nothing_is_left()

    def test_a_store_that_the_node_lacks(self):
        """The submitting machine sees it, the node does not: the folder goes while the job waits."""
        (self.shared / "gone.quarry").write_bytes((self.shared / "plant.quarry").read_bytes())
        holder = self.slurm.call("sbatch", "--parsable", "--nodes=4", "--exclusive", "--output=/dev/null", "--wrap", "sleep 100").stdout.strip()
        self.wait_for(lambda: self.slurm.states(holder) == ["RUNNING"], "holder", None)
        waiting = subprocess.Popen([BIN / "quarry", "cluster", "--slurm", "-N", "1", "gone.quarry", "--", "-o", "gone.exr", *self.picture()],
                                   cwd=self.shared, env=self.slurm.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.wait_for(lambda: len(self.slurm.call("squeue", "--noheader", "--states=PENDING").stdout.splitlines()) == 1, "job that waits", None)
        (self.shared / "gone.quarry").unlink()
        self.slurm.call("scancel", holder)
        errors = waiting.communicate(timeout=TIMEOUT_S)[1]
        self.assertEqual(waiting.returncode, 1)
        self.assertRegex(errors.splitlines()[-1], r"^quarry: job \d+: .*gone\.quarry")
        self.await_end()
        self.nothing_is_left()

    def test_a_node_with_an_older_version(self):
        older = self.shared / "older"
        older.write_text(f"#!/bin/sh\nif [ \"$SLURMD_NODENAME\" = n2 ]; then echo quarry-worker 0.0.1; else exec {BIN}/quarry-worker \"$@\"; fi\n")
        older.chmod(0o755)
        programs = self.shared / "programs"
        programs.mkdir()
        try:
            for program in ("quarry", "quarry-master"):
                (programs / program).symlink_to(BIN / program)
            (programs / "quarry-worker").symlink_to(older)
            environment = dict(self.slurm.environment, QUARRY_BIN=str(programs))
            done = subprocess.run(["sbatch", "--parsable", "-W", "-N", "4", "--output=quarry-%j.log", slurm_script(), "plant.quarry", "-o", "older.exr",
                                   *self.picture()], cwd=self.shared, env=environment, capture_output=True, text=True, timeout=TIMEOUT_S)
            self.assertIn("failed: node n2 has Quarry 0.0.1, and this is", self.log(done.stdout.strip()))
        finally:
            for path in programs.iterdir():
                path.unlink()
            programs.rmdir()
            older.unlink()
        self.await_end()
        self.nothing_is_left()

    def test_the_printed_script_is_the_shipped_one(self):
        printed = self.quarry("cluster", "--slurm", "-N", 3, "--print", "plant.quarry", "--", "-o", "it's.exr", *self.picture()).stdout
        first, _, script = printed.partition("\n")
        self.assertRegex(first, r"^# QUARRY_BIN=\S+ sbatch --nodes=3 --export=ALL --exclusive --output=quarry-%j.log quarry.sbatch plant.quarry -o 'it'\\''s.exr' ")
        self.assertEqual(script, pathlib.Path(slurm_script()).read_text())


class WithoutSlurm(Case):
    def test_no_slurm(self):
        store = self.store("plant", 2000)
        empty = self.path("empty")
        os.mkdir(empty)
        environment = dict(os.environ, PATH=empty)
        self.must_fail(1, "there is no sbatch on this machine's PATH: is Slurm installed here", "quarry", "cluster", "--slurm", store, env=environment)
        self.must_fail(1, "there is no squeue on this machine's PATH", "quarry", "cluster", "--stop", 7, env=environment)

    def test_refused_arguments(self):
        store = self.store("plant", 2000)
        self.must_fail(2, "say where: --slurm", "quarry", "cluster", store)
        self.must_fail(2, "name a scene store", "quarry", "cluster", "--slurm")
        self.must_fail(2, "--array needs the arguments of quarry render", "quarry", "cluster", "--slurm", "--array", 2, store)
        self.must_fail(2, "--array divides the frames of a --camera-path", "quarry", "cluster", "--slurm", "--array", 2, store, "--", "-o",
                       self.path("x.png"))
        self.must_fail(2, "--http has no effect", "quarry", "cluster", "--slurm", "--http", "127.0.0.1:1", store, "--", "-o", self.path("x.png"))
        self.must_fail(2, "--stop takes the number of a job", "quarry", "cluster", "--stop", "all")
        self.must_fail(2, "--stop takes the number of a job", "quarry", "cluster", "--stop", "12_")
        for option, own in (("--job-name=x", "--job-name"), ("--jo=x", "--job-name"), ("--arr=0-3", "--array"), ("--out=x", "--output"), ("--chd=/", "--chdir"),
                            ("--w", "--wrap"), ("-Jx", "-J"), ("-HJx", "-J"), ("-sQa0-3", "-a"), ("-o", "-o")):
            self.must_fail(2, f"needs its own {own}$", "quarry", "cluster", "--slurm", f"--sbatch={option}", "--print", store)
        for option in ("--account=joJoDa", "-Ajo", "--wait", "-p", "--open-mode=append", "--comment=-J"):
            self.must("quarry", "cluster", "--slurm", f"--sbatch={option}", "--print", store)

    def test_more_jobs_than_frames(self):
        (self.folder / "walk.json").write_text(json.dumps({"frames": [{"eye": [6, 6, 14 + i], "at": [30, 30, 16]} for i in range(3)]}))
        self.must_fail(2, "--array 16: there are 3 frames to divide", "quarry", "cluster", "--slurm", "-N", 1, "--array", 16, self.store("plant", 2000), "--print",
                       "--", "-o", "w.png", "--camera-path", self.path("walk.json"))

    def test_names_with_spaces_in_the_script(self):
        folder = self.folder / "my work & co"
        folder.mkdir()
        (folder / "plant v2 (final).quarry").write_bytes(pathlib.Path(self.store("plant", 2000)).read_bytes())
        done = subprocess.run([BIN / "quarry", "cluster", "--slurm", "--print", "-N", "2", "plant v2 (final).quarry", "--", "-o", "out 1.png"], cwd=folder,
                              capture_output=True, text=True, timeout=TIMEOUT_S)
        self.assertEqual(done.returncode, 0, done.stderr)
        first, _, script = done.stdout.partition("\n")
        self.assertEqual(subprocess.run(["bash", "-n"], input=script, text=True, capture_output=True).stderr, "")
        words = shlex.split(first.removeprefix("# "))
        self.assertEqual(words[-4:], ["quarry.sbatch", "plant v2 (final).quarry", "-o", "out 1.png"])


def slurm_script():
    return str(pathlib.Path(__file__).parents[3] / "deploy/slurm/quarry.sbatch")


if __name__ == "__main__":
    main()

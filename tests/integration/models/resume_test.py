"""Runs of quarry-preprocess that end early, and runs that go on from there."""
import os
import pathlib
import random
import signal
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, main

KILLS = 20


class Resume(Case):
    """`--resume` finishes a killed run, with the same bytes, whatever the moment of the kill."""

    def setUp(self):
        super().setUp()
        self.model, self.store = self.path("plant.ply"), self.path("plant.quarry")
        self.work = pathlib.Path(self.store + ".work")

    def make(self, triangles, *, scene="plant", model=None):
        self.must("quarry-scene", scene, "--triangles", triangles, "-o", model or self.model, "--quiet")

    def start(self, *more, models=None):
        run = subprocess.Popen([str(BIN / "quarry-preprocess"), *(models or [self.model]), "-o", self.store, "--memory", "64M",
                                *map(str, more)], stderr=subprocess.PIPE, text=True)
        self.addCleanup(run.stderr.close)
        self.addCleanup(run.wait)
        self.addCleanup(run.kill)
        return run

    def wait_for(self, seen, run):
        while not seen():
            self.assertIsNone(run.poll(), "ended before it could be killed")
            time.sleep(0.002)

    def whole(self, *models):
        """The bytes that a run gives that nothing disturbs."""
        self.must("quarry-preprocess", *(models or [self.model]), "-o", self.path("whole.quarry"), "--quiet", "--threads", 2)
        return pathlib.Path(self.path("whole.quarry")).read_bytes()

    def must_be(self, whole):
        self.assertTrue(pathlib.Path(self.store).read_bytes() == whole, "other bytes than those of a run that was not killed")
        self.assertEqual([p.name for p in self.folder.iterdir() if "work" in p.name or "lock" in p.name], [])

    def test_twenty_kills(self):
        self.make(700000)
        city = self.path("city.obj")
        self.make(100000, scene="city", model=city)
        models = [city, self.model]
        began = time.monotonic()
        whole = self.whole(*models)
        usual = time.monotonic() - began
        chance = random.Random(os.environ.get("QUARRY_TEST_SEED", "7"))
        kills, went_on = 0, 0
        while True:
            run = self.start("--resume", "--checkpoint", 0.05, "--threads", 1 + kills % 2, models=models)
            try:
                # Late ones too, though the work gets less from kill to kill.
                run.wait(timeout=chance.uniform(0.02, 1.2 * usual) if kills < KILLS else 600)
            except subprocess.TimeoutExpired:
                run.kill()
                kills += 1
                run.wait()
            told = run.stderr.read()
            went_on += "continuing" in told
            if run.returncode == 0:
                self.must_be(whole)
                if kills >= KILLS:
                    break
                pathlib.Path(self.store).unlink()
            else:
                self.assertEqual(run.returncode, -signal.SIGKILL, told)
                if pathlib.Path(self.store).exists():  # all but the tidying was done
                    self.assertTrue(pathlib.Path(self.store).read_bytes() == whole)
                    pathlib.Path(self.store).unlink()
        self.assertGreater(went_on, KILLS // 4)

    def test_a_kill_in_every_phase(self):
        self.make(1200000)
        whole = self.whole()
        phases = {"import": lambda: (self.work / "import-positions").exists(),
                  "parting": lambda: (self.work / "region-0").exists(),
                  "smoothing": lambda: (self.work / "border-0").exists(),
                  "building": lambda: (self.work / "store").exists() and (self.work / "store").stat().st_size > 1000}
        for phase, seen in phases.items():
            with self.subTest(phase=phase):
                run = self.start("--quiet", "--checkpoint", 0.02)
                self.wait_for(seen, run)
                run.kill()
                run.wait()
                again = self.start("--resume")
                told = again.communicate()[1]
                self.assertEqual(again.returncode, 0, told)
                # The import is one piece of work: a run that is killed in it begins anew.
                self.assertIn("starting from the beginning" if phase == "import" else "continuing", told)
                self.must_be(whole)

    def test_a_kill_before_cleanup(self):
        """The store has its name, and the journal still names the file that has become the store."""
        self.make(1000000)
        whole = self.whole()
        run = self.start("--quiet", "--checkpoint", 0.1, "--threads", 1)
        self.wait_for(lambda: (self.work / "store").exists() and not (self.work / "region-0").exists(), run)
        run.kill()
        run.wait()
        (self.work / "store").unlink()
        pathlib.Path(self.store).write_bytes(whole)  # it gets its name when it is whole
        again = self.start("--resume")
        told = again.communicate()[1]
        self.assertEqual(again.returncode, 0, told)
        self.assertIn("starting from the beginning", told)
        self.must_be(whole)

    def test_an_interrupt_names_the_kept_files(self):
        self.make(600000)
        run = self.start("--quiet")
        self.wait_for(lambda: (self.work / "region-0").exists(), run)
        run.send_signal(signal.SIGINT)
        self.assertIn("--resume continues", run.communicate()[1])
        self.assertEqual(run.returncode, 1)
        self.assertTrue(self.work.is_dir())
        # Other options, or other models, are no part of this.
        self.must_fail(1, r"plant\.quarry\.work: was begun with \"--scale 1\", now \"--scale 2\"", "quarry-preprocess", self.model,
                       "-o", self.store, "--resume", "--scale", 2)
        os.utime(self.model, (1, 1))
        self.must_fail(1, r"plant\.ply: has changed since the run began; start again without --resume", "quarry-preprocess", self.model,
                       "-o", self.store, "--resume")
        self.make(1000, model=self.path("other.ply"))
        self.must_fail(1, "was begun with other models", "quarry-preprocess", self.path("other.ply"), "-o", self.store, "--resume")
        self.assertTrue(self.work.is_dir())
        # Without --resume all is begun anew.
        self.must("quarry-preprocess", self.model, "-o", self.store, "--quiet")
        self.must_be(self.whole())

    def test_a_changed_material_library_is_refused(self):
        """Every file that the model names counts, also one that was not there."""
        city = self.path("city.obj")
        self.make(400000, scene="city", model=city)
        with open(city) as model:
            start = model.read(4096)
        libraries = [line.split(maxsplit=1)[1] for line in start.splitlines() if line.startswith("mtllib ")]
        self.assertEqual(len(libraries), 1, start[:300])
        with open(city, "a") as model:
            model.write("mtllib missing.mtl\n")
        run = self.start("--quiet", models=[city])
        self.wait_for(lambda: (self.work / "region-0").exists(), run)
        run.kill()
        run.wait()
        command = ["quarry-preprocess", city, "-o", self.store, "--resume", "--quiet"]
        library = self.folder / libraries[0]
        then = library.stat()
        os.utime(library, (1, 1))
        self.must_fail(1, r"\.mtl: has changed since the run began; start again without --resume", *command)
        os.utime(library, ns=(then.st_atime_ns, then.st_mtime_ns))
        pathlib.Path(self.path("missing.mtl")).touch()
        self.must_fail(1, r"missing\.mtl: has changed since the run began", *command)
        pathlib.Path(self.path("missing.mtl")).unlink()
        self.must(*command)
        self.must_be(self.whole(city))

    def test_an_interrupt_with_nothing_to_keep(self):
        self.make(200000)
        run = self.start("--quiet")
        self.wait_for((self.work / "journal").exists, run)
        run.send_signal(signal.SIGTERM)
        self.assertIn("nothing was written", run.communicate()[1])
        self.assertEqual(sorted(p.name for p in self.folder.iterdir() if p.name.startswith("plant.quarry")), [])

    def test_two_outputs_of_one_name_share_a_folder_for_spill(self):
        self.make(400000)
        whole = self.whole()
        stores = [self.folder / name / "x.quarry" for name in ("a", "b")]
        runs = []
        for store in stores:
            store.parent.mkdir()
            runs.append(subprocess.Popen([str(BIN / "quarry-preprocess"), self.model, "-o", str(store), "--tmp", str(self.folder), "--quiet"]))
        for run in runs:
            self.assertEqual(run.wait(TIMEOUT_S), 0)
        for store in stores:
            self.assertTrue(store.read_bytes() == whole)
        self.assertEqual([p.name for p in self.folder.iterdir() if "work" in p.name], [])

    def test_a_journal_torn_or_damaged(self):
        self.make(600000)
        whole = self.whole()
        run = self.start("--quiet", "--threads", 1)
        self.wait_for(lambda: (self.work / "store").exists() and (self.work / "store").stat().st_size > 2000000, run)
        run.kill()
        run.wait()
        kept = {p.name: p.read_bytes() for p in self.work.iterdir()}
        journal = kept["journal"]
        command = ["quarry-preprocess", self.model, "-o", self.store, "--resume", "--quiet"]

        def lay(content):
            self.work.mkdir(exist_ok=True)
            for name, data in kept.items():
                (self.work / name).write_bytes(data)
            (self.work / "journal").write_bytes(content)

        # The last note half written; and none.
        for content in (journal + b"\0" * 100, journal + journal[:40], journal[:20], b""):
            lay(content)
            self.must(*command)
            self.must_be(whole)
        # Synchronised bytes are missing, though the files that they replace may be gone: no loss of power does that.
        for content in (journal[:-1], journal[:len(journal) // 2] + b"?" + journal[len(journal) // 2 + 1:]):
            lay(content)
            done = self.run_program(*command)
            if done.returncode == 0:
                self.must_be(whole)
            else:
                self.assertRegex(done.stderr, "start again without --resume\n$")

    def test_a_full_disk_that_gets_space_again(self):
        if os.geteuid() != 0:
            self.skipTest("needs root, to mount a small disk")
        self.make(600000)
        # Packed, its size does not tell that the disk is too small.
        subprocess.run(["gzip", "-1", self.model], check=True)
        whole = self.whole(self.model + ".gz")
        small = self.path("small")
        pathlib.Path(small).mkdir()
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=46M", "tmpfs", small], capture_output=True).returncode != 0:
            self.skipTest("tmpfs cannot be mounted here")
        try:
            command = ["quarry-preprocess", self.model + ".gz", "-o", self.store, "--tmp", small, "--quiet", "--resume"]
            self.must_fail(1, r"No space left.*--resume continues", *command)
            subprocess.run(["mount", "-o", "remount,size=200M", small], check=True)
            self.must(*command)
            self.must_be(whole)
            self.assertEqual(os.listdir(small), [])
        finally:
            subprocess.run(["umount", small], check=True)


if __name__ == "__main__":
    main()

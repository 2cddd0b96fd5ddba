"""One seeded run: a cluster behind links that can be hurt, a walk, faults, and the checks of the images and of the spool afterwards."""
import asyncio
import json
import os
import pathlib
import random
import secrets
import shutil
import time

import clock
import disk
import faults
from link import Link
from moving_viewer import MovingViewer
from processes import Program, left_over
from stage import BIN, CACHE, MODES

# Limit of a run: thrice the time of an undisturbed run, GRACE_S, and for each fault its duration and RECOVERY_S, the longest of the stated
# time-outs that may follow it (ten seconds to greet after six of silence, or a pause of five before a source is asked again).
GRACE_S, RECOVERY_S = 20, 17
START_S = 60  # until the cluster's programs listen
UNDISTURBED_S = 120  # for the undisturbed one itself
MARK = "QUARRY_CHAOS_RUN"
OUTPUT_DISK, SPOOL_DISK = "1M", "1M"
FRAMES_BEFORE_JOIN = 3  # of the undisturbed walk's last worker
VIEWER_S = 60  # after the walk, until a viewer has an exact picture
LINK_RATE = 300000  # bytes a second: slow enough that a walk takes some seconds, most of them on the way


class Run:
    """Everything of one seed. Its folder is below the stage's."""

    def __init__(self, stage, seed, able, undisturbed_s=None, watched=False):
        self.watched, self.viewer, self.token = watched, None, secrets.token_hex(32)
        self.stage, self.seed, self.undisturbed_s = stage, seed, undisturbed_s
        self.random = random.Random(seed)
        self.folder = stage.folder / f"run-{seed}"
        self.folder.mkdir()
        self.mark = f"{MARK}={os.getpid()}-{seed}-{secrets.token_hex(4)}"
        r = self.random
        self.mode = r.choice(MODES)
        self.tls = r.random() < 0.5
        self.workers = [f"worker-{i + 1}" for i in range(r.randint(2, 3))]
        self.servers = [f"server-{i + 1}" for i in range(r.randint(1, 2))]
        self.master_serves = r.random() < 0.3
        self.schedule = r.choice(("footprint", "random"))  # workers with tiles given at random lack blocks that other workers hold
        links = ["to-client", *("to-" + name for name in self.workers + self.servers), *("peers-to-" + name for name in self.workers)]
        self.faults = faults.draw(r, self.workers, self.servers, links, able)
        kinds = {fault.kind for fault in self.faults}
        self.output = disk.Disk(str(self.folder / "out"), OUTPUT_DISK) if "full-output" in kinds else None
        self.spool = disk.Disk(str(self.folder / "spool"), SPOOL_DISK) if "full-spool" in kinds else None
        for name in ("out", "spool"):
            (self.folder / name).mkdir(exist_ok=True)
        self.clock = clock.Clock(str(self.folder / "clock")) if "clock" in kinds else None
        self.programs, self.links, self.wrong, self.events = {}, {}, [], []
        # The programs' address; and the one that workers have for others, as behind a router that passes connections on.
        self.host, self.outside = (f"127.{1 + os.getpid() % 250}.{1 + n // 250 % 250}.{1 + n % 250}" for n in (2 * seed, 2 * seed + 1))

    @property
    def limit_s(self):
        if self.undisturbed_s is None:
            return UNDISTURBED_S
        return GRACE_S + 3 * self.undisturbed_s + sum(fault.for_s + RECOVERY_S for fault in self.faults)

    # --- the cluster

    def _environment(self):
        name, value = self.mark.split("=")
        environment = {**os.environ, name: value, "QUARRY_PARENT": str(os.getpid()), "QUARRY_CACHE_DIR": str(self.folder)}
        return {**environment, **self.clock.environment} if self.clock else environment

    def _security(self):
        if not self.tls:
            return []
        secret = self.folder / "secret"
        if not secret.exists():
            secret.write_text(secrets.token_hex(32))
            secret.chmod(0o600)
        return ["--secret-file", str(secret)]

    def _live(self):
        if not self.watched:
            return []
        token = self.folder / "token"
        token.write_text(self.token)
        token.chmod(0o600)
        return ["--http", f"{self.host}:9500", "--view-token-file", token]

    async def _program(self, name, program, *arguments, restart=True):
        self.programs[name] = Program(name, [str(BIN / program), *map(str, arguments), *self._security()], self.folder / f"{name}.log",
                                      self._environment(), restart)
        await self.programs[name].start()

    async def _link(self, name, port, target_port, host=None, comes_from=None, rate=LINK_RATE):
        host = host or self.host
        link = self.links[name] = Link(name, (host, port), (self.host, target_port), self.random, rate, comes_from)
        await link.open()
        return f"{host}:{port}"

    async def _listens(self, port):
        while True:
            try:
                _, writer = await asyncio.open_connection(self.host, port)
                return writer.close()
            except OSError:
                await asyncio.sleep(0.02)

    async def _start_cluster(self):
        sources = ["master"] if self.master_serves else []
        for i, name in enumerate(self.servers):
            await self._program(name, "quarry-master", self.stage.store, "--listen", f"{self.host}:{9001 + i}", "--serve-only")
            sources.append(await self._link("to-" + name, 9301 + i, 9001 + i))
        await self._program("master", "quarry-master", self.stage.store, "--listen", f"{self.host}:9000", "--spool", self.folder / "spool",
                            "--schedule", self.schedule, *(part for source in sources for part in ("--source", source)), *self._live())
        await self._listens(9000)
        if self.watched:
            self.viewer = MovingViewer(f"http://{self.host}:9500/?token={self.token}")
        for name in self.workers if self.seed else self.workers[:-1]:
            await self._start_worker(name)
        address = await self._link("to-client", 9100, 9000)
        await self._program("client", "quarry", "render", self.stage.store, *self.stage.render_options(self.mode), "-o",
                            self.folder / "out/f.png", "--master", address, *(() if self.seed else ("--stats", self.folder / "stats.json")),
                            restart=False)

    async def _start_worker(self, name):
        i = self.workers.index(name)
        # The master takes the worker to be where its connection comes from, and tells the others so: there the link to it listens.
        address = await self._link("to-" + name, 9201 + i, 9000, comes_from=self.outside)
        await self._link("peers-to-" + name, 9401 + i, 9401 + i, host=self.outside, rate=LINK_RATE if self.seed else None)
        await self._program(name, "quarry-worker", "--master", address, "--name", name, "--threads", 1, "--cache", CACHE, "--peers",
                            f"{self.host}:{9401 + i}")

    async def _join_late(self):
        """Starts the undisturbed walk's last worker late: it lacks the others' blocks, and the way to them is faster than to the voxel servers,
        so that it must ask them."""
        while len(list((self.folder / "out").iterdir())) < FRAMES_BEFORE_JOIN:
            await asyncio.sleep(0.02)
        await self._start_worker(self.workers[-1])

    # --- the walk

    async def _hurt(self):
        """Applies the faults once the client has been heard: a client that fails to connect at first ends at once."""
        while self.links["to-client"].bytes < 500:
            await asyncio.sleep(0.02)
        begin = time.monotonic()

        async def one(fault):
            await asyncio.sleep(max(0.0, fault.at_s - (time.monotonic() - begin)))
            self.events.append(f"{time.monotonic():.2f} {fault}")
            await faults.apply(self, fault)
            self.events.append(f"{time.monotonic():.2f} healed: {fault}")

        await asyncio.gather(*(one(fault) for fault in self.faults))

    async def walk(self):
        """Returns a line's worth of facts."""
        begin = time.monotonic()
        hurting = None
        try:
            try:
                await asyncio.wait_for(self._start_cluster(), START_S)
            except asyncio.TimeoutError:
                self.wrong.append(f"the cluster does not listen within {START_S} s")
                return {"seed": self.seed, "result": "wrong", "seconds": START_S, "wrong": self.wrong}
            hurting = asyncio.create_task(self._hurt() if self.seed else self._join_late())
            try:
                status = await asyncio.wait_for(self.programs["client"].process.wait(), self.limit_s)
                if status:
                    self.wrong.append(f"the client ended with {status}")
            except asyncio.TimeoutError:
                self.wrong.append(f"not done within {self.limit_s:.0f} s")
            seconds = time.monotonic() - begin
        finally:
            if hurting:
                hurting.cancel()
                for failed in await asyncio.gather(hurting, return_exceptions=True):
                    if isinstance(failed, Exception):
                        self.wrong.append(f"the harness failed: {failed!r}")
            if self.viewer and (wrong := await asyncio.to_thread(self.viewer.end, VIEWER_S)):
                self.wrong.append(wrong)
            await asyncio.sleep(0.3)  # for the master to let go of the job
            await self._end()
        self._check()
        restarts = sum(len(program.own_ends) for program in self.programs.values())
        return {"seed": self.seed, "result": "wrong" if self.wrong else "ok", "seconds": round(seconds, 2), "limit_s": round(self.limit_s),
                "mode": self.mode, "schedule": self.schedule, "tls": self.tls, "workers": len(self.workers), "servers": len(self.servers),
                "faults": [str(fault) for fault in self.faults], "met": sum("healed" not in event for event in self.events),
                "bits_flipped": sum(link.flipped for link in self.links.values()), "bytes_of_peers": self._bytes_of_peers(),
                "blocks_of_peers": self._blocks_of_peers(),
                "frames_seen": self.viewer.frames if self.viewer else None, "own_ends": restarts, "wrong": self.wrong}

    async def _end(self):
        for program in reversed(list(self.programs.values())):
            if not await program.end():
                self.wrong.append(f"{program.name} did not end within ten seconds of SIGTERM")
        for link in self.links.values():
            await link.close()

    # --- afterwards

    def _bytes_of_peers(self):
        return sum(link.bytes for name, link in self.links.items() if name.startswith("peers-to-"))

    def _blocks_of_peers(self):
        """Bytes of blocks that workers have had from each other in the undisturbed walk."""
        if not (stats := self.folder / "stats.json").exists():
            return 0
        return sum(worker["voxel_bytes_from_peer"] for worker in json.loads(stats.read_text())["frames"][-1]["workers"])

    def _check(self):
        images = {path.name: path for path in (self.folder / "out").iterdir()}
        expected = self.stage.images[self.mode]
        if sorted(images) != sorted(expected):
            self.wrong.append(f"the output holds {sorted(images)}")
        for name in images.keys() & expected.keys():
            if images[name].read_bytes() != expected[name]:
                self.wrong.append(f"{name} is not the undisturbed image")
        if left := [str(path.relative_to(self.folder)) for path in (self.folder / "spool").rglob("*") if path.name != "jobs.lock"]:
            self.wrong.append(f"left in the spool: {left}")
        if not self.seed and not self._blocks_of_peers():
            self.wrong.append("no blocks between workers")
        if left := left_over(self.mark):
            self.wrong.append(f"processes left: {left}")
        # A worker that was started amid flipped bits may take the master for a stranger, as one may whose master has changed its scene:
        # they say so and end, and are started again. No other end is in order, and a signal never.
        excused = any(fault.kind in ("flip", "older-master") for fault in self.faults)
        for program in self.programs.values():
            for status in program.own_ends:
                if status != 1 or not excused:
                    self.wrong.append(f"{program.name} ended by itself with {status}")

    def logs(self):
        parts = ["faults:\n" + "\n".join(self.events)]
        for path in sorted(self.folder.glob("*.log")):
            parts.append(f"{path.name}:\n{path.read_text(errors='replace')[-6000:]}")
        return "\n\n".join(parts)

    def clean(self, keep):
        for mounted in (self.output, self.spool):
            if mounted:
                mounted.close()
        if not keep:
            shutil.rmtree(self.folder)

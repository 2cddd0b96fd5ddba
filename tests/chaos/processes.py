"""Programs that are watched over as a service manager would: one that ends is started again."""
import asyncio
import contextlib
import os
import signal
import time

RESTART_S = 0.3  # from an end to the new start


class Program:
    """A program under faults. Faults may overlap: the program is as usual again after the last of them."""

    def __init__(self, name, command, log, environment, restart=True):
        self.name, self.command, self.log, self.environment, self.restart = name, command, log, environment, restart
        self.process = None
        self.own_ends = []  # exit statuses of ends that nobody asked for
        self._expected = False
        self._held = asyncio.Event()
        self._held.set()
        self._ended = False
        self._instead, self._holders = [], 0  # commands of faults in its place, of which the last counts; faults that keep it from starting
        self._starting = asyncio.Lock()
        self._watch = None

    async def start(self):
        await self._spawn()
        if self.restart:
            self._watch = asyncio.create_task(self._supervise())

    async def _spawn(self):
        self._expected = False
        command = self._instead[-1] if self._instead else self.command
        with open(self.log, "ab") as log:
            log.write(f"--- {self.name} starts at {time.monotonic():.2f}: {' '.join(command)}\n".encode())
            log.flush()
            self.process = await asyncio.create_subprocess_exec(*command, stdout=log, stderr=log, stdin=asyncio.subprocess.DEVNULL,
                                                                env=self.environment)

    async def _supervise(self):
        while True:
            status = await self.process.wait()
            if self._ended:
                return
            if not self._expected:
                self.own_ends.append(status)
            await asyncio.sleep(RESTART_S)
            await self._held.wait()
            async with self._starting:
                if not self._ended:
                    await self._spawn()

    def _signal(self, number):
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(number)

    def kill(self):
        self._expected = True
        self._signal(signal.SIGKILL)

    @contextlib.asynccontextmanager
    async def gone(self, command=None):
        """Killed, and not started again within; or started with another command, that ends with it."""
        if command:
            self._instead.append(command)
        else:
            self._holders += 1
        self._hold()
        self.kill()
        try:
            yield
        finally:
            if command:
                self._instead.remove(command)
                self.kill()
            else:
                self._holders -= 1
            self._hold()

    def _hold(self):
        if self._holders:
            self._held.clear()
        else:
            self._held.set()

    @contextlib.asynccontextmanager
    async def stopped(self):
        process = self.process
        self._signal(signal.SIGSTOP)
        try:
            yield
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGCONT)

    async def end(self):
        """As a person would: SIGTERM. True when it ended within ten seconds."""
        async with self._starting:
            self._ended = True
        self._held.set()
        if self.process is None:
            return True
        self._signal(signal.SIGCONT)
        self._signal(signal.SIGTERM)
        in_time = True
        try:
            await asyncio.wait_for(self.process.wait(), 10)
        except asyncio.TimeoutError:
            in_time = False
            self._signal(signal.SIGKILL)
            await self.process.wait()
        if self._watch:
            self._watch.cancel()
            await asyncio.gather(self._watch, return_exceptions=True)
        return in_time


def left_over(mark):
    """Ids of living processes whose environment holds `mark`: the processes of a run that should have ended."""
    found = []
    for entry in os.listdir("/proc"):
        if not entry.isdigit() or int(entry) == os.getpid():
            continue
        with contextlib.suppress(OSError):
            with open(f"/proc/{entry}/environ", "rb") as file:
                if mark.encode() in file.read().split(b"\0"):
                    found.append(int(entry))
    return found

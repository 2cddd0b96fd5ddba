"""Faults, drawn from a seed before a run: the same seed hurts the same programs and links at the same times, for as long."""
import asyncio
import contextlib
import dataclasses

KINDS = ("kill-worker", "stop-worker", "kill-server", "stop-server", "kill-master", "stop-master", "link-down", "trickle", "flip", "cut",
         "delay", "older-server", "older-master", "full-output", "full-spool", "clock", "mute-worker", "lying-worker")

SPREAD_S = 5  # faults begin within it: about the time of a walk


@dataclasses.dataclass
class Fault:
    kind: str
    target: str   # the program's name, or the link's
    at_s: float   # after the first is due
    for_s: float  # until it heals
    detail: float = 0  # between 0 and 1; its meaning depends on the kind

    def __str__(self):
        return f"{self.kind} {self.target} at {self.at_s:.2f} for {self.for_s:.2f}".replace("  ", " ")


def draw(random, workers, servers, links, able):
    """Some faults, in the order of their times. `able`: kinds that can be done here."""
    kinds = [kind for kind in KINDS if kind in able]
    faults = []
    if not kinds:
        return faults
    for _ in range(random.randint(1, 5)):
        kind = random.choice(kinds)
        target = {"worker": random.choice(workers), "server": random.choice(servers), "master": "master",
                  "output": "", "spool": ""}.get(kind.split("-")[-1], "" if kind == "clock" else random.choice(links))
        faults.append(Fault(kind, target, random.uniform(0, SPREAD_S), _duration(random, kind), random.random()))
    return sorted(faults, key=lambda fault: fault.at_s)


def _duration(random, kind):
    """Mostly shorter than the six seconds after which silence is death, sometimes longer."""
    if kind == "kill-worker":
        return random.uniform(0.1, 2)
    return random.choice((random.uniform(0.2, 2), random.uniform(2, 6), random.uniform(6, 11)))


async def apply(run, fault):
    """Does it, waits for as long as it lasts, and heals it; also when cancelled."""
    async with _HURT[fault.kind](run, fault):
        await asyncio.sleep(fault.for_s)


def _kill(run, fault):
    return run.programs[fault.target].gone()


def _stop(run, fault):
    return run.programs[fault.target].stopped()


def _older(run, fault):
    program = run.programs[fault.target]
    return program.gone([run.stage.older if part == run.stage.store else part for part in program.command])


def _bad(kind):
    """In the worker's place one that answers no tile, or tells lies."""
    def hurt(run, fault):
        program = run.programs[fault.target]
        return program.gone([str(run.stage.bad_worker), kind, *program.command])
    return hurt


def _down(run, fault):
    return run.links[fault.target].down(refuse=fault.detail < 0.5)


def _trickle(run, fault):
    return _with(run.links[fault.target], rate=int(500 + 20000 * fault.detail))


def _delay(run, fault):
    return _with(run.links[fault.target], delay_s=0.05 + 0.4 * fault.detail)


def _flip(run, fault):
    return _with(run.links[fault.target], flip=0.02 + 0.3 * fault.detail)


@contextlib.asynccontextmanager
async def _with(link, **values):
    for name, value in values.items():
        setattr(link, name, value)
    try:
        yield
    finally:
        for name in values:
            setattr(link, name, link.usual_rate if name == "rate" else 0)


@contextlib.asynccontextmanager
async def _cut(run, fault):
    """Again and again while it lasts."""
    async def cutting():
        while True:
            run.links[fault.target].cut()
            await asyncio.sleep(0.3 + fault.detail)
    task = asyncio.create_task(cutting())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@contextlib.asynccontextmanager
async def _clock(run, fault):
    """An hour or years, forward or back."""
    sign = 1 if fault.detail < 0.5 else -1
    run.clock.set(sign * int(10 ** (1 + 7.5 * abs(2 * fault.detail - 1))))
    try:
        yield
    finally:
        run.clock.set(0)


_HURT = {"kill-worker": _kill, "kill-server": _kill, "kill-master": _kill, "stop-worker": _stop, "stop-server": _stop, "stop-master": _stop,
         "link-down": _down, "trickle": _trickle, "delay": _delay, "flip": _flip, "cut": _cut, "older-server": _older,
         "older-master": _older, "full-output": lambda run, _: run.output.full(), "full-spool": lambda run, _: run.spool.full(),
         "clock": _clock, "mute-worker": _bad("mute"), "lying-worker": _bad("lie")}

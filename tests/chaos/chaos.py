#!/usr/bin/env python3
"""Short walks through a small scene by a cluster to which faults happen, drawn from a seed. Each must end with the images of the
undisturbed walk. Prints a JSON line a run; of one that went wrong also the logs. Exit status: 0 when all were right.
Usage: tests/chaos/run --seeds A-B [--jobs N] [--kinds KIND,...] [--textured] [--viewer] [--keep]"""
import argparse
import asyncio
import json
import pathlib
import shutil
import sys
import tempfile

import clock
import disk
import faults
from one_run import Run
from stage import Stage


def kinds_here(wanted):
    """The wanted kinds of faults that this machine can do; prints why it cannot do the others."""
    able = set(wanted)
    for kinds, why in (({"full-output", "full-spool"}, disk.why_not()), ({"clock"}, clock.why_not())):
        if why and able & kinds:
            print(f"chaos: left out: {', '.join(sorted(able & kinds))}: {why}", file=sys.stderr)
            able -= kinds
    return able


async def run_seed(stage, seed, able, keep, watched, undisturbed_s=None):
    run = Run(stage, seed, able, undisturbed_s, watched)
    try:
        result = await run.walk()
        print(json.dumps(result), flush=True)
        if run.wrong:
            again = f"tests/chaos/run --seeds {seed}{' --textured' * stage.textured}{' --viewer' * watched}"
            print(f"--- seed {seed} failed; repeat it: {again}\n{run.logs()}\n---", file=sys.stderr, flush=True)
        return result
    finally:
        run.clean(keep)


async def run_all(stage, seeds, able, jobs, keep, watched):
    # Whether its workers ask each other for enough blocks is a matter of chance.
    for _ in range(3):
        undisturbed = await run_seed(stage, 0, set(), keep, watched)
        if not undisturbed["wrong"] or not all("blocks between workers" in wrong for wrong in undisturbed["wrong"]):
            break
    if undisturbed["result"] != "ok":
        return [undisturbed]
    turn = asyncio.Semaphore(jobs)

    async def one(seed):
        async with turn:
            return await run_seed(stage, seed, able, keep, watched, undisturbed["seconds"])

    return await asyncio.gather(*(one(seed) for seed in seeds))


def seeds(text):
    ranges = [part.partition("-") for part in text.split(",")]
    numbers = [seed for first, _, last in ranges for seed in range(int(first), int(last or first) + 1)]
    if not numbers:
        raise ValueError("none")
    return numbers


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds, default="1-8", help="as 1-8 or 3,16-20")
    parser.add_argument("--jobs", type=int, default=1, help="runs at once")
    parser.add_argument("--kinds", default=",".join(faults.KINDS), help="only these faults (changes what a seed draws)")
    parser.add_argument("--textured", action="store_true", help="a scene with textures and cut-outs instead of the plant")
    parser.add_argument("--viewer", action="store_true", help="a viewer moves meanwhile, and must get an exact picture at the end")
    parser.add_argument("--keep", action="store_true", help="keep each run's folder")
    a = parser.parse_args()
    if unknown := set(a.kinds.split(",")) - set(faults.KINDS):
        parser.error(f"no such fault: {', '.join(sorted(unknown))}; there are {', '.join(faults.KINDS)}")
    folder = pathlib.Path(tempfile.mkdtemp(prefix="quarry-chaos-"))
    try:
        able = kinds_here(a.kinds.split(","))
        results = asyncio.run(run_all(Stage(folder, a.textured), a.seeds, able, a.jobs, a.keep, a.viewer))
    finally:
        if a.keep:
            print(f"chaos: kept {folder}", file=sys.stderr)
        else:
            shutil.rmtree(folder)
    bad = [result["seed"] for result in results if result["result"] != "ok"]
    slowest = max(results, key=lambda result: result["seconds"])
    print(f"chaos: {len(results) - len(bad)} of {len(results)} runs were right, the slowest after {slowest['seconds']} s "
          f"(seed {slowest['seed']})" + (f"; wrong: {bad}" if bad else ""), file=sys.stderr)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

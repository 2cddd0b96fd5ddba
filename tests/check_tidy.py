#!/usr/bin/env python3
"""Runs clang-tidy (.clang-tidy) over sources, and the headers that they include. Usage: check_tidy.py ROOT BUILD [FOLDER...]
Without FOLDER: the folders of programs that run in a cluster, as all folders would take a test too long."""
import concurrent.futures
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

FOLDERS = ("common", "master", "worker")
SKIPPED = 77  # as tests/CMakeLists.txt says to ctest


def separate_commands(build, folder):
    """Writes `build`'s compile_commands.json to `folder`, with an entry for each file of a unit of several (QUARRY_UNITY): each file is
    checked alone, so that it must include all that it uses."""
    entries = []
    for entry in json.loads((pathlib.Path(build) / "compile_commands.json").read_text()):
        unit = pathlib.Path(entry["file"])
        if "Unity" not in unit.parts:
            entries.append(entry)
            continue
        for source in re.findall(r'^#include "(.*)"', unit.read_text(), re.M):
            entries.append({**entry, "file": source, "command": entry["command"].replace(str(unit), source)})
    (pathlib.Path(folder) / "compile_commands.json").write_text(json.dumps(entries))


def faults(build, source):
    """clang-tidy's findings in a source and in the project's headers that it includes; empty: none."""
    # Pragmas of g++ are no faults.
    done = subprocess.run(["clang-tidy", "-p", build, "--quiet", "--extra-arg=-Wno-unknown-pragmas", "--extra-arg=-Wno-unknown-warning-option", source],
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return "" if done.returncode == 0 else done.stdout or done.stderr


def main():
    root, build, folders = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3:] or FOLDERS
    if shutil.which("clang-tidy") is None:
        print("skipped: there is no clang-tidy; deploy/install --tests installs it")
        return SKIPPED
    sources = [path for folder in folders for path in (root / folder).rglob("*.cpp")]
    # The dearest first, so that no processor ends long after the others: kernels, then by size.
    sources.sort(key=lambda path: ("kernels" not in path.name, -path.stat().st_size))
    with tempfile.TemporaryDirectory() as commands, concurrent.futures.ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        separate_commands(build, commands)
        found = [text for text in pool.map(lambda source: faults(commands, source), sources) if text]
    print("\n".join(found) or f"{len(sources)} sources without a fault")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

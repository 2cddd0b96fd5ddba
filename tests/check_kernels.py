#!/usr/bin/env python3
"""Checks that kernels compiled for one instruction set share no code with the rest of the program: the linker keeps one of
several copies of an inline function, and must never choose one that this processor cannot run.
Usage: check_kernels.py LIBRARY..."""
import re
import subprocess
import sys

OBJECTS = {"avx512.cpp.o": r"N_AVX3", "avx2.cpp.o": r"N_AVX2"}
faults = []
for library in sys.argv[1:]:
    seen = set()
    member = ""
    for line in subprocess.run(["nm", "-C", "--defined-only", library], check=True, capture_output=True, text=True).stdout.splitlines():
        if line.endswith(".o:"):
            member = line[:-1].rsplit("_", 1)[-1]
        match = re.match(r"[0-9a-f]+ [WVu] (.*)", line)
        if match and member in OBJECTS:
            seen.add(member)
            if not re.search(OBJECTS[member], match.group(1)):
                faults.append(f"{library}: {member} shares {match.group(1)}")
    if seen != set(OBJECTS):
        faults.append(f"{library}: expected kernels in {sorted(OBJECTS)}, found {sorted(seen)}")
print("\n".join(faults[:20]))
sys.exit(1 if faults else 0)

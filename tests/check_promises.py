"""Checks that the tests which tests/PROMISES.md names for each promise exist. Usage: tests/check_promises.py ROOT"""
import pathlib
import re
import sys

tests = pathlib.Path(sys.argv[1]) / "tests"
table = (tests / "PROMISES.md").read_text()
missing, named = [], 0
for row in re.findall(r"^\| (.*) \| (.*) \|$", table, re.M)[1:]:
    for part in row[1].split("; "):
        name, _, cases = part.partition(": ")
        path = tests / name
        text = path.read_text() if path.is_file() else ""
        # A comma separates names of Python's tests; a name of Catch2's may hold commas.
        for case in cases.split(", ") if name.endswith("_test.py") else [cases]:
            named += 1
            # Catch2's names may be broken over lines.
            if not case or case not in re.sub(r'"\s*\n\s*"', "", text):
                missing.append(f"{name}: {case}")
print("\n".join(missing) or f"{named} tests of promises are there")
sys.exit(1 if missing or named < 40 else 0)

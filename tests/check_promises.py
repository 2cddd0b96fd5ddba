"""The tests that tests/README.md names for each promise are there. Usage: tests/check_promises.py ROOT"""
import pathlib
import re
import sys

tests = pathlib.Path(sys.argv[1]) / "tests"
table = (tests / "README.md").read_text().split("## Promises and their tests", 1)[1]
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

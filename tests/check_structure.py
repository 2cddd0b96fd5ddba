#!/usr/bin/env python3
"""Checks sizes: lines of a file, subjects of a folder, lines of a function. Usage: check_structure.py ROOT"""
import pathlib
import re
import sys

FOLDERS = ("common", "preprocess", "worker", "master", "scenes", "deploy")
TESTS = "tests"             # only its folders' subjects are counted
FILE_LINES = 400            # or a reason at the top: "Long: ..."
FOLDER_SUBJECTS = 16        # a header with its source is one; among tests so is a script
FUNCTION_LINES = 100
FUNCTION_LINES_P99 = 45
SOURCES = {".h", ".cpp", ".cu", ".cuh"}
SCRIPTS = {".py", ".mjs", ""}
NO_FUNCTION = re.compile(r"(namespace|class|struct|enum|union|extern|switch|if|for|while|else|do|case|template <[^(]*> (class|struct))\b")


ONE_LINE = re.compile(r" {0,4}(?!if|for|while|return|const auto|auto|//|else|case)[\w:<>~\[\]].*\).*\{.*\}$")


def signature_start(lines, number):
    """The first line of the statement that ends with line `number`."""
    while number > 0:
        before = lines[number - 1].strip()
        if not before or before.startswith(("//", "#")) or before.endswith((";", "{", "}", "public:", "private:", "protected:")):
            break
        number -= 1
    return number


def functions(lines):
    """(first line, lines) of each function, laid out as clang-format does."""
    number = 0
    while number < len(lines):
        end = None
        if lines[number].rstrip().endswith("{") and not lines[number].lstrip().startswith("//"):
            start = signature_start(lines, number)
            signature = " ".join(line.strip() for line in lines[start:number + 1])
            indent = re.match(" *", lines[start]).group()
            if "(" in signature and not NO_FUNCTION.match(signature) and "=" not in signature.split("(")[0].replace("operator=", ""):
                end = next((n for n in range(number + 1, len(lines)) if re.match(indent + "}", lines[n])), None)
        if end is not None:
            yield start + 1, end - start + 1
            number = end
        elif ONE_LINE.match(lines[number]):
            yield number + 1, 1
        number += 1


def main():
    root = pathlib.Path(sys.argv[1])
    faults, lengths = [], []
    for folder in (*FOLDERS, TESTS):
        counted = SOURCES | SCRIPTS if folder == TESTS else SOURCES
        for place in [root / folder, *sorted(p for p in (root / folder).rglob("*") if p.is_dir())]:
            subjects = {p.stem for p in place.iterdir() if p.suffix in counted and p.is_file()}
            if len(subjects) > FOLDER_SUBJECTS:
                faults.append(f"{place.relative_to(root)}: {len(subjects)} subjects, more than {FOLDER_SUBJECTS}")
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in SOURCES:
                continue
            name, lines = path.relative_to(root), path.read_text().split("\n")
            if len(lines) - 1 > FILE_LINES and not any(re.match(r"// Long: \S", line) for line in lines[:12]):
                faults.append(f"{name}: {len(lines) - 1} lines, more than {FILE_LINES}, without a reason ('// Long: ...') at its top")
            for first, count in functions(lines):
                lengths.append(count)
                if count > FUNCTION_LINES:
                    faults.append(f"{name}:{first}: a function of {count} lines, more than {FUNCTION_LINES}")
    lengths.sort()
    median, p99 = lengths[len(lengths) // 2], lengths[len(lengths) * 99 // 100]
    if p99 > FUNCTION_LINES_P99:
        faults.append(f"functions: one in a hundred has more than {p99} lines; {FUNCTION_LINES_P99} is the limit")
    print("\n".join(faults) if faults else
          f"{len(lengths)} functions: median {median}, p99 {p99}, longest {lengths[-1]} lines")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())

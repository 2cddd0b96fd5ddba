#!/usr/bin/env python3
"""Checks the words of comments: roundabout ones are rare. Usage: check_words.py ROOT [--list FOLDER]
Counts "what", "who" and "those who|that|which|of", and once more each comment that begins with What or Who, in comments of C++, Python, JavaScript,
CMake and shell. --list shows where they are in a folder."""
import collections
import io
import pathlib
import re
import sys
import tokenize

FOLDERS = ("common", "preprocess", "worker", "master", "scenes", "deploy", "tests")
LEAST_WORDS = 2000   # in a smaller folder a word more or less decides
MOST = 2             # of a thousand words
WORD = re.compile(r"[A-Za-z']+")
ROUNDABOUT = re.compile(r"\bwhat\b|\bwho\b|\bthose (?:that|which|of)\b", re.IGNORECASE)
BEGINNING = re.compile(r"\s*(?:what|who)\b", re.IGNORECASE)
C_COMMENT = re.compile(r'"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])+\'|//[^\n]*|/\*.*?\*/', re.DOTALL)
SHELL_COMMENT = re.compile(r"(?:^|(?<=\s))#(?!!)[^\n]*")


def python_comments(text):
    """Comments and docstrings."""
    try:
        tokens = list(tokenize.generate_tokens(io.StringIO(text).readline))
    except (tokenize.TokenError, SyntaxError):
        return
    fresh = True
    for token in tokens:
        if token.type == tokenize.COMMENT and not token.string.startswith("#!"):
            yield token.start[0], token.string.lstrip("# ")
        elif token.type == tokenize.STRING and fresh:
            yield token.start[0], token.string.strip("\"'rbf")
        if token.type not in (tokenize.COMMENT, tokenize.NL):
            fresh = token.type in (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENCODING)


def matched_comments(pattern, text):
    for match in pattern.finditer(text):
        if match[0][0] not in "\"'":
            yield text.count("\n", 0, match.start()) + 1, match[0].strip("/*#!< \n")


def comments(path):
    """Lines and texts; comments on lines that follow each other are one."""
    text = path.read_text(errors="replace")
    script = text.startswith("#!") and "python" in text.split("\n", 1)[0]
    if path.suffix == ".py" or script:
        found = python_comments(text)
    elif path.suffix in (".h", ".cpp", ".cu", ".js", ".mjs", ".css"):
        found = matched_comments(C_COMMENT, text)
    elif path.name == "CMakeLists.txt" or path.suffix in (".cmake", ".sh") or text.startswith("#!"):
        found = matched_comments(SHELL_COMMENT, text)
    else:
        return
    joined = None
    for line, comment in found:
        if joined and line == joined[1] + 1:
            joined = (joined[0], line, joined[2] + " " + comment)
            continue
        if joined:
            yield joined[0], joined[2]
        joined = (line, line + comment.count("\n"), comment)
    if joined:
        yield joined[0], joined[2]


def count(path):
    words, places = 0, []
    for line, comment in comments(path):
        words += len(WORD.findall(comment))
        faults = len(ROUNDABOUT.findall(comment)) + bool(BEGINNING.match(comment))
        if faults:
            places.append((line, faults, " ".join(comment.split())))
    return words, places


def main():
    root = pathlib.Path(sys.argv[1])
    listed = sys.argv[3] if len(sys.argv) > 3 else None
    folders = collections.defaultdict(lambda: [0, 0])
    for top in FOLDERS:
        for path in sorted((root / top).rglob("*")):
            if not path.is_file() or path.suffix in (".exr", ".png", ".jpg", ".md"):
                continue
            words, places = count(path)
            folder = str(path.parent.relative_to(root))
            folders[folder][0] += words
            folders[folder][1] += sum(faults for _, faults, _ in places)
            if listed == folder:
                for line, _, comment in places:
                    print(f"{path.relative_to(root)}:{line}: {comment}")
    if listed:
        return
    bad = [(folder, words, faults) for folder, (words, faults) in sorted(folders.items()) if words >= LEAST_WORDS and faults * 1000 > MOST * words]
    for folder, words, faults in bad:
        print(f"{folder}: {faults} roundabout words among {words} of comments, {1000 * faults / words:.1f} in 1,000, more than {MOST}")
    if bad:
        sys.exit(1)
    print(f"comments of {sum(words >= LEAST_WORDS for words, _ in folders.values())} folders have at most {MOST} roundabout words in 1,000")


if __name__ == "__main__":
    main()

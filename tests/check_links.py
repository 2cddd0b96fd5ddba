#!/usr/bin/env python3
"""Checks that relative links of Markdown pages lead to files, and their anchors to headings. Usage: check_links.py ROOT"""
import functools
import os
import pathlib
import re
import sys
import urllib.parse

# Folders that no page of the project lies in: builds, and packages of other projects.
SKIPPED = re.compile(r"build|node_modules|\.")
FENCE = re.compile(r"^ *(```|~~~).*?^ *\1", re.M | re.S)
CODE = re.compile(r"(`+)(?!`).*?(?<!`)\1(?!`)", re.S)
COMMENT = re.compile(r"<!--.*?-->", re.S)
INLINE = re.compile(r"\]\(\s*(?:<([^>]*)>|([^\s()]*(?:\([^\s()]*\)[^\s()]*)*))(?:\s+(?:\"[^\"]*\"|'[^']*'))?\s*\)")
REFERENCE = re.compile(r"^ {0,3}\[[^\]^][^\]]*\]:\s+<?([^\s>]+)", re.M)
HTML = re.compile(r"<(?:a|img|source)\b[^>]*?\b(?:href|src|srcset)=\"([^\"]*)\"")
SCHEME = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]*:|//")
HEADING = re.compile(r"^ {0,3}#{1,6}[ \t]+(.*?)(?:[ \t]+#+)?[ \t]*$", re.M)
OWN_ANCHOR = re.compile(r"<[a-z]+\b[^>]*?\b(?:id|name)=\"([^\"]+)\"")


def pages(root):
    for folder, folders, files in os.walk(root):
        folders[:] = sorted(name for name in folders if not SKIPPED.match(name))
        yield from (pathlib.Path(folder, name) for name in sorted(files) if name.endswith(".md"))


def blank(match):
    """Nothing, but for the line ends, so that lines keep their numbers."""
    return "\n" * match.group().count("\n")


@functools.cache
def text_of(page):
    """The page without blocks of code and comments."""
    return COMMENT.sub(blank, FENCE.sub(blank, page.read_text()))


@functools.cache
def anchors(page):
    """The anchors that GitHub gives a page's headings, and the page's own."""
    found, seen = set(OWN_ANCHOR.findall(text_of(page))), {}
    for heading in HEADING.findall(text_of(page)):
        shown = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        name = re.sub(r"[^\w\- ]", "", shown.strip().lower()).replace(" ", "-")
        times = seen[name] = seen.get(name, -1) + 1
        found.add(f"{name}-{times}" if times else name)
    return found


def links(page):
    """(line, target) of each link of the page."""
    text = CODE.sub(blank, text_of(page))
    for pattern in (INLINE, REFERENCE, HTML):
        for match in pattern.finditer(text):
            yield text.count("\n", 0, match.start()) + 1, next((g for g in match.groups() if g), "")


def fault(root, page, target):
    """The sentence about a link that leads nowhere, or None."""
    path, _, anchor = target.partition("#")
    place = page
    if path:
        path = urllib.parse.unquote(path)
        place = root / path.lstrip("/") if path.startswith("/") else page.parent / path
    place = pathlib.Path(os.path.normpath(place))
    if not place.is_relative_to(root):
        return f"{target} leads out of the project"
    if not place.exists():
        return f"{target} leads to no file"
    if anchor and place.suffix == ".md" and urllib.parse.unquote(anchor) not in anchors(place):
        return f"{target}: {place.relative_to(root)} has no heading of that anchor"
    return None


def main():
    root = pathlib.Path(sys.argv[1]).resolve()
    checked, faults = 0, []
    for page in pages(root):
        for line, target in links(page):
            if SCHEME.match(target):
                continue
            checked += 1
            if why := fault(root, page, target):
                faults.append(f"{page.relative_to(root)}:{line}: {why}")
    print("\n".join(faults) or f"{checked} links lead somewhere")
    return 1 if faults or checked < 20 else 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""Checks that no class has too many methods. Usage: check_classes.py ROOT [--list]
A method is a function that a class declares, constructors included, defaulted and deleted functions excluded. With --list: prints every
class with more than half of the methods allowed."""
import pathlib
import re
import sys

FOLDERS = ("common", "preprocess", "worker", "master", "scenes", "deploy")
SOURCES = {".h", ".cpp", ".cu", ".cuh"}
METHODS = 32
# Other limits, of classes in files under a path; of several paths the longest counts.
LIMITS = {"common/engine/": 25}
# Lane types have a method for each operation of a lane.
LANE_TYPES = {"common/kdtree/lane.h": "ScalarLane", "common/kdtree/simd_lane.h": "SimdLanes"}

COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/|R\"(\w*)\(.*?\)\1\"|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])'", re.S)
OPERATOR = re.compile(r"\boperator\s*(\(\)|\[\]|[-+*/%^&|~!=<>,]+|\s(new|delete)(\[\])?)")
HEAD = re.compile(r"\b(?:class|struct|union)\b(?P<rest>[^;{}()=]*(?:\([^{};()]*\)[^;{}()=]*)*)\{")
NAME = re.compile(r"((?:\w+::)*\w+)\s*(?:final\s*)?(?::(?!:).*)?$", re.S)
NO_METHOD = re.compile(r"(?:using|typedef|friend|static_assert|enum|class|struct|union|return|if|for|while|switch|else|do)\b")


def plain(text):
    """Code without comments, texts, preprocessor lines, attributes, and with operators as names."""
    text = re.sub(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", "", text, flags=re.M)
    text = COMMENT.sub(" ", text)
    text = re.sub(r"\[\[.*?\]\]|\balignas\s*\([^()]*\)|\b__attribute__\s*\(\(.*?\)\)", " ", text, flags=re.S)
    return OPERATOR.sub("operator_", text).replace("->", " ")


def body_end(text, start):
    """Where the bracket that opens at `start` closes."""
    depth = 0
    for place in range(start, len(text)):
        depth += (text[place] == "{") - (text[place] == "}")
        if depth == 0:
            return place
    return len(text)


def without_angles(statement):
    """Without the arguments of templates, innermost first."""
    before = None
    while before != statement:
        before, statement = statement, re.sub(r"<[^<>;{}]*>", " ", statement)
    return statement


def is_method(statement):
    statement = re.sub(r"\b(?:public|protected|private)\s*:(?!:)", " ", statement)
    statement = re.sub(r"\btemplate\b|\brequires\b", " ", without_angles(statement)).strip()
    if not statement or NO_METHOD.match(statement) or re.search(r"=\s*(?:default|delete)\s*$", statement):
        return False
    return "(" in statement.split("=")[0] and not re.match(r"[^(]*\(\s*[*&]", statement)


def methods(body):
    """How many functions the body of a class declares. A body inside it ends the declaration in front of it."""
    count, start, place, depth = 0, 0, 0, 0
    while place < len(body):
        sign = body[place]
        depth += (sign == "(") - (sign == ")")
        if sign == ";" and depth == 0:
            count += is_method(body[start:place])
            start = place + 1
        elif sign == "{":
            end = body_end(body, place)
            after = body[end + 1:].lstrip()[:1]
            # The body of a function, unless an initializer goes on.
            if depth == 0 and after not in {",", ";", "{"}:
                count += is_method(body[start:place])
                start = end + 1
            else:
                body = body[:place] + " " * (end + 1 - place) + body[end + 1:]
            place = end
        place += 1
    return count


def classes(text):
    """(name, methods) of each class in a file, classes inside others included."""
    text = plain(text)
    for match in HEAD.finditer(text):
        if re.search(r"\benum\s*$", text[:match.start()]):
            continue
        name = NAME.search(without_angles(match["rest"]).strip())
        if name:
            yield name[1], methods(text[match.end():body_end(text, match.end() - 1)])


# Pieces of code, and the methods of the classes in them.
EXAMPLES = {
    "struct A { int a = f(); std::function<void(int)> b; void (*c)(int); };": [0],
    "class A { public: A(); ~A() = default; A(const A&) = delete; void F(int) const { if (x) { y(); } } };": [2],
    "class A final : public B<C()> { int F(int a = {}) { return g({1}); } int b{3}; static int G(); };": [2],
    "class A { explicit A(int b) : b_(b), c_{b} {} template <class T> requires (C<T>) T F(T); enum class E { kA }; };": [2],
    "struct A { bool operator==(const A&) const = default; bool operator<(A) const; A& operator=(A b) { return *this; } };": [2],
    "struct A { struct B { void F(); void G() {} }; B b; // void H();\n using C = int(int); };": [0, 2],
    "class A::B { [[nodiscard]] Result<std::vector<int>> F(const char* a = \"};\"); auto G() const -> int; };": [2],
    "enum class A { kB }; class C; template <class T> struct D<T*> { T F(); };": [1],
}


def self_test():
    for code, expected in EXAMPLES.items():
        found = [count for _, count in classes(code)]
        assert found == expected, f"{code}: {found} methods, not {expected}"
    limits = {"a/": 25, "a/b/": 7}
    assert [limit_of(name, limits) for name in ("a/x.h", "a/b/x.h", "c/x.h")] == [25, 7, METHODS]


def limit_of(name, limits):
    fitting = [path for path in limits if name.startswith(path)]
    return limits[max(fitting, key=len)] if fitting else METHODS


def main():
    self_test()
    root = pathlib.Path(sys.argv[1])
    faults, most = [], (0, "")
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in SOURCES:
                continue
            name = path.relative_to(root).as_posix()
            for title, count in classes(path.read_text()):
                if LANE_TYPES.get(name) == title:
                    continue
                limit = limit_of(name, LIMITS)
                if "--list" in sys.argv and 2 * count > limit:
                    print(f"{count:4} {name}: {title}")
                if count > limit:
                    faults.append(f"{name}: {title} has {count} methods, more than {limit}")
                most = max(most, (count, title))
    print("\n".join(faults) if faults else f"classes have at most {most[0]} methods ({most[1]})")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())

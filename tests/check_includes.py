#!/usr/bin/env python3
"""Checks that includes point only the ways that the architecture allows. Usage: check_includes.py ROOT"""
import pathlib
import re
import sys

MAY_INCLUDE = {
    "common": {"common"},
    "preprocess": {"common", "preprocess"},
    "worker": {"common", "worker"},
    "master": {"common", "master"},
    "scenes": {"common", "scenes"},
    "deploy": {"common", "deploy"},
    "tests": {"common", "preprocess", "worker", "master", "scenes", "deploy", "tests"},
}
# Inside folders: includes that files under a path must not have, and the reasons.
MUST_NOT = [
    ("common/kdtree/", r"boost/|openssl/|cuda|common/net/|common/protocol/", "kernels use no network and no CUDA header"),
    ("(?!common/kdtree/gpu/|tests/)", r"common/kdtree/gpu/", "no program renders on a GPU yet: only tests and benches include its kernels"),
    ("common/kdtree/build/", r"common/kdtree/(trace/|kernels)", "building a tree needs no kernel"),
    ("common/math/", r"boost/|common/(net|protocol|voxel)/", "mathematics stands alone"),
    ("common/protocol/", r"boost/|common/kdtree/|common/net/", "the protocol is bytes only"),
    ("(?!common/api/|deploy/command/rays/|tests/)", r"common/api/", "programs of Quarry's own use the engine; rays are asked for by quarry.h"),
    ("common/api/", r"common/(net|http|protocol|program|command_line)/|CLI/|boost/", "the library links what the engine and stores on servers need, and no more"),
    ("common/engine/", r"common/net/|openssl/|boost/beast", "the engine uses no socket"),
    ("common/engine/rays/", r"common/scene/|common/engine/(?!rays/|blocks/)", "rays use no camera, no material and no pixel"),
    ("common/engine/sources/", r"common/engine/(surfaces|integrators|film|blocks)/", "sources only make rays"),
    ("common/engine/surfaces/", r"common/engine/(sources|integrators|film)/", "surfaces do not depend on their users"),
    ("common/engine/film/", r"common/engine/(rays|sources|integrators)/", "the film only keeps results"),
    ("common/engine/(surfaces|integrators)/", r"common/protocol/|common/engine/(engine|renderer|blocks/(loader|voxel_cache))", "shading uses no blocks that are being loaded"),
    ("common/http/", r"common/(?!(base|http|net)/)", "the server does not depend on its content"),
    ("common/remote/", r"common/(?!(base|remote|voxel)/)", "reading files on servers needs neither protocol nor renderer"),
    ("common/(base|scene|voxel|protocol|net|kdtree|math)/", r"common/engine/", "only renderers include the engine"),
    ("worker/sources/", r"worker/[a-z_]+\.h", "sources do not depend on the session"),
    ("master/pictures/", r"boost/|common/net/|master/(?!pictures/)", "pictures use no sockets and do not depend on their users"),
    ("master/schedule/", r"boost/|common/net/|master/(?!(pictures|schedule)/)|master/pictures/image_output", "the schedule is pure: no sockets, no files, no jobs, no viewer"),
    ("master/jobs/", r"master/display/", "jobs do not depend on viewers"),
    ("master/display/(live_picture|view_pacer|picker|viewer_message|live_stats|welcome)", r"common/http/http|common/net/|boost/", "decisions about a viewer's picture use no sockets"),
    ("preprocess/(build_stage|import_stage|estimate/)", r"preprocess/preprocess\.h", "stages do not depend on the run"),
    ("preprocess/import/", r"preprocess/(ingest|spill|partition|estimate|texture)/", "importers depend only on their sink"),
    ("preprocess/spill/", r"preprocess/(ingest|partition|smooth|estimate|texture)/", "spilling does not depend on its users"),
    ("preprocess/partition/", r"preprocess/(import|ingest|smooth|estimate|texture)/", "partitioning starts from spilled triangles"),
    ("preprocess/smooth/", r"preprocess/(import|ingest|estimate|texture)/", "smoothing starts from spilled triangles"),
    ("(?!tests/)", r"embree", "only tests link Embree"),
    ("common/", r"OpenImageIO|assimp|draco/|meshoptimizer|\.hxx", "large libraries stay out of the code that all programs share"),
    ("worker/", r"OpenImageIO|assimp|draco/|meshoptimizer|\.hxx", "large libraries stay out of the worker"),
    ("(?!preprocess/import/cad/open_cascade/|tests/integration/models/cad_)", r"\.hxx", "only quarry-import-cad and its test link Open CASCADE"),
    ("tests/support/", r"tests/(?!support/)", "shared code of tests does not depend on single folders"),
    ("tests/bench/", r"tests/(unit|reference|golden|integration|laboratory/(?!variants/))", "programs that measure need no test"),
    ("tests/laboratory/structures/", r"tests/laboratory/(variants|gpu|machine|tables|page)/", "structures do not depend on their runners"),
    ("tests/laboratory/(variants|gpu|machine)/", r"tests/laboratory/(tables|page)/", "measured code does not depend on the tables"),
]
# Asio, Beast and OpenImageIO take seconds a file: they stay out of headers altogether.
HEAVY = re.compile(r"boost/asio|boost/beast|boost/process|OpenImageIO|nlohmann/json\.hpp|flatbuffers|CLI/")
# Calls that throw, or lose their text in silence, when standard output or error cannot be written.
UNCHECKED = re.compile(r"fmt::print\(|std::(cout|cerr|clog|puts)\b")
# But for the one stream that Beast's HTTP and WebSockets are made with: two files include it.
MAY_BE_HEAVY = {"common/http/served_stream.h"}
# Names that files under a path must not use, and the reasons.
MUST_NOT_SAY = [
    ("common/engine/(rays|sources|surfaces|film)/", r"RenderMode|\.mode\b", "a mode is a class of integrators, not a branch"),
]
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]', re.M)


def faults(root):
    for folder, allowed in MAY_INCLUDE.items():
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in {".h", ".cpp", ".cu", ".cuh"}:
                continue
            name = path.relative_to(root).as_posix()
            if folder != "tests" and UNCHECKED.search(path.read_text()):
                yield f"{name}: writes to a standard stream itself: Log() and Print() of common/base/log.h do"
            for prefix, pattern, why in MUST_NOT_SAY:
                if re.match(prefix, name) and (said := re.search(pattern, path.read_text())):
                    yield f"{name}: says {said.group()}: {why}"
            for kind, target in INCLUDE.findall(path.read_text()):
                first = target.split("/")[0]
                if (first in MAY_INCLUDE or first == "tests") and first not in allowed:
                    yield f"{name}: includes {target}: {folder}/ may include only {', '.join(sorted(allowed))}"
                if kind == '"' and "/" in target and not (root / target).exists():
                    yield f"{name}: includes {target}, which is not in the tree"
                if folder != "tests" and path.suffix == ".h" and name not in MAY_BE_HEAVY and HEAVY.search(target):
                    yield f"{name}: includes {target}: heavy headers stay out of headers"
                for prefix, pattern, why in MUST_NOT:
                    if re.match(prefix, name) and re.search(pattern, target):
                        yield f"{name}: includes {target}: {why}"


def main():
    root = pathlib.Path(sys.argv[1])
    found = list(faults(root))
    print("\n".join(found) if found else "includes point only the allowed ways")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

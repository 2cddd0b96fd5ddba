"""Stores of models, made by Quarry's own programs and kept for the next time."""
from __future__ import annotations

import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import uuid

import numpy

from ._errors import ArgumentError, Error, SourceError

_MAGIC = b"QUARRY"
_CHUNK = 1 << 20  # vertices or triangles in memory at once, as bytes of PLY


def _command():
    """$QUARRY_COMMAND, else the `quarry` on PATH."""
    found = os.environ.get("QUARRY_COMMAND") or shutil.which("quarry")
    if not found:
        raise SourceError("the command `quarry` is not there, which makes stores of models; install the package quarry, or name it by QUARRY_COMMAND")
    return found


def _failure(done):
    """The error of a command that failed: its sentence is the last line that it printed."""
    lines = [line for line in done.stderr.decode(errors="replace").splitlines() if line.strip()]
    text = lines[-1] if lines else f"the preprocessor ended with status {done.returncode}"
    return ArgumentError(text) if done.returncode == 2 else Error(text)


def is_store(path) -> bool:
    """Whether a file begins as stores do."""
    with open(path, "rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def store_of(path) -> str:
    """The store itself, or the kept store of a model, which is made if there is none; `quarry cache` lists and limits these.

    Errors: ArgumentError, SourceError, Error with the preprocessor's sentence.
    """
    text = os.fspath(path)
    if re.match(r"(https?|s3)://", text):
        return text
    if not os.path.isfile(text) or is_store(text):
        return text
    done = subprocess.run([_command(), "cache", "add", text, "--quiet"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    if done.returncode != 0:
        raise _failure(done)
    return os.fsdecode(done.stdout.rstrip(b"\n"))


def _folder() -> pathlib.Path:
    """The folder of kept meshes, the user's alone: beside the stores that `quarry` keeps."""
    base = os.environ.get("QUARRY_CACHE_DIR")
    if not base:
        base = os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache"), "quarry")
    folder = pathlib.Path(base) / "meshes"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


def _checked(vertices, triangles):
    points = numpy.asarray(vertices)
    if points.dtype not in (numpy.float32, numpy.float64):
        raise ArgumentError(f"vertices has dtype {points.dtype}; give float32 or float64")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ArgumentError(f"vertices has shape {points.shape}; give (n, 3)")
    corners = numpy.asarray(triangles)
    if corners.dtype.kind not in "iu":
        raise ArgumentError(f"triangles has dtype {corners.dtype}; give whole numbers")
    if corners.ndim != 2 or corners.shape[1] != 3:
        raise ArgumentError(f"triangles has shape {corners.shape}; give (n, 3)")
    if len(points) >= 2**31:
        raise ArgumentError(f"vertices has {len(points)} rows; at most 2147483647")
    bad = (corners < 0) | (corners >= len(points))
    if bad.any():
        row = int(numpy.argmax(bad.any(axis=1)))
        raise ArgumentError(f"triangles[{row}] is {corners[row].tolist()}; vertices has {len(points)} rows")
    return numpy.ascontiguousarray(points), numpy.ascontiguousarray(corners, dtype=numpy.int32)


def _write_ply(out, points, corners):
    kind = "float" if points.dtype == numpy.float32 else "double"
    out.write("\n".join(["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *(f"property {kind} {axis}" for axis in "xyz"),
                         f"element face {len(corners)}", "property list uchar int vertex_indices", "end_header", ""]).encode())
    for at in range(0, len(points), _CHUNK):
        out.write(points[at:at + _CHUNK].tobytes())
    for at in range(0, len(corners), _CHUNK):
        some = corners[at:at + _CHUNK]
        faces = numpy.empty(len(some), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, some
        out.write(faces.tobytes())


def store_of_mesh(vertices, triangles, up_axis: str) -> str:
    """The kept store of a mesh in memory, found by a hash of its numbers. Errors: ArgumentError, SourceError, Error."""
    points, corners = _checked(vertices, triangles)
    if up_axis not in ("y", "z"):
        raise ArgumentError(f"up_axis is {up_axis!r}; it is 'y' or 'z'")
    key = hashlib.sha256(f"1 {up_axis} {points.dtype} {len(points)} ".encode())
    key.update(points.data)
    key.update(corners.data)
    store = _folder() / f"{key.hexdigest()[:32]}.quarry"
    if store.exists():
        return str(store)
    # Under a name of its own: another thread or process may make the same.
    made = store.with_name(f"{store.stem}.{uuid.uuid4().hex}.quarry")
    command = [_command(), "preprocess", "-", "-o", made, "--quiet", "--up-axis", up_axis]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        try:
            _write_ply(process.stdin, points, corners)
        except BrokenPipeError:
            pass  # the program says why
        try:
            _, errors = process.communicate()
        except BaseException:
            process.terminate()
            raise
    if process.returncode != 0:
        raise _failure(subprocess.CompletedProcess(command, process.returncode, stderr=errors))
    os.replace(made, store)
    return str(store)

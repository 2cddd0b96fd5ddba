"""Scenes and their asks."""
from __future__ import annotations

import ctypes
import itertools
import os
import threading
from typing import Mapping, Optional, Sequence, Union

import numpy

from . import _library, _stores
from ._errors import ArgumentError
from ._names import Names

_UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}
_tags = itertools.count(1)  # by which each call is cancelled alone


def _bytes_of(size: Union[int, str]) -> int:
    """A size as the commands take it: 4096, "256M", "1.5G"; K, M, G and T are powers of 2."""
    if isinstance(size, str):
        text = size.strip().upper().removesuffix("IB").removesuffix("B")
        unit = text[-1:] if text[-1:] in "KMGT" else ""
        try:
            size = int(float(text.removesuffix(unit)) * _UNITS[unit])
        except (ValueError, OverflowError):
            raise ArgumentError(f"cache is {size!r}; give bytes, or a text such as '2G'") from None
    if not 0 <= size < 2**63:
        raise ArgumentError(f"cache is {size}; give bytes, or a text such as '2G'")
    return int(size)


def _address(array: Optional[numpy.ndarray]) -> Optional[int]:
    return None if array is None else array.ctypes.data


def _interruptibly(work, cancel, waits=True):
    """work(), on another thread if this is the main one, where Ctrl-C arrives: an exception here cancels the work, and waits for its end first unless
    `waits` is false. `work` holds all that the library writes to: it outlives any number of interrupts."""
    if threading.current_thread() is not threading.main_thread():
        return work()
    outcome, over = [], threading.Event()

    def run():
        try:
            outcome.append((work(), None))
        except BaseException as error:  # goes to the thread that waits
            outcome.append((None, error))
        finally:
            over.set()

    worker = threading.Thread(target=run, daemon=True)
    try:
        worker.start()
        over.wait()
    except BaseException:
        cancel()
        while waits and worker.ident is not None:
            try:
                if over.wait(0.02):
                    break
                cancel()  # again, where the call had not begun
            except KeyboardInterrupt:
                continue
        raise
    result, error = outcome[0]
    if error is not None:
        raise error
    return result


class _RaySet:
    """The caller's rays as the library reads them."""

    def __init__(self, rays, tnear, tfar, glass: str):
        array = numpy.asarray(rays)
        if array.dtype not in (numpy.float32, numpy.float64):
            raise ArgumentError(f"rays has dtype {array.dtype}; give float32 or float64")
        if array.ndim < 1 or array.shape[-1] != 6:
            raise ArgumentError(f"rays has shape {array.shape}; its last dimension is 6: origin and direction")
        if glass not in ("surface", "pass"):
            raise ArgumentError(f"glass is {glass!r}; it is 'surface' or 'pass'")
        self.shape, self.dtype = array.shape[:-1], array.dtype
        self.array = numpy.ascontiguousarray(array).reshape(-1, 6)
        self.count = len(self.array)
        self.tnear, self.tfar = (self._ends(value, name) for value, name in ((tnear, "tnear"), (tfar, "tfar")))
        size = self.dtype.itemsize
        self.given = _library.Rays(
            count=self.count, type=1 if size == 4 else 0, flags=_library.GLASS_PASSES if glass == "pass" else 0, origins=_address(self.array),
            directions=(_address(self.array) or 0) + 3 * size, stride=6 * size, tnear=_address(self.tnear), tfar=_address(self.tfar), tag=next(_tags))

    def _ends(self, value, name):
        """One number a ray, or None."""
        if value is None:
            return None
        try:
            spread = numpy.broadcast_to(numpy.asarray(value, dtype=self.dtype), self.shape)
        except (TypeError, ValueError):
            raise ArgumentError(f"{name} has shape {numpy.shape(value)}; the rays have {self.shape}") from None
        return numpy.ascontiguousarray(spread).reshape(-1)


_FIELDS = {"t_hit": ("t", numpy.float64, ()), "geometry_ids": ("part", numpy.uint32, ()), "primitive_ids": ("triangle", numpy.uint32, ()),
           "primitive_uvs": ("uv", numpy.float32, (2,)), "primitive_normals": ("normal", numpy.float32, (3,)),
           "material_ids": ("material", numpy.uint32, ())}


class Scene:
    """A scene, open for rays.

    Thread-safe: several threads may ask one scene at once, and close() ends their calls with CancelledError. The GIL is free during calls, and Ctrl-C
    ends them. A scene of a parent process is an error after a fork.
    """

    def __init__(self, path: Union[str, os.PathLike], cache: Union[int, str] = "2G", threads: int = 0):
        """Opens a store: a path, http://, https:// or s3://. A model is preprocessed first, into a store that is kept for the next time.

        cache: memory for decoded voxels, in bytes or as "2G"; at least the scene's largest block. threads: of computation; 0 for all processors.
        Errors: ArgumentError, SourceError, DataError, MemoryError, ProcessorError; Error with the preprocessor's sentence.
        """
        self._handle = None
        path = _stores.store_of(path)
        self._lock = threading.Lock()
        if not 0 <= threads < 2**32:
            raise ArgumentError(f"threads is {threads}; give 0 for all processors")
        options = _library.Options(cache_bytes=_bytes_of(cache), threads=threads)
        lock, left = threading.Lock(), []

        def open_store():
            opened = ctypes.c_void_p()
            _library.call("open", os.fsencode(path), options, ctypes.byref(opened))
            with lock:
                if not left:
                    self._handle = opened.value
                    return
            _library.call("close", opened)

        def leave():
            with lock:
                left.append(True)

        _interruptibly(open_store, leave, waits=False)  # __del__ closes what was opened until then
        self._path = os.fspath(path)
        self._description = _library.Description()
        _library.call("describe", self._handle, self._description)

    @classmethod
    def from_triangles(cls, vertices: numpy.ndarray, triangles: numpy.ndarray, *, up_axis: str = "z", cache: Union[int, str] = "2G",
                       threads: int = 0) -> Scene:
        """A scene of a mesh in memory: vertices, float32 or float64, shape (n, 3), and triangles, whole numbers, shape (m, 3).

        The preprocessor makes a store of it, which is kept in the folder `meshes` of the kept stores and found again by the mesh's numbers. Remove old
        ones by hand: `quarry cache` does not list them. primitive_ids are rows of `triangles`.
        Errors: ArgumentError (names the row), SourceError, Error with the preprocessor's sentence.
        """
        return cls(_stores.store_of_mesh(vertices, triangles, up_axis), cache, threads)

    def close(self) -> None:
        """Frees the scene; calls under way end with CancelledError. Closing again does nothing."""
        with self._lock:
            handle, self._handle = self._handle, None
        if handle is not None:
            _library.call("close", handle)

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def __del__(self):
        try:
            self.close()
        except Exception:  # after a fork the child has nothing to close
            pass

    def __repr__(self) -> str:
        return f"quarry.Scene({self._path!r}{', closed' if self._handle is None else ''})"

    def _handle_or_raise(self):
        if self._handle is None:
            raise ArgumentError("the scene is closed")
        return self._handle

    @property
    def bounds(self) -> numpy.ndarray:
        """Lower and upper corner of the box of all triangles, in the model's coordinates. Shape (2, 3), float64."""
        return numpy.array([self._description.lower, self._description.upper])

    @property
    def up_axis(self) -> str:
        """'y' or 'z'."""
        return "xyz"[self._description.up_axis]

    @property
    def unit_in_metres(self) -> float:
        """The length of a unit of the model; 1 where that is not known."""
        return self._description.unit_in_metres

    @property
    def offset(self) -> numpy.ndarray:
        """What the store subtracts from the model's coordinates. Shape (3,), float64."""
        return numpy.array(self._description.offset)

    @property
    def triangle_count(self) -> int:
        """Triangles with a surface. Ids count all triangles of the model's files."""
        return self._description.triangles

    @property
    def parts(self) -> Names:
        """Names of the parts, by the ids in geometry_ids."""
        return Names(self, "part_name", self._description.parts)

    @property
    def materials(self) -> Names:
        """Names of the materials, by the ids in material_ids."""
        return Names(self, "material_name", self._description.materials)

    def cast_rays(self, rays: numpy.ndarray, *, tnear=None, tfar=None, glass: str = "surface",
                  fields: Sequence[str] = tuple(_FIELDS)) -> Mapping[str, numpy.ndarray]:
        """The nearest hit of each ray.

        rays: float32 or float64, shape (..., 6): origin and direction, whose length may be any but 0. tnear, tfar: one number, or one a ray, in lengths of
        the direction; hits lie from tnear on and before tfar. glass: 'surface', or 'pass' for materials that let light through to be no surfaces.
        fields: the arrays to return; fewer are faster.
        Returns arrays by name, of the rays' leading shape: t_hit (of the rays' dtype; inf where there is no hit), geometry_ids (parts), primitive_ids,
        primitive_uvs, primitive_normals (unit, by the triangle's winding), material_ids. Ids are INVALID_ID where there is no hit.
        Errors: ArgumentError (names the argument and the ray), SourceError, DataError, MemoryError, CancelledError.
        """
        asked = _RaySet(rays, tnear, tfar, glass)
        arrays, hits = self._make(fields, asked.count)
        self._ask(asked, "nearest", hits, keep=arrays)
        return self._shaped(arrays, asked, asked.shape)

    def test_occlusions(self, rays: numpy.ndarray, tnear=None, tfar=None, *, glass: str = "surface") -> numpy.ndarray:
        """Whether each ray hits anything between tnear and tfar. Returns bool of the rays' leading shape. Else as cast_rays()."""
        asked = _RaySet(rays, tnear, tfar, glass)
        hit = numpy.empty(asked.count, dtype=numpy.bool_)
        self._ask(asked, "any", _address(hit), keep=hit)
        return hit.reshape(asked.shape)

    def count_intersections(self, rays: numpy.ndarray, *, tnear=None, tfar=None, glass: str = "surface") -> numpy.ndarray:
        """How many hits each ray has. Returns int32 of the rays' leading shape. Else as cast_rays()."""
        asked = _RaySet(rays, tnear, tfar, glass)
        return self._count(asked).reshape(asked.shape)

    def list_intersections(self, rays: numpy.ndarray, *, tnear=None, tfar=None, glass: str = "surface",
                           fields: Sequence[str] = tuple(_FIELDS)) -> Mapping[str, numpy.ndarray]:
        """All hits of each ray, in the order of (t, triangle).

        Returns, beside the arrays of cast_rays() with one entry a hit, ray_splits: int64, one more than the rays; hits of ray i, counted over the leading
        shape, are entries ray_splits[i] to ray_splits[i + 1]; and ray_ids, int64: the ray of each hit. Else as cast_rays().
        """
        asked = _RaySet(rays, tnear, tfar, glass)
        counts = self._count(asked)
        splits = numpy.zeros(asked.count + 1, dtype=numpy.int64)
        numpy.cumsum(counts, out=splits[1:])
        arrays, hits = self._make(fields, int(splits[-1]))
        self._ask(asked, "all", _address(splits), hits, keep=(splits, arrays))
        result = self._shaped(arrays, asked, (int(splits[-1]),))
        return {"ray_splits": splits, "ray_ids": numpy.repeat(numpy.arange(asked.count, dtype=numpy.int64), counts), **result}

    @staticmethod
    def create_rays_pinhole(fov_deg: float, center, eye, up, width_px: int, height_px: int, *, vertical: bool = False) -> numpy.ndarray:
        """Rays through the centres of a picture's pixels, as `quarry render` shoots them.

        fov_deg: the horizontal angle of view, or with `vertical` the vertical one, which `quarry render --fov` has. center: the point looked at.
        Returns float64, shape (height_px, width_px, 6). At t = 1 a ray is at distance 1 along the axis of view.
        Errors: ArgumentError.
        """
        points = []
        for name, value in (("eye", eye), ("center", center), ("up", up)):
            point = numpy.ascontiguousarray(value, dtype=numpy.float64)
            if point.shape != (3,):
                raise ArgumentError(f"{name} has shape {point.shape}; give three numbers")
            points.append(point)
        for name, value in (("width_px", width_px), ("height_px", height_px)):
            if not 0 < value < 2**31:
                raise ArgumentError(f"{name} is {value}")
        rays = numpy.empty((height_px, width_px, 6))
        _library.call("pinhole", *map(_address, points), fov_deg, 0 if vertical else 1, width_px, height_px, _address(rays))
        return rays

    def cancel(self) -> None:
        """Ends all calls under way of this scene, from another thread: they raise CancelledError. Later calls are not affected."""
        _library.call("cancel", self._handle_or_raise(), _library.EVERY_TAG)

    @property
    def statistics(self) -> Mapping[str, Union[int, float]]:
        """Work since the scene was opened: rays, blocks loaded and evicted, bytes in the cache, seconds. See quarry.h."""
        measured = _library.Statistics()
        _library.call("measure", self._handle_or_raise(), measured)
        return {name: getattr(measured, name) for name, _ in measured._fields_ if name != "size"}

    def _count(self, asked):
        counts = numpy.empty(asked.count, dtype=numpy.int32)
        self._ask(asked, "count", _address(counts), keep=counts)
        return counts

    @staticmethod
    def _make(fields, count):
        """Arrays for hits, by name, and the structure that names them to the library."""
        unknown = [name for name in fields if name not in _FIELDS]
        if unknown:
            raise ArgumentError(f"fields has {unknown[0]!r}; known are {', '.join(_FIELDS)}")
        arrays = {name: numpy.empty((count, *_FIELDS[name][2]), dtype=_FIELDS[name][1]) for name in fields}
        return arrays, _library.Hits(**{_FIELDS[name][0]: _address(array) for name, array in arrays.items()})

    @staticmethod
    def _shaped(arrays, asked, shape):
        if asked.dtype == numpy.float32 and "t_hit" in arrays:
            arrays["t_hit"] = arrays["t_hit"].astype(numpy.float32)
        return {name: array.reshape((*shape, *_FIELDS[name][2])) for name, array in arrays.items()}

    def _ask(self, asked, name, *outputs, keep):
        """`keep`: the arrays behind the addresses in `outputs`; the call on the other thread holds them."""
        handle = self._handle_or_raise()

        def work(_held=(asked, keep)):
            _library.call(name, handle, asked.given, *outputs)

        _interruptibly(work, lambda: self._cancel(handle, asked.given.tag))

    @staticmethod
    def _cancel(handle, tag):
        try:
            _library.call("cancel", handle, tag)
        except ArgumentError:  # closed meanwhile: the call has ended
            pass

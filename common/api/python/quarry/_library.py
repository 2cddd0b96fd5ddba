"""libquarry by ctypes: the structures and calls of quarry.h."""
import ctypes
import os
import pathlib

from ._errors import BY_STATUS

INVALID_ID = 0xFFFFFFFF  #: stands for no id: for the triangle of a ray that hits nothing

_SONAME = "libquarry.so.0"


class Sized(ctypes.Structure):
    """A structure of quarry.h, whose first member is its size."""

    def __init__(self, **members):
        super().__init__(size=ctypes.sizeof(type(self)), **members)


class Options(Sized):
    _fields_ = [("size", ctypes.c_size_t), ("cache_bytes", ctypes.c_uint64), ("threads", ctypes.c_uint32)]


class Description(Sized):
    _fields_ = [("size", ctypes.c_size_t), ("lower", ctypes.c_double * 3), ("upper", ctypes.c_double * 3), ("offset", ctypes.c_double * 3),
                ("unit_in_metres", ctypes.c_double), ("up_axis", ctypes.c_uint32), ("materials", ctypes.c_uint32), ("parts", ctypes.c_uint64),
                ("triangles", ctypes.c_uint64), ("triangle_ids", ctypes.c_uint64), ("voxels", ctypes.c_uint64), ("decoded_bytes", ctypes.c_uint64),
                ("largest_block_bytes", ctypes.c_uint64)]


class Rays(Sized):
    _fields_ = [("size", ctypes.c_size_t), ("count", ctypes.c_size_t), ("type", ctypes.c_int), ("flags", ctypes.c_uint32), ("origins", ctypes.c_void_p),
                ("directions", ctypes.c_void_p), ("stride", ctypes.c_ssize_t), ("tnear", ctypes.c_void_p), ("tfar", ctypes.c_void_p),
                ("t_stride", ctypes.c_ssize_t), ("tag", ctypes.c_uint64)]


class Hits(Sized):
    _fields_ = [("size", ctypes.c_size_t)] + [(name, ctypes.c_void_p) for name in ("t", "triangle", "uv", "part", "material", "normal")]


class Statistics(Sized):
    _fields_ = [("size", ctypes.c_size_t)] + [(name, ctypes.c_uint64) for name in (
        "rays", "rays_suspended", "blocks_loaded", "evictions", "bytes_decoded", "cache_bytes")] + [
        (name, ctypes.c_double) for name in ("compute_seconds", "stall_seconds")]


GLASS_PASSES = 1
EVERY_TAG = 2**64 - 1


def _load():
    """The library: $QUARRY_LIBRARY, else the one beside this file (of a wheel), else the system's."""
    beside = pathlib.Path(__file__).with_name(_SONAME)
    name = os.environ.get("QUARRY_LIBRARY") or (str(beside) if beside.exists() else _SONAME)
    library = ctypes.CDLL(name)
    scene, structure, pointer, size = ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t
    library.quarry_error.restype = library.quarry_version.restype = ctypes.c_char_p
    for call, arguments in {
            "open": (ctypes.c_char_p, structure, ctypes.POINTER(ctypes.c_void_p)), "close": (scene,), "describe": (scene, structure),
            "part_name": (scene, ctypes.c_uint32, ctypes.c_char_p, size, ctypes.POINTER(size)),
            "material_name": (scene, ctypes.c_uint32, ctypes.c_char_p, size, ctypes.POINTER(size)), "nearest": (scene, structure, structure),
            "any": (scene, structure, pointer), "count": (scene, structure, pointer), "all": (scene, structure, pointer, structure),
            "cancel": (scene, ctypes.c_uint64), "measure": (scene, structure),
            "pinhole": (pointer, pointer, pointer, ctypes.c_double, ctypes.c_int, ctypes.c_uint32, ctypes.c_uint32, pointer)}.items():
        getattr(library, f"quarry_{call}").argtypes = arguments
    return library


_library = _load()


def call(name, *arguments):
    """Makes a call of quarry.h. Structures are passed by their address. Raises the error of its status."""
    status = getattr(_library, f"quarry_{name}")(*(ctypes.addressof(a) if isinstance(a, Sized) else a for a in arguments))
    if status != 0:
        raise BY_STATUS[status](_library.quarry_error().decode(errors="replace"))


def version() -> str:
    """The library's release."""
    return _library.quarry_version().decode()

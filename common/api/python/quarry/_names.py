"""Names of parts and materials, read from the store one by one: a model may have millions."""
import collections.abc
import ctypes

from . import _library


class Names(collections.abc.Sequence):
    """A sequence of names by id. Thread-safe. Errors: SourceError, DataError."""

    def __init__(self, scene, call: str, count: int):
        self._scene, self._call, self._count = scene, call, count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index):
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(self._count))]
        at = index.__index__()
        at += self._count if at < 0 else 0
        if not 0 <= at < self._count:
            raise IndexError(f"{self._call.split('_')[0]} {index} of {self._count}")
        length, room = ctypes.c_size_t(), ctypes.create_string_buffer(256)
        _library.call(self._call, self._scene._handle_or_raise(), at, room, len(room), ctypes.byref(length))
        if length.value >= len(room):
            room = ctypes.create_string_buffer(length.value + 1)
            _library.call(self._call, self._scene._handle_or_raise(), at, room, len(room), None)
        return room.value.decode(errors="replace")

"""A reader of the EXRs that Quarry writes: ZIP, samples of 32 bits. Tests compare by it the pixels that other programs would read."""
import dataclasses
import pathlib
import struct
import zlib

LINES = 16  # of a chunk


@dataclasses.dataclass
class Exr:
    attributes: dict  # bytes by name
    types: dict       # by channel: 0 whole numbers, 2 floats
    rows: dict        # by channel, from the upper row of the data window on

    def window(self, name):
        return struct.unpack("<4i", self.attributes[name])

    def at(self, channels, x, y):
        """Values of channels at a pixel, counted from the data window's corner."""
        return tuple(self.rows[channel][y][x] for channel in channels)


def attributes_of(data):
    """The header, and where the table of chunks begins."""
    attributes, at = {}, 8
    while data[at] != 0:
        name_end = data.index(b"\0", at)
        type_end = data.index(b"\0", name_end + 1)
        size = int.from_bytes(data[type_end + 1:type_end + 5], "little")
        attributes[data[at:name_end].decode()] = data[type_end + 5:type_end + 5 + size]
        at = type_end + 5 + size
    return attributes, at + 1


def channels_of(listed):
    types, at = {}, 0
    while listed[at] != 0:
        end = listed.index(b"\0", at)
        types[listed[at:end].decode()] = listed[end + 1]
        at = end + 17
    return types


def unpacked(chunk, size):
    """Undoes ZIP: deflate, then differences, then two halves that alternate."""
    if len(chunk) == size:
        return chunk
    packed = bytearray(zlib.decompress(chunk))
    for i in range(1, len(packed)):
        packed[i] = (packed[i - 1] + packed[i] - 128) & 255
    half = (size + 1) // 2
    out = bytearray(size)
    out[0::2], out[1::2] = packed[:half], packed[half:]
    return bytes(out)


def read_exr(path):
    data = pathlib.Path(path).read_bytes()
    attributes, table = attributes_of(data)
    types = channels_of(attributes["channels"])
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    width, rows = right - left + 1, {name: [] for name in types}
    for first in range(top, bottom + 1, LINES):
        at = int.from_bytes(data[table:table + 8], "little")
        table += 8
        lines = min(LINES, bottom + 1 - first)
        size = struct.unpack("<i", data[at + 4:at + 8])[0]
        raw = unpacked(data[at + 8:at + 8 + size], lines * width * 4 * len(types))
        place = 0
        for _ in range(lines):
            for name in sorted(types):
                rows[name].append(struct.unpack_from(f"<{width}{'I' if types[name] == 0 else 'f'}", raw, place))
                place += 4 * width
    return Exr(attributes, types, rows)

"""PNGs of 8 bits a channel read back, and many of them on one sheet, to be looked at together."""
import struct
import zlib


def pixels(path):
    """Width, height and the bytes of an 8-bit RGB PNG, rows filtered by none or up."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        if kind == b"IHDR":
            width, height = struct.unpack(">II", body[:8])
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    raw, rows, before = zlib.decompress(packed), bytearray(), bytearray(3 * width)
    for y in range(height):
        line = raw[y * (3 * width + 1) + 1:(y + 1) * (3 * width + 1)]
        if raw[y * (3 * width + 1)] == 2:
            line = bytes((a + b) & 255 for a, b in zip(line, before))
        rows += line
        before = line
    return width, height, rows


def add_to_sheet(picture, sheet):
    """Puts a third of the picture's rows and columns on the contact sheet, four pictures a row."""
    width, height, rows = pixels(picture)
    row = 3 * width
    small = []
    for y in range(1, height, 3):
        line = rows[y * row:(y + 1) * row]
        thin = bytearray(3 * len(line[3::9]))
        for channel in range(3):
            thin[channel::3] = line[3 + channel::9]
        small.append(bytes(thin))
    sheet.append(small)


def write_sheet(path, sheet):
    columns = 4
    lines = []
    for at in range(0, len(sheet), columns):
        pictures = sheet[at:at + columns]
        empty = bytes(len(pictures[0][0]))
        for y in range(len(pictures[0])):
            lines.append(b"\0" + b"".join(p[y] for p in pictures) + empty * (columns - len(pictures)))

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", (len(lines[0]) - 1) // 3, len(lines), 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"".join(lines))) + chunk(b"IEND", b""))

"""Images, and a scene with every kind of texture, for tests."""
import array
import json
import math
import pathlib
import random
import struct
import zlib


def png(width, height, row, channels=3, level=1, depth=8, kind=None, before=()):
    """A PNG; `row(y)` gives a row's bytes. `kind`: of colour, PNG's number; `before`: names and contents of chunks ahead of the data."""
    packer = zlib.compressobj(level)
    packed = b"".join(packer.compress(b"\0" + row(y)) for y in range(height)) + packer.flush()
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels] if kind is None else kind

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0)) +
            b"".join(chunk(*one) for one in before) + chunk(b"IDAT", packed) + chunk(b"IEND", b""))


def noise(width, height, seed, channels=3, low=0):
    chance = random.Random(seed)
    return png(width, height, lambda y: bytes(chance.randrange(low, 256) for _ in range(width * channels)), channels)


def checkers(width, height, cell, dark=(20, 20, 20), light=(240, 240, 240)):
    rows = [b"".join(bytes(light if (x // cell + odd) % 2 else dark) for x in range(width)) for odd in (0, 1)]
    return png(width, height, lambda y: rows[y // cell % 2])


def dents(width, height):
    """A normal map of round dents."""

    def row(y):
        out = bytearray()
        for x in range(width):
            dx, dy = 0.5 * math.sin(x / width * 8 * math.pi), 0.5 * math.sin(y / height * 8 * math.pi)
            out += bytes(int(127.5 + 127.5 * v / math.sqrt(1 + dx * dx + dy * dy)) for v in (dx, dy, 1))
        return bytes(out)

    return png(width, height, row)


def leaves(width, height):
    """Discs with alpha."""

    def row(y):
        out = bytearray()
        for x in range(width):
            inside = math.hypot(x % 32 - 16, y % 32 - 16) < 12
            out += bytes((60, 160, 50, 255 if inside else 0))
        return bytes(out)

    return png(width, height, row, 4)


def sheet(columns, rows, place, repeat=1.0):
    """Positions, uv and triangles of a grid; `place(u, v)` gives a position, u and v in [0, 1]."""
    positions = [place(x / columns, y / rows) for y in range(rows + 1) for x in range(columns + 1)]
    uvs = [(x / columns * repeat, y / rows * repeat) for y in range(rows + 1) for x in range(columns + 1)]
    triangles = []
    for y in range(rows):
        for x in range(columns):
            a = y * (columns + 1) + x
            triangles += [(a, a + 1, a + columns + 1), (a + 1, a + columns + 2, a + columns + 1)]
    return positions, uvs, triangles


def glb(document, buffer):
    """The bytes of a glTF in one file."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    buffer += bytes(-len(buffer) % 4)
    return (b"glTF" + struct.pack("<III", 2, 28 + len(text) + len(buffer), len(text)) + b"JSON" + text +
            struct.pack("<I", len(buffer)) + b"BIN\0" + buffer)


class Glb:
    """A glTF in one file, of sheets and materials with images."""

    def __init__(self):
        self.buffer, self.views, self.accessors, self.primitives, self.images = b"", [], [], [], []
        self.textures, self.materials, self.samplers = [], [], []

    def view(self, data):
        self.views.append({"buffer": 0, "byteOffset": len(self.buffer), "byteLength": len(data)})
        self.buffer += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def image(self, content, **sampler):
        """The number of a texture of this PNG."""
        self.images.append({"bufferView": self.view(content), "mimeType": "image/png"})
        self.samplers.append(sampler)
        self.textures.append({"source": len(self.images) - 1, "sampler": len(self.samplers) - 1})
        return len(self.textures) - 1

    def material(self, **members):
        self.materials.append(members)
        return len(self.materials) - 1

    def add(self, sheet_, material):
        positions, uvs, triangles = sheet_

        def accessor(kind, component, values, count):
            self.accessors.append({"bufferView": self.view(values.tobytes()), "componentType": component,
                                   "count": count, "type": kind})
            return len(self.accessors) - 1

        self.primitives.append({
            "attributes": {"POSITION": accessor("VEC3", 5126, array.array("f", (v for p in positions for v in p)), len(positions)),
                           "TEXCOORD_0": accessor("VEC2", 5126, array.array("f", (v for p in uvs for v in p)), len(uvs))},
            "indices": accessor("SCALAR", 5125, array.array("I", (v for t in triangles for v in t)), 3 * len(triangles)),
            "material": material})

    def content(self):
        document = {"asset": {"version": "2.0"}, "accessors": self.accessors, "materials": self.materials,
                    "textures": self.textures, "images": self.images, "samplers": self.samplers,
                    "meshes": [{"primitives": self.primitives}], "nodes": [{"mesh": 0}],
                    "bufferViews": self.views, "buffers": [{"byteLength": len(self.buffer)}]}
        return glb({name: member for name, member in document.items() if member}, self.buffer)

    def write(self, path):
        pathlib.Path(path).write_bytes(self.content())


def write_scene(folder, columns=96):
    """Two models: a glTF with every map of its kind, and an OBJ with the others. Returns their paths."""
    folder = pathlib.Path(folder)
    glb = Glb()
    everything = glb.material(
        pbrMetallicRoughness={"baseColorTexture": {"index": glb.image(noise(300, 260, 1, low=90))},
                              "metallicRoughnessTexture": {"index": glb.image(noise(64, 64, 2))}},
        normalTexture={"index": glb.image(dents(256, 200)), "scale": 0.7},
        emissiveTexture={"index": glb.image(noise(33, 65, 3))}, emissiveFactor=[0.2, 0.1, 0.1])
    board = glb.material(pbrMetallicRoughness={
        "baseColorTexture": {"index": glb.image(checkers(512, 512, 8), wrapS=33648, wrapT=33071)}, "metallicFactor": 0})
    cut = glb.material(alphaMode="MASK", doubleSided=True, pbrMetallicRoughness={
        "baseColorTexture": {"index": glb.image(leaves(128, 128))}, "metallicFactor": 0})
    veil = glb.material(alphaMode="BLEND", doubleSided=True, pbrMetallicRoughness={
        "baseColorFactor": [1, 1, 1, 0.7], "baseColorTexture": {"index": glb.image(noise(70, 64, 6, 4))}, "metallicFactor": 0})
    glass = glb.material(alphaMode="BLEND", doubleSided=True, pbrMetallicRoughness={"baseColorFactor": [0.6, 0.9, 0.7, 0.3], "metallicFactor": 0})
    glb.add(sheet(6, 6, lambda u, v: (7 * u, 1 + v, 1 + 2 * v)), veil)
    glb.add(sheet(2, 2, lambda u, v: (3 + 3 * u, 3 + 0.3 * v, 3 * v)), glass)
    glb.add(sheet(columns, columns, lambda u, v: (10 * u, 10 * v, math.sin(9 * u) * math.cos(7 * v) * 0.4), 3), everything)
    glb.add(sheet(columns, columns, lambda u, v: (40 * u - 15, 40 * v - 15, -1), 6), board)
    for k in range(4):
        glb.add(sheet(columns // 4, columns // 4, lambda u, v, k=k: (2 + 5 * u, 4 + 0.5 * k, 0.5 + 4 * v), 2), cut)
    glb.write(folder / "every.glb")
    (folder / "grey.png").write_bytes(noise(64, 48, 4, 1))
    (folder / "tint.png").write_bytes(noise(130, 70, 5, low=60))
    (folder / "s.mtl").write_text(
        "newmtl mirror\nKd 0.2 0.2 0.2\nKs 0.7 0.7 0.7\nNs 90\nillum 3\nmap_Kd tint.png\nbump -bm 0.3 grey.png\n"
        "newmtl shiny\nKd 0.6 0.6 0.6\nKs 1 1 1\nNs 30\nmap_Ks -s 2 2 tint.png\nmap_Kd grey.png\n")
    positions, uvs, triangles = sheet(columns, columns // 2, lambda u, v: (
        9 + 1.5 * math.cos(2 * math.pi * u) * math.sin(math.pi * (0.02 + 0.96 * v)),
        2 + 1.5 * math.sin(2 * math.pi * u) * math.sin(math.pi * (0.02 + 0.96 * v)),
        1.5 - 1.5 * math.cos(math.pi * (0.02 + 0.96 * v))))
    lines = ["mtllib s.mtl"]
    lines += [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in positions]
    lines += [f"vt {u:.5f} {v:.5f}" for u, v in uvs]
    lines += [f"vn {(x - 9) / 1.5:.5f} {(y - 2) / 1.5:.5f} {(z - 1.5) / 1.5:.5f}" for x, y, z in positions]
    for half, material in enumerate(("mirror", "shiny")):
        lines.append(f"usemtl {material}")
        of = triangles[half * len(triangles) // 2:(half + 1) * len(triangles) // 2]
        lines += ["f " + " ".join(f"{v + 1}/{v + 1}/{v + 1}" for v in t) for t in of]
    (folder / "s.obj").write_text("\n".join(lines) + "\n")
    return [folder / "every.glb", folder / "s.obj"]


def write_leaves(folder, count=40):
    """Leaves over a floor that mirrors a little: an OBJ whose leaves are rectangles with an opacity map. Returns its path."""
    folder = pathlib.Path(folder)

    def row(y):
        across = abs((y + 0.5) / 16 - 1)
        along = [(x + 0.5) / 64 for x in range(64)]
        return bytes(255 if across < 4 * a * (1 - a) and not (0.2 < across < 0.7 and a * 8 % 1 < 0.25) else 0 for a in along)

    (folder / "leaf.png").write_bytes(png(64, 32, row, 1))
    (folder / "leaves.mtl").write_text("newmtl floor\nKd 0.5 0.45 0.4\nKs 0.3 0.3 0.3\nNs 200\nillum 3\n"
                                       "newmtl leaf\nKd 0.2 0.6 0.15\nmap_d leaf.png\nnewmtl dry\nKd 0.7 0.4 0.1\nmap_d leaf.png\n")
    lines = ["mtllib leaves.mtl", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]

    def rectangle(material, middle, a, b):
        for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            lines.append("v " + " ".join(f"{m + i * u + j * v:.4f}" for m, u, v in zip(middle, a, b)))
        lines.extend((f"usemtl {material}", "f -4/1 -3/2 -2/3 -1/4"))

    rectangle("floor", (0, 0, 0), (20, 0, 0), (0, 20, 0))
    chance = random.Random(1)
    for i in range(count):
        a = [chance.uniform(-1, 1) for _ in range(3)]
        rectangle("dry" if i % 5 == 0 else "leaf", (chance.uniform(-3, 3), chance.uniform(-3, 3), chance.uniform(1, 5)), a,
                  (-a[1] / 2, a[0] / 2, chance.uniform(-0.3, 0.3)))
    (folder / "leaves.obj").write_text("\n".join(lines) + "\n")
    return folder / "leaves.obj"

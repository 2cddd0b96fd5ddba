"""Small models of things that people know, for tests/bench/pictures/first_pictures and the tests of guesses: each is right only one way up. Axes as built: x to the
right, y to the back, z up; save() turns them so that the axis named points up."""
import math
import pathlib
import struct

TURN = 2 * math.pi


class Mesh:
    """Triangles of three points each, in the order added; `parts` names where each part begins."""

    def __init__(self):
        self.triangles, self.parts = [], []

    def part(self, name):
        self.parts.append((len(self.triangles), name))
        return self

    def quad(self, a, b, c, d):
        self.triangles += [(a, b, c), (a, c, d)]

    def grid(self, point, columns, rows):
        """Quads of point(u, v), u and v in [0, 1], facing where u x v points."""
        at = [[point(i / columns, j / rows) for i in range(columns + 1)] for j in range(rows + 1)]
        for j in range(rows):
            for i in range(columns):
                a, b, c, d = at[j][i], at[j][i + 1], at[j + 1][i + 1], at[j + 1][i]
                if a != b:
                    self.triangles.append((a, b, c))
                if c != d:
                    self.triangles.append((a, c, d))

    def box(self, low, high):
        (x, y, z), (X, Y, Z) = low, high
        self.quad((x, y, z), (x, Y, z), (X, Y, z), (X, y, z))
        self.quad((x, y, Z), (X, y, Z), (X, Y, Z), (x, Y, Z))
        self.quad((x, y, z), (X, y, z), (X, y, Z), (x, y, Z))
        self.quad((x, Y, z), (x, Y, Z), (X, Y, Z), (X, Y, z))
        self.quad((x, y, z), (x, y, Z), (x, Y, Z), (x, Y, z))
        self.quad((X, y, z), (X, Y, z), (X, Y, Z), (X, y, Z))

    def lathe(self, profile, place=(0, 0, 0), columns=48, squeeze=1.0):
        """Turns (radius, height) about the vertical through `place`; depth is multiplied by `squeeze`."""
        def point(u, v):
            at = v * (len(profile) - 1)
            i = min(int(at), len(profile) - 2)
            t = at - i
            r, z = (p + (q - p) * t for p, q in zip(profile[i], profile[i + 1]))
            angle = TURN * (u % 1)
            return (place[0] + r * math.cos(angle), place[1] + squeeze * r * math.sin(angle), place[2] + z)
        self.grid(point, columns, 4 * (len(profile) - 1))

    def sphere(self, place, radius, n=16):
        self.lathe([(radius * math.sin(math.pi * i / n), -radius * math.cos(math.pi * i / n)) for i in range(n + 1)], place, 2 * n)

    def wheel(self, place, radius, width, n=32):
        """A cylinder about the y axis."""
        x, y, z = place
        rim = [(x + radius * math.cos(TURN * i / n), z + radius * math.sin(TURN * i / n)) for i in range(n)]
        for (a, b), (c, d) in zip(rim, rim[1:] + rim[:1]):
            self.quad((a, y, b), (a, y + width, b), (c, y + width, d), (c, y, d))
            self.triangles += [((x, y, z), (a, y, b), (c, y, d)), ((x, y + width, z), (c, y + width, d), (a, y + width, b))]


def bust():
    """Head and shoulders on a foot: taller than wide, wider than deep, flat at the bottom."""
    m = Mesh()
    m.lathe([(0, 0), (0.17, 0), (0.17, 0.03), (0.11, 0.06), (0.1, 0.12)])
    m.lathe([(0, 0.12), (0.16, 0.13), (0.29, 0.2), (0.31, 0.28), (0.24, 0.38), (0.1, 0.42), (0.085, 0.5)], squeeze=0.55)
    m.lathe([(0.08, 0.48), (0.11, 0.52), (0.145, 0.6), (0.15, 0.68), (0.12, 0.77), (0.05, 0.82), (0, 0.825)], place=(0, -0.02, 0), squeeze=1.2)
    m.sphere((0, -0.2, 0.63), 0.025, 8)
    return m


def staircase():
    """Fourteen solid steps between two stringers."""
    m = Mesh()
    for i in range(14):
        m.box((0, 0.28 * i, 0), (1.0, 0.28 * (i + 1), 0.175 * (i + 1)))
    return m


def spiral_stairs():
    """Wedges about a column, with a post each."""
    m = Mesh()
    m.lathe([(0, 0), (0.08, 0), (0.08, 4), (0, 4)], columns=24)
    for i in range(20):
        a, b, z = TURN * i / 14, TURN * (i + 1) / 14, 0.19 * (i + 1)
        ring = [(r * math.cos(t), r * math.sin(t)) for t in (a, b) for r in (0.08, 0.95)]
        p, q, s, t = (ring[k] for k in (0, 1, 3, 2))
        for h in (z - 0.04, z):
            m.quad(*[(x, y, h) for x, y in (p, q, s, t)])
        for (c, d) in ((p, q), (q, s), (s, t)):
            m.quad((*c, z - 0.04), (*d, z - 0.04), (*d, z), (*c, z))
        m.lathe([(0.015, z), (0.015, z + 0.9)], place=(0.92 * math.cos(a), 0.92 * math.sin(a), 0), columns=8)
    return m


def still_life(backdrop=False):
    """A vase, fruit, a plate and a book on a cloth; a wall behind them if `backdrop`."""
    m = Mesh()
    m.grid(lambda u, v: (1.6 * u - 0.8, 1.0 * v - 0.5, 0.01 * math.sin(9 * u) * math.cos(7 * v)), 40, 24)
    m.lathe([(0, 0), (0.07, 0), (0.12, 0.12), (0.13, 0.25), (0.06, 0.4), (0.05, 0.5), (0.08, 0.56)], place=(-0.3, 0.1, 0.02))
    m.lathe([(0, 0.03), (0.12, 0.03), (0.2, 0.06), (0.21, 0.07), (0.12, 0.05), (0, 0.045)], place=(0.25, -0.05, 0))
    for x, y, r in ((0.2, -0.05, 0.055), (0.3, -0.02, 0.06), (0.25, 0.06, 0.05), (-0.05, -0.2, 0.06), (0.05, 0.2, 0.055)):
        m.sphere((x, y, (0.05 if x > 0.15 else 0.01) + r), r)
    m.box((-0.65, -0.3, 0.01), (-0.4, -0.1, 0.05))
    if backdrop:
        m.quad((-4, 1.5, -1), (4, 1.5, -1), (4, 1.5, 4), (-4, 1.5, 4))
    return m


def car(plate=20.0, n=220):
    """A body of 2 * n * n triangles on four wheels; `plate`: how many times as long the plate is under it, 0 for none."""
    m = Mesh().part("car")

    def body(u, v):
        """A hull with a cabin: rings around the long axis."""
        s = 2 * u - 1
        half = 0.9 * (1 - abs(s) ** 6) ** 0.5 + 0.02
        roof = 0.55 + 0.45 / (1 + (2.2 * (s - 0.1)) ** 8)
        angle = TURN * (v % 1)
        c, w = math.cos(angle), math.sin(angle)
        power = 0.35
        return (2.2 * s, half * math.copysign(abs(c) ** power, c), 0.25 + (roof / 2) * (1 + math.copysign(abs(w) ** power, w)) * (1 - 0.25 * abs(s) ** 4))
    m.grid(body, n, n)
    for x in (-1.4, 1.35):
        for y in (-0.95, 0.7):
            m.wheel((x, y, 0.33), 0.33, 0.25, 48)
    if plate:
        m.part("plate")
        h = 2.2 * plate
        m.quad((-h, -h, 0), (h, -h, 0), (h, h, 0), (-h, h, 0))
    return m


def tower(storeys=12, walls=True):
    """Empty storeys: slabs, columns at the border, a core, and windows in the walls between the columns."""
    m = Mesh()
    w, d, h = 18.0, 14.0, 3.5
    for k in range(storeys + 1):
        m.box((0, 0, h * k - 0.3), (w, d, h * k))
    for k in range(storeys):
        z = h * k
        for x in [w * i / 6 for i in range(7)]:
            for y in (0.0, d - 0.4):
                m.box((min(x, w - 0.4), y, z), (min(x, w - 0.4) + 0.4, y + 0.4, z + h - 0.3))
        for y in [d * i / 4 for i in range(1, 4)]:
            for x in (0.0, w - 0.4):
                m.box((x, y, z), (x + 0.4, y + 0.4, z + h - 0.3))
        m.box((w / 2 - 2, d / 2 - 1.5, z), (w / 2 + 2, d / 2 + 1.5, z + h - 0.3))
        if walls:
            m.box((0.1, 0.1, z), (w - 0.1, 0.2, z + 0.9))
            m.box((0.1, d - 0.2, z), (w - 0.1, d - 0.1, z + 0.9))
            m.box((0.1, 0.1, z), (0.2, d - 0.1, z + 0.9))
            m.box((w - 0.2, 0.1, z), (w - 0.1, d - 0.1, z + 0.9))
    return m


def lit_room():
    """A closed room with a table and shelves, and a window that shines: part "window" is its light."""
    m = Mesh().part("room")
    w, d, h = 5.0, 4.0, 2.7
    m.quad((0, 0, 0), (w, 0, 0), (w, d, 0), (0, d, 0))
    m.quad((0, 0, h), (0, d, h), (w, d, h), (w, 0, h))
    m.quad((0, 0, 0), (0, 0, h), (w, 0, h), (w, 0, 0))
    m.quad((0, d, 0), (w, d, 0), (w, d, h), (0, d, h))
    m.quad((0, 0, 0), (0, d, 0), (0, d, h), (0, 0, h))
    m.quad((w, 0, 0), (w, 0, h), (w, d, h), (w, d, 0))
    m.box((1.5, 1.2, 0.7), (3.2, 2.2, 0.75))
    for x in (1.55, 3.1):
        for y in (1.25, 2.1):
            m.box((x, y, 0), (x + 0.05, y + 0.05, 0.7))
    for k in range(5):
        m.box((0, 3.6, 0.45 * k), (1.8, 4.0, 0.45 * k + 0.03))
    m.part("window")
    m.quad((w - 0.01, 1.0, 0.9), (w - 0.01, 1.0, 2.1), (w - 0.01, 3.0, 2.1), (w - 0.01, 3.0, 0.9))
    return m


def turned(point, up):
    x, y, z = point
    return (x, z, -y) if up == "y" else (x, y, z)


def save(mesh, path, up="z", comments=(), scale=1.0):
    """Writes OBJ (with `path`.mtl where parts have looks), binary STL or PLY, by the path's ending."""
    path = pathlib.Path(path)
    triangles = [[turned(tuple(scale * v for v in p), up) for p in t] for t in mesh.triangles]
    if path.suffix == ".stl":
        head = (comments[0] if comments else "").encode().ljust(80, b"\0")
        rows = b"".join(struct.pack("<12fH", 0, 0, 0, *t[0], *t[1], *t[2], 0) for t in triangles)
        return path.write_bytes(head + struct.pack("<I", len(triangles)) + rows)
    numbers, vertices, faces = {}, [], []
    for t in triangles:
        face = []
        for p in t:
            key = tuple(round(v / scale, 9) for v in p)
            if key not in numbers:
                numbers[key] = len(vertices)
                vertices.append(p)
            face.append(numbers[key])
        faces.append(face)
    if path.suffix == ".ply":
        head = ["ply", "format ascii 1.0", *(f"comment {c}" for c in comments), f"element vertex {len(vertices)}", "property float x", "property float y",
                "property float z", f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
        rows = [f"{x:.7g} {y:.7g} {z:.7g}" for x, y, z in vertices] + [f"3 {a} {b} {c}" for a, b, c in faces]
        return path.write_text("\n".join(head + rows) + "\n")
    lines = [f"# {c}" for c in comments] + [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in vertices]
    names = dict(mesh.parts)
    if "window" in names.values():
        lines.insert(len(comments), f"mtllib {path.stem}.mtl")
        path.with_suffix(".mtl").write_text("newmtl room\nKd 0.7 0.65 0.6\nnewmtl window\nKd 0 0 0\nKe 40 45 50\n")
    for i, (a, b, c) in enumerate(faces):
        if i in names:
            lines += [f"o {names[i]}"] + ([f"usemtl {names[i]}"] if "window" in names.values() else [])
        lines.append(f"f {a + 1} {b + 1} {c + 1}")
    return path.write_text("\n".join(lines) + "\n")


MODELS = {"bust": bust, "staircase": staircase, "spiral-stairs": spiral_stairs, "still-life": still_life, "still-life-backdrop": lambda: still_life(True),
          "car-on-plate": car, "tower": tower, "lit-room": lit_room}

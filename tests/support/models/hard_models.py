"""Models that split planes divide badly: triangles that lie in each other's way."""
import array
import math
import random
import struct

KINDS = ("fan", "slivers", "needles", "stacked", "soup")


def write(path, kind, n, seed=1):
    """Writes n triangles as binary PLY: a fan round one vertex, slivers across the whole box, needles along the axes, copies of
    one triangle, or a soup of large ones."""
    chance = random.Random(seed)
    u, near = chance.random, lambda: 1e-4 * (chance.random() - 0.5)
    values, faces = array.array("f"), ((3, 3 * i, 3 * i + 1, 3 * i + 2) for i in range(n))
    if kind == "fan":
        values.extend((0, 0, 0))
        faces = ((3, 0, 1 + i, 1 + (i + 1) % n) for i in range(n))
    for i in range(n):
        if kind == "fan":
            t = 2 * math.pi * i / n
            values.extend((math.cos(t), math.sin(t), 0.1 * math.sin(7 * t)))
        elif kind == "slivers":
            b = (u(), u(), u())
            values.extend((u(), u(), u(), *b, b[0] + near(), b[1] + near(), b[2] + near()))
        elif kind == "needles":
            a = (u(), u(), u())
            b = list(a)
            b[i % 3] += 0.3
            values.extend((*a, *b, a[0] + near(), a[1] + near(), a[2] + near()))
        elif kind == "stacked":
            values.extend((0, 0, 0, 1, 0, 0, 0, 1, 0))
        else:
            values.extend(u() for _ in range(9))
    pack = struct.Struct("<BIII").pack
    with open(path, "wb") as file:
        file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(values) // 3}\nproperty float x\nproperty float y\n"
                   f"property float z\nelement face {n}\nproperty list uchar uint vertex_indices\nend_header\n".encode())
        values.tofile(file)
        for face in faces:
            file.write(pack(*face))

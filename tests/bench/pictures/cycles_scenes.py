"""Scenes of tests/bench/pictures/cycles, in a form that two renderers read. A scene is a Picture: one triangle mesh, materials by kind, lights as
Quarry's view files have them, and a camera. Kinds of materials: diffuse, metal (white), layer (a matt body under a clear layer), glass, emission."""
import dataclasses
import gzip
import math

import numpy

BLACK = (0, 0, 0)
KITCHEN = "bitterli_country_kitchen"


@dataclasses.dataclass
class Picture:
    mesh: "Mesh"
    camera: dict
    lights: list = dataclasses.field(default_factory=list)
    sky: tuple = BLACK          # radiance; the eye sees it too
    environment: bool = False   # whether photograph() lights it, in place of the sky
    bounces: int = 16
    tolerance: float = 0.01     # relative, of a block


class Mesh:
    """Triangles with materials. Normals are kept if every vertex has one."""

    def __init__(self):
        self.vertices, self.triangles, self.materials, self.normals = [], [], [], []
        self.kinds, self.count = [], 0

    def material(self, kind, **values):
        self.kinds.append({"kind": kind, **values})
        return len(self.kinds) - 1

    def add(self, vertices, triangles, material, normals=None):
        """`material`: one number, or one a triangle."""
        self.vertices.append(numpy.asarray(vertices, dtype=numpy.float32))
        self.triangles.append(numpy.asarray(triangles, dtype=numpy.int32) + self.count)
        self.materials.append(numpy.broadcast_to(numpy.asarray(material, dtype=numpy.int32), len(triangles)))
        self.normals.append(normals)
        self.count += len(vertices)

    def arrays(self):
        made = {"vertices": numpy.concatenate(self.vertices), "triangles": numpy.concatenate(self.triangles),
                "materials": numpy.concatenate(self.materials)}
        if all(n is not None for n in self.normals):
            made["normals"] = numpy.concatenate(self.normals).astype(numpy.float32)
        return made

    def sphere(self, centre, radius, material, rings=48, smooth=False):
        """Rings of triangles. Shared vertices; the normals are the sphere's."""
        up, around = numpy.meshgrid(numpy.linspace(0, math.pi, rings + 1), numpy.linspace(0, 2 * math.pi, 2 * rings, endpoint=False), indexing="ij")
        unit = numpy.stack([numpy.sin(up) * numpy.cos(around), numpy.cos(up), numpy.sin(up) * numpy.sin(around)], -1).reshape(-1, 3)
        row, column = (a.ravel() for a in numpy.meshgrid(numpy.arange(rings), numpy.arange(2 * rings), indexing="ij"))
        a, b = row * 2 * rings + column, row * 2 * rings + (column + 1) % (2 * rings)
        c, d = a + 2 * rings, b + 2 * rings
        upper, lower = numpy.stack([a, b, c], -1)[row > 0], numpy.stack([b, d, c], -1)[row < rings - 1]
        self.add(numpy.asarray(centre) + radius * unit, numpy.concatenate([upper, lower]), material, unit if smooth else None)


def read_obj(path):
    """Vertices, triangles (polygons as fans), the number of each triangle's material, and the names of the materials."""
    vertices, triangles, materials, names = [], [], [], {}
    current = 0
    with (gzip.open if path.suffix == ".gz" else open)(path, "rt") as lines:
        for line in lines:
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                vertices.append((float(words[1]), float(words[2]), float(words[3])))
            elif words[0] == "f":
                at = [int(w.split("/", 1)[0]) for w in words[1:]]
                at = [i - 1 if i > 0 else len(vertices) + i for i in at]
                for k in range(1, len(at) - 1):
                    triangles.append((at[0], at[k], at[k + 1]))
                    materials.append(current)
            elif words[0] == "usemtl":
                current = names.setdefault(words[1], len(names))
    return numpy.array(vertices), numpy.array(triangles), numpy.array(materials), list(names)


def read_mtl(path):
    """By name: the words of each line, by their first."""
    materials, current = {}, None
    for line in path.read_text().splitlines():
        words = line.split("#")[0].split()
        if words and words[0] == "newmtl":
            current = materials.setdefault(words[1], {})
        elif words:
            current[words[0]] = [float(w) for w in words[1:]] if words[0] != "map_Kd" else words[1:]
    return materials


WHITE, RED, GREEN = (0.725, 0.71, 0.68), (0.63, 0.065, 0.05), (0.14, 0.45, 0.091)
CORNELL_CAMERA = {"eye": [0, 1, 3.9], "at": [0, 1, 0], "up": [0, 1, 0], "fov": 36}


def box(corners, height):
    """The sides and the top of a box on the floor. `corners`: x and z, seen from above around to the left."""
    low, high = [(x, 0, z) for x, z in corners], [(x, height, z) for x, z in corners]
    return [(low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]) for i in range(4)] + [tuple(high)]


ROOM = {
    "floor": [((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1))],
    "ceiling": [((-1, 2, 1), (-1, 2, -1), (1, 2, -1), (1, 2, 1))],
    "back": [((-1, 0, -1), (1, 0, -1), (1, 2, -1), (-1, 2, -1))],
    "right": [((1, 0, -1), (1, 0, 1), (1, 2, 1), (1, 2, -1))],
    "left": [((-1, 0, 1), (-1, 0, -1), (-1, 2, -1), (-1, 2, 1))],
    "short": box([(0.53, 0.75), (0.7, 0.17), (0.13, 0), (-0.05, 0.57)], 0.6),
    "tall": box([(-0.53, 0.09), (0.04, -0.09), (-0.14, -0.67), (-0.71, -0.49)], 1.2),
    "light": [((-0.24, 1.98, 0.16), (-0.24, 1.98, -0.22), (0.23, 1.98, -0.22), (0.23, 1.98, 0.16))],
}


def cornell(kinds=(), extra=None, **more):
    """The Cornell box, with McGuire's boxes in an even room. `kinds`: materials by the names in ROOM, where they are not matt; None: not there.
    `extra` adds to the mesh."""
    mesh, colors = Mesh(), {"left": RED, "right": GREEN}
    given = {"light": {"kind": "emission", "radiance": (17, 12, 4)}} | dict(kinds)
    for name, quads in ROOM.items():
        kind = given.get(name, {"kind": "diffuse", "color": colors.get(name, WHITE)})
        if kind:
            number = mesh.material(**kind)
            for quad in quads:
                mesh.add(quad, [(0, 1, 2), (0, 2, 3)], number)
    if extra:
        extra(mesh)
    return Picture(mesh, CORNELL_CAMERA, **more)


def metal(roughness):
    return {"kind": "metal", "roughness": roughness}


def layer(color, ior, roughness):
    return {"kind": "layer", "color": color, "ior": ior, "roughness": roughness, "body": light_left(ior, roughness) if roughness > 0 else []}


def fresnel(cosine, ior):
    g = numpy.sqrt(ior * ior - 1 + cosine * cosine)
    return 0.5 * ((g - cosine) / (g + cosine)) ** 2 * (1 + ((cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)) ** 2)


def light_left(ior, roughness, points=33, side=96):
    """The share of light that a rough layer leaves to the body, as pairs of cosine and share: 1 less the integral of the layer's lobe, GGX with visible
    normals (Heitz 2018) and height-correlated shadowing, scaled up for light that is reflected twice as Turquin 2019 does."""
    alpha = roughness * roughness
    u, v = (a.ravel() for a in numpy.meshgrid((numpy.arange(side) + 0.5) / side, (numpy.arange(side) + 0.5) / side))

    def smith(z):
        return 0.5 * (numpy.sqrt(1 + alpha * alpha * (1 - z * z) / (z * z)) - 1)

    pairs = []
    for cosine in numpy.linspace(0, 1, points):
        view = numpy.array([math.sqrt(1 - cosine * cosine), 0, max(cosine, 1e-3)])
        stretched = view * (alpha, alpha, 1)
        stretched /= numpy.linalg.norm(stretched)
        first = numpy.array([0, 1, 0])
        second = numpy.cross(stretched, first)
        radius, angle = numpy.sqrt(u), 2 * math.pi * v
        a, b = radius * numpy.cos(angle), radius * numpy.sin(angle)
        s = 0.5 * (1 + stretched[2])
        b = (1 - s) * numpy.sqrt(1 - a * a) + s * b
        facet = a[:, None] * first + b[:, None] * second + numpy.sqrt(numpy.maximum(1 - a * a - b * b, 0))[:, None] * stretched
        facet = facet * (alpha, alpha, 1)
        facet /= numpy.linalg.norm(facet, axis=1)[:, None]
        toward = facet @ view
        height = 2 * toward * facet[:, 2] - view[2]
        share = numpy.where(height > 0, (1 + smith(view[2])) / (1 + smith(view[2]) + smith(numpy.maximum(height, 1e-6))), 0)
        full = share.mean()
        pairs.append((float(cosine), float(1 - (share * fresnel(toward, ior)).mean() * (1 + fresnel(1.0, ior) * (1 - full) / full))))
    return pairs


LAMP = {"type": "rectangle", "position": [0, 1.97, -0.03], "edges": [[0.5, 0, 0], [0, 0, 0.4]], "radiance": [17, 12, 4]}
SUN = {"type": "sun", "direction": [0.3, 0.5, 1], "radiance": [3, 2.8, 2.5], "angle": 4}
GLASS = {"kind": "glass", "ior": 1.5}
NO_BOXES, NO_LIGHT = {"short": None, "tall": None}, {"light": None}


def spheres():
    """A white sphere of each roughness in a white sky. Their radiance is 1 by the law of energy."""
    mesh = Mesh()
    for i in range(9):
        mesh.sphere((i % 3 - 1, i // 3 - 1, 0), 0.45, mesh.material(**metal(0.2 + 0.1 * i)))
    return Picture(mesh, {"eye": [0, 0, 8], "at": [0, 0, 0], "up": [0, 1, 0], "fov": 24}, sky=(1, 1, 1), bounces=4, tolerance=0.02)


def balls(*kinds):
    def add(mesh):
        for kind, place in zip(kinds, ((-0.5, 0.4, -0.3), (0.45, 0.35, 0.35))):
            mesh.sphere(place, place[1] - 0.001, mesh.material(**kind))
    return add


def photograph(width=512):
    """An image of all directions, as rows of linear RGB: a bright haze on one side, a ground, and a sun of some texels, 20,000 times as bright as the rest."""
    x, y = numpy.meshgrid((numpy.arange(width) + 0.5) / width, (numpy.arange(width // 2) + 0.5) / (width // 2))
    height = numpy.cos(math.pi * y)
    side = 0.5 + 0.5 * numpy.cos(2 * math.pi * (x - 0.6))
    blue = numpy.stack([0.2 + 0.5 * side, 0.3 + 0.4 * side, 0.6 + 0.1 * side], -1)
    rows = numpy.where((height > 0)[..., None], blue * (1.2 - numpy.maximum(height, 0))[..., None], (0.12, 0.1, 0.07))
    rows[(numpy.hypot((x - 0.7) * 2, y - 0.3) < 0.01)] = (12000, 11000, 9000)
    return rows


def smooth(**more):
    """Spheres with normals of vertices, in a room with normals of faces."""
    mesh = Mesh()
    floor = mesh.material("diffuse", color=WHITE)
    mesh.add([(-4, 0, -4), (-4, 0, 4), (4, 0, 4), (4, 0, -4)], [(0, 1, 2), (0, 2, 3)], floor, numpy.tile([0, 1, 0], (4, 1)))
    for x, kind in ((-1.1, {"kind": "diffuse", "color": RED}), (0, metal(0.3)), (1.1, layer(GREEN, 1.5, 0))):
        mesh.sphere((x, 0.5, 0), 0.5, mesh.material(**kind), smooth=True)
    return Picture(mesh, {"eye": [0, 2, 5], "at": [0, 0.4, 0], "up": [0, 1, 0], "fov": 36}, **({"lights": [SUN], "sky": (0.5, 0.6, 0.8), "tolerance": 0.02} | more))


def kitchen(scenes, kind):
    """The kitchen with flat facets. `kind`: diffuse; ggx, where metals are rough and white; or fresnel, where shiny paint has a smooth clear layer
    and glass refracts. Textures count as their mean, about 0.4; white paint is 0.7 at most, so that light ends in the room."""
    folder = scenes / KITCHEN
    vertices, triangles, numbers, names = read_obj(folder / "scene.obj.gz")
    library, mesh, made, there = read_mtl(folder / "scene.mtl"), Mesh(), [], []
    for name in names:
        m = library[name]
        color = (0.45, 0.38, 0.3) if "map_Kd" in m else tuple(min(c, 0.7) for c in m["Kd"])
        illum, shiny = m.get("illum", [2])[0], max(m.get("Ks", BLACK)) > 0
        glass = illum == 7
        there.append(not glass or kind == "fresnel")
        if max(m.get("Ke", BLACK)) > 0:
            made.append(mesh.material("emission", radiance=tuple(m["Ke"])))
        elif glass:
            made.append(mesh.material(**GLASS))
        elif illum == 3 and kind == "ggx":
            made.append(mesh.material(**metal(max(0.2, (2 / (m["Ns"][0] + 2)) ** 0.25))))
        elif shiny and illum == 2 and kind == "fresnel":
            made.append(mesh.material(**layer(color, 1.5, 0)))
        else:
            made.append(mesh.material("diffuse", color=(0.5, 0.5, 0.5) if illum == 3 else color))
    kept = numpy.array(there)[numbers]
    mesh.add(vertices, triangles[kept], numpy.array(made)[numbers[kept]])
    camera = {"eye": [1.211, 1.8047, 3.8524], "at": [-1.2617, 1.5696, -1.2157], "up": [0, 1, 0], "fov": 40}
    return Picture(mesh, camera, tolerance=0.02 if kind == "ggx" else 0.01)


SCENES = {
    "spheres": lambda s: spheres(),
    "cornell-diffuse": lambda s: cornell(),
    "cornell-lamp": lambda s: cornell(NO_LIGHT, lights=[LAMP], bounces=2),
    "cornell-sun-and-sky": lambda s: cornell(NO_LIGHT, lights=[SUN], sky=(0.3, 0.4, 0.6)),
    "cornell-ggx": lambda s: cornell({"tall": metal(0.3), "short": metal(0.6), "back": metal(0.8)}, tolerance=0.02),
    "cornell-fresnel": lambda s: cornell({"tall": metal(0), "short": layer(WHITE, 1.5, 0), "floor": layer(WHITE, 1.5, 0), "back": layer(GREEN, 2, 0)}),
    "cornell-glass": lambda s: cornell(NO_LIGHT | NO_BOXES, balls(GLASS, metal(0)), lights=[LAMP]),
    "cornell-rough-layer": lambda s: cornell({"tall": layer(RED, 1.5, 0.3), "short": layer(WHITE, 1.5, 0.5), "floor": layer(WHITE, 1.5, 0.4),
                                              "back": layer(GREEN, 2, 0.7)}, tolerance=0.02),
    "smooth": lambda s: smooth(),
    "cornell-environment": lambda s: cornell(NO_LIGHT | {"tall": metal(0.3)}, environment=True, tolerance=0.02),
    "smooth-environment": lambda s: smooth(lights=[], sky=BLACK, environment=True),
    "kitchen-diffuse": lambda s: kitchen(s, "diffuse"),
    "kitchen-ggx": lambda s: kitchen(s, "ggx"),
    "kitchen-fresnel": lambda s: kitchen(s, "fresnel"),
}

"""Models in formats of today's tools, for tests/bench/pictures/first_pictures and the tests of readers: STEP, Draco in glTF, 3MF, and a PLY with a texture."""
import io
import math
import shutil
import subprocess
import zipfile

from tests.support.models import first_models
from tests.support.models.textured_scene import glb, png

MODEL_PART = "3D/3dmodel.model"
DRACO = "KHR_draco_mesh_compression"


def draco_glb(mesh):
    """A GLB of the bytes that draco_encoder writes; positions are its attribute 0."""
    document = {
        "asset": {"version": "2.0"}, "extensionsUsed": [DRACO], "extensionsRequired": [DRACO],
        "buffers": [{"byteLength": len(mesh)}], "bufferViews": [{"buffer": 0, "byteLength": len(mesh)}],
        "accessors": [{"componentType": 5126, "count": 1, "type": "VEC3"}, {"componentType": 5125, "count": 3, "type": "SCALAR"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "extensions": {DRACO: {"bufferView": 0, "attributes": {"POSITION": 0}}}}]}],
        "nodes": [{"mesh": 0}]}
    return glb(document, mesh)


def assembly(folder, binaries, _):
    """A STEP file of 300 parts of forty shapes in three levels, with names and colours."""
    path = folder / "assembly.step"
    writer = binaries / "quarry-test-cad"
    return writer.exists() and not subprocess.run([writer, "write", path, "300", "40", "MM"], capture_output=True).returncode and path


def draco_scan(folder, _, scenes):
    """The dragon of a scanner, y up, as Draco in a GLB."""
    scan, packed, path = scenes / "dragon/dragon_vrip_res2.ply", folder / "scan.drc", folder / "draco-scan.glb"
    if not scan.exists() or not shutil.which("draco_encoder"):
        return None
    subprocess.run(["draco_encoder", "-i", scan, "-o", packed, "-qp", "14"], check=True, capture_output=True)
    path.write_bytes(draco_glb(packed.read_bytes()))
    packed.unlink()
    return path


def archive_3mf(model):
    """A 3MF of the bytes of its model."""
    relationships = ('<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="r" '
                     f'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="/{MODEL_PART}"/></Relationships>')
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in (("[Content_Types].xml", "<Types/>"), ("_rels/.rels", relationships), (MODEL_PART, model)):
            archive.writestr(name, content)
    return out.getvalue()


def print_3mf(folder, *_):
    """A bust of 80 mm on a printer's plate, three times, one of them red."""
    mesh = first_models.bust()
    numbers = {}
    for triangle in mesh.triangles:
        for p in triangle:
            numbers.setdefault(tuple(round(100 * v, 6) for v in p), len(numbers))
    vertices = "".join('<vertex x="%.7g" y="%.7g" z="%.7g"/>' % p for p in numbers)
    faces = ([numbers[tuple(round(100 * v, 6) for v in p)] for p in t] for t in mesh.triangles)
    triangles = "".join('<triangle v1="%d" v2="%d" v3="%d"/>' % tuple(f) for f in faces)
    objects = "".join(f'<object id="{i}" type="model" {looks}><mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh></object>'
                      for i, looks in ((1, ""), (2, 'pid="9" pindex="0"')))
    items = "".join(f'<item objectid="{i}" transform="1 0 0 0 1 0 0 0 1 {x} 100 0"/>' for i, x in ((1, 30), (2, 110), (1, 190)))
    model = ('<?xml version="1.0"?><model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><basematerials id="9">'
             f'<base name="red" displaycolor="#D03020FF"/></basematerials>{objects}</resources><build>{items}</build></model>')
    (folder / "print.3mf").write_bytes(archive_3mf(model.encode()))
    return folder / "print.3mf"


def vase_image(path, width=256, height=256):
    """Bands and dots in three colours, as a PNG."""
    def colour(x, y):
        if y % 64 < 10:
            return (20, 60, 130)
        return (190, 70, 30) if math.hypot(x % 32 - 16, y % 64 - 37) < 10 else (232, 222, 200)
    path.write_bytes(png(width, height, lambda y: b"".join(bytes(colour(x, y)) for x in range(width))))


def textured_ply(folder, *_, columns=96):
    """A painted vase, z up: `comment TextureFile`, and coordinates at each face's corners as scanners write them."""
    profile = [(0.0, 0.0), (0.5, 0.0), (0.62, 0.25), (0.85, 0.8), (0.8, 1.4), (0.45, 1.9), (0.33, 2.2), (0.36, 2.5), (0.5, 2.65)]
    rows = 8 * (len(profile) - 1)
    vertices = []
    for j in range(rows + 1):
        i, t = divmod(j, 8)
        (r, z), (s, w) = profile[min(i, len(profile) - 1)], profile[min(i + 1, len(profile) - 1)]
        r, z = r + (s - r) * t / 8, z + (w - z) * t / 8
        vertices += [(r * math.cos(first_models.TURN * c / columns), r * math.sin(first_models.TURN * c / columns), z) for c in range(columns)]
    faces = []
    for j in range(rows):
        for c in range(columns):
            at = lambda column, row: (row * columns + column % columns, 2 * column / columns, row / rows)
            a, b, d, e = at(c, j), at(c + 1, j), at(c + 1, j + 1), at(c, j + 1)
            faces += [(a, b, d), (a, d, e)] if j else [(a, d, e)]
    vase_image(folder / "vase.png")
    head = ["ply", "format ascii 1.0", "comment TextureFile vase.png", f"element vertex {len(vertices)}", "property float x", "property float y",
            "property float z", f"element face {len(faces)}", "property list uchar int vertex_indices", "property list uchar float texcoord", "end_header"]
    lines = ["%.7g %.7g %.7g" % p for p in vertices]
    lines += ["3 %d %d %d 6 " % tuple(corner[0] for corner in f) + " ".join("%.7g %.7g" % corner[1:] for corner in f) for f in faces]
    (folder / "textured.ply").write_text("\n".join(head + lines) + "\n")
    return folder / "textured.ply"


# name -> (function of the folder, the programs' folder and the scenes' folder that gives the model's path, or nothing; its needs)
FILES = {"assembly": (assembly, "quarry-test-cad"), "draco-scan": (draco_scan, "dragon, or draco_encoder,"), "print": (print_3mf, ""),
         "textured": (textured_ply, "")}

"""A picture of the gallery beside the one of Cycles: the same view, exposure and curve."""
import gzip
import json
import math
import pathlib
import shutil
import subprocess
import sys

sys.dont_write_bytecode = True
from tests.integration.exr import read_exr
from tests.support.models.textured_scene import png

HERE = pathlib.Path(__file__).resolve().parent
# Of a clear day's sky, to the sun: its place is taken by one radiance.
SKY = (0.25, 0.3, 0.4)


def numpy_of():
    """numpy, which only --cycles needs; None where it is not there."""
    try:
        import numpy
        return numpy
    except ImportError:
        return None


def unpacked(model, folder):
    """An OBJ that Blender can open, beside its MTL and textures."""
    if model.suffix != ".gz":
        return model
    into = folder / f"{model.parent.name}.unpacked"
    into.mkdir(exist_ok=True)
    for beside in model.parent.iterdir():
        if beside != model and not (into / beside.name).exists():
            (into / beside.name).symlink_to(beside.resolve())
    with gzip.open(model) as packed, open(into / model.stem, "wb") as whole:
        shutil.copyfileobj(packed, whole)
    return into / model.stem


def principled(m, colored):
    """A material of a .materials.json as Blender's Principled shader has it."""
    root = (m["specular_ior"] - 1) / (m["specular_ior"] + 1)
    return {"kind": "principled", "color": m["base_color"], "metalness": m["base_metalness"], "roughness": m["specular_roughness"],
            "specular": m["specular_weight"] * root * root / 0.08, "transmission": m["transmission_weight"], "ior": m["specular_ior"],
            "emission": m["emission"], "colored": colored}


def arrays_of_plant(ply):
    """quarry-scene's PLY and its materials as gallery_blender.py reads them: the path of the .npz."""
    numpy, data = numpy_of(), ply.read_bytes()
    end = data.index(b"end_header\n") + 11
    counts = [int(line.split()[2]) for line in data[:end].decode().splitlines() if line.startswith("element")]
    vertices = numpy.frombuffer(data, [("at", "<f4", 3), ("color", "u1", 3)], counts[0], end)
    faces = numpy.frombuffer(data, [("count", "u1"), ("corners", "<u4", 3), ("material", "<u2"), ("part", "<u4")], counts[1], end + vertices.nbytes)
    shown = vertices["color"] / 255
    linear = numpy.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    numpy.savez(ply.with_suffix(".npz"), vertices=vertices["at"], triangles=faces["corners"], materials=faces["material"],
                colors=numpy.concatenate([linear, numpy.ones((counts[0], 1))], axis=1))
    materials = json.loads(ply.with_suffix(".materials.json").read_text())["materials"]
    ply.with_suffix(".json").write_text(json.dumps({"materials": [principled(m, True) for m in materials]}))
    return ply.with_suffix(".npz")


def array_of(path):
    numpy, rows = numpy_of(), read_exr(path).rows
    return numpy.stack([numpy.array(rows[c], dtype=numpy.float64) for c in "RGB"], -1)


def common_view(path):
    """Rewrites a view file so that both programs light by it alike."""
    view = json.loads(path.read_text())
    if "turbidity" in view.get("sky", {}):
        sun = next((light["radiance"] for light in view["lights"] if light["type"] == "sun"), (1, 1, 1))
        view["sky"] = {"radiance": [a * b for a, b in zip(SKY, sun)]}
    view["background"] = view.get("sky", {"radiance": (0, 0, 0)})["radiance"]
    path.write_text(json.dumps(view))


def beside(render, model, picture, ev):
    """`render`: Quarry's command without output and view. Writes PICTURE.cycles.png; the ratio of the means and of the medians, Quarry's over Cycles'."""
    numpy = numpy_of()
    view, ours, theirs = (picture.with_suffix(suffix) for suffix in (".view.json", ".quarry.exr", ".cycles.exr"))
    common_view(view)
    subprocess.run([*render, "--view", view, "-o", ours], check=True)
    samples = json.loads(view.read_text())["spp"]
    done = subprocess.run(["blender", "-b", "--factory-startup", "--python-exit-code", "1", "--python", HERE / "gallery_blender.py", "--", model, view,
                           str(samples), theirs], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"Blender failed on {picture.stem}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    pictures = [array_of(path) for path in (ours, theirs)]
    shown = [numpy.clip(p * math.pow(2, ev), 0, None) for p in pictures]
    # A curve that rolls bright values off, the same for both.
    sheet = ((numpy.concatenate([s / (1 + 0.5 * s) for s in shown], axis=1).clip(0, 1) ** (1 / 2.2)) * 255 + 0.5).astype(numpy.uint8)
    picture.with_suffix(".cycles.png").write_bytes(png(sheet.shape[1], sheet.shape[0], lambda y: sheet[y].tobytes()))
    for path in (view, ours, theirs):
        path.unlink()
    return tuple(f(pictures[0]) / max(f(pictures[1]), 1e-9) for f in (numpy.mean, numpy.median))

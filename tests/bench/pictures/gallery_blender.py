"""Blender's side of `tests/bench/pictures/gallery --cycles`: renders a model with Cycles as a view of Quarry shows it, into an EXR of linear floats.
An OBJ is read by Blender's own importer, which makes Principled materials of its MTL. The roughness of a material is then set by Quarry's rule for Ns,
since Blender's is another. Blender takes each Tf for glass; here only illum 4, 6, 7 and 9 are glass. Blender shows map_Kd alone, where an MTL means
its product with Kd. An NPZ holds arrays as in cycles_blender.py, with a JSON of its materials beside it.
Run by that program: blender -b --factory-startup --python-exit-code 1 --python gallery_blender.py -- MODEL VIEW.json SAMPLES OUT.exr"""
import json
import pathlib
import sys

import bpy
import numpy

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import cycles_blender


GLASS = (4, 6, 7, 9)


def values_of(path, key):
    """The numbers after a keyword by material, from the MTL files that lie beside an OBJ."""
    found = {}
    for mtl in path.parent.glob("*.mtl"):
        name = None
        for words in (line.split("#")[0].split() for line in mtl.read_text(errors="replace").splitlines()):
            if words[:1] == ["newmtl"] and len(words) > 1:
                name = words[1]
            elif words[:1] == [key] and len(words) > 1:
                found[name] = [float(word) for word in words[1:]]
    return found


def read_obj(path):
    bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z")
    exponents, models, colors = (values_of(path, key) for key in ("Ns", "illum", "Kd"))
    for material in bpy.data.materials:
        for node in material.node_tree.nodes if material.use_nodes else ():
            if node.type == "BSDF_PRINCIPLED":
                node.distribution = "MULTI_GGX"
                if material.name in exponents:
                    node.inputs["Roughness"].default_value = (2 / (max(exponents[material.name][0], 0) + 2)) ** 0.25
                if models.get(material.name, [0])[0] not in GLASS:
                    node.inputs["Transmission"].default_value = 0
                if node.inputs["Base Color"].is_linked and material.name in colors:
                    product = material.node_tree.nodes.new("ShaderNodeVectorMath")
                    product.operation = "MULTIPLY"
                    material.node_tree.links.new(node.inputs["Base Color"].links[0].from_socket, product.inputs[0])
                    product.inputs[1].default_value = colors[material.name][:3]
                    material.node_tree.links.new(product.outputs[0], node.inputs["Base Color"])


def main():
    model, view_path, samples, out = sys.argv[sys.argv.index("--") + 1:]
    view = json.loads(pathlib.Path(view_path).read_text())
    cycles_blender.make_empty()
    if model.endswith(".npz"):
        cycles_blender.make_mesh(json.loads(pathlib.Path(model).with_suffix(".json").read_text()), numpy.load(model))
    else:
        read_obj(pathlib.Path(model))
    for light in view["lights"]:
        if light.get("position") == "eye":
            light["position"] = view["camera"]["eye"]
        cycles_blender.make_light({"angle": 0.53} | light)
    cycles_blender.make_camera(view["camera"])
    cycles_blender.make_world(view.get("sky", {"radiance": (0, 0, 0)})["radiance"])
    cycles_blender.set_options({"bounces": view.get("bounces", 8)}, *view["size"], int(samples))
    bpy.context.scene.render.filepath = out
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()

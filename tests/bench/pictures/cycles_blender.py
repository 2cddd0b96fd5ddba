"""Blender's side of tests/bench/pictures/cycles: reads a scene of cycles_scenes.py from FOLDER and renders it with Cycles, one EXR a seed.
gallery_blender.py takes its lights, cameras and options from here. Run by that bench: blender -b --factory-startup --python-exit-code 1 --python cycles_blender.py -- FOLDER NAME SIZE SAMPLES SEED,SEED...
Reads FOLDER/NAME.json and FOLDER/NAME.npz; writes FOLDER/NAME.cycles.SEED.exr, linear floats of 32 bits, and FOLDER/NAME.cycles.json, the seconds of each. A picture
of one sample goes before, so that none of them builds Cycles' tree."""
import json
import math
import pathlib
import sys
import time

import bpy
import numpy
from mathutils import Matrix, Vector


class Nodes:
    """The node tree of one material or world; links by the names of sockets."""

    def __init__(self, owner):
        owner.use_nodes = True
        self.tree = owner.node_tree
        self.tree.nodes.clear()

    def add(self, kind, settings=(), **inputs):
        node = self.tree.nodes.new(kind)
        for name, value in dict(settings).items():
            setattr(node, name, value)
        for name, value in inputs.items():
            key = int(name[1:]) if name[0] == "_" else name.replace("_", " ")
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, node.inputs[key])
            else:
                node.inputs[key].default_value = value
        return node

    def math(self, operation, *values):
        return self.add("ShaderNodeMath", {"operation": operation}, **{f"_{i}": v for i, v in enumerate(values)}).outputs[0]


def opaque(color):
    return (*color, 1)


def fresnel_of(nodes, ior):
    """The Fresnel node inverts the index behind a surface; a layer has the same index on both sides, so the inversion is undone."""
    behind = nodes.add("ShaderNodeNewGeometry").outputs["Backfacing"]
    sign = nodes.math("SUBTRACT", 1.0, nodes.math("MULTIPLY", behind, 2.0))
    return nodes.add("ShaderNodeFresnel", IOR=nodes.math("POWER", ior, sign)).outputs[0]


def layered(nodes, m):
    """A matt body under a clear layer. A smooth layer is the Fresnel node's mix with a mirror. A rough layer is the specular lobe of
    Principled, and the body is darkened by the share that this lobe sends back to the viewer, by a curve over the cosine."""
    if m["roughness"] == 0:
        return nodes.add("ShaderNodeMixShader", _0=fresnel_of(nodes, m["ior"]),
                         _1=nodes.add("ShaderNodeBsdfDiffuse", Color=opaque(m["color"])).outputs[0],
                         _2=nodes.add("ShaderNodeBsdfGlossy", {"distribution": "SHARP"}, Color=opaque((1, 1, 1))).outputs[0])
    geometry = nodes.add("ShaderNodeNewGeometry")
    cosine = nodes.add("ShaderNodeVectorMath", {"operation": "DOT_PRODUCT"}, _0=geometry.outputs["Incoming"], _1=geometry.outputs["Normal"])
    curve = nodes.add("ShaderNodeFloatCurve", Value=nodes.math("ABSOLUTE", cosine.outputs["Value"]))
    points = curve.mapping.curves[0].points
    for x, y in m["body"]:
        # The curve has two points from the start, at 0 and at 1.
        point = points[0 if x == 0 else 1] if x in (0, 1) else points.new(x, y)
        point.location = (x, y)
    for point in points:
        point.handle_type = "VECTOR"
    curve.mapping.update()
    body = nodes.add("ShaderNodeVectorMath", {"operation": "SCALE"}, _0=m["color"], Scale=curve.outputs[0])
    root = (m["ior"] - 1) / (m["ior"] + 1)
    lobe = nodes.add("ShaderNodeBsdfPrincipled", {"distribution": "MULTI_GGX"}, Base_Color=opaque((0, 0, 0)), Specular=root * root / 0.08,
                     Roughness=m["roughness"])
    return nodes.add("ShaderNodeAddShader", _0=nodes.add("ShaderNodeBsdfDiffuse", Color=body.outputs[0]).outputs[0], _1=lobe.outputs[0])


def material_of(m):
    made = bpy.data.materials.new(m["kind"])
    nodes = Nodes(made)
    if m["kind"] == "diffuse":
        shader = nodes.add("ShaderNodeBsdfDiffuse", Color=opaque(m["color"]))
    elif m["kind"] == "metal":
        shader = nodes.add("ShaderNodeBsdfGlossy", {"distribution": "MULTI_GGX" if m["roughness"] > 0 else "SHARP"}, Color=opaque((1, 1, 1)),
                           Roughness=m["roughness"])
    elif m["kind"] == "layer":
        shader = layered(nodes, m)
    elif m["kind"] == "glass":
        shader = nodes.add("ShaderNodeBsdfGlass", {"distribution": "SHARP"}, Color=opaque((1, 1, 1)), IOR=m["ior"])
    elif m["kind"] == "principled":
        shader = nodes.add("ShaderNodeBsdfPrincipled", {"distribution": "MULTI_GGX"}, Base_Color=opaque(m["color"]), Metallic=m["metalness"],
                           Specular=m["specular"], Roughness=m["roughness"], Transmission=m["transmission"], IOR=m["ior"],
                           Emission=opaque(m["emission"]), Emission_Strength=1.0)
        if m["colored"]:
            tint = nodes.add("ShaderNodeVertexColor", {"layer_name": "colors"})
            base = nodes.add("ShaderNodeVectorMath", {"operation": "MULTIPLY"}, _0=tint.outputs[0], _1=m["color"])
            nodes.tree.links.new(base.outputs[0], shader.inputs["Base Color"])
    else:
        shader = nodes.add("ShaderNodeEmission", Color=opaque(m["radiance"]), Strength=1)
    nodes.add("ShaderNodeOutputMaterial", Surface=shader.outputs[0])
    return made


def make_mesh(scene, arrays):
    vertices, triangles = arrays["vertices"], arrays["triangles"]
    mesh = bpy.data.meshes.new("mesh")
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(numpy.float32).ravel())
    mesh.loops.add(3 * len(triangles))
    mesh.loops.foreach_set("vertex_index", triangles.astype(numpy.int32).ravel())
    mesh.polygons.add(len(triangles))
    mesh.polygons.foreach_set("loop_start", numpy.arange(0, 3 * len(triangles), 3, dtype=numpy.int32))
    mesh.polygons.foreach_set("loop_total", numpy.full(len(triangles), 3, dtype=numpy.int32))
    for m in scene["materials"]:
        mesh.materials.append(material_of(m))
    mesh.polygons.foreach_set("material_index", arrays["materials"].astype(numpy.int32))
    if "colors" in arrays:
        colors = mesh.color_attributes.new("colors", "FLOAT_COLOR", "POINT")
        colors.data.foreach_set("color", arrays["colors"].astype(numpy.float32).ravel())
    smooth = "normals" in arrays
    mesh.polygons.foreach_set("use_smooth", numpy.full(len(triangles), smooth))
    mesh.update(calc_edges=True)
    if smooth:
        mesh.use_auto_smooth = True
        mesh.normals_split_custom_set_from_vertices(arrays["normals"].tolist())
    bpy.context.collection.objects.link(bpy.data.objects.new("mesh", mesh))


def add_lamp(kind, light, towards, right=None):
    """An object whose own -Z points `towards`."""
    z = -Vector(towards).normalized()
    x = Vector(right).normalized() if right else z.orthogonal().normalized()
    lamp = bpy.data.lights.new(kind, kind)
    held = bpy.data.objects.new(kind, lamp)
    held.matrix_world = Matrix((x, z.cross(x), z)).transposed().to_4x4()
    held.matrix_world.translation = Vector(light.get("position", (0, 0, 0)))
    held.visible_camera = True  # as Quarry's are; Blender hides lamps
    bpy.context.collection.objects.link(held)
    lamp.cycles.use_multiple_importance_sampling = True
    return lamp


def make_light(light):
    if light["type"] == "sun":
        half = math.radians(light["angle"]) / 2
        lamp = add_lamp("SUN", light, [-x for x in light["direction"]])
        lamp.angle = 2 * half
        # A sun of strength E has the radiance E / (pi tan^2); Quarry's, pi radiance / (2 pi (1 - cos)).
        scale = math.pi * math.tan(half) ** 2 * math.pi / (2 * math.pi * (1 - math.cos(half)))
        lamp.color, lamp.energy = light["radiance"], scale
        return
    if light["type"] == "point":
        lamp = add_lamp("POINT", light, (0, 0, -1))
        lamp.shadow_soft_size = 0
        lamp.color, lamp.energy = light["radiance"], 4 * math.pi ** 2  # Blender: irradiance at distance 1 = energy / (4 pi)
        return
    first, second = (Vector(e) for e in light["edges"])
    lamp = add_lamp("AREA", light, first.cross(second), first)
    lamp.shape, lamp.size, lamp.size_y = "RECTANGLE", first.length, second.length
    lamp.color, lamp.energy = light["radiance"], 4 * first.length * second.length  # Blender: radiance = energy / (4 area)


def make_camera(camera):
    made = bpy.data.cameras.new("camera")
    made.sensor_fit, made.sensor_width, made.sensor_height = "VERTICAL", 32, 32
    made.angle = math.radians(camera["fov"])
    made.clip_start, made.clip_end = 1e-4, 1e5
    held = bpy.data.objects.new("camera", made)
    eye = Vector(camera["eye"])
    z = (eye - Vector(camera["at"])).normalized()
    x = Vector(camera["up"]).cross(z).normalized()
    held.matrix_world = Matrix((x, z.cross(x), z)).transposed().to_4x4()
    held.matrix_world.translation = eye
    bpy.context.collection.objects.link(held)
    bpy.context.scene.camera = held


def set_options(scene, width, height, samples):
    bpy.context.scene.render.engine = "CYCLES"
    options = {"device": "CPU", "use_denoising": False, "samples": samples, "use_adaptive_sampling": False, "light_sampling_threshold": 0,
               "min_light_bounces": 0, "min_transparent_bounces": 0, "caustics_reflective": True, "caustics_refractive": True, "blur_glossy": 0,
               "use_guiding": False, "pixel_filter_type": "BOX", "filter_width": 1, "sample_clamp_direct": 0, "sample_clamp_indirect": 0,
               "use_fast_gi": False, "use_auto_tile": False, "film_exposure": 1, "time_limit": 0}
    for kind in ("max", "diffuse", "glossy", "transmission"):
        options[f"{kind}_bounces"] = scene["bounces"]
    for name, value in options.items():
        setattr(bpy.context.scene.cycles, name, value)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = width, height
    render.resolution_percentage = 100
    render.use_persistent_data = True
    render.film_transparent = render.use_compositing = render.use_sequencer = False
    image = render.image_settings
    image.file_format, image.color_mode, image.color_depth, image.exr_codec = "OPEN_EXR", "RGB", "32", "ZIP"
    bpy.context.scene.view_settings.view_transform = "Raw"


def make_world(radiance, environment=None):
    """`environment`: the path of an image of all directions, in place of the radiance. In the image z is up, in the scene y."""
    world = bpy.data.worlds.new("world")
    nodes = Nodes(world)
    color = opaque(radiance)
    if environment:
        scene = nodes.add("ShaderNodeSeparateXYZ", Vector=nodes.add("ShaderNodeTexCoord").outputs["Generated"])
        x, y, z = (scene.outputs[name] for name in "XYZ")
        direction = nodes.add("ShaderNodeCombineXYZ", X=x, Y=nodes.math("MULTIPLY", z, -1.0), Z=y)
        image = bpy.data.images.load(environment)
        color = nodes.add("ShaderNodeTexEnvironment", {"image": image}, Vector=direction.outputs[0]).outputs["Color"]
        world.cycles.sampling_method = "MANUAL"
        world.cycles.sample_map_resolution = 2048
    nodes.add("ShaderNodeOutputWorld", Surface=nodes.add("ShaderNodeBackground", Color=color, Strength=1).outputs[0])
    bpy.context.scene.world = world


def make_empty():
    for held in list(bpy.data.objects):
        bpy.data.objects.remove(held)


def main():
    folder, name, size, samples, seeds = sys.argv[sys.argv.index("--") + 1:]
    at = pathlib.Path(folder) / name
    scene = json.loads(at.with_name(f"{name}.json").read_text())
    make_empty()
    make_mesh(scene, numpy.load(at.with_name(f"{name}.npz")))
    for light in scene["lights"]:
        make_light(light)
    make_camera(scene["camera"])
    make_world(scene["sky"], str(at.with_name(f"{name}.sky.exr").absolute()) if scene["environment"] else None)
    set_options(scene, int(size), int(size), 1)
    bpy.ops.render.render()
    bpy.context.scene.cycles.samples = int(samples)
    seconds = []
    for seed in map(int, seeds.split(",")):
        bpy.context.scene.cycles.seed = seed
        bpy.context.scene.render.filepath = str(at.with_name(f"{name}.cycles.{seed}.exr"))
        begun = time.monotonic()
        bpy.ops.render.render(write_still=True)
        seconds.append(time.monotonic() - begun)
    at.with_name(f"{name}.cycles.json").write_text(json.dumps(seconds))


if __name__ == "__main__":
    main()

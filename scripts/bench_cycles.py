"""Bakes a .glb with Blender's Cycles, on the CPU, for scripts/bench. Runs inside Blender 3.4:

  blender -b -P scripts/bench_cycles.py -- SCENE.glb OUT.npy --size 256 --samples 64 [--bounces 8]
                                            [--threads 2] [--seed 0]

OUT.npy: float32 (size, size, 4), row 0 = v 0: irradiance over pi, and 1 in the fourth channel where
a texel was baked. OUT.json: seconds of the bake call alone (scene sync and BVH included, start of
Blender and import left out), wall and CPU.

The bake is the same as Lightkiln's: Lambert materials, no denoiser, no clamp, no adaptive sampling,
no margin, one sample pattern for all. Emitters shine on both sides: that spares Cycles a test at
every hit, and is right where the back of no lamp is visible. Faces that are black and emit are lamps
and are not baked.
"""
import argparse
import json
import resource
import sys
import time

import bpy
import numpy as np

np.bool = bool  # Debian's glTF importer uses this name, which NumPy 1.24 removed


def arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    parser.add_argument("out")
    parser.add_argument("--size", type=int, required=True)
    parser.add_argument("--samples", type=int, required=True)
    parser.add_argument("--bounces", type=int, default=8)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1:])


def constant(socket):
    if socket.is_linked:
        sys.exit(f"{socket.name} is textured: this script bakes plain colors only")
    return socket.default_value


def make_lambert(material, target):
    """Replaces the imported shader by Diffuse + Emission, and makes `target` the bake's image.
    Returns whether the material is a lamp."""
    tree = material.node_tree
    shader = next((n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    if shader is None:
        sys.exit(f"material {material.name} is not one that the importer makes")
    color = list(constant(shader.inputs["Base Color"]))
    emission = list(constant(shader.inputs["Emission"]))
    strength = constant(shader.inputs["Emission Strength"])
    lit = max(emission[:3]) * strength > 0
    black = max(color[:3]) == 0
    tree.nodes.clear()
    surface = tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"]
    shaders = []
    if not (lit and black):
        diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
        diffuse.inputs["Color"].default_value = color
        shaders.append(diffuse.outputs[0])
    if lit:
        glow = tree.nodes.new("ShaderNodeEmission")
        glow.inputs["Color"].default_value = emission
        glow.inputs["Strength"].default_value = strength
        shaders.append(glow.outputs[0])
    if len(shaders) == 2:
        both = tree.nodes.new("ShaderNodeAddShader")
        for i, s in enumerate(shaders):
            tree.links.new(s, both.inputs[i])
        shaders = [both.outputs[0]]
    tree.links.new(shaders[0], surface)
    image = tree.nodes.new("ShaderNodeTexImage")
    image.image = target
    tree.nodes.active = image
    return lit and black


def joined(objects):
    """Joins the meshes into one object, since one sync and one bake call are fastest in Blender."""
    bpy.ops.object.select_all(action="DESELECT")
    for o in objects:
        o.select_set(True)
    bpy.context.view_layer.objects.active = objects[0]
    if len(objects) > 1:
        bpy.ops.object.join()
    mesh = bpy.context.view_layer.objects.active
    mesh.data.uv_layers.active = mesh.data.uv_layers[-1]  # TEXCOORD_1
    return mesh


def configure(scene, a):
    scene.render.engine = "CYCLES"
    scene.render.threads_mode = "FIXED"
    scene.render.threads = a.threads
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = a.samples
    cycles.seed = a.seed
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = a.bounces
    cycles.glossy_bounces = cycles.transmission_bounces = 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0


def cpu_seconds():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main():
    a = arguments()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=a.scene, import_shading="NORMALS")
    if bpy.data.lights:
        sys.exit("the scene has punctual lights: this script knows emissive surfaces only")
    target = bpy.data.images.new("lightmap", a.size, a.size, alpha=True, float_buffer=True)
    target.colorspace_settings.name = "Non-Color"
    target.pixels.foreach_set(np.full(a.size * a.size * 4, -1, np.float32))  # -1: not baked
    lamps = {m.name for m in bpy.data.materials if make_lambert(m, target)}
    meshes = [o for o in bpy.data.objects if o.type == "MESH"]
    baked = [o for o in meshes if {s.material.name for s in o.material_slots} - lamps]
    mesh = joined(baked)

    configure(bpy.context.scene, a)
    wall, cpu = time.time(), cpu_seconds()
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, margin=0,
                        use_clear=False, uv_layer=mesh.data.uv_layers[-1].name)
    wall, cpu = time.time() - wall, cpu_seconds() - cpu

    pixels = np.empty(a.size * a.size * 4, np.float32)
    target.pixels.foreach_get(pixels)
    pixels = pixels.reshape(a.size, a.size, 4)[::-1]  # Blender's first row is the bottom
    lit = pixels[..., 0] >= 0
    pixels[~lit] = 0
    pixels[..., 3] = lit
    np.save(a.out, pixels)
    with open(a.out.rsplit(".", 1)[0] + ".json", "w") as f:
        json.dump({"seconds": wall, "cpu_seconds": cpu, "texels": int(lit.sum()),
                   "samples": a.samples, "blender": bpy.app.version_string}, f)


try:
    main()
except Exception as error:  # Blender itself would print it and exit with 0
    sys.exit(f"bench_cycles: {type(error).__name__}: {error}")

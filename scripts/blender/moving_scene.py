"""What scripts/draw_moving_scene does inside Blender (3.4 or newer):

  blender --background --factory-startup --python moving_scene.py -- balls|arm OUT
"""
import json
import math
import random
import sys
from pathlib import Path

import bpy
from mathutils import Vector

SIZE, TRAIN, TEST = 240, 100, 16
DISTANCE = 4.0  # of the cameras


def textured(texture, first, second, scale):
    """A material of two colours: checkers, or noise where texture is ShaderNodeTexNoise."""
    material = bpy.data.materials.new("two colours")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.7
    place = nodes.new("ShaderNodeTexCoord")
    pattern = nodes.new(texture)
    pattern.inputs["Scale"].default_value = scale
    links.new(place.outputs["Object"], pattern.inputs["Vector"])
    if texture == "ShaderNodeTexChecker":
        pattern.inputs["Color1"].default_value = (*first, 1)
        pattern.inputs["Color2"].default_value = (*second, 1)
        links.new(pattern.outputs["Color"], shader.inputs["Base Color"])
        return material
    ramp = nodes.new("ShaderNodeValToRGB")
    for end, colour, at in zip(ramp.color_ramp.elements, (first, second), (0.4, 0.6)):
        end.color, end.position = (*colour, 1), at
    links.new(pattern.outputs["Fac"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    return material


def ball(radius, material):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=radius)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def box(size, material):
    bpy.ops.mesh.primitive_cube_add(size=1)
    bpy.context.object.scale = size
    bpy.ops.object.transform_apply(scale=True)
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def balls():
    """Builds the scene; gives a function that puts it to a time in [0, 1]."""
    colours = [((0.8, 0.1, 0.1), (0.9, 0.8, 0.2)), ((0.1, 0.3, 0.8), (0.9, 0.9, 0.9)),
               ((0.1, 0.6, 0.2), (0.05, 0.1, 0.1))]
    all_balls = [ball(0.42, textured("ShaderNodeTexChecker", *c, 5)) for c in colours]
    board = box((3, 3, 0.15),
                textured("ShaderNodeTexNoise", (0.35, 0.2, 0.1), (0.75, 0.6, 0.4), 3))
    board.location.z = -0.9

    def put(time):
        for i, one in enumerate(all_balls):
            angle = 2 * math.pi * i / 3 + 1.2 * time
            of_bounce = (1.6 * time + 0.31 * i) % 1
            height = 4.8 * of_bounce * (1 - of_bounce)
            one.location = (0.85 * math.cos(angle), 0.85 * math.sin(angle), height - 0.4)
            one.rotation_euler = (2 * time, 3 * time * (i - 1), 0)

    return put


def arm():
    """As balls()."""
    colours = [((0.8, 0.5, 0.1), (0.2, 0.1, 0.05)), ((0.1, 0.5, 0.7), (0.9, 0.9, 0.8)),
               ((0.7, 0.1, 0.4), (0.95, 0.8, 0.3)), ((0.2, 0.7, 0.3), (0.1, 0.1, 0.3))]
    base = box((0.9, 0.9, 0.3),
               textured("ShaderNodeTexNoise", (0.2, 0.2, 0.25), (0.7, 0.7, 0.7), 6))
    base.location.z = -1.1
    joints = []
    for i, colour in enumerate(colours):
        joint = bpy.data.objects.new("joint", None)
        bpy.context.scene.collection.objects.link(joint)
        joint.location.z = 0.6 if joints else -0.95
        if joints:
            joint.parent = joints[-1]
        width = 0.34 - 0.05 * i
        limb = box((width, width, 0.62), textured("ShaderNodeTexChecker", *colour, 9))
        limb.parent = joint
        limb.location.z = 0.3
        joints.append(joint)

    def put(time):
        for i, joint in enumerate(joints):
            joint.rotation_euler = (0.75 * math.sin(1.6 * math.pi * time + 0.5 * i),
                                    0.45 * math.sin(2.2 * math.pi * time + i),
                                    0.5 * time if i == 0 else 0)

    return put


def prepare():
    """An empty scene with its light and background; gives the camera."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 24
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 2
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.film_transparent = True
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.6
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy = 2.5
    camera = bpy.data.cameras.new("camera")
    camera.angle = 0.69
    for data, turned in ((sun, (0.6, 0.3, 0)), (camera, (0, 0, 0))):
        thing = bpy.data.objects.new(data.name, data)
        thing.rotation_euler = turned
        scene.collection.objects.link(thing)
    scene.camera = thing
    return thing


def shoot(camera, path):
    """A photo from anywhere around and above; gives its pose, camera to world as in OpenGL."""
    around, up = random.uniform(0, 2 * math.pi), random.uniform(0.05, 1.1)
    camera.location = (DISTANCE * math.cos(around) * math.cos(up),
                       DISTANCE * math.sin(around) * math.cos(up), DISTANCE * math.sin(up))
    to_middle = Vector((0, 0, -0.1)) - camera.location
    camera.rotation_euler = to_middle.to_track_quat("-Z", "Y").to_euler()
    bpy.context.view_layer.update()
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return [list(row) for row in camera.matrix_world]


def main():
    kind, out = sys.argv[sys.argv.index("--") + 1:]
    out = Path(out).resolve()
    random.seed(7)
    camera = prepare()
    put = {"balls": balls, "arm": arm}[kind]()
    for split, photos in (("train", TRAIN), ("test", TEST)):
        frames = []
        for i in range(photos):
            time = i / (photos - 1) if split == "train" else (i + 0.5) / photos
            put(time)
            pose = shoot(camera, out / split / f"r_{i:03}.png")
            frames.append({"file_path": f"./{split}/r_{i:03}", "time": time,
                           "transform_matrix": pose})
        text = json.dumps({"camera_angle_x": camera.data.angle, "frames": frames}, indent=1)
        (out / f"transforms_{split}.json").write_text(text)


main()

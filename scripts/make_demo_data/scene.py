"""Geometry of the demo scene: a still life on a stone plinth in a ruined court among hills.

Unit: metre; +z up. Everything is built here from primitives, noise and a seeded generator.
"""
import math
import random

import bmesh
import bpy
from mathutils import Vector, noise

import materials as m

SUBJECT = Vector((0.0, 0.0, 1.06))  # what the photographer looks at


def mesh_object(name, vertices, faces, material, smooth=True):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    mesh.update()
    for polygon in mesh.polygons:
        polygon.use_smooth = smooth
    return place(name, mesh, material)


def place(name, mesh, material=None, location=(0, 0, 0), rotation=(0, 0, 0), scale=1.0):
    if material and not mesh.materials:
        mesh.materials.append(material)
    made = bpy.data.objects.new(name, mesh)
    made.location, made.rotation_euler = location, rotation
    made.scale = (scale,) * 3 if isinstance(scale, (int, float)) else scale
    bpy.context.scene.collection.objects.link(made)
    return made


def primitive(name, create, material, smooth=True, **options):
    """A mesh from one of bmesh's primitive operators."""
    mesh, b = bpy.data.meshes.new(name), bmesh.new()
    create(b, **options)
    if smooth:
        for face in b.faces:
            face.smooth = True
    b.to_mesh(mesh)
    b.free()
    mesh.materials.append(material)
    return mesh


def lathe(name, profile, material, segments=64, flutes=0, depth=0.0):
    """Surface of revolution of (radius, z) pairs; flutes carve `depth` of the radius away."""
    vertices, faces = [], []
    for radius, z in profile:
        for s in range(segments):
            a = 2 * math.pi * s / segments
            r = radius * (1 - depth * abs(math.sin(0.5 * flutes * a))) if flutes else radius
            vertices.append((r * math.cos(a), r * math.sin(a), z))
    for row in range(len(profile) - 1):
        for s in range(segments):
            t = (s + 1) % segments
            faces.append((row * segments + s, row * segments + t, (row + 1) * segments + t,
                          (row + 1) * segments + s))
    faces.append(tuple(range((len(profile) - 1) * segments, len(profile) * segments)))
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    for polygon in mesh.polygons:
        polygon.use_smooth = len(polygon.vertices) == 4
    mesh.use_auto_smooth, mesh.auto_smooth_angle = True, math.radians(35)
    mesh.materials.append(material)
    return mesh


def lumpy(name, material, rng, subdivisions=4, amount=0.35, frequency=1.4, squash=(1, 1, 1)):
    """An icosphere pushed about by noise: rocks and tree crowns."""
    mesh = primitive(name, bmesh.ops.create_icosphere, material, radius=1.0,
                     subdivisions=subdivisions)
    offset = Vector([rng.uniform(-50, 50) for _ in range(3)])
    for vertex in mesh.vertices:
        push = noise.fractal(vertex.co * frequency + offset, 0.9, 2.0, 5)
        vertex.co *= 1 + amount * push
        vertex.co = Vector(a * b for a, b in zip(vertex.co, squash))
    mesh.update()
    return mesh


def plinth_and_still_life():
    limestone = m.material("limestone", m.stone)
    steps = [(1.15, 0.0), (1.15, 0.16), (1.0, 0.16), (1.0, 0.30), (0.78, 0.33), (0.74, 0.38),
             (0.70, 0.42), (0.68, 0.62), (0.72, 0.66), (0.82, 0.69), (0.86, 0.72), (0.86, 0.78)]
    place("plinth", lathe("plinth", steps, limestone, 128))

    bpy.ops.mesh.primitive_monkey_add(size=0.66, location=(0.02, 0.02, 1.23),
                                      rotation=(math.radians(-6), 0, math.radians(25)))
    head = bpy.context.object
    head.modifiers.new("smooth", "SUBSURF").render_levels = 3
    bpy.ops.object.shade_smooth()
    head.data.materials.append(m.material("copper", m.metal))

    vase = [(0.07, 0.0), (0.10, 0.01), (0.15, 0.08), (0.175, 0.16), (0.16, 0.25), (0.10, 0.33),
            (0.065, 0.38), (0.062, 0.42), (0.085, 0.46), (0.09, 0.47), (0.075, 0.465),
            (0.05, 0.42), (0.045, 0.38)]
    place("vase", lathe("vase", vase, m.material("glaze", m.glaze)), location=(-0.47, 0.28, 0.78))

    foot = [(0.24, 0.0), (0.24, 0.03), (0.20, 0.05), (0.19, 0.12), (0.22, 0.15), (0.22, 0.18)]
    place("foot", lathe("foot", foot, limestone, 64), location=(0, 0, 0.78))

    cube = primitive("crate", bmesh.ops.create_cube, m.material("wood", m.wood), False, size=0.22)
    for location, turn in [((0.53, 0.26, 0.89), 0.4), ((0.36, 0.50, 0.89), 1.2)]:
        block = place("crate", cube, location=location, rotation=(0, 0, turn))
        block.modifiers.new("bevel", "BEVEL").width = 0.012

    ball = primitive("ball", bmesh.ops.create_uvsphere, m.material("ball", m.cloth_ball),
                     u_segments=64, v_segments=32, radius=0.16)
    place("ball", ball, location=(-0.28, -0.48, 0.94), rotation=(0.5, 0.3, 0))
    chrome = m.material("steel", lambda g: m.metal(g, (0.86, 0.88, 0.92), 0.09))
    bpy.ops.mesh.primitive_torus_add(major_radius=0.17, minor_radius=0.055, major_segments=96,
                                     minor_segments=32, location=(0.40, -0.40, 0.835),
                                     rotation=(0.0, 0.0, 0.0))
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(chrome)
    stone_egg = lumpy("egg", m.material("green stone", lambda g: m.stone(
        g, (0.20, 0.42, 0.30), (0.03, 0.12, 0.10), 2.0)), random.Random(3), 5, 0.12, 1.2)
    place("egg", stone_egg, location=(0.40, -0.40, 0.93), scale=0.12)


def court(rng):
    """Paved disc, a ring of columns (some broken, some joined by lintels) and fallen pieces."""
    disc = [(8.3, -0.4), (8.3, 0.0), (0.0001, 0.0)]
    place("paving", lathe("paving", disc, m.material("paving", m.paving), 160))
    marble = m.material("marble", lambda g: m.stone(g, (0.70, 0.64, 0.55), (0.32, 0.27, 0.22), 0.8))
    count, ring, tall = 11, 6.4, 3.6
    heights = [tall if i % 4 else rng.uniform(0.9, 2.4) for i in range(count)]
    for i, height in enumerate(heights):
        angle = 2 * math.pi * (i + 0.3) / count
        spot = (ring * math.cos(angle), ring * math.sin(angle), 0.0)
        base = [(0.52, 0), (0.52, 0.14), (0.47, 0.14), (0.50, 0.20), (0.47, 0.26), (0.40, 0.30)]
        place("base", lathe("base", base, marble, 64), location=spot)
        rows = [(0.38 - 0.05 * t, 0.28 + (height - 0.28) * t) for t in (k / 12 for k in range(13))]
        shaft = lathe("shaft", rows, marble, 240, 20, 0.09)
        if height < tall:  # a slanted, crumbled break
            lean = rng.uniform(0, 2 * math.pi)
            for v in shaft.vertices:
                if v.co.z > height - 0.2:
                    v.co.z += 0.5 * (v.co.x * math.cos(lean) + v.co.y * math.sin(lean))
                    v.co.z += 0.12 * noise.noise(v.co * 5)
        place("shaft", shaft, location=spot, rotation=(0, 0, angle))
        if height == tall:
            head = [(0.33, tall), (0.38, tall + 0.05), (0.36, tall + 0.1), (0.52, tall + 0.24)]
            place("capital", lathe("capital", head, marble, 64), location=spot)
            slab = primitive("slab", bmesh.ops.create_cube, marble, False, size=1.0)
            place("slab", slab, location=(spot[0], spot[1], tall + 0.31), rotation=(0, 0, angle),
                  scale=(1.1, 1.1, 0.16))
    for i in (1, 5):
        a, b = (2 * math.pi * (k + 0.3) / count for k in (i, i + 1))
        middle = ring * math.cos((b - a) / 2)
        beam = primitive("beam", bmesh.ops.create_cube, marble, False, size=1.0)
        place("beam", beam, rotation=(0, 0, (a + b) / 2), scale=(0.75, 4.6, 0.55),
              location=(middle * math.cos((a + b) / 2), middle * math.sin((a + b) / 2), tall + 0.66))
    drum = lathe("drum", [(0.0001, 0), (0.37, 0), (0.35, 1.3), (0.0001, 1.3)], marble, 240, 20, 0.09)
    for angle, radius, turn in [(0.9, 4.6, 0.4), (3.7, 4.9, 2.2), (5.3, 5.2, 1.3)]:
        place("drum", drum, rotation=(math.pi / 2, 0, turn),
              location=(radius * math.cos(angle), radius * math.sin(angle), 0.37))


def ground_height(x, y):
    r = math.hypot(x, y)
    rise = min(max((r - 9.0) / 60.0, 0.0), 1.0)
    rolling = 2.2 * rise * noise.fractal(Vector((x, y, 0)) * 0.045, 1.0, 2.0, 4)
    hills = min(max((r - 70.0) / 160.0, 0.0), 1.0) ** 1.4
    ridge = 0.5 + 0.5 * noise.noise(Vector((x / max(r, 1.0), y / max(r, 1.0), 0)) * 2.2)
    crags = noise.ridged_multi_fractal(Vector((x, y, 7.0)) * 0.012, 0.9, 2.1, 6, 1.0, 2.0)
    return -0.12 + rolling + hills * (6 + 34 * ridge + 13 * (crags - 0.8) * ridge)


def landscape(rng):
    spokes, radii = 360, [0.0]
    while radii[-1] < 700:
        radii.append(max(radii[-1] * 1.045, radii[-1] + 0.5))
    vertices, faces = [], []
    for r in radii:
        for s in range(spokes):
            x, y = r * math.cos(2 * math.pi * s / spokes), r * math.sin(2 * math.pi * s / spokes)
            vertices.append((x, y, ground_height(x, y)))
    for row in range(len(radii) - 1):
        for s in range(spokes):
            t = (s + 1) % spokes
            faces.append((row * spokes + s, (row + 1) * spokes + s, (row + 1) * spokes + t,
                          row * spokes + t))
    mesh_object("land", vertices, faces, m.material("land", m.land))

    rocks = [lumpy("rock", m.material("rock", lambda g: m.stone(
        g, (0.42, 0.38, 0.34), (0.14, 0.12, 0.11), 1.3)), rng, 4, 0.45, 1.1, (1, 0.8, 0.6))
        for _ in range(4)]
    for _ in range(70):
        angle, r = rng.uniform(0, 2 * math.pi), 8.8 * math.exp(rng.uniform(0.0, 1.7))
        x, y, size = r * math.cos(angle), r * math.sin(angle), rng.uniform(0.2, 0.9)
        place("rock", rng.choice(rocks), location=(x, y, ground_height(x, y) + 0.15 * size),
              rotation=(0, 0, rng.uniform(0, 6.3)), scale=size)

    crowns = [lumpy("cypress", m.material("cypress", m.leaves), rng, 5, 0.28, 2.2, (0.24, 0.24, 1.0)),
              lumpy("oak", m.material("oak", lambda g: m.leaves(
                  g, (0.02, 0.05, 0.008), (0.17, 0.22, 0.05))), rng, 5, 0.55, 1.6, (1.0, 1.0, 0.8))]
    bark = m.material("bark", lambda g: m.stone(g, (0.20, 0.13, 0.08), (0.07, 0.045, 0.03), 2.0))
    trunk = lathe("trunk", [(0.09, -1.0), (0.06, 0.0), (0.05, 1.0)], bark, 16)
    for _ in range(90):
        angle, r = rng.uniform(0, 2 * math.pi), 11.5 * math.exp(rng.uniform(0.0, 2.4))
        x, y = r * math.cos(angle), r * math.sin(angle)
        z, kind = ground_height(x, y), rng.randrange(2)
        size = rng.uniform(2.2, 3.6) if kind == 0 else rng.uniform(1.2, 2.1)
        place("crown", crowns[kind], location=(x, y, z + size * (1.1 if kind == 0 else 1.5)),
              rotation=(0, 0, rng.uniform(0, 6.3)), scale=size)
        place("trunk", trunk, location=(x, y, z + 0.4 * size), scale=size)


def light():
    elevation, azimuth = math.radians(38), math.radians(130)
    m.sky(bpy.context.scene.world, elevation, azimuth)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle, sun.color = 3.2, math.radians(0.9), (1.0, 0.93, 0.82)
    lamp = bpy.data.objects.new("sun", sun)
    toward = Vector((math.sin(azimuth) * math.cos(elevation),
                     math.cos(azimuth) * math.cos(elevation), math.sin(elevation)))
    lamp.rotation_euler = toward.to_track_quat("Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(lamp)


def build(seed):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.world = bpy.data.worlds.new("world")
    noise.seed_set(seed)
    rng = random.Random(seed)
    plinth_and_still_life()
    court(rng)
    landscape(rng)
    light()

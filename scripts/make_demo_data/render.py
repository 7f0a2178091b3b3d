"""Renders the photos of the demo capture. Run by make.sh:

  blender -b --factory-startup -P render.py -- OUT_FOLDER [--only I,J,...] [--samples N] [--png]

The lens is a real distorting one: Cycles traces the rays of the distorted pixels directly with its
polynomial lens, fitted below to r_d = r_u (1 + k r_u^2), r_u = tan(theta); no picture is resampled.
"""
import argparse
import math
import os
import random
import sys

import bpy
import numpy as np
from mathutils import Matrix, Vector

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import scene as demo  # noqa: E402

SEED = 7
PHOTOS = 48
CLEAN_PHOTOS = 26  # the rest get a quarter of the samples, as if taken at a higher ISO
WIDTH, HEIGHT = 640, 480
FOCAL = 520.0  # pixels
RADIAL = -0.12
SENSOR = 36.0  # mm across; the unit of the polynomial


def lens_coefficients():
    """k1..k4 of theta(r) = k1 r + k2 r^2 + k3 r^3 + k4 r^4, r in mm on the sensor."""
    corner = 1.03 * math.hypot(WIDTH, HEIGHT) / 2 / FOCAL
    undistorted = np.linspace(0, 1.2, 20001)
    distorted = undistorted * (1 + RADIAL * undistorted**2)
    inside = (distorted > 0) & (distorted <= corner) & (undistorted < 1.2)
    r = distorted[inside] * FOCAL * SENSOR / WIDTH
    theta = np.arctan(undistorted[inside])
    powers = np.stack([r**k for k in (1, 2, 3, 4)], axis=1)
    scale = np.abs(powers).max(axis=0)
    k = np.linalg.lstsq(powers / scale, theta, rcond=None)[0] / scale
    worst = np.abs(powers @ k - theta).max() * FOCAL
    print(f"lens: polynomial follows the radial model to {worst:.4f} px")
    return k


def camera_path():
    """A walk of 1.75 turns: one round at chest height, then higher, with a hand's unsteadiness."""
    rng = random.Random(SEED)
    poses = []
    for i in range(PHOTOS):
        t = i / (PHOTOS - 1)
        first = t < 0.6
        angle = 2 * math.pi * (0.08 + (t / 0.6 if first else 1 + (t - 0.6) / 0.4 * 0.75))
        angle += rng.gauss(0, 0.025)
        radius = (2.3 if first else 2.05) + 0.2 * math.sin(5 * angle + 1) + rng.gauss(0, 0.06)
        if first:
            height = 1.32 + 0.14 * math.sin(3 * angle) + rng.gauss(0, 0.04)
        else:
            height = 1.95 + 0.18 * math.sin(2 * angle) + rng.gauss(0, 0.04)
        if i % 7 == 3:
            height -= 0.35
        eye = Vector((radius * math.cos(angle), radius * math.sin(angle), height))
        target = demo.SUBJECT + Vector([rng.gauss(0, 0.07) for _ in range(3)])
        poses.append((eye, target, rng.gauss(0, 0.025)))
    return poses


def aim(camera, eye, target, roll):
    rotation = (target - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    camera.matrix_world = Matrix.Translation(eye) @ rotation @ Matrix.Rotation(roll, 4, "Z")


def make_camera():
    data = bpy.data.cameras.new("camera")
    data.type = "PANO"
    data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR
    data.clip_start, data.clip_end = 0.05, 5000
    lens = data.cycles
    lens.panorama_type = "FISHEYE_LENS_POLYNOMIAL"
    lens.fisheye_fov = math.radians(170)
    k = lens_coefficients()
    lens.fisheye_polynomial_k0 = 0.0
    for i in range(4):  # Cycles negates the polynomial
        setattr(lens, f"fisheye_polynomial_k{i + 1}", -float(k[i]))
    made = bpy.data.objects.new("camera", data)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.scene.camera = made
    return made


def settings(samples, png):
    s = bpy.context.scene
    s.render.engine = "CYCLES"
    s.cycles.device = "CPU"
    s.cycles.samples = samples
    s.cycles.use_adaptive_sampling = True
    s.cycles.adaptive_threshold = 0.035
    s.cycles.use_denoising = False
    s.cycles.max_bounces = 5
    s.cycles.diffuse_bounces, s.cycles.glossy_bounces = 2, 3
    s.cycles.use_fast_gi, s.cycles.fast_gi_method = True, "REPLACE"
    s.cycles.ao_bounces_render = 1
    s.world.light_settings.distance = 6.0
    s.cycles.sample_clamp_indirect = 4.0
    s.cycles.caustics_reflective = s.cycles.caustics_refractive = False
    s.cycles.blur_glossy = 0.3
    s.render.use_persistent_data = True
    s.render.resolution_x, s.render.resolution_y, s.render.resolution_percentage = WIDTH, HEIGHT, 100
    s.view_settings.view_transform = "Filmic"
    s.view_settings.look = "Medium High Contrast"
    s.view_settings.exposure = 0.2
    s.render.image_settings.file_format = "PNG" if png else "JPEG"
    s.render.image_settings.color_mode = "RGB"
    s.render.image_settings.quality = 90


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("out")
    parser.add_argument("--only", default="")
    parser.add_argument("--samples", type=int, default=40)
    parser.add_argument("--png", action="store_true")
    args = parser.parse_args(sys.argv[sys.argv.index("--") + 1:])
    os.makedirs(args.out, exist_ok=True)
    demo.build(SEED)
    settings(args.samples, args.png)
    camera = make_camera()
    chosen = {int(i) for i in args.only.split(",") if i}
    for i, (eye, target, roll) in enumerate(camera_path()):
        if chosen and i not in chosen:
            continue
        aim(camera, eye, target, roll)
        bpy.context.scene.cycles.samples = (
            args.samples if i < CLEAN_PHOTOS else args.samples // 4)
        bpy.context.scene.cycles.seed = SEED + i  # noise differs from photo to photo
        bpy.context.scene.render.filepath = os.path.join(
            args.out, f"{i:03d}.{'png' if args.png else 'jpg'}")
        bpy.ops.render.render(write_still=True)


main()

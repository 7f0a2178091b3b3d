#!/usr/bin/env python3
"""Writes camera_models.txt: pixels of known directions through every COLMAP camera model.

Written from the models' published definitions in polar form (radius or angle from the axis, and
azimuth), with Python's standard library only, so that it shares nothing with the engine's code.
Each line: model name, image size, number of parameters, parameters, x y z of the direction, pixel.

    python3 tests/golden/camera_models.py > tests/golden/camera_models.txt
"""
from math import atan, atan2, cos, hypot, pi, sin, tan

FX, FY, CX, CY = 701.25, 695.5, 331.75, 238.125


def tangential(x, y, p1, p2):
    """OpenCV's decentring terms in polar form: x y = r^2 sin(2a) / 2, x^2 - y^2 = r^2 cos(2a)."""
    r2, a = x * x + y * y, atan2(y, x)
    return (p1 * r2 * sin(2 * a) + p2 * r2 * (2 + cos(2 * a)),
            p2 * r2 * sin(2 * a) + p1 * r2 * (2 - cos(2 * a)))


def polar(direction, fisheye):
    """(radius or angle, azimuth)."""
    x, y, z = direction
    rho = hypot(x, y)
    return (pi / 2 - atan(z / rho) if fisheye and rho else rho / z), atan2(y, x)


def series(r, ks):
    """1 + k1 r^2 + k2 r^4 + ..."""
    return 1 + sum(k * r ** (2 * i + 2) for i, k in enumerate(ks))


def image_point(model, p, direction):
    r, a = polar(direction, "FISHEYE" in model)
    c, s = cos(a), sin(a)
    if model in ("SIMPLE_PINHOLE", "PINHOLE"):
        x, y = r * c, r * s
    elif model in ("SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"):
        rd = r * series(r, p[3:])
        x, y = rd * c, rd * s
    elif model == "OPENCV_FISHEYE":
        rd = r * series(r, p[4:])
        x, y = rd * c, rd * s
    elif model == "OPENCV":
        rd = r * series(r, p[4:6])
        dx, dy = tangential(r * c, r * s, p[6], p[7])
        x, y = rd * c + dx, rd * s + dy
    elif model == "FULL_OPENCV":
        k1, k2, p1, p2, k3, k4, k5, k6 = p[4:]
        rd = r * series(r, (k1, k2, k3)) / series(r, (k4, k5, k6))
        dx, dy = tangential(r * c, r * s, p1, p2)
        x, y = rd * c + dx, rd * s + dy
    elif model == "FOV":
        rd = atan(2 * r * tan(p[4] / 2)) / p[4]
        x, y = rd * c, rd * s
    elif model == "THIN_PRISM_FISHEYE":
        k1, k2, p1, p2, k3, k4, sx, sy = p[4:]
        rd = r * series(r, (k1, k2, k3, k4))
        dx, dy = tangential(r * c, r * s, p1, p2)
        x, y = rd * c + dx + sx * r * r, rd * s + dy + sy * r * r
    elif model == "RAD_TAN_THIN_PRISM_FISHEYE":
        p0, p1, s0, s1, s2, s3 = p[10:]
        rd = r * series(r, p[4:10])
        # Aria writes (2 x^2 + r^2) p0 + 2 x y p1: its p0, p1 are OpenCV's p2, p1.
        dx, dy = tangential(rd * c, rd * s, p1, p0)
        x = rd * c + dx + s0 * rd ** 2 + s1 * rd ** 4
        y = rd * s + dy + s2 * rd ** 2 + s3 * rd ** 4
    if model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE",
                                   "RADIAL_FISHEYE"):
        return p[0] * x + p[1], p[0] * y + p[2]
    return p[0] * x + p[2], p[1] * y + p[3]


ONE, TWO = (FX, CX, CY), (FX, FY, CX, CY)
MODELS = {
    "SIMPLE_PINHOLE": ONE,
    "PINHOLE": TWO,
    "SIMPLE_RADIAL": ONE + (-0.11,),
    "RADIAL": ONE + (-0.13, 0.031),
    "OPENCV": TWO + (-0.12, 0.043, 0.0017, -0.0023),
    "OPENCV_FISHEYE": TWO + (0.021, -0.013, 0.0041, -0.0007),
    "FULL_OPENCV": TWO + (0.31, 0.052, 0.0013, -0.0011, 0.0037, 0.41, 0.083, 0.0019),
    "FOV": TWO + (0.87,),
    "SIMPLE_RADIAL_FISHEYE": ONE + (-0.017,),
    "RADIAL_FISHEYE": ONE + (0.023, -0.0061),
    "THIN_PRISM_FISHEYE": TWO + (0.019, -0.011, 0.0009, -0.0012, 0.0031, -0.0004, 0.0007, -0.0005),
    "RAD_TAN_THIN_PRISM_FISHEYE": TWO + (0.026, -0.019, 0.0071, -0.0023, 0.00041, -0.00003, 0.0011,
                                         -0.0008, 0.0006, -0.0002, -0.0004, 0.0003),
}
DIRECTIONS = [(0.0, 0.0, 1.0), (0.3, -0.2, 1.0), (-0.41, 0.27, 2.0), (0.02, 0.44, 0.9),
              (-0.9, -0.8, 2.5), (1e-7, -2e-7, 1.0)]
WIDE = [(1.0, 0.7, 0.2), (-0.8, 0.5, -0.1)]  # beyond 75 and 90 degrees: fisheyes only

for name, params in MODELS.items():
    for d in DIRECTIONS + (WIDE if "FISHEYE" in name else []):
        numbers = params + d + image_point(name, params, d)
        print(name, 640, 480, len(params), " ".join(repr(float(v)) for v in numbers))

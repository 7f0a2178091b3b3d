#!/usr/bin/env python3
"""Writes encodings.txt: hash-grid shapes and corners, spherical harmonics, contraction.

Written from the published definitions in other forms than the engine's: grid rows with unbounded
integers and exact fractions, spherical harmonics through associated Legendre functions of the polar
angle, contraction in fifty-digit decimals. Python's standard library only.

    python3 tests/golden/encodings.py > tests/golden/encodings.txt

Lines, all numbers in decimal:
  shape levels log2_entries base finest | per level: scale resolution entries offset dense
  corners scale side entries dense x y z | eight rows, eight weights
  harmonics x y z | Y_0^0 ... Y_3^3
  contract x y z | image
"""
from decimal import Decimal, getcontext
from fractions import Fraction
from math import acos, atan2, ceil, cos, factorial, floor, pi, sin, sqrt
from struct import pack, unpack

getcontext().prec = 50


def float32(v):
    return unpack("f", pack("f", v))[0]


def shape(levels, log2_entries, base, finest):
    """tiny-cuda-nn's level geometry: N_l = base b^l cells, b^(L-1) = finest / base."""
    out, offset = [], 0
    for l in range(levels):
        scale = base * (finest / base) ** (l / max(levels - 1, 1)) - 1
        # A position at 1 reads the vertices up to floor(scale + 1/2) + 1.
        side = ceil(float32(scale)) + 2
        dense = side ** 3 <= 2 ** log2_entries
        entries = -(-side ** 3 // 8) * 8 if dense else 2 ** log2_entries
        out += [float32(scale), side, entries, offset, int(dense)]
        offset += entries
    return out


def corners(scale, side, entries, dense, p):
    at = [min(max(Fraction(c), 0), 1) * Fraction(scale) + Fraction(1, 2) for c in p]
    low = [floor(a) for a in at]
    far = [a - c for a, c in zip(at, low)]
    rows, weights = [], []
    for corner in range(8):
        bits = [corner >> i & 1 for i in range(3)]
        x, y, z = (c + b for c, b in zip(low, bits))
        if dense:
            rows.append(x + side * y + side * side * z)
        else:
            rows.append(((x % 2 ** 32) ^ (y * 2654435761 % 2 ** 32) ^ (z * 805459861 % 2 ** 32))
                        % entries)
        weight = Fraction(1)
        for b, f in zip(bits, far):
            weight *= f if b else 1 - f
        weights.append(float(weight))
    return rows + weights


def legendre(l, m, x):
    """Associated Legendre function P_l^m with the Condon-Shortley phase, by the recurrence in l."""
    p = 1.0
    for k in range(m):
        p *= -(2 * k + 1) * sqrt(max(0.0, 1 - x * x))
    if l == m:
        return p
    previous, p = p, (2 * m + 1) * x * p
    for k in range(m + 2, l + 1):
        previous, p = p, ((2 * k - 1) * x * p - (k + m - 1) * previous) / (k - m)
    return p


def harmonics(d):
    theta, phi = acos(max(-1.0, min(1.0, d[2]))), atan2(d[1], d[0])
    out = []
    for l in range(4):
        for m in range(-l, l + 1):
            a = abs(m)
            norm = sqrt((2 * l + 1) / (4 * pi) * factorial(l - a) / factorial(l + a))
            angle = 1.0 if m == 0 else sqrt(2) * (cos(a * phi) if m > 0 else sin(a * phi))
            out.append(norm * legendre(l, a, cos(theta)) * angle)
    return out


def contract(p):
    p = [Decimal(c) for c in p]
    r = sum(c * c for c in p).sqrt()
    return p if r <= 1 else [(2 - 1 / r) * c / r for c in p]


def line(kind, *numbers):
    print(kind, " ".join(str(n) if isinstance(n, int) else repr(float(n)) for n in numbers))


for config in [(1, 10, 16, 16), (8, 18, 16, 2048), (16, 14, 16, 524288), (4, 19, 2, 64),
               (5, 24, 512, 1048576), (3, 10, 7, 100)]:
    line("shape", *config, *shape(*config))

# Positions whose product with the scale is exact in float, so that no rounding moves a corner. The
# finest ones reach cells whose hash terms wrap around 2^32 many times.
PLACES = [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.5, 0.25, 0.75), (-0.5, 0.125, 2.0),
          (0.0009765625, 0.9990234375, 0.333984375), (0.71875, 0.03125, 0.84375)]
for scale, side, entries, dense in [(15.0, 17, 4920, True), (2.0, 4, 64, True), (1.0, 3, 32, True),
                                    (15.5, 18, 5832, True), (63.0, 65, 2 ** 14, False),
                                    (1024.0, 1026, 2 ** 18, False), (2.0 ** 19, 2 ** 19 + 2, 2 ** 10, False),
                                    (2.0 ** 20, 2 ** 20 + 2, 2 ** 24, False)]:
    for p in PLACES:
        line("corners", scale, side, entries, int(dense), *p,
             *corners(scale, side, entries, dense, p))

golden = pi * (3 - sqrt(5))
DIRECTIONS = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)]
for i in range(40):
    z = 1 - (2 * i + 1) / 40
    DIRECTIONS.append((sqrt(1 - z * z) * cos(golden * i), sqrt(1 - z * z) * sin(golden * i), z))
for d in DIRECTIONS:
    line("harmonics", *d, *harmonics(d))

for p in [(0.0, 0.0, 0.0), (0.3, -0.4, 0.5), (1.0, 0.0, 0.0), (0.0, -1.0000001, 0.0),
          (0.6, 0.8, 0.0000001), (1.5, -2.5, 0.75), (-3.0, 4.0, 12.0), (1e3, 1e-3, -1e3),
          (1e5, -2e5, 3e5), (1e-20, 0.0, -1e-20), (0.0, 1e12, 0.0)]:
    line("contract", *p, *contract(p))

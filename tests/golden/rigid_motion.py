#!/usr/bin/env python3
"""Writes rigid_motion.txt: points moved by a screw, with first and second derivatives.

Written from the definition in another form than the engine's: the motion is the power series of the
matrix exponential of [[W, v], [0, 0]] in 150-digit decimals, and derivatives are difference
quotients with steps of 1e-40. Python's standard library only.

    python3 tests/golden/rigid_motion.py > tests/golden/rigid_motion.txt

Lines, all numbers in decimal; w is the rotation vector, v the velocity, x the point; g are
coefficients of a loss g . x', dw dv dx a direction:
  motion w v x | x'
  gradient w v x g | its gradient by w, v, x
  along w v x dw dv dx | the derivative of x' along the direction
  second w v x dw dv dx g | the gradient by w, v, x of g . (that derivative)
"""
from decimal import Decimal as D, getcontext
from random import Random
from struct import pack, unpack

getcontext().prec = 150
random = Random(11)
STEP = D(10) ** -40


def f32(v):
    return D(unpack("f", pack("f", float(v)))[0])


def product(a, b):
    return [[sum((a[i][k] * b[k][j] for k in range(4)), D(0)) for j in range(4)] for i in range(4)]


def motion(p):
    """p: w, v, x in one list."""
    a, b, c = p[0:3]
    generator = [[D(0), -c, b, p[3]], [c, D(0), -a, p[4]], [-b, a, D(0), p[5]], [D(0)] * 4]
    column = list(p[6:9]) + [D(1)]
    total = list(column)
    for k in range(1, 400):
        column = [sum(generator[i][j] * column[j] for j in range(4)) / k for i in range(4)]
        total = [t + q for t, q in zip(total, column)]
        if max(abs(q) for q in column) < D(10) ** -145 and k > 20:
            break
    return total[:3]


def gradient(f, p):
    out = []
    for i in range(len(p)):
        up, down = list(p), list(p)
        up[i] += STEP
        down[i] -= STEP
        out.append((f(up) - f(down)) / (2 * STEP))
    return out


def along(p, t):
    up = motion([a + STEP * b for a, b in zip(p, t)])
    down = motion([a - STEP * b for a, b in zip(p, t)])
    return [(a - b) / (2 * STEP) for a, b in zip(up, down)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def line(word, numbers):
    print(word, " ".join(f"{float(v):.17g}" for v in numbers))


PI = 3.14159265358979
for angle in (0, 1e-8, 1e-3, 0.3, 0.999, 1.001, 2, PI, 4.5, 2 * PI, 10):
    axis = [random.uniform(-1, 1) for _ in range(3)]
    length = sum(a * a for a in axis) ** 0.5
    w = [f32(angle * a / length + 0.0) for a in axis]
    v, x, g = ([f32(random.uniform(-1, 1)) for _ in range(3)] for _ in range(3))
    t = [f32(random.uniform(-1, 1)) for _ in range(9)]
    p = w + v + x
    line("motion", p + motion(p))
    line("gradient", p + g + gradient(lambda q: dot(g, motion(q)), p))
    line("along", p + t + along(p, t))
    line("second", p + t + g + gradient(lambda q: dot(g, along(q, t)), p))

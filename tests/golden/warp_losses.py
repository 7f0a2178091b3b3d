#!/usr/bin/env python3
"""Writes warp_losses.txt: the elastic loss of single Jacobians, with its gradient.

Written from the definition in another form than the engine's: squared singular values are the roots of
the characteristic polynomial, bisected between the roots of its derivative in 150-digit decimals, and
derivatives are difference quotients with steps of 1e-40. Python's standard library only.

    python3 tests/golden/warp_losses.py > tests/golden/warp_losses.txt

Lines, all numbers in decimal:
  elastic penalty J | loss, its gradient; J and the gradient column by column
"""
from decimal import Decimal as D, getcontext
from random import Random
from struct import pack, unpack

getcontext().prec = 150
random = Random(3)
STEP = D(10) ** -40


def f32(v):
    return D(unpack("f", pack("f", float(v)))[0])


def squared_singular_values(j):
    """j: three columns."""
    a = [[sum(x * y for x, y in zip(p, q)) for q in j] for p in j]
    c2 = a[0][0] + a[1][1] + a[2][2]
    c1 = sum(a[i][i] * a[k][k] - a[i][k] * a[k][i] for i, k in ((0, 1), (0, 2), (1, 2)))
    c0 = sum(a[0][i] * (a[1][(i + 1) % 3] * a[2][(i + 2) % 3] - a[1][(i + 2) % 3] * a[2][(i + 1) % 3])
             for i in range(3))
    p = lambda x: ((x - c2) * x + c1) * x - c0
    root = max(c2 * c2 - 3 * c1, D(0)).sqrt()
    turns = [(c2 - root) / 3, (c2 + root) / 3]
    borders = [D(0)] + turns + [c2 + 1]
    out = []
    for i in range(3):
        low, high, rising = borders[i], borders[i + 1], i != 1
        for _ in range(480):
            middle = (low + high) / 2
            if (p(middle) > 0) == rising:
                high = middle
            else:
                low = middle
        out.append((low + high) / 2)
    return out


def loss(numbers, penalty):
    j = [numbers[3 * i:3 * i + 3] for i in range(3)]
    # max(s, 1e-6) of the singular values
    logs = [max(q, D(10) ** -12).ln() / 2 for q in squared_singular_values(j)]
    u = sum(v * v for v in logs) / penalty ** 2
    return penalty * 2 * u / (u + 4)


def matrix(turn, stretch):
    """A rotation by Cayley's formula times a diagonal matrix, as columns."""
    x, y, z = turn
    n = 1 + x * x + y * y + z * z
    r = [[1 + x * x - y * y - z * z, 2 * (x * y - z), 2 * (x * z + y)],
         [2 * (x * y + z), 1 - x * x + y * y - z * z, 2 * (y * z - x)],
         [2 * (x * z - y), 2 * (y * z + x), 1 - x * x - y * y + z * z]]
    return [f32(r[i][c] / n * stretch[c]) for c in range(3) for i in range(3)]


none, some = (0, 0, 0), (0.3, -0.2, 0.5)
cases = [matrix(none, (1, 1, 1)), matrix(some, (1, 1, 1)), matrix(some, (1.1, 1.1, 1.1)),
         matrix(none, (2, 2, 0.5)), matrix(some, (1, 1, -1)), matrix(some, (3, 0.1, 1)),
         matrix(none, (1, 1, 0)), matrix(none, (1, 0.5, 1e-8)), matrix(none, (1, 0.5, 1e-3)),
         matrix(none, (1, 1 + 1e-6, 1))]
cases += [[f32(random.uniform(-1, 1)) for _ in range(9)] for _ in range(3)]
cases += [[f32((k % 4 == 0) + random.uniform(-0.02, 0.02)) for k in range(9)] for _ in range(3)]
for case in cases:
    for penalty in (f32(0.03), f32(0.5)):
        gradient = []
        for k in range(9):
            up, down = list(case), list(case)
            up[k] += STEP
            down[k] -= STEP
            gradient.append((loss(up, penalty) - loss(down, penalty)) / (2 * STEP))
        numbers = [penalty] + case + [loss(case, penalty)] + gradient
        # Noise of the difference quotient, where the derivative is 0.
        print("elastic", " ".join("0" if abs(v) < D(10) ** -25 else f"{float(v):.17g}" for v in numbers))

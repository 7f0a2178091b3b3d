#!/usr/bin/env python3
"""Writes sampling.txt: step functions, frustums as Gaussians, losses on weights.

Written from the papers' definitions in exact fractions, in other forms than the engine's: a sample is
found by adding up bins until its share is reached, the moments of a frustum are the quotients of
integrals over it, a maximum looks at every bin, a sum over pairs at every pair, and a Jacobian is a
difference quotient in sixty-digit decimals. Python's standard library only.

    python3 tests/golden/sampling.py > tests/golden/sampling.txt

Lines, all numbers in decimal; n bins have n + 1 edges:
  points m k | m positions, m weights, k shares | k positions
  blur n padding | n weights | n weights
  shares n | n weights | n + 1 cumulative shares
  dilate n dilation | n + 1 edges, n weights | 3 n + 1 edges, 3 n weights
  cone t0 t1 radius | mean of t, variance of t, variance across
  distortion n | n + 1 edges, n weights | loss
  interlevel n m | n + 1 edges, n weights, m + 1 proposal edges, m proposal weights | loss
  blurred n k | n + 1 edges, n weights | k + 1 posts of the next level, mip-NeRF's
  dilated n k exponent | n + 1 edges, n weights | k + 1 posts of the next level, mip-NeRF 360's
  warp x y z dx dy dz t_variance r_variance px py pz | mean along p, variance along p
"""
from decimal import Decimal, getcontext
from fractions import Fraction as F
from random import Random
from struct import pack, unpack

getcontext().prec = 60
random = Random(5)


def f32(v):
    """The nearest float, exactly: what the engine is given."""
    return F(unpack("f", pack("f", float(v)))[0])


def numbers(n, scale=1.0):
    return [f32(random.random() * scale) for _ in range(n)]


def edges(n, low=0.0, high=1.0):
    inner = sorted(low + (high - low) * random.random() for _ in range(n - 1))
    return [f32(v) for v in [low] + inner + [high]]


def line(kind, *groups):
    print(kind, *(repr(float(v)) for group in groups for v in group))


def at_share(e, w, u):
    """Where the share u of the weights w of the bins between the edges e lies below."""
    total, below = sum(w), F(0)
    for i, wi in enumerate(w):
        share = wi / total
        if u < below + share or i == len(w) - 1:
            return e[i] + (u - below) / share * (e[i + 1] - e[i]) if share else e[i]
        below += share


def points(m, k, weights):
    x = [f32(2 + 4 * v) for v in sorted(random.random() for _ in range(m))]
    u = sorted(numbers(k))
    middles = [(a + b) / 2 for a, b in zip(x, x[1:])]
    raised = [w + F(1, 100000) for w in weights[1:-1]]
    line("points", [m, k], x, weights, u, [at_share(middles, raised, v) for v in u])


def blurred_weights(w, padding):
    n = len(w)
    larger = [max(w[max(i - 1, 0)], w[min(i, n - 1)]) for i in range(n + 1)]
    return [(larger[i] + larger[i + 1]) / 2 + padding for i in range(n)]


def blur(w, padding):
    line("blur", [len(w), padding], w, blurred_weights(w, padding))


def blurred(e, w, k):
    """Stratified posts without jitter: k + 1 shares from 0 to just below 1."""
    u = [(1 - F(1, 2 ** 23)) * i / k for i in range(k + 1)]
    mass = blurred_weights(w, f32(0.01))
    line("blurred", [len(w), k], e, w, [at_share(e, mass, v) for v in u])


def shares(w):
    n = len(w)
    missing = max(F(0), F(1, 100000) - sum(w))
    w2 = [v + missing / n for v in w]
    line("shares", [n], w, [sum(w2[:i]) / sum(w2) for i in range(n + 1)])


def dilated_histogram(e, w, d):
    clip = lambda v: min(max(v, F(0)), F(1))
    n = len(w)
    out = sorted(e + [clip(v - d) for v in e[:-1]] + [clip(v + d) for v in e[1:]])
    mass = []
    for a, b in zip(out, out[1:]):
        near = [w[i] / (e[i + 1] - e[i]) for i in range(n)
                if e[i + 1] > e[i] and e[i] - d <= a and e[i + 1] + d > a]
        mass.append(max(near, default=F(0)) * (b - a))
    total = sum(mass)
    return out, [m / total if total else m for m in mass]


def dilate(e, w, d):
    out, mass = dilated_histogram(e, w, d)
    line("dilate", [len(w), d], e, w, out, mass)


def power(v, exponent):
    return F(Decimal(v.numerator) / Decimal(v.denominator)) if exponent == 1 else F(
        (Decimal(v.numerator) / Decimal(v.denominator)) ** Decimal(float(exponent)))


def dilated(e, w, k, exponent):
    """Dilated by 0.0025 + 0.5 / n, without the outermost bins, raised to the exponent; then the k
    middles of even shares, posts half way between them and mirrored at both ends within [0, 1]."""
    out, mass = dilated_histogram(e, w, F(1, 400) + F(1, 2) / len(w))
    out, mass = out[1:-1], [power(m, exponent) if m else m for m in mass[1:-1]]
    at = [at_share(out, mass, F(2 * i + 1, 2 * k)) for i in range(k)]
    middles = [(a + b) / 2 for a, b in zip(at, at[1:])]
    first, last = max(F(0), 2 * at[0] - middles[0]), min(F(1), 2 * at[-1] - middles[-1])
    line("dilated", [len(w), k, exponent], e, w, [first] + middles + [last])


def cone(t0, t1, r):
    """The share of the frustum at t grows with t^2; across, a disc of radius r t has r^2 t^2 / 4."""
    moment = lambda k: (t1 ** (k + 1) - t0 ** (k + 1)) / (k + 1)
    mean = moment(3) / moment(2)
    line("cone", [t0, t1, r], [mean, moment(4) / moment(2) - mean ** 2,
                               r * r / 4 * moment(4) / moment(2)])


def distortion(e, w):
    m = [(a + b) / 2 for a, b in zip(e, e[1:])]
    n = len(w)
    pairs = sum(w[i] * w[j] * abs(m[i] - m[j]) for i in range(n) for j in range(n))
    own = sum(w[i] ** 2 * (e[i + 1] - e[i]) for i in range(n)) / 3
    line("distortion", [n], e, w, [pairs + own])


def interlevel(e, w, pe, pw):
    loss = F(0)
    for i, wi in enumerate(w):
        bound = sum(p for j, p in enumerate(pw) if pe[j + 1] > e[i] and pe[j] <= e[i + 1])
        loss += max(F(0), wi - bound) ** 2 / (wi + F(1, 2 ** 23))
    line("interlevel", [len(w), len(pw)], e, w, pe, pw, [loss])


def contract(x):
    r = sum(v * v for v in x).sqrt()
    return x if r <= 1 else [v * (2 - 1 / r) / r for v in x]


def warp(x, d, t_variance, r_variance, p):
    dec = lambda v: Decimal(v.numerator) / Decimal(v.denominator)
    x, d, p = [dec(v) for v in x], [dec(v) for v in d], [dec(v) for v in p]
    tv, rv = dec(t_variance), dec(r_variance)
    h = Decimal(10) ** -25
    # Derivatives of p . f along the three axes.
    q = []
    for k in range(3):
        up, down = list(x), list(x)
        up[k] += h
        down[k] -= h
        q.append(sum(pi * (a - b) for pi, a, b in zip(p, contract(up), contract(down))) / (2 * h))
    along = sum(a * b for a, b in zip(q, d))
    square = sum(a * a for a in q)
    d2 = sum(v * v for v in d)
    variance = tv * along ** 2 + rv * (square - along ** 2 / d2)
    line("warp", x, d, [tv, rv], p, [sum(a * b for a, b in zip(p, contract(x))), variance])


for m in (4, 17, 64):
    points(m, 2 * m, numbers(m))
    points(m, 9, [F(0)] * m)
spike = [F(0)] * 20
spike[7] = F(1)
points(20, 33, spike)

for n in (1, 2, 3, 40):
    blur(numbers(n), f32(0.01))
blur(spike, F(0))

for w in (numbers(30), [F(0)] * 12, spike, [f32(1e-7)] * 5, [f32(1e8), F(0), f32(1e-8)]):
    shares(w)

for n, d in ((1, 0.01), (8, 0.004), (24, 0.03), (24, 0.3)):
    dilate(edges(n), numbers(n), f32(d))
doubled = edges(10)
doubled[4] = doubled[5] = doubled[3]
dilate(doubled, numbers(10), f32(0.01))
dilate(edges(20), spike, f32(0.005))
dilate(edges(20), [F(0)] * 20, f32(0.005))

for t0, t1 in ((0, 1), (0, 1e-6), (2, 2.001), (2, 6), (1000, 1000.001), (1e5, 1e6), (0.2, 1e6),
               (3, 3.0000002), (1e-5, 1e-3)):
    cone(f32(t0), f32(t1), f32(0.0012))

for n in (1, 2, 32, 128):
    distortion(edges(n), numbers(n, 1 / n))
distortion(doubled, numbers(10))
distortion(edges(20), spike)

for n, m in ((1, 1), (32, 64), (64, 16), (5, 5)):
    interlevel(edges(n), numbers(n, 2 / n), edges(m), numbers(m, 2 / m))
same = edges(12)
interlevel(same, numbers(12), same, numbers(12))
interlevel(edges(20), spike, edges(10), numbers(10, 0.05))
interlevel(edges(20), numbers(20), edges(10), [F(0)] * 10)

for scale in (0.3, 1.01, 3, 100, 1e5):
    for _ in range(3):
        x = [f32(scale * (2 * random.random() - 1)) for _ in range(3)]
        d = [random.random() - 0.5 for _ in range(3)]
        size = sum(v * v for v in d) ** 0.5
        d = [f32(v / size) for v in d]
        p = [random.random() - 0.5 for _ in range(3)]
        size = sum(v * v for v in p) ** 0.5
        warp(x, d, f32(scale * random.random()), f32(0.01 * scale * random.random()),
             [f32(v / size) for v in p])

# Whole levels; no bin is so light that a float's rounding of its share moves a post visibly.
for n, k in ((8, 8), (64, 32), (128, 128)):
    blurred(edges(n), [f32((0.2 + random.random()) / n) for _ in range(n)], k)
for n, k in ((8, 8), (64, 32)):
    for exponent in (F(1), F(1, 2)):
        dilated(edges(n), [f32((0.2 + random.random()) / n) for _ in range(n)], k, exponent)

#!/usr/bin/env python3
"""Writes grid_training.txt: ten Adam steps of a tiny grid model in float64, with tolerances.

The model is the one that tests/model/grid_training_test.cc builds: a hash grid of 2 levels x 4
features (one dense, one hashed), density network 8-16-8, colour network (8 + 16 harmonics)-16-16-3,
six rays with other samples in each step. Written with numpy from the published formulas; gradients by
hand, checked here against complex step before anything is printed.

Tolerances are those of a float32 program with any order of summation: the run is repeated with every
matrix product disturbed at random within its a priori rounding bound n u |A| |B| and every other
result within a few u, and the largest deviation of 16 such runs is taken three times.

    /usr/bin/python3 tests/golden/grid_training.py > tests/golden/grid_training.txt
    /usr/bin/python3 tests/golden/grid_training.py shared > tests/golden/grid_training_shared.txt
    /usr/bin/python3 tests/golden/grid_training.py roulette > tests/golden/grid_training_roulette.txt

The second run has one colour, that of their mean features, for successive samples of up to 0.2 of the
light, and none for what less than 0.3 of it reaches. The third besides lets samples whose gradient by
the density network's output is below the mean learn by chance, and then by so much more.

Lines: `loss value tolerance` of each step; `layer value tolerance value tolerance ...` of each
network layer, [out x in] row by row, and `table ...`, rows of 4, after the last step.
"""
import sys

import numpy as np

SHARED, STOP, LEAST = 0.2, 0.3, 1e-10  # LEAST: what a sample counts in a mean besides its light
STEPS, U = 10, 2.0 ** -24
COUNTS = [[7, 0, 5, 9, 3, 8], [1, 16, 0, 4, 17, 2], [12, 3, 3, 0, 1, 6]]  # samples of each ray
LAYERS = [(8, 16), (16, 8), (24, 16), (16, 16), (16, 3)]  # in, out
# Scale, vertices per axis (0: hashed), rows of each level.
LEVELS = [(2.0, 4, 64), (8.0, 0, 64)]
f32 = lambda v: float(np.float32(v))
RATE, BETA1, BETA2, EPSILON, L2, HUBER = map(f32, (0.01, 0.9, 0.99, 1e-15, 1e-3, 0.1))


def uniform(stream, n):
    """n numbers of 24 bits in [0, 1): the finaliser of MurmurHash3 over a counter."""
    out = np.empty(n)
    for i in range(n):
        h = (i * 2654435761 + stream * 2654435769) & 0xFFFFFFFF
        h ^= h >> 16
        h = h * 0x85EBCA6B & 0xFFFFFFFF
        h ^= h >> 13
        h = h * 0xC2B2AE35 & 0xFFFFFFFF
        h ^= h >> 16
        out[i] = (h >> 8) / 2 ** 24
    return out


class Exact:
    """Arithmetic without noise."""

    def product(self, a, b):
        return a @ b

    def round(self, x, ulps=1):
        return x


class Noisy(Exact):
    def __init__(self, seed):
        self.random = np.random.default_rng(seed)

    def product(self, a, b):
        bound = a.shape[1] * U * (np.abs(a) @ np.abs(b))
        return a @ b + self.random.uniform(-1, 1, bound.shape) * bound

    def round(self, x, ulps=1):
        return x * (1 + ulps * U * self.random.uniform(-1, 1, np.shape(x)))


class Batch:
    def __init__(self, step):
        counts = COUNTS[step % len(COUNTS)]
        rays, n = len(counts), sum(counts)
        self.begin = np.concatenate([[0], np.cumsum(counts)])
        # Odd multiples of 1/2048 never fall on a border of either level.
        self.places = (2 * np.floor(1024 * uniform(100 * step + 10, 3 * n)) + 1).reshape(3, n) / 2048
        d = 2 * uniform(100 * step + 11, 3 * rays).reshape(3, rays) - 1
        d = d / np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        self.directions = d.astype(np.float32).astype(float)
        self.delta = uniform(100 * step + 12, n) / 4 + 1 / 16
        self.background = uniform(100 * step + 13, 3 * rays).reshape(3, rays)
        self.target = uniform(100 * step + 14, 3 * rays).reshape(3, rays)
        self.scale = f32(1 / (3 * rays))
        self.ray_of = np.repeat(np.arange(rays), counts)
        self.offset = uniform(100 * step + 15, 1)[0]


def lookup(level, places):
    """Rows [8 x n] of a level and their weights."""
    scale, side, entries = level
    at = places * scale + 0.5
    low = np.floor(at).astype(np.int64)
    far = at - low
    rows, weights = [], []
    for corner in range(8):
        bit = [corner & 1, corner >> 1 & 1, corner >> 2]
        v = [low[i] + bit[i] for i in range(3)]
        if side:
            rows.append(v[0] + side * v[1] + side * side * v[2])
        else:
            rows.append((v[0] ^ v[1] * 2654435761 ^ v[2] * 805459861) % entries)
        w = [far[i] if bit[i] else 1 - far[i] for i in range(3)]
        weights.append(w[0] * w[1] * w[2])
    return np.array(rows), np.array(weights)


def harmonics(d):
    """Degrees 0 to 3 through powers of x + i y, whose parts are rho^m cos and sin of m phi."""
    z, p = d[2], [np.ones(d.shape[1], complex)]
    for _ in range(3):
        p.append(p[-1] * (d[0] + 1j * d[1]))
    # P_l^m(z) / rho^m with the phase (-1)^m, and (2l+1)(l-m)!/(4 pi (l+m)!).
    legendre = {(0, 0): 1 + 0 * z, (1, 0): z, (1, 1): -1 + 0 * z, (2, 0): (3 * z ** 2 - 1) / 2,
                (2, 1): -3 * z, (2, 2): 3 + 0 * z, (3, 0): (5 * z ** 3 - 3 * z) / 2,
                (3, 1): -1.5 * (5 * z ** 2 - 1), (3, 2): 15 * z, (3, 3): -15 + 0 * z}
    ratio = {(0, 0): 1, (1, 0): 1, (1, 1): 2, (2, 0): 1, (2, 1): 6, (2, 2): 24, (3, 0): 1,
             (3, 1): 12, (3, 2): 120, (3, 3): 720}
    out = []
    for l in range(4):
        for m in range(-l, l + 1):
            a = abs(m)
            norm = np.sqrt((2 * l + 1) / (4 * np.pi) / ratio[l, a] * (2 if m else 1))
            out.append(norm * legendre[l, a] * (p[a].imag if m < 0 else p[a].real))
    return np.array(out)


def relu(x):
    return np.where(x.real > 0, x, 0)


def groups_of(weight, begin):
    """First sample, end and ray of each group."""
    out = []
    for r in range(len(begin) - 1):
        left, first = 1, begin[r]
        for i in range(begin[r], begin[r + 1] + 1):
            gone = i == begin[r + 1] or left < STOP
            if i > first and (gone or weight[first:i + 1].real.sum() > SHARED):
                out.append((first, i, r))
                first = i
            if gone:
                break
            left -= weight[i].real
    return out


def kept_by_chance(d, offset):
    """The columns of d that are kept, grown by the inverse of their chance; zeros for the others."""
    norms = np.abs(d).sum(0)
    chance = np.minimum(norms / norms.mean(), 1)
    drawn = np.floor(offset + np.concatenate([[0], np.cumsum(np.where(chance < 1, chance, 0))]))
    kept = (norms > 0) & ((chance == 1) | (drawn[1:] > drawn[:-1]))
    return np.where(kept, d / np.where(kept, chance, 1), 0)


def evaluate(w, table, b, q, shared, gradients=True, roulette=False):
    """Loss of a batch and its gradients by w, by table, and which table rows received any."""
    n, rays = b.places.shape[1], len(b.begin) - 1
    found = [lookup(level, b.places) for level in LEVELS]
    rows = [r + 64 * i for i, (r, _) in enumerate(found)]
    x = np.concatenate([q.round((table[r] * weight[..., None]).sum(0).T, 12)
                        for r, (_, weight) in zip(rows, found)])
    a1 = relu(q.product(w[0], x))
    h = q.product(w[1], a1)
    density = q.round(np.exp(h[0]), 2)
    alpha = q.round(-np.expm1(-q.round(density * b.delta)), 8)
    light, after, weight = np.ones((3, n + rays), density.dtype)  # behind a ray, behind a sample
    for r in range(rays):
        t = 1
        for i in range(b.begin[r], b.begin[r + 1]):
            weight[i] = q.round(t * alpha[i])
            t = q.round(t * (1 - alpha[i]), 2)
            after[i] = t
        light[r] = t

    # What has a colour: each sample, or a group of them.
    groups = groups_of(weight, b.begin) if shared else [(i, i + 1, b.ray_of[i]) for i in range(n)]
    ray_of = np.array([r for _, _, r in groups])
    share, total = np.zeros((2, n), density.dtype)  # of a sample in its mean; the group's light
    mix = np.zeros((n, len(groups)), density.dtype)
    for g, (first, end, _) in enumerate(groups):
        s = slice(first, end)
        total[s] = (weight[s] + LEAST).sum()
        share[s] = q.round((weight[s] + LEAST) / total[s], 4) if shared else 1
        mix[s, g] = share[s]
    mean = q.product(h, mix) if shared else h
    y = np.concatenate([mean, q.round(harmonics(b.directions), 6)[:, ray_of]])
    a2 = relu(q.product(w[2], y))
    a3 = relu(q.product(w[3], a2))
    colour = q.round(1 / (1 + np.exp(-q.product(w[4], a3))), 4)
    of_group = np.array([q.round(weight[a:e].sum(), e - a) for a, e, _ in groups])
    pixel = np.zeros((3, rays), colour.dtype)
    for r in range(rays):
        s = np.nonzero(ray_of == r)[0]
        t = q.round(1 - of_group[s].sum(), len(s) + 1) if shared else light[r]
        pixel[:, r] = q.product(colour[:, s], of_group[s, None])[:, 0] + t * b.background[:, r]
    e = q.round(pixel, 2) - b.target
    inside = np.abs(e.real) <= HUBER
    sign = np.where(e.real > 0, 1, -1)
    loss = np.where(inside, e * e, HUBER * (2 * sign * e - HUBER)).sum() * b.scale
    if not gradients:
        return loss

    d_pixel = q.round(2 * np.where(inside, e, sign * HUBER) * b.scale, 3)
    g = [None] * 5
    d = q.round(of_group * d_pixel[:, ray_of] * colour * (1 - colour), 6)
    g[4] = q.product(d, a3.T)
    d = np.where(a3 > 0, q.product(w[4].T, d), 0)
    g[3] = q.product(d, a2.T)
    d = np.where(a2 > 0, q.product(w[3].T, d), 0)
    g[2] = q.product(d, y.T)
    d_mean = q.product(w[2].T, d)[:8]

    # By the weights: as light of a colour, and as a part of a mean. The background shows where they
    # do not add up to 1: with a colour for every sample where the last one lets light through.
    d_weight, d = np.zeros(n), q.product(d_mean, mix.T) if shared else d_mean
    for k, (first, end, r) in enumerate(groups):
        for i in range(first, end):
            over = b.background[:, r] if shared else 0
            d_weight[i] = q.round((colour[:, k] - over) @ d_pixel[:, r], 5)
            if shared:
                d_weight[i] += q.round(d_mean[:, k] @ (h[:, i] - mean[:, k]) / total[i], 12)
    d_density = np.zeros(n)
    for r in range(rays):
        behind = 0 if shared else light[r] * (b.background[:, r] @ d_pixel[:, r])
        for i in reversed(range(b.begin[r], b.begin[r + 1])):
            d_density[i] = b.delta[i] * (q.round(after[i] * d_weight[i], 2) - q.round(behind, 2))
            behind += weight[i] * d_weight[i]
    d[0] += q.round(d_density * density, 4)
    if roulette:
        d = q.round(kept_by_chance(d, b.offset), d.shape[1] + 12)
    g[1] = q.product(d, a1.T)
    d = np.where(a1 > 0, q.product(w[1].T, d), 0)
    g[0] = q.product(d, x.T)
    d = q.product(w[0].T, d)
    g_table, touched = np.zeros_like(table), np.zeros(len(table), bool)
    for level, (r, (_, weight)) in enumerate(zip(rows, found)):
        part = d[4 * level:4 * level + 4]
        for i in np.nonzero(np.abs(part).sum(0))[0]:
            for corner in range(8):
                g_table[r[corner, i]] += q.round(weight[corner, i] * part[:, i], 4)
                touched[r[corner, i]] = True
    return loss, g, g_table, touched


def adam(g, m, v, w, t, q):
    m[...] = q.round(BETA1 * m + (1 - BETA1) * g, 3)
    v[...] = q.round(BETA2 * v + (1 - BETA2) * g * g, 4)
    m_hat, v_hat = m / (1 - BETA1 ** t), v / (1 - BETA2 ** t)
    w[...] = q.round(w - q.round(RATE * m_hat / (np.sqrt(v_hat) + EPSILON), 6))


def start():
    w = [(2 * uniform(1 + i, a * b) - 1).reshape(b, a) / 2 for i, (a, b) in enumerate(LAYERS)]
    return w, (2 * uniform(9, 4 * 128) - 1).reshape(128, 4) / 2


def train(q, shared, roulette):
    w, table = start()
    moments = [(np.zeros_like(a), np.zeros_like(a)) for a in w]
    m, v, counters = np.zeros_like(table), np.zeros_like(table), np.zeros(128)
    losses = []
    for step in range(STEPS):
        loss, g, g_table, touched = evaluate(w, table, Batch(step), q, shared,
                                             roulette=roulette)
        losses.append(loss)
        for a, da, (ma, va) in zip(w, g, moments):
            adam(q.round(da + L2 * a), ma, va, a, step + 1, q)
        for r in np.nonzero(touched)[0]:
            counters[r] += 1
            adam(g_table[r], m[r], v[r], table[r], counters[r], q)
    return losses, w, table


def check_gradients(shared):
    w, table = start()
    _, g, g_table, _ = evaluate(w, table, Batch(0), Exact(), shared)
    for arrays, analytic in ((w, g), ([table], [g_table])):
        for k, a in enumerate(arrays):
            for i in range(0, a.size, 7):
                c = [x.astype(complex) for x in arrays]
                c[k].flat[i] += 1e-50j
                both = (c, table) if arrays is w else (w, c[0])
                want = evaluate(*both, Batch(0), Exact(), shared, gradients=False).imag / 1e-50
                assert abs(analytic[k].flat[i] - want) < 1e-12, (k, i, analytic[k].flat[i], want)


def main():
    roulette = sys.argv[1:] == ["roulette"]
    shared = roulette or sys.argv[1:] == ["shared"]
    check_gradients(shared)
    losses, w, table = train(Exact(), shared, roulette)
    runs = [train(Noisy(seed), shared, roulette) for seed in range(16)]

    def line(kind, value, others):
        value = np.asarray(value)
        worst = 3 * np.max([np.abs(np.asarray(o) - value) for o in others], axis=0) + U * np.abs(value)
        print(kind, " ".join(f"{v:.12g} {t:.2g}" for v, t in zip(value.ravel(), worst.ravel())))

    for i, loss in enumerate(losses):
        line("loss", loss, [r[0][i] for r in runs])
    for i, a in enumerate(w):
        line("layer", a, [r[1][i] for r in runs])
    line("table", table, [r[2] for r in runs])


main()

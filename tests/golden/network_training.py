#!/usr/bin/env python3
"""Writes network_training.txt: ten Adam steps of two tiny radiance networks in float64.

The networks are those that tests/model/network_training_test.cc builds. `points`: frequency encoding, a
ReLU density, squared error (Mildenhall et al. 2020). `gaussians`: integrated encoding, a softplus density,
padded colours, an opaque last interval, Charbonnier and distortion loss (Barron et al. 2021, 2022). Both
have a trunk of three layers of 16 with the encoding given again behind the second, a density head, a
bottleneck of 5 and a view layer of 7 behind it. Written with numpy from the published formulas; gradients
by hand, checked here against complex step before anything is printed.

Tolerances are those of a float32 program with any order of summation: the run is repeated with every
matrix product disturbed at random within its a priori rounding bound n u |A| |B| and every other
result within a few u, and the largest deviation of 16 such runs is taken three times.

    /usr/bin/python3 tests/golden/network_training.py > tests/golden/network_training.txt

Lines: `points-loss value tolerance` of each step; `points-layer value tolerance value tolerance ...` of
each layer after the last step, [out x in] row by row, then its biases; the same of `gaussians`.
"""
import numpy as np

STEPS, RAYS, U = 10, 5, 2.0 ** -24
SAMPLES = 7  # of every ray
f32 = lambda v: float(np.float32(v))
RATE, BETA1, BETA2, EPSILON = map(f32, (0.01, 0.9, 0.999, 1e-6))
PADDING, CHARBONNIER, DISTORTION, BIAS = map(f32, (0.001, 0.001, 0.01, -1))
DEGREES, VIEW_DEGREES, WIDTH, BOTTLENECK, VIEW_WIDTH = 2, 1, 16, 5, 7


def uniform(stream, n):
    """n numbers of 24 bits in [0, 1): the finaliser of MurmurHash3 over a counter."""
    i = np.arange(n, dtype=np.uint64)
    mask = np.uint64(0xFFFFFFFF)
    h = (i * np.uint64(2654435761) + np.uint64(stream * 2654435769 & 0xFFFFFFFF)) & mask
    h ^= h >> np.uint64(16)
    h = h * np.uint64(0x85EBCA6B) & mask
    h ^= h >> np.uint64(13)
    h = h * np.uint64(0xC2B2AE35) & mask
    h ^= h >> np.uint64(16)
    return (h >> np.uint64(8)).astype(float) / 2 ** 24


class Exact:
    """Arithmetic without noise."""

    def product(self, a, b):
        return a @ b

    def round(self, x, ulps=1):
        return x

    def shift(self, x, ulps=1):
        return x


class Noisy(Exact):
    def __init__(self, seed):
        self.random = np.random.default_rng(seed)

    def product(self, a, b):
        bound = (a.shape[1] + 1) * U * (np.abs(a) @ np.abs(b))
        return a @ b + self.random.uniform(-1, 1, bound.shape) * bound

    def round(self, x, ulps=1):
        return x * (1 + ulps * U * self.random.uniform(-1, 1, np.shape(x)))

    def shift(self, x, ulps=1):  # of numbers up to 1
        return x + ulps * U * self.random.uniform(-1, 1, np.shape(x))


class Batch:
    def __init__(self, step):
        n, stream = RAYS * SAMPLES, 100 * step
        self.mean = (2 * uniform(stream + 10, 3 * n) - 1).reshape(3, n)
        self.variance = (uniform(stream + 11, 3 * n) / 4).reshape(3, n)
        d = 2 * uniform(stream + 12, 3 * RAYS).reshape(3, RAYS) - 1
        d = d / np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        self.directions = d.astype(np.float32).astype(float)
        self.delta = uniform(stream + 13, n) / 4 + 1 / 16
        self.background = uniform(stream + 14, 3 * RAYS).reshape(3, RAYS)
        self.target = uniform(stream + 15, 3 * RAYS).reshape(3, RAYS)
        self.scale = f32(1 / (3 * RAYS))
        # Edges of each ray's intervals in normalised distance: multiples of 1/1024.
        steps = 1 + np.floor(127 * uniform(stream + 16, RAYS * (SAMPLES + 1))).reshape(RAYS, -1)
        self.edges = np.cumsum(steps, 1) / 1024
        self.ray_of = np.repeat(np.arange(RAYS), SAMPLES)


def frequencies(x, degrees):
    parts = [x]
    for k in range(degrees):
        parts += [np.sin(2 ** k * x), np.cos(2 ** k * x)]
    return np.concatenate(parts)


def integrated(mean, variance, degrees):
    damped = [np.exp(-0.5 * 4 ** k * variance) for k in range(degrees)]
    sines = [d * np.sin(2 ** k * mean) for k, d in enumerate(damped)]
    cosines = [d * np.cos(2 ** k * mean) for k, d in enumerate(damped)]
    return np.concatenate(sines + cosines)


def shapes(gaussians):
    code = 2 * 3 * DEGREES + (0 if gaussians else 3)
    return [(code, WIDTH), (WIDTH, WIDTH), (code + WIDTH, WIDTH), (WIDTH, 1), (WIDTH, BOTTLENECK),
            (BOTTLENECK + 3 + 6 * VIEW_DEGREES, VIEW_WIDTH), (VIEW_WIDTH, 3)]


def relu(x):
    return np.where(x.real > 0, x, 0)


def evaluate(w, bias, b, gaussians, q, gradients=True):
    """Loss of a batch and its gradients by weights and biases."""
    layer = lambda i, x: q.product(w[i], x) + bias[i][:, None]
    if gaussians:
        x = q.shift(integrated(b.mean, b.variance, DEGREES), 6)
    else:
        x = np.concatenate([b.mean, q.shift(frequencies(b.mean, DEGREES)[3:], 4)])
    a0 = relu(layer(0, x))
    a1 = relu(layer(1, a0))
    c = np.concatenate([x, a1])
    a2 = relu(layer(2, c))
    raw = layer(3, a2)[0]
    if gaussians:
        at = raw + BIAS
        density = q.round(np.log(1 + np.exp(at)), 6)
        slope = q.round(1 / (1 + np.exp(-at)), 6)
    else:
        density, slope = relu(raw), np.where(raw.real > 0, 1.0, 0.0)
    view = q.shift(frequencies(b.directions, VIEW_DEGREES), 4)[:, b.ray_of]
    y = np.concatenate([layer(4, a2), view])
    z = relu(layer(5, y))
    colour = q.round(1 / (1 + np.exp(-layer(6, z))), 6)
    padding = PADDING if gaussians else 0
    shown = q.round(colour * (1 + 2 * padding) - padding, 2)

    alpha = q.round(-np.expm1(-density * b.delta), 8)
    n = len(alpha)
    after, weight = np.ones((2, n), colour.dtype)
    pixel = np.zeros((3, RAYS), colour.dtype)
    for r in range(RAYS):
        t = 1
        for i in range(r * SAMPLES, (r + 1) * SAMPLES):
            opaque = gaussians and i + 1 == (r + 1) * SAMPLES
            weight[i] = t if opaque else q.round(t * alpha[i])
            t = q.round(t * (1 - alpha[i]), 2)
            after[i] = t
        s = slice(r * SAMPLES, (r + 1) * SAMPLES)
        rest = q.shift(1 - weight[s].sum(), SAMPLES)
        pixel[:, r] = q.product(shown[:, s], weight[s, None])[:, 0] + rest * b.background[:, r]
    e = q.shift(pixel, 3) - b.target
    if gaussians:
        root = np.sqrt(e * e + CHARBONNIER ** 2)
        loss, d_pixel = (root * b.scale).sum(), q.round(e / root * b.scale, 4)
    else:
        loss, d_pixel = (e * e * b.scale).sum(), q.round(2 * e * b.scale, 3)

    d_weight = (d_pixel[:, b.ray_of] * (shown - b.background[:, b.ray_of])).sum(0)
    if gaussians:
        for r in range(RAYS):
            s = slice(r * SAMPLES, (r + 1) * SAMPLES)
            middle = (b.edges[r, 1:] + b.edges[r, :-1]) / 2
            apart, width = np.abs(middle[:, None] - middle), np.diff(b.edges[r])
            v, share = weight[s], DISTORTION / RAYS
            loss = loss + share * (v @ apart @ v + (v * v * width).sum() / 3)
            d_weight[s] += q.round(share * (2 * apart @ v + 2 * v * width / 3), 8)
    if not gradients:
        return loss
    d_weight = q.round(d_weight, 6)

    d_density = np.zeros(n)
    for r in range(RAYS):
        behind = 0
        for i in reversed(range(r * SAMPLES, (r + 1) * SAMPLES)):
            if not (gaussians and i + 1 == (r + 1) * SAMPLES):
                d_density[i] = b.delta[i] * (q.round(after[i] * d_weight[i], 2) - behind)
            behind = q.round(behind + weight[i] * d_weight[i], 2)
    g, g_bias = [None] * 7, [None] * 7

    def back(i, d, x):
        g[i], g_bias[i] = q.product(d, x.T), q.product(d, np.ones((n, 1)))[:, 0]
        return q.product(w[i].T, d)

    d = q.round(weight * d_pixel[:, b.ray_of] * (1 + 2 * padding) * colour * (1 - colour), 8)
    d = np.where(z > 0, back(6, d, z), 0)
    d = back(5, d, y)[:BOTTLENECK]
    d_a2 = back(4, d, a2) + back(3, q.round(d_density * slope, 4)[None], a2)
    d = back(2, np.where(a2 > 0, d_a2, 0), c)[len(x):]
    d = back(1, np.where(a1 > 0, d, 0), a0)
    back(0, np.where(a0 > 0, d, 0), x)
    return loss, g, g_bias


def adam(g, m, v, w, t, q):
    m[...] = q.round(BETA1 * m + (1 - BETA1) * g, 3)
    v[...] = q.round(BETA2 * v + (1 - BETA2) * g * g, 4)
    m_hat, v_hat = m / (1 - BETA1 ** t), v / (1 - BETA2 ** t)
    w[...] = q.round(w - q.round(RATE * m_hat / (np.sqrt(v_hat) + EPSILON), 6))


def start(gaussians):
    w = [(2 * uniform(1 + i, a * b) - 1).reshape(b, a) / 2
         for i, (a, b) in enumerate(shapes(gaussians))]
    bias = [(2 * uniform(21 + i, b) - 1) / 4 for i, (_, b) in enumerate(shapes(gaussians))]
    return w, bias


def train(gaussians, q):
    w, bias = start(gaussians)
    moments = [(np.zeros_like(a), np.zeros_like(a)) for a in w + bias]
    losses = []
    for step in range(STEPS):
        loss, g, g_bias = evaluate(w, bias, Batch(step), gaussians, q)
        losses.append(loss)
        for a, da, (ma, va) in zip(w + bias, g + g_bias, moments):
            adam(da, ma, va, a, step + 1, q)
    return losses, [np.concatenate([a.ravel(), b]) for a, b in zip(w, bias)]


def check_gradients(gaussians):
    w, bias = start(gaussians)
    _, g, g_bias = evaluate(w, bias, Batch(0), gaussians, Exact())
    for arrays, analytic in ((w, g), (bias, g_bias)):
        for k, a in enumerate(arrays):
            for i in range(0, a.size, 3):
                c = [x.astype(complex) for x in arrays]
                c[k].flat[i] += 1e-50j
                both = (c, bias) if arrays is w else (w, c)
                want = evaluate(*both, Batch(0), gaussians, Exact(), gradients=False).imag / 1e-50
                assert abs(analytic[k].flat[i] - want) < 1e-12, (k, i, analytic[k].flat[i], want)


def main():
    for name, gaussians in (("points", False), ("gaussians", True)):
        check_gradients(gaussians)
        losses, layers = train(gaussians, Exact())
        runs = [train(gaussians, Noisy(seed)) for seed in range(16)]

        def line(kind, value, others):
            value = np.asarray(value)
            worst = 3 * np.max([np.abs(np.asarray(o) - value) for o in others], axis=0)
            worst = worst + U * np.abs(value)
            print(f"{name}-{kind}",
                  " ".join(f"{v:.12g} {t:.2g}" for v, t in zip(value.ravel(), worst.ravel())))

        for i, loss in enumerate(losses):
            line("loss", loss, [r[0][i] for r in runs])
        for i, a in enumerate(layers):
            line("layer", a, [r[1][i] for r in runs])


main()

#!/usr/bin/env python3
"""Writes metrics.txt: PSNR and SSIM of made-up pictures, in float64, the long way.

SSIM by its definition, window after window, with the full 11 x 11 Gaussian; nothing is separable
here and nothing is shared with the engine's code. Each line: case, width, height, channels, masked
(0 or 1), PSNR, SSIM. The pictures follow from the case's number, see picture().

    python3 tests/golden/metrics.py > tests/golden/metrics.txt
"""
import numpy as np

MASK = 2**32 - 1


def noise(seed, count):
    """`count` numbers of 0 to 255 from a 32-bit linear congruential generator."""
    state, out = seed, []
    for _ in range(count):
        state = (state * 1664525 + 1013904223) & MASK
        out.append(state >> 24)
    return np.array(out, dtype=np.int64)


def picture(case, width, height, channels):
    """Picture a: a ramp with some noise. Picture b: a, changed in a way of the case's own."""
    y, x, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(channels), indexing="ij")
    n = noise(case + 1, width * height * channels).reshape(height, width, channels)
    m = noise(case + 1001, width * height * channels).reshape(height, width, channels)
    a = (x * 3 + y * 2 + c * 40 + n // 4) % 256
    if case == 0:      # a little noise
        b = np.clip(a + m // 16 - 8, 0, 255)
    elif case == 1:    # inverted: covariance below 0
        b = 255 - a
    elif case == 2:    # flat against flat: variances of 0
        a, b = np.full_like(a, 200), np.full_like(a, 190)
    elif case == 3:    # unrelated
        b = m
    elif case == 4:    # paler
        b = a // 2 + 60
    else:              # moved by a pixel
        b = np.roll(a, 1, axis=1)
    return a, b


def ssim_map(a, b, keep):
    """Masked-out pixels have no weight in a window; nan where its centre is masked out."""
    i = np.arange(11) - 5
    g = np.exp(-0.5 * (i / 1.5) ** 2)
    gauss = np.outer(g, g)
    height, width, channels = a.shape
    result = np.zeros((height - 10, width - 10, channels))
    for y in range(height - 10):
        for x in range(width - 10):
            if not keep[y + 5, x + 5]:
                result[y, x] = np.nan
                continue
            window = gauss * keep[y:y + 11, x:x + 11]
            window = window / window.sum()
            for c in range(channels):
                p, q = a[y:y + 11, x:x + 11, c], b[y:y + 11, x:x + 11, c]
                mp, mq = (window * p).sum(), (window * q).sum()
                vp = max(0.0, (window * p * p).sum() - mp * mp)
                vq = max(0.0, (window * q * q).sum() - mq * mq)
                cov = (window * p * q).sum() - mp * mq
                cov = np.sign(cov) * min(np.sqrt(vp * vq), abs(cov))
                result[y, x, c] = ((2 * mp * mq + 1e-4) * (2 * cov + 9e-4)
                                   / ((mp * mp + mq * mq + 1e-4) * (vp + vq + 9e-4)))
    return result


def main():
    print("# case width height channels masked psnr ssim; made by metrics.py")
    for case, (width, height, channels) in enumerate(
            [(47, 33, 3), (20, 50, 3), (30, 30, 3), (11, 11, 3), (64, 21, 1), (13, 90, 4)]):
        a, b = (p / 255.0 for p in picture(case, width, height, channels))
        keep = (noise(case + 5001, width * height).reshape(height, width) >= 100)
        for masked in (0, 1):
            k = keep if masked else np.ones_like(keep)
            mse = ((a - b) ** 2)[k].mean()
            ssim = ssim_map(a, b, k)[k[5:-5, 5:-5]]
            print(case, width, height, channels, masked, repr(float(-10 * np.log10(mse))),
                  repr(float(ssim.mean())) if ssim.size else "none")


if __name__ == "__main__":
    main()

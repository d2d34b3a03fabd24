"""Compiled inner loops of seeing targets; their plain-numpy twins are in the tests."""

from __future__ import annotations

from numba import njit

from armsight.arrays import Bytes, Floats, Floats32


@njit(cache=True, nogil=True)
def last_steps_down(
    values: Floats32,
    inside: Bytes,
    at: Floats32,
    width: int,
    height: int,
    off: int,
    clear: float,
    out: Floats,
) -> None:
    """Write where each ray crosses the half level of its last step down, in samples.

    Args:
        values: (m, r) the signal along each ray.
        inside: (m, r) not 0 in the region.
        at: (m, r, 2) the samples' pixels.
        width: of the picture [px].
        height: of the picture [px].
        off: samples from the border to both levels.
        clear: least height of a step.
        out: (m,) the crossing in samples from the first, or -1: no clear step in the picture.
    """
    rays, samples = values.shape
    for i in range(rays):
        out[i] = -1.0
        k = samples - 1
        while k >= 0 and inside[i, k] == 0:
            k -= 1
        if k - off - 1 < 0 or k + off + 3 >= samples:
            continue
        u, v = at[i, k + off + 2]
        if not (0.0 <= u <= width - 1.0 and 0.0 <= v <= height - 1.0):
            continue
        low = 0.5 * (values[i, k + off + 1] + values[i, k + off + 2])
        high = 0.5 * (values[i, k - off - 1] + values[i, k - off])
        if high - low < clear:
            continue
        level = 0.5 * (high + low)
        for j in range(k - off, k + off + 1):
            if values[i, j] >= level > values[i, j + 1]:
                out[i] = j + (values[i, j] - level) / (values[i, j] - values[i, j + 1])
                break

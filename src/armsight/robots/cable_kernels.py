"""Compiled shapes of a cable between two ends: how it hangs still, and how it swings.

Still it is the catenary of its length. It swings as a chain of point masses on rods of fixed length
that resist bending: symplectic steps, and after each the rods' lengths by Newton's method, whose
matrix is tridiagonal (Goldenthal et al., Efficient simulation of inextensible cloth, 2007). Plain
twins are in the tests: the catenary's own properties, and a chain in MuJoCo.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Points, Vector3

GRAVITY = 9.81
TAUT = 1.0005
"""A cable is at least so much longer than the way: what is shorter would be torn off."""
PLUMB = 1e-3
"""A hanger that is less than this aside hangs straight above [m]."""
STEP = 0.002
"""Of the chain [s]."""
ROUNDS = 3
"""Of Newton's method a step."""
LOOK = 1e-3
"""Ahead, for how fast a still cable moves [s]."""


@njit(cache=True, nogil=True)
def catenary(along: float, up: float, length: float) -> tuple[float, float]:
    """The curve's a, and how far aside of its first end its lowest point would be [m].

    sqrt(L^2 - v^2) = 2 a sinh(h / 2 a), by Newton's method on u = h / 2 a.

    Args:
        along: h, the way between its ends aside [m].
        up: v, upwards [m].
        length: L, more than the way [m].
    """
    ratio = np.sqrt(length * length - up * up) / along
    u = np.sqrt(6.0 * (ratio - 1.0)) if ratio < 3.0 else np.log(2.0 * ratio) + 1.0
    for _ in range(30):
        step = (np.sinh(u) - ratio * u) / (np.cosh(u) - ratio)
        u -= step
        if abs(step) < 1e-12:
            break
    a = 0.5 * along / u
    return a, 0.5 * along - a * np.arctanh(up / length)


@njit(cache=True, nogil=True)
def hang(end: Vector3, hanger: Vector3, length: float, out: Points) -> None:
    """Write (n, 3) points of a still cable from its end to its hanger, equally far apart [m]."""
    n = out.shape[0]
    wx, wy, wz = hanger[0] - end[0], hanger[1] - end[1], hanger[2] - end[2]
    along = np.sqrt(wx * wx + wy * wy)
    length = max(length, TAUT * np.sqrt(along * along + wz * wz))
    if along < PLUMB:
        down = 0.5 * (length - wz)
        for k in range(n):
            out[k, 0], out[k, 1] = end[0], end[1]
            out[k, 2] = end[2] + abs(length * k / (n - 1) - down) - down
        return
    a, lowest = catenary(along, wz, length)
    first, high = np.sinh(-lowest / a), np.cosh(lowest / a)
    for k in range(n):
        x = lowest + a * np.arcsinh(length * k / (n - 1) / a + first)
        out[k, 0] = end[0] + x * wx / along
        out[k, 1] = end[1] + x * wy / along
        out[k, 2] = end[2] + a * (np.cosh((x - lowest) / a) - high)


@njit(cache=True, nogil=True)
def swing(
    place: Points,
    velocity: Points,
    to: Vector3,
    seconds: float,
    length: float,
    mass: float,
    bending: float,
    damping: float,
) -> None:
    """Let a cable move while its first end is led straight to a place; the other is held.

    Args:
        place: (n + 1, 3) points of it, equally far apart, replaced [m].
        velocity: (n + 1, 3) theirs, replaced [m/s].
        to: (3,) where its first end is in the end [m].
        seconds: how long that takes.
        length: of all of it [m].
        mass: of a metre [kg/m].
        bending: what resists bending [N m^2].
        damping: what resists its change [N m^2 s].
    """
    n = place.shape[0] - 1
    steps = max(int(np.ceil(seconds / STEP)), 1)
    h = seconds / steps
    reach = np.sqrt(((place[n] - to) ** 2).sum())
    reach = max(reach, np.sqrt(((place[n] - place[0]) ** 2).sum()))
    piece = max(length, TAUT * reach) / n
    of_one = mass * piece
    stiff, slows = bending / piece**3 / of_one, damping / piece**3 / of_one
    lead = (to - place[0]) / seconds
    speeds = np.empty_like(place)
    way, back, gap = np.empty((n, 3)), np.empty(n), np.empty(n)
    for _ in range(steps):
        speeds[:] = velocity
        for i in range(1, n):
            speeds[i, 2] -= h * GRAVITY
        for i in range(1, n):
            for c in range(3):
                kink = place[i - 1, c] - 2.0 * place[i, c] + place[i + 1, c]
                turns = velocity[i - 1, c] - 2.0 * velocity[i, c] + velocity[i + 1, c]
                push = h * (stiff * kink + slows * turns)
                speeds[i, c] += 2.0 * push
                speeds[i - 1, c] -= push
                speeds[i + 1, c] -= push
        for c in range(3):
            speeds[0, c], speeds[n, c] = lead[c], 0.0
        velocity[:] = place  # where each was, until the step is done
        for i in range(n + 1):
            for c in range(3):
                place[i, c] += h * speeds[i, c]
        for _ in range(ROUNDS):
            _keep_lengths(place, piece, way, back, gap)
        for i in range(n + 1):
            for c in range(3):
                velocity[i, c] = (place[i, c] - velocity[i, c]) / h


@njit(cache=True, nogil=True)
def _keep_lengths(place: Points, piece: float, way: Points, back: Points, gap: Points) -> None:
    """One step towards rods of length ``piece`` [m]; the ends stay. The rest is working memory."""
    n = place.shape[0] - 1
    for i in range(n):
        square = 0.0
        for c in range(3):
            way[i, c] = place[i + 1, c] - place[i, c]
            square += way[i, c] * way[i, c]
        long = max(np.sqrt(square), 1e-9)
        for c in range(3):
            way[i, c] /= long
        gap[i] = long - piece
    # Thomas' algorithm; the ends are too heavy to move.
    for i in range(n):
        middle = (0.0 if i == 0 else 1.0) + (0.0 if i == n - 1 else 1.0) + 1e-9
        if i > 0:
            side = -(way[i - 1, 0] * way[i, 0] + way[i - 1, 1] * way[i, 1])
            side -= way[i - 1, 2] * way[i, 2]
            middle -= side * back[i - 1]
            gap[i] -= side * gap[i - 1]
        after = 0.0
        if i < n - 1:
            after = -(way[i, 0] * way[i + 1, 0] + way[i, 1] * way[i + 1, 1])
            after -= way[i, 2] * way[i + 1, 2]
        back[i] = after / middle
        gap[i] /= middle
    for i in range(n - 2, -1, -1):
        gap[i] -= back[i] * gap[i + 1]
    for i in range(1, n):
        for c in range(3):
            place[i, c] += gap[i] * way[i, c] - gap[i - 1] * way[i - 1, c]


@njit(cache=True, nogil=True)
def dragged(
    end: Vector3, lead: Vector3, hanger: Vector3, length: float, center: Points, velocity: Points
) -> None:
    """Write the (k, 3) middles of a still cable's pieces, and how fast they move with its end.

    Args:
        end: (3,) where it leaves the tool [m].
        lead: (3,) how fast that moves [m/s].
        hanger: (3,) where it hangs [m].
        length: of it [m].
        center: (k, 3) out [m].
        velocity: (k, 3) out [m/s].
    """
    k = center.shape[0]
    now, soon = np.empty((k + 1, 3)), np.empty((k + 1, 3))
    hang(end, hanger, length, now)
    hang(end + LOOK * lead, hanger, length, soon)
    for i in range(k):
        for c in range(3):
            middle = 0.5 * (now[i, c] + now[i + 1, c])
            center[i, c] = middle
            velocity[i, c] = (0.5 * (soon[i, c] + soon[i + 1, c]) - middle) / LOOK

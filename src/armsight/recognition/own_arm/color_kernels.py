"""Compiled loops for outlines in colour; plain-numpy twins are in the tests.

Lenses are straight here: pictures are rectified first. A lens is fx, fy, cx, cy.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints, Points, Pose, Poses

INSET = 0.5
"""How far the middle of a rim's pixel lies within the outline, on average [px]."""
UNEXPLAINED = 0.4
"""Weight of what moved beside the arm, in a patch that the arm touches: it may be a shadow."""


@njit(cache=True, nogil=True)
def silhouette_agreement(
    poses: Poses, points: Floats, patches: Ints, areas: Ints, lens: Floats, spacing: float
) -> Floats:
    """(k,) how well an arm at (k, 4, 4) poses explains what moved, 0..1: a Dice coefficient.

    What stands at the same place in most views belongs to the median picture and does not show as
    moved; neither is it asked for.

    Args:
        poses: ``T_camera_base``.
        points: (f, m, 3) of the arm's surface in ``base``, one row a view.
        patches: (f, h, w) cells of the pictures: number of the patch that moved there, 0 for none.
        areas: (f, p) cells of each patch; patch 0 is what stands.
        lens: of the cells.
        spacing: of the points [m].
    """
    frames, count = points.shape[0], points.shape[1]
    h, w = patches.shape[1], patches.shape[2]
    out = np.zeros(poses.shape[0])
    often = np.zeros((h, w), np.int64)  # in how many views the arm is there
    seen = np.zeros((frames, h, w), np.uint8)
    marked = np.empty((frames, h * w, 2), np.int64)  # where: only these cells are visited
    marks = np.zeros(frames, np.int64)
    touched = np.zeros(areas.shape[1], np.bool_)
    for k in range(poses.shape[0]):
        T = poses[k]
        outside = 0
        for f in range(frames):
            marks[f] = 0
            for i in range(count):
                p = points[f, i]
                z = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3]
                if z < 0.2:
                    outside += 1
                    continue
                x = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3]
                y = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3]
                u = int(np.floor(lens[0] * x / z + lens[2] + 0.5))
                v = int(np.floor(lens[1] * y / z + lens[3] + 0.5))
                if u < 0 or v < 0 or u >= w or v >= h:
                    outside += 1
                    continue
                r = int(0.5 * spacing * lens[0] / z + 0.3)
                for b in range(max(v - r, 0), min(v + r, h - 1) + 1):
                    for a in range(max(u - r, 0), min(u + r, w - 1) + 1):
                        if seen[f, b, a] == 0:
                            seen[f, b, a] = 1
                            often[b, a] += 1
                            marked[f, marks[f], 0], marked[f, marks[f], 1] = b, a
                            marks[f] += 1
        hits, asked, beside = 0, 0, 0
        for f in range(frames):
            touched[:] = False
            explained = 0
            for i in range(marks[f]):
                b, a = marked[f, i, 0], marked[f, i, 1]
                patch = patches[f, b, a]
                if 2 * often[b, a] > frames:
                    explained += patch > 0
                    continue
                asked += 1
                if patch > 0:
                    hits += 1
                    explained += 1
                    touched[patch] = True
            whole = 0
            for patch in range(1, areas.shape[1]):
                if touched[patch]:
                    whole += areas[f, patch]
            beside += max(whole - explained, 0)
        for f in range(frames):
            for i in range(marks[f]):
                b, a = marked[f, i, 0], marked[f, i, 1]
                seen[f, b, a] = 0
                often[b, a] = 0
        if asked >= 4 * frames:
            share = 1.0 - outside / (frames * count)
            out[k] = share * 2.0 * hits / (asked + hits + UNEXPLAINED * beside)
    return out


@njit(cache=True, nogil=True)
def bilinear(image: Floats32, u: float, v: float, c: int) -> float:
    """Value of a channel of an (h, w, channels) image between its pixels; the border goes on."""
    h, w = image.shape[0], image.shape[1]
    u, v = min(max(u, 0.0), w - 1.001), min(max(v, 0.0), h - 1.001)
    a, b = int(u), int(v)
    s, t = u - a, v - b
    return (1 - t) * ((1 - s) * image[b, a, c] + s * image[b, a + 1, c]) + t * (
        (1 - s) * image[b + 1, a, c] + s * image[b + 1, a + 1, c]
    )


@njit(cache=True, nogil=True)
def outline_equations(
    T: Pose,
    points: Points,
    normals: Floats,
    group: Ints,
    image: Floats32,
    lens: Floats,
    reach: int,
    scale: float,
    least: float,
    H: Floats,
    g: Floats,
    found: Floats,
) -> int:
    """Add the distances of an outline from the picture's edges to the normal equations of a pose.

    Along each point's normal the best edge is looked for (Harris and Stennett 1990, RAPiD): where
    the colour changes, and what moved ends.

    Args:
        T: ``T_camera_base``.
        points: (m, 3) of the outline in ``base``.
        normals: (m, 2) in the picture, outwards.
        group: (m,) cluster of each.
        image: (h, w, 4) red, green, blue, and how much of it moved, 0..255.
        lens: of the picture.
        reach: how far edges are looked for [px].
        scale: of the distances, for Cauchy's weights [px].
        least: weaker edges are none, grey levels.
        H: (clusters, 6, 6), added to.
        g: (clusters, 6), added to.
        found: (m,) written: distance of the edge [px], NaN for none.

    Returns:
        How many points have an edge.
    """
    h, w = image.shape[0], image.shape[1]
    J = np.empty(6)
    used = 0
    for i in range(points.shape[0]):
        found[i] = np.nan
        p = points[i]
        x = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3]
        y = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3]
        z = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3]
        if z < 0.2:
            continue
        nu, nv = normals[i, 0], normals[i, 1]
        u, v = lens[0] * x / z + lens[2], lens[1] * y / z + lens[3]
        if u < 3 or v < 3 or u > w - 4 or v > h - 4:
            continue
        best, at = 0.0, 0.0
        before, after = 0.0, 0.0
        last, top = 0.0, 0.0
        peak = False
        for s in range(-reach - 1, reach + 2):
            edge = 0.0
            for c in range(3):
                d = bilinear(image, u + nu * (s + 1.0), v + nv * (s + 1.0), c) - bilinear(
                    image, u + nu * (s - 1.0), v + nv * (s - 1.0), c
                )
                edge = max(edge, abs(d))
            inside = bilinear(image, u + nu * (s - 2.0), v + nv * (s - 2.0), 3)
            outside = bilinear(image, u + nu * (s + 2.0), v + nv * (s + 2.0), 3)
            ends = max(inside - outside, 0.0)
            strength = (edge + ends) * (1.0 - 0.5 * (s / (reach + 1.0)) ** 2)
            if peak:
                after = strength
                peak = False
            if strength > best and abs(s) <= reach:
                best, at = strength, float(s)
                before, after = last, 0.0
                top = edge + ends
                peak = True
            last = strength
        if top < least:
            continue
        # The top of a parabola through the strongest and its neighbours.
        bend = before - 2.0 * best + after
        if bend < -1e-6:
            at += min(max(0.5 * (before - after) / bend, -0.5), 0.5)
        at -= INSET
        found[i] = at
        weight = 1.0 / (scale * scale * (1.0 + (at / scale) ** 2))
        au, av = lens[0] * nu / z, lens[1] * nv / z
        # Distance along the normal of d(pixel)/d(point).
        jx, jy, jz = au, av, -(au * x + av * y) / z
        J[0], J[1], J[2] = jx, jy, jz
        J[3], J[4], J[5] = y * jz - z * jy, z * jx - x * jz, x * jy - y * jx
        for a in range(6):
            g[group[i], a] -= weight * J[a] * at
            for b in range(6):
                H[group[i], a, b] += weight * J[a] * J[b]
        used += 1
    return used

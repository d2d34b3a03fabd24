"""Crops as other cameras would have shown them, and the targets that belong to them.

Turning about the optical axis, zooming and shifting a crop are what a virtual camera does that is
aimed a little differently; nothing is mirrored, since a mirrored arm is another arm. Every draw
follows from the seed and the sample's number in the training, so nothing here is state.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Floats32, Ints
from armsight.recognition.any_arm.learning.examples import HALF, SCALE, UNSEEN, Examples
from armsight.recognition.any_arm.views import GREY

STRIDE = 4
_LINKS = 10
_SHRUNK = 0.75
"""Scale below which single pixels of an image would alias."""


@dataclass(frozen=True)
class Changes:
    """How much crops are changed.

    Attributes:
        size: side of what comes out [px].
        extent: least and greatest longer side of the arm, share of the crop; a share ``wide`` of
            the crops has arms smaller than that, down to ``least``.
        zoom: least and greatest scale of the pixels.
        turn_deg: about the optical axis, either way.
        shift: of the arm from the middle, share of the room that is left, either way.
        gain: of the whole, log, standard deviation; tint: of each channel.
        grey, blur, noise, jpeg, cover: probabilities; surrounded: of another room, and not the
            grey of :func:`armsight.recognition.any_arm.views.take_crop`, beyond its edges;
            elsewhere: the arm alone before another room; shaded: light that changes across.
    """

    size: int = 128
    extent: tuple[float, float] = (0.45, 1.05)
    wide: float = 0.3
    least: float = 0.12
    zoom: tuple[float, float] = (0.35, 2.2)
    turn_deg: float = 15.0
    shift: float = 0.7
    gain: float = 0.3
    tint: float = 0.1
    grey: float = 0.08
    blur: float = 0.2
    noise: float = 0.25
    jpeg: float = 0.2
    cover: float = 0.2
    surrounded: float = 0.5
    elsewhere: float = 0.15
    shaded: float = 0.25


STEADY_EXTENT = 0.77
"""Of arms in crops that are measured: what a second look aims at."""


@dataclass(frozen=True)
class Batch:
    """Crops and what is to be learned of them; cells are of 4 pixels.

    Attributes:
        images: (n, h, w, 3) uint8.
        links: (n, 10, h / 4, w / 4) share of each cell that is background, link 0, 1 ...
        coordinates: (n, 3, h / 4, w / 4) in -1..1; known: (n, h / 4, w / 4) where they are.
        points: (n, p, 2) landmarks [cells]; NaN where there is none.
        type: (n,) numbers of the types.
    """

    images: Bytes
    links: Floats32
    coordinates: Floats32
    known: Floats32
    points: Floats32
    type: Ints


def make_batch(
    data: Examples, chosen: Ints, numbers: Ints | None, seed: int, how: Changes
) -> Batch:
    """A batch of crops.

    Args:
        data: what is learned from.
        chosen: (n,) which.
        numbers: (n,) of the samples in the training; None leaves them as they are.
        seed: of every draw.
        how: much.
    """
    made = []
    for k, i in enumerate(chosen):
        rng = None if numbers is None else np.random.default_rng([seed, 71, int(numbers[k])])
        made.append(_changed(data, int(i), rng, how))
    images, links, coordinates, known, points = (np.stack(part) for part in zip(*made, strict=True))
    return Batch(images, links, coordinates, known, points, data.robot[chosen])


def _changed(
    data: Examples, i: int, rng: np.random.Generator | None, how: Changes
) -> tuple[Bytes, Floats32, Floats32, Floats32, Floats32]:
    image, links, points = data.images[i], data.links[i], data.points[i]
    size = (how.size, how.size)
    A = _motion(links, rng, how)
    image = _warped(image, A, size)
    if rng is not None:
        image = _surrounded(image, A, data, rng, how)
    links = _bytes(cv2.warpAffine(links, A[:2], size, flags=cv2.INTER_NEAREST))
    if rng is not None:
        image = _elsewhere(image, links, data, rng, how)
        image, links = _covered(image, links, data, rng, how)
        image = _recoloured(image, rng, how)
    shares = _shares(links)
    coordinates, known = _coordinates(data.coordinates[i], A, size)
    known = known * (shares[0] < 0.5)
    moved = points @ A[:2, :2].T.astype(np.float32) + A[:2, 2].astype(np.float32)
    cells = (moved - 0.5 * (STRIDE - 1)) / STRIDE
    return image, shares, coordinates, known, cells.astype(np.float32)


def _warped(image: Bytes, A: Floats, size: tuple[int, int]) -> Bytes:
    """An image moved by A, grey beyond it; made much smaller, by area first, as in use."""
    zoom = float(np.hypot(A[0, 0], A[1, 0]))
    if zoom < _SHRUNK:
        h, w = image.shape[:2]
        small = (max(1, round(1.2 * zoom * w)), max(1, round(1.2 * zoom * h)))
        image = _bytes(cv2.resize(image, small, interpolation=cv2.INTER_AREA))
        sx, sy = w / small[0], h / small[1]
        A = A @ np.array([[sx, 0, 0.5 * sx - 0.5], [0, sy, 0.5 * sy - 0.5], [0, 0, 1]])
    grey = (GREY, GREY, GREY)
    return _bytes(cv2.warpAffine(image, A[:2], size, flags=cv2.INTER_LINEAR, borderValue=grey))


def _motion(links: Bytes, rng: np.random.Generator | None, how: Changes) -> Floats:
    """(3, 3) from the old pixels to the new ones: the arm, turned, at a size and place drawn."""
    rows, columns = np.flatnonzero(links.any(1)), np.flatnonzero(links.any(0))
    side = max(links.shape)
    if not len(rows):
        return _anywhere(side, rng, how)
    low = np.array([columns[0], rows[0]], float)
    high = np.array([columns[-1] + 1, rows[-1] + 1], float)
    span = float(np.clip((high - low).max(), 8, side))
    extent, turn, aside = STEADY_EXTENT, 0.0, np.zeros(2)
    if rng is not None:
        wide = rng.random() < how.wide
        extent = rng.uniform(how.least, how.extent[0]) if wide else rng.uniform(*how.extent)
        turn = np.deg2rad(how.turn_deg) * rng.uniform(-1, 1)
        aside = how.shift * rng.uniform(-1, 1, 2)
    zoom = float(np.clip(extent * how.size / span, *how.zoom))
    room = 0.5 * np.maximum(how.size - zoom * (high - low), 0.15 * how.size)
    c, s = zoom * np.cos(turn), zoom * np.sin(turn)
    A = np.eye(3)
    A[:2, :2] = [[c, -s], [s, c]]
    middle = 0.5 * (low + high) - 0.5
    A[:2, 2] = 0.5 * (how.size - 1) + aside * room - A[:2, :2] @ middle
    return A


def _anywhere(side: int, rng: np.random.Generator | None, how: Changes) -> Floats:
    """The same of a picture without an arm: any part of it, since that is what is asked about."""
    zoom, aside = how.size / side, np.zeros(2)
    if rng is not None:
        zoom *= float(np.exp(rng.uniform(0.0, np.log(how.zoom[1]))))
        aside = rng.uniform(-1, 1, 2)
    room = 0.5 * (zoom * side - how.size)
    A = np.diag([zoom, zoom, 1.0])
    A[:2, 2] = 0.5 * (how.size - 1) - zoom * 0.5 * (side - 1) + aside * room
    return A


def _surrounded(
    image: Bytes, A: Floats, data: Examples, rng: np.random.Generator, how: Changes
) -> Bytes:
    """Beyond the edges of the picture another one that has no arm.

    Grey, which stays otherwise, is what the end of a picture looks like in use: the arm goes on.
    """
    if rng.random() >= how.surrounded:
        return image
    h, w = data.images.shape[1:3]
    inside = cv2.warpAffine(np.ones((h, w), np.uint8), A[:2], (how.size, how.size))
    if inside.all() or not len(data.empty):
        return image
    other = data.images[int(rng.choice(data.empty))]
    B = _anywhere(max(h, w), rng, how)
    beyond = _bytes(cv2.warpAffine(other, B[:2], (how.size, how.size)))
    return np.where(inside[..., None] > 0, image, beyond)


def _elsewhere(
    image: Bytes, links: Bytes, data: Examples, rng: np.random.Generator, how: Changes
) -> Bytes:
    """The arm cut out, before a picture that has none: no room goes with a type."""
    if rng.random() >= how.elsewhere or not links.any():
        return image
    if not len(data.empty):
        return image
    other = data.images[int(rng.choice(data.empty))]
    B = _anywhere(max(data.images.shape[1:3]), rng, how)
    room = cv2.warpAffine(other, B[:2], (how.size, how.size), borderMode=cv2.BORDER_REFLECT)
    arm = cv2.GaussianBlur((links > 0).astype(np.float32), (0, 0), 0.6)[..., None]
    return _bytes(np.round(arm * image + (1.0 - arm) * room))


def _shares(links: Bytes) -> Floats32:
    """Counted in bytes, row by row and column by column: a tenth of the time of a mean."""
    one = (links[None] == np.arange(_LINKS, dtype=np.uint8)[:, None, None]).view(np.uint8)
    of_rows = sum(one[:, k::STRIDE] for k in range(STRIDE))
    count = sum(of_rows[:, :, k::STRIDE] for k in range(STRIDE))
    return np.asarray(count, np.float32) / np.float32(STRIDE**2)


def _coordinates(source: np.ndarray, A: Floats, size: tuple[int, int]) -> tuple[Floats32, Floats32]:
    """The nearest known coordinates at each cell's middle."""
    w, h = size
    x = np.arange(w // STRIDE) * STRIDE + 0.5 * (STRIDE - 1)
    y = np.arange(h // STRIDE) * STRIDE + 0.5 * (STRIDE - 1)
    back = np.linalg.inv(A)
    u = back[0, 0] * x[None] + back[0, 1] * y[:, None] + back[0, 2]
    v = back[1, 0] * x[None] + back[1, 1] * y[:, None] + back[1, 2]
    column = np.round((u - 0.5) / HALF).astype(np.int64)
    row = np.round((v - 0.5) / HALF).astype(np.int64)
    inside = (column >= 0) & (row >= 0) & (column < source.shape[1]) & (row < source.shape[0])
    taken = source[np.where(inside, row, 0), np.where(inside, column, 0)]
    known = inside & (taken[..., 0] != UNSEEN)
    value = np.where(known[..., None], taken, 0).astype(np.float32) / np.float32(SCALE)
    return np.ascontiguousarray(value.transpose(2, 0, 1)), known.astype(np.float32)


def _covered(
    image: Bytes, links: Bytes, data: Examples, rng: np.random.Generator, how: Changes
) -> tuple[Bytes, Bytes]:
    """A piece of another picture in front."""
    if rng.random() >= how.cover:
        return image, links
    h, w = links.shape
    bw, bh = (int(rng.uniform(0.08, 0.35) * s) for s in (w, h))
    x, y = int(rng.integers(0, w - bw)), int(rng.integers(0, h - bh))
    image, links = image.copy(), links.copy()
    other = data.images[int(rng.integers(len(data)))]
    ox, oy = (int(rng.integers(0, max(s - b, 0) + 1)) for s, b in zip(other.shape[1::-1], (bw, bh)))
    piece = other[oy : oy + bh, ox : ox + bw]
    image[y : y + bh, x : x + bw] = cv2.resize(piece, (bw, bh))
    links[y : y + bh, x : x + bw] = 0
    return image, links


def _recoloured(image: Bytes, rng: np.random.Generator, how: Changes) -> Bytes:
    gain = np.exp(how.gain * rng.normal()) * np.exp(how.tint * rng.normal(size=3))
    power = np.exp(0.15 * rng.normal())
    curve = 255.0 * np.clip((np.arange(256)[:, None] / 255.0) ** power * gain, 0, 1)
    table = np.round(curve).astype(np.uint8)
    image = _bytes(cv2.LUT(image, table[None]))
    if rng.random() < how.shaded:
        corners = np.exp(0.3 * rng.normal(size=(2, 2))).astype(np.float32)
        field = cv2.resize(corners, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        image = _bytes(np.clip(image * field[..., None], 0, 255))
    if rng.random() < how.grey:
        image = np.repeat(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[..., None], 3, 2)
    if rng.random() < how.blur:
        image = _bytes(cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.4, 1.8))))
    if rng.random() < how.noise:
        strength = np.float32(rng.uniform(1.0, 9.0))
        grain = strength * rng.standard_normal(image.shape, np.float32)
        image = np.clip(image + grain, 0, 255).astype(np.uint8)
    if rng.random() < how.jpeg:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 90))]
        image = _bytes(cv2.imdecode(cv2.imencode(".jpg", image, quality)[1], cv2.IMREAD_COLOR))
    return image


def _bytes(image: object) -> Bytes:
    """What OpenCV gives, as the type that it is."""
    return np.asarray(image, np.uint8)

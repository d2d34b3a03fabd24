"""Samples with what is known of them drawn over, as one picture."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats
from armsight.errors import DatasetError, UsageError
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.data.sample import Sample
from armsight.writing import write_atomically

LINK_COLORS = np.array(
    [
        [230, 60, 50],
        [240, 150, 40],
        [235, 220, 60],
        [110, 200, 70],
        [60, 190, 190],
        [70, 110, 230],
        [150, 80, 220],
        [230, 90, 180],
        [150, 150, 150],
    ],
    np.uint8,
)
"""(9, 3) RGB of the links, base first."""
LEAST_WIDTH = 384
"""Of a sample in the picture [px]; smaller ones are enlarged."""


def show(samples: LabelledSet, count: int = 12, columns: int = 4) -> ColorImage:
    """(h, w, 3) samples spread evenly over a set, each with its labels.

    Raises:
        UsageError: no samples or columns are asked for.
        DatasetError: a sample is damaged.
    """
    if count < 1 or columns < 1:
        raise UsageError(f"{count} samples in {columns} columns cannot be shown; 1 is the least")
    count = min(count, len(samples))
    chosen = np.linspace(0, len(samples) - 1, count).round().astype(int)
    tiles = [overlay(samples[int(i)]) for i in chosen]
    columns = min(columns, count)
    empty = np.zeros_like(tiles[0])
    tiles += [empty] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[k : k + columns]) for k in range(0, len(tiles), columns)]
    return np.ascontiguousarray(np.vstack(rows))


def overlay(sample: Sample) -> ColorImage:
    """(h, w, 3) links tinted, outline, skeleton from base to last joint, and key points.

    Filled dots are visible, rings are hidden.
    """
    factor = max(1, -(-LEAST_WIDTH // sample.image.shape[1]))
    picture = _tinted(sample)
    picture = np.ascontiguousarray(
        cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_LINEAR)
    )
    mask = cv2.resize(
        sample.mask.astype(np.uint8), None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST
    )
    outline, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, outline, -1, (255, 255, 255), 1, cv2.LINE_AA)
    if len(sample.q):
        _skeleton(picture, sample, factor)
    for pixel, visible in zip(sample.keypoints_px, sample.keypoints_visible):
        if np.isfinite(pixel).all() and np.abs(pixel).max() < 1e5:
            thickness = -1 if visible else 1
            cv2.circle(picture, _place(pixel, factor), 3, (60, 255, 60), thickness, cv2.LINE_AA)
    text = f"{sample.index} {sample.robot}"
    for color, thick in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.putText(
            picture, text, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, color, thick, cv2.LINE_AA
        )
    return picture


def write_picture(path: Path, picture: ColorImage) -> None:
    """Write a PNG or JPEG whole or not at all.

    Raises:
        UsageError: the name does not end in .png or .jpg.
        DatasetError: the file cannot be written.
    """
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise UsageError(f"{path}: name a picture that ends in .png or .jpg")
    data = cv2.imencode(path.suffix.lower(), np.ascontiguousarray(picture[..., ::-1]))[1]
    write_atomically(path, data.tobytes(), error=DatasetError)


def _tinted(sample: Sample) -> Bytes:
    colors = np.concatenate([np.zeros((1, 3), np.uint8), LINK_COLORS])
    tint = colors[np.minimum(sample.link_ids, len(LINK_COLORS))]
    mixed = 0.6 * sample.image + 0.4 * tint
    return np.asarray(np.where(sample.mask[..., None], mixed, sample.image), np.uint8)


def _skeleton(picture: ColorImage, sample: Sample, factor: int) -> None:
    """Line from the base through the joints."""
    points = sample.camera.project(np.vstack([sample.base_camera, sample.joints_camera]))
    if not np.isfinite(points).all() or np.abs(points).max() > 1e5:
        return
    line = np.array([_place(p, factor) for p in points], np.int32)
    cv2.polylines(picture, [line], False, (0, 0, 0), 4, cv2.LINE_AA)
    cv2.polylines(picture, [line], False, (255, 255, 60), 2, cv2.LINE_AA)
    for p in line:
        cv2.circle(picture, (int(p[0]), int(p[1])), 4, (255, 60, 60), -1, cv2.LINE_AA)


def _place(pixel: Floats, factor: int) -> tuple[int, int]:
    """A pixel of the sample in the enlarged picture."""
    u, v = (np.asarray(pixel) + 0.5) * factor - 0.5
    return round(float(u)), round(float(v))

"""The port detector beside what OpenCV offers: template matching and ORB, on the same pictures.

    nice -n 19 python benchmarks/charging.py --pictures 12

Each peer gets the simplified drawing of every inlet as its template (the detector makes its own
from the same table). Template matching: normalised correlation over 12 sizes and 8 rolls at a
quarter of the picture's size, no tilt. ORB: 2000 features, brute-force matches with the ratio test,
RANSAC homography. A port is found by place when the answer lies within half a mouth's radius; none
of the peers is asked for the type. Times are processor time on one core, medians.
"""

from __future__ import annotations

import argparse
import time

import cv2
import numpy as np

from armsight.charging.find import INLETS, FindOptions, find_ports
from armsight.charging.ports.outline import sample_union
from armsight.charging.ports.table import PORTS, Port
from armsight.devices.camera_models import stereo_pair
from armsight.experiments.port_pictures import Album
from armsight.experiments.port_scene import random_view


def picture_of(port: Port, scale: float, roll: float) -> np.ndarray:
    """The drawing filled in: plate and pedestals light, cavities dark; scale in px/m."""
    size = int(2.3 * port.radius * scale)
    image = np.full((size, size), 90, np.uint8)
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])

    def fill(outlines: list, level: int) -> None:
        for outline in outlines:
            p, _ = sample_union([outline], 0.001)
            p = p[np.argsort(np.arctan2(*(p - p.mean(axis=0)).T[::-1]))]
            q = (p * [1, -1]) @ turn.T * scale + 0.5 * size
            cv2.fillPoly(image, [np.round(16 * q).astype(np.int32)], level, shift=4)

    fill([rim.outline for rim in port.of_kind("mouth")], 25)
    fill([rim.outline for rim in port.of_kind("pedestal")], 70)
    fill([rim.outline for rim in port.of_kind("recess")], 25)
    return image


def by_template(image: np.ndarray) -> np.ndarray:
    """The best place by normalised correlation [px]."""
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    best, place = -1.0, np.zeros(2)
    for name in INLETS:
        for scale in np.geomspace(120.0, 1000.0, 12):
            for roll in np.deg2rad(np.arange(-28, 29, 8)):
                part = picture_of(PORTS[name], scale, roll)
                if min(part.shape) < 8 or max(part.shape) > min(small.shape):
                    continue
                answer = cv2.matchTemplate(small, part, cv2.TM_CCOEFF_NORMED)
                _, score, _, (x, y) = cv2.minMaxLoc(answer)
                if score > best:
                    best = score
                    place = 4.0 * (np.array([x, y]) + 0.5 * part.shape[0])
    return place


def by_orb(image: np.ndarray) -> np.ndarray | None:
    """The place by features and a homography [px], or None."""
    orb = cv2.ORB_create(2000)
    points, features = orb.detectAndCompute(image, None)
    if features is None:
        return None
    best, place = 0, None
    for name in INLETS:
        part = picture_of(PORTS[name], 4000.0, 0.0)
        own, words = orb.detectAndCompute(part, None)
        if words is None or len(words) < 8:
            continue
        pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(words, features, k=2)
        good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < 0.8 * p[1].distance]
        if len(good) < 8:
            continue
        a = np.float32([own[m.queryIdx].pt for m in good])
        b = np.float32([points[m.trainIdx].pt for m in good])
        H, inliers = cv2.findHomography(a, b, cv2.RANSAC, 4.0)
        if H is not None and inliers.sum() > best:
            best = int(inliers.sum())
            middle = np.float32([[[0.5 * part.shape[1], 0.5 * part.shape[0]]]])
            place = cv2.perspectiveTransform(middle, H)[0, 0]
    return place


def ours(image: np.ndarray, lens) -> np.ndarray | None:
    """The place of the surest detection [px], or None."""
    found = find_ports(image, lens, FindOptions(ports=INLETS))
    return found[0].pixel if found else None


def main() -> None:
    """Run and print a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--pictures", type=int, default=12)
    parser.add_argument("--seed", type=int, default=0)
    words = parser.parse_args()
    pair = stereo_pair()
    lens = pair.left
    album = Album(pair, samples=0)
    rng = np.random.default_rng((words.seed, 21))
    views = [random_view(rng, INLETS, (0.3, 1.5)) for _ in range(words.pictures)]
    methods = {
        "armsight": lambda image: ours(image, lens),
        "OpenCV template matching": by_template,
        "OpenCV ORB + homography": by_orb,
    }
    hits, times = dict.fromkeys(methods, 0), {name: [] for name in methods}
    for i, view in enumerate(views):
        picture = album.picture(view, both=False)
        T = picture.T_camera_port[0]
        truth = lens.project(T[None, :3, 3])[0]
        radius = PORTS[view.port].radius * lens.fx / T[2, 3]
        for name, method in methods.items():
            start = time.process_time()
            place = method(picture.images[0])
            if i:  # the first call pays for compiling
                times[name].append(1e3 * (time.process_time() - start))
            hits[name] += place is not None and np.linalg.norm(place - truth) < 0.5 * radius
    album.close()
    print(f"{words.pictures} pictures of 1280x960, inlets at 0.3 to 1.5 m, 0 to 45 deg")
    for name in methods:
        middle = np.median(times[name]) if times[name] else float("nan")
        print(f"{name:28} found {hits[name]:3d}   {middle:8.1f} ms")


if __name__ == "__main__":
    main()

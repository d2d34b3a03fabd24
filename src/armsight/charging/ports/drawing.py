"""The simplified drawing of a port as SVG, true to scale.

The charging paper makes its templates from such drawings (its figure 3).
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats
from armsight.charging.ports.outline import Outline, inside_any
from armsight.charging.ports.table import MM, Port

INK = "#202020"


def drawing(port: Port) -> str:
    """SVG of a port as it is looked at; one unit is one millimetre."""
    xs, ys, _ = zip(*_box(port.plate), *(_box_ for rim in port.rims for _box_ in _box(rim.outline)))
    left, right, low, high = min(xs) - 3, max(xs) + 3, min(ys) - 3, max(ys) + 3
    size = f"{right - left:.2f} {high - low:.2f}"
    lines = [
        '<svg xmlns="http://www.w3.org/2000/svg" '
        f'width="{right - left:.2f}mm" height="{high - low:.2f}mm" '
        f'viewBox="{left:.2f} {-high:.2f} {size}">',
        f"<title>{port.title}</title>",
        f'<g fill="none" stroke="{INK}" stroke-width="0.4">',
        _path("plate", [port.plate]),
        _path("mouth", [rim.outline for rim in port.of_kind("mouth")]),
    ]
    lines += [_path(rim.name, [rim.outline]) for rim in port.rims if rim.kind != "mouth"]
    lines += [
        f'<circle id="pin {pin.name}" cx="{pin.x / MM:.3f}" cy="{-pin.y / MM:.3f}" '
        f'r="{0.5 * pin.diameter / MM:.3f}" fill="{INK}" stroke="none"/>'
        for pin in port.pins
        if not port.plug
    ]
    return "\n".join([*lines, "</g>", "</svg>"]) + "\n"


def _box(outline: Outline) -> list[tuple[float, float, float]]:
    r, w = outline.radius, outline.spread
    return [
        ((outline.x - w - r) / MM, (outline.y - r) / MM, 0.0),
        ((outline.x + w + r) / MM, (outline.y + r) / MM, 0.0),
    ]


def _path(name: str, outlines: list[Outline]) -> str:
    """The border of outlines joined, as closed lines through its points."""
    lines = []
    for loop in _loops(outlines, 0.5 * MM):
        steps = " L".join(f"{x / MM:.3f},{-y / MM:.3f}" for x, y in loop)
        lines.append(f"M{steps} Z")
    return f'<path id="{name}" d="{" ".join(lines)}"/>'


def _loops(outlines: list[Outline], step: float) -> list[Floats]:
    """(n, 2) points around each piece of several outlines joined, anticlockwise."""
    runs = []
    for i, outline in enumerate(outlines):
        points, _ = outline.sample(step)
        inside = inside_any([o for j, o in enumerate(outlines) if j != i], points, 1e-9)
        ends = np.flatnonzero(inside & ~np.roll(inside, -1))  # each is followed by a run
        if len(ends) == 0:
            runs += [] if inside.any() else [points]
            continue
        for end, after in zip(ends, [*ends[1:], ends[0] + len(points)]):
            turn = np.roll(np.arange(len(points)), -int(end) - 1)[: int(after - end)]
            runs.append(points[turn[~inside[turn]]])
    loops = []
    while runs:
        loop = runs.pop(0)
        while runs:  # what goes on where this ends, if it is not nearer to its own beginning
            gaps = [float(np.linalg.norm(run[0] - loop[-1])) for run in runs]
            nearest = int(np.argmin(gaps))
            if gaps[nearest] >= float(np.linalg.norm(loop[0] - loop[-1])):
                break
            loop = np.concatenate([loop, runs.pop(nearest)])
        loops.append(loop)
    return loops

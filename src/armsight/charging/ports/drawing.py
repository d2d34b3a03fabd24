"""The simplified drawing of a port as SVG, true to scale.

The charging paper makes its templates from such drawings (its figure 3).
"""

from __future__ import annotations

from armsight.charging.ports.outline import Outline, sample_union
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
    """The border of outlines joined, as one closed line through its points."""
    import numpy as np

    points, _ = sample_union(outlines, 0.5 * MM)
    if len(outlines) > 1:  # pieces of several curves: in the order around the middle of them all
        middle = points.mean(axis=0)
        points = points[np.argsort(np.arctan2(*(points - middle).T[::-1]))]
    steps = " L".join(f"{x / MM:.3f},{-y / MM:.3f}" for x, y in points)
    return f'<path id="{name}" d="M{steps} Z"/>'

"""A board as a PDF, true to scale: plain vector rectangles, no library."""

from __future__ import annotations

from armsight.calibration.boards import Board
from armsight.errors import UsageError

PAPERS = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "letter": (215.9, 279.4),
}
"""Width and height upright [mm]."""

_POINT = 72.0 / 25.4  # points a millimetre
_CIRCLE = 0.5522847498  # of a quarter circle's Bezier curve


def board_pdf(board: Board, paper: str = "A4") -> bytes:
    """A PDF page with the board in its middle, a 100 mm rule and how to print it.

    The paper is turned upright or across, whichever holds the board.

    Raises:
        UsageError: unknown paper, or the board does not fit with 8 mm to spare.
    """
    if paper not in PAPERS:
        raise UsageError(f"no paper '{paper}'; choose one of {', '.join(PAPERS)}")
    x0, y0, x1, y1 = board.outline
    width, height = 1e3 * (x1 - x0), 1e3 * (y1 - y0)
    w, h = PAPERS[paper]
    if width > height:
        w, h = h, w
    if width + 16 > w or height + 16 > h:
        fits = [
            p
            for p, (a, b) in PAPERS.items()
            if min(width, height) + 16 <= min(a, b) and max(width, height) + 16 <= max(a, b)
        ]
        hint = f"use {fits[0]}" if fits else "make the squares smaller"
        raise UsageError(
            f"a board of {width:.0f} x {height:.0f} mm does not fit on {paper} ({w:.0f} x "
            f"{h:.0f} mm); {hint}"
        )
    left, top = 0.5 * (w - width), 0.5 * (h - height)

    def box(a: float, b: float, c: float, d: float) -> str:
        """PDF's y runs up: a rectangle in mm from the page's upper left corner."""
        return (
            f"{a * _POINT:.4f} {(h - d) * _POINT:.4f} {(c - a) * _POINT:.4f} "
            f"{(d - b) * _POINT:.4f} re f"
        )

    def disc(a: float, b: float, c: float, d: float) -> str:
        """An ellipse in a rectangle, by four Bezier curves."""
        x, y = 0.5 * (a + c) * _POINT, (h - 0.5 * (b + d)) * _POINT
        r, s = 0.5 * (c - a) * _POINT, 0.5 * (d - b) * _POINT
        k, m = _CIRCLE * r, _CIRCLE * s
        curves = (
            (x + r, y + m, x + k, y + s, x, y + s),
            (x - k, y + s, x - r, y + m, x - r, y),
            (x - r, y - m, x - k, y - s, x, y - s),
            (x + k, y - s, x + r, y - m, x + r, y),
        )
        drawn = " ".join(" ".join(f"{v:.4f}" for v in c) + " c" for c in curves)
        return f"{x + r:.4f} {y:.4f} m {drawn} f"

    lines = ["0 g"]
    shade = True
    for tile in board.tiles():
        if tile.dark != shade:
            lines.append("0 g" if tile.dark else "1 g")
            shade = tile.dark
        corners = (
            left + 1e3 * (tile.x0 - x0),
            top + 1e3 * (tile.y0 - y0),
            left + 1e3 * (tile.x1 - x0),
            top + 1e3 * (tile.y1 - y0),
        )
        lines.append(disc(*corners) if tile.round else box(*corners))
    lines.append("0 g")
    if top >= 12:  # a rule to check the printer with
        lines.append(box(left, h - 7.0, left + 100.0, h - 6.6))
        lines += [box(left + k, h - 8.4, left + k + 0.3, h - 6.6) for k in (0.0, 50.0, 99.7)]
        lines.append(
            _text(
                left,
                5.0 - 2.2,
                f"100 mm. {board.describe()}. Print at 100 %, without "
                "fitting; measure it; mount it flat.",
            )
        )
    stream = "\n".join(lines).encode("latin-1")
    return _document(w * _POINT, h * _POINT, stream)


def _text(x: float, y: float, words: str) -> str:
    safe = words.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
    return f"BT /F1 7 Tf {x * _POINT:.3f} {y * _POINT:.3f} Td ({safe}) Tj ET"


def _document(width: float, height: float, stream: bytes) -> bytes:
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        (
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] "
            "/Contents 4 0 R /Resources << /Font << /F1 5 0 R >> >> >>"
        ).encode(),
        b"<< /Length %d >>\nstream\n" % len(stream) + stream + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    out = bytearray(b"%PDF-1.4\n")
    places = []
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n" % number + body + b"\nendobj\n"
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    for place in places:
        out += b"%010d 00000 n \n" % place
    out += b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        len(objects) + 1,
        start,
    )
    return bytes(out)

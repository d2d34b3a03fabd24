"""Which of a folder's lenses belongs to a camera, and whether it fits its pictures' size."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from armsight.calibration.findings import Finding
from armsight.calibration.layouts.lens_files import LENSES, LensFile, UnusableLens, read_lenses
from armsight.errors import CalibrationError


@dataclass(frozen=True)
class GivenLens:
    """A camera's lens as the set gives it.

    Attributes:
        lens: it, or None.
        words: for the table of what was read.
        files: that hold lenses.
        findings: what is odd.
    """

    lens: LensFile | None
    words: str
    files: tuple[Path, ...]
    findings: tuple[Finding, ...] = ()


def given_lens(
    others: Sequence[Path],
    named: Path | None,
    camera: str,
    size: tuple[int, int],
    cameras: int,
) -> GivenLens:
    """The lens of a camera among a folder's files.

    Args:
        others: the folder's files that are no pictures.
        named: the file that the user names, or None.
        camera: its name; a lens that is called so is its own.
        size: (width, height) of its pictures [px].
        cameras: how many there are.

    Raises:
        CalibrationError: the file that the user names holds none.
    """
    notes: list[Finding] = []
    if named is not None:
        if not named.is_file():
            raise CalibrationError(f"{named}: no such file")
        found = read_lenses(named, *size)
        if not found:
            raise CalibrationError(f"{named}: no lens found in it")
        files: tuple[Path, ...] = (named,)
    else:
        found, files = [], ()
        for file in others:
            if file.suffix.lower() not in LENSES or file.stat().st_size > 1_000_000:
                continue
            if "pose" in file.stem.lower():
                continue
            try:
                mine = read_lenses(file, *size)
            except UnusableLens as error:
                notes.append(_unusable(str(error)))
                continue
            except CalibrationError:
                continue
            if mine:
                found += mine
                files = (*files, file)
    if not found:
        words = "none that can be used" if notes else "none given"
        return GivenLens(None, f"{words}: solved from the pictures", (), tuple(notes))
    lens, doubt = _own(found, camera, size, cameras, named is not None)
    if lens is None:
        words = "none given for it: solved from the pictures"
        return GivenLens(None, words, files, (*notes, *doubt))
    given = _of_size(lens, size, files)
    return replace(given, findings=(*doubt, *given.findings))


def _own(
    found: Sequence[LensFile], camera: str, size: tuple[int, int], cameras: int, named: bool
) -> tuple[LensFile | None, tuple[Finding, ...]]:
    """The lens that is a camera's: by its name, else by its pictures' size; doubts are said."""
    for texts in (
        [f.name for f in found],
        [f.source.stem for f in found],
        [f.source.parent.name for f in found],
    ):
        own = [f for f, text in zip(found, texts) if _called(camera, text)]
        if own and (len(own) < len(found) or len(found) == 1):  # a word of all tells nothing
            return next((f for f in own if _is_of(f, size)), own[0]), ()
    fit = [f for f in found if _is_of(f, size)] or list(found)
    one = all(_alike(f, fit[0]) for f in fit)
    files = ", ".join(dict.fromkeys(f.source.name for f in fit))
    if cameras == 1:
        doubt = f"{len(fit)} lenses may be the camera's ({files}): the first is taken"
        return fit[0], () if one else (_doubt(doubt),)
    if one and len(fit) < len(found):
        return fit[0], ()  # the others are of another size
    if one and named:
        return fit[0], (_doubt(f"{files}: one lens for {cameras} cameras, {camera} too"),)
    if len(found) < cameras:
        return None, ()
    return None, (_doubt(f"{camera}: no lens is called so ({files}): solved from the pictures"),)


def _called(camera: str, text: str) -> bool:
    """Whether a name is in a text; a number as a whole one (``1`` is not in ``cam10``)."""
    word, text = camera.lower(), text.lower()
    if word.isdigit():
        return int(word) in {int(n) for n in re.findall(r"\d+", text)}
    return re.search(rf"{re.escape(word)}(?!\d)", text) is not None


def _is_of(lens: LensFile, size: tuple[int, int]) -> bool:
    return lens.sized and (lens.camera.width, lens.camera.height) == size


def _alike(a: LensFile, b: LensFile) -> bool:
    """The same lens twice, or as well as."""
    return abs(a.camera.fx - b.camera.fx) < 0.003 * b.camera.fx


def _doubt(message: str) -> Finding:
    return Finding(
        "which_lens",
        "warning",
        message,
        "give it by --lens FILE, or call lenses as the cameras' folders or pictures are called",
    )


def _unusable(reason: str) -> Finding:
    return Finding(
        "lens_model",
        "warning",
        f"{reason}: not used, the lens is solved from the pictures",
        "give the lens as fx fy cx cy and k1 k2 p1 p2 k3 (plumb_bob)",
    )


def _of_size(lens: LensFile, size: tuple[int, int], files: tuple[Path, ...]) -> GivenLens:
    c = lens.camera
    bent = "" if lens.bent else ", without distortion"
    words = f"{lens.source.name}: f {c.fx:.1f} {c.fy:.1f}, centre {c.cx:.1f} {c.cy:.1f}{bent}"
    if not lens.sized or (c.width, c.height) == size or not all(size):
        return GivenLens(replace(lens, camera=replace(c, width=size[0], height=size[1]))
                         if all(size) else lens, words, files)  # fmt: skip
    factor = size[0] / c.width
    if abs(size[1] / c.height - factor) < 0.01 * factor:
        note = Finding(
            "lens_resolution",
            "warning",
            f"{lens.source.name}: the lens is for {c.width}x{c.height}, the pictures are "
            f"{size[0]}x{size[1]}: scaled by {factor:.4g}",
            "give the lens of this resolution",
        )
        scaled = replace(c.scaled(factor), width=size[0], height=size[1])
        return GivenLens(replace(lens, camera=scaled), f"{words}, scaled", files, (note,))
    note = Finding(
        "lens_resolution",
        "warning",
        f"{lens.source.name}: the lens is for {c.width}x{c.height}, the pictures are cut to "
        f"{size[0]}x{size[1]}: not used, solved from the pictures",
        "give the lens of this resolution",
    )
    return GivenLens(None, "solved from the pictures", files, (note,))

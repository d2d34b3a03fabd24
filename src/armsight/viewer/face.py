"""The panel of a task's face: state, reason, figures, curves, pictures and buttons of any task."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import cv2
import numpy as np
import viser

from armsight.arrays import ColorImage, Floats
from armsight.motion.face import Face, ShownFace, Trace
from armsight.viewer import html
from armsight.viewer.history import SECONDS
from armsight.viewer.plots import plot

WIDEST = 640
"""A wider picture is sent smaller [px]."""
MOST_SAMPLES = 300
"""Of a curve that are drawn."""
OLD = 1.0
"""A face that was made longer ago is said to be old [s]."""
LINES = ("#facc15", "#38bdf8", "#f87171", "#a3e635", "#c084fc", "#fb923c")


class FacePanel:
    """A folder of the panel; hidden while no task shows anything.

    Parts are made when a task first shows them, changed while they stay, and removed when it shows
    them no more.

    Args:
        gui: of the page.
        press: told the name of a button that was pressed.
    """

    def __init__(self, gui: viser.GuiApi, press: Callable[[str], None]) -> None:
        self._gui = gui
        self._press = press
        self._folder = gui.add_folder("Task", visible=False)
        with self._folder:
            self._words = gui.add_html("", order=0.0)
        self._buttons: dict[str, Any] = {}
        self._pictures: dict[str, Any] = {}
        self._shown_images: dict[str, ColorImage] = {}
        self._plots: dict[tuple[str, tuple[str, ...]], Any] = {}

    def update(self, shown: ShownFace | None, now: float) -> None:
        """Words, figures and buttons."""
        self._folder.visible = shown is not None
        face = Face() if shown is None else shown.face
        if shown is not None:
            self._folder.label = f"Task: {shown.task}"
            self._words.content = words(shown, now)
        self._update_buttons(face)

    def update_slowly(self, shown: ShownFace | None) -> None:
        """Curves and pictures; a few times a second is enough."""
        self._update_plots(() if shown is None else shown.traces)
        self._update_pictures(Face() if shown is None else shown.face)

    def _update_buttons(self, face: Face) -> None:
        wanted = {button.name: button for button in face.buttons}
        _drop(self._buttons, wanted)
        for name, button in wanted.items():
            handle = self._buttons.get(name)
            if handle is None:
                with self._folder:
                    handle = self._gui.add_button(button.label or name, order=1.0)
                handle.on_click(_presses(self._press, name, handle))
                self._buttons[name] = handle
            _set(handle, "label", button.label or name)
            _set(handle, "disabled", not button.enabled)

    def _update_plots(self, traces: Sequence[Trace]) -> None:
        """Curves of one unit share a plot."""
        by_unit: dict[str, list[Trace]] = {}
        for trace in traces:
            if np.count_nonzero(np.isfinite(trace.values)) > 1:
                by_unit.setdefault(trace.unit, []).append(trace)
        wanted = {(unit, tuple(t.name for t in group)): group for unit, group in by_unit.items()}
        _drop(self._plots, wanted)
        for key, group in wanted.items():
            data = columns(group)
            handle = self._plots.get(key)
            if handle is not None:
                handle.data = data
                continue
            unit, names = key
            lines = [(name, LINES[i % len(LINES)]) for i, name in enumerate(names)]
            title = ", ".join(names) + (f" [{unit}]" if unit else "")
            with self._folder:
                self._plots[key] = plot(
                    self._gui, title, data, lines, SECONDS, legend=len(names) > 1, order=2.0
                )

    def _update_pictures(self, face: Face) -> None:
        wanted = {picture.name: picture.image for picture in face.pictures}
        _drop(self._pictures, wanted)
        for name, image in wanted.items():
            if self._shown_images.get(name) is image and name in self._pictures:
                continue
            self._shown_images[name] = image
            small = fitted(image)
            handle = self._pictures.get(name)
            if handle is None:
                with self._folder:
                    self._pictures[name] = self._gui.add_image(
                        small, label=name, format="jpeg", jpeg_quality=80, order=3.0
                    )
            else:
                handle.image = small
        for gone in [name for name in self._shown_images if name not in wanted]:
            del self._shown_images[gone]


def words(shown: ShownFace, now: float) -> str:
    """State, reason and figures as HTML; every text of the task is escaped."""
    face = shown.face
    age = now - shown.stamp
    old = f"said {age:.1f} s ago" if age > OLD else ""
    head = (
        f"<div style='{html.FONT};margin:0 .2em .4em'>"
        f"<div style='font-weight:700;font-size:1.05em'>{escape(face.state) or '–'}"
        f"<span style='float:right;font-weight:400;font-size:.75em;color:{html.BAD}'>{old}</span>"
        f"</div><div style='font-size:.82em;line-height:1.3;{html.DIM}'>{escape(face.reason)}</div>"
        "</div>"
    )
    cells = [
        (escape(f.name), f"{value(f.value)} {escape(f.unit)}".strip(), "inherit", "")
        for f in face.figures
    ]
    return head + (html.boxes(cells, "") if cells else "")


def value(number: float) -> str:
    """A figure in four digits, or a dash where there is none."""
    return f"{number:.4g}" if np.isfinite(number) else "–"


def columns(traces: Sequence[Trace]) -> tuple[Floats, ...]:
    """Time before the newest sample [s], and each curve on it, straight where it has no value.

    The page's plot finds no scale, and draws nothing, where a single value is NaN.
    """
    known = [np.isfinite(trace.values) for trace in traces]
    times = np.unique(np.concatenate([t.times[k] for t, k in zip(traces, known)]))
    if len(times) > MOST_SAMPLES:
        step = 1 + (len(times) - 1) // MOST_SAMPLES
        times = times[(len(times) - 1) % step :: step]  # the newest among them
    newest = max(trace.times[-1] for trace in traces)
    rows = [np.interp(times, t.times[k], t.values[k]) for t, k in zip(traces, known)]
    return (times - newest, *rows)


def fitted(image: ColorImage) -> ColorImage:
    """A picture no wider than is worth sending."""
    image = np.ascontiguousarray(image)
    height, width = image.shape[:2]
    if width <= WIDEST:
        return image
    size = (WIDEST, max(1, round(height * WIDEST / width)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _drop(shown: dict[Any, Any], wanted: Any) -> None:
    for gone in [key for key in shown if key not in wanted]:
        shown.pop(gone).remove()


def _set(handle: Any, name: str, now: Any) -> None:
    if getattr(handle, name) != now:
        setattr(handle, name, now)


def _presses(press: Callable[[str], None], name: str, handle: Any) -> Callable[[Any], None]:
    """A press that was on its way while the task switched its button off is none."""
    return lambda _: None if handle.disabled else press(name)

"""The panels of the page: state and controls on the right, pictures and plots on the left."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser

from armsight.arrays import ColorImage
from armsight.runtime.view import SessionView
from armsight.viewer import html
from armsight.viewer.devices import devices
from armsight.viewer.face import FacePanel
from armsight.viewer.history import SECONDS, History
from armsight.viewer.plots import plot
from armsight.viewer.scene import Layer

SPEEDS = {"½×": 0.5, "1×": 1.0, "2×": 2.0, "max": math.inf}
WIDTH = 320
"""Of each column of panels [px]."""
NO_PLOT_ABOVE = 1.5
"""Distances beyond are drawn as this [m]: what matters is near."""


class Controls:
    """What the page may do to a session; ``None`` where it cannot."""

    def __init__(
        self,
        pause: Callable[[], None],
        go_on: Callable[[], None],
        reset: Callable[[], None] | None,
        speed: Callable[[float], None] | None,
        declare_empty: Callable[[], None],
    ) -> None:
        self.pause = pause
        self.go_on = go_on
        self.declare_empty = declare_empty
        self.reset = reset
        self.speed = speed


class Panels:
    """All that is not the 3D scene."""

    def __init__(
        self,
        server: viser.ViserServer,
        title: str,
        controls: Controls,
        layers: Sequence[Layer],
        armless: bool,
        draggable: Sequence[str],
        drag: Callable[[str], None],
        press: Callable[[str], None],
    ) -> None:
        self._gui = gui = server.gui
        self._controls = controls
        self._armless = armless
        gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, brand_color=(56, 189, 248)
        )
        gui.set_panel_label(f"armsight · {title}")
        self._distances = History(2)
        self._speeds = History(1)
        self._texts: dict[str, Any] = {}
        self._put("pulse", html.pulse(0))
        self._put("banner", html.banner(None, "", armless))
        self._put("permit", html.permit(None))
        self._put("figures", html.figures(None, 0.0, 0.0))
        self._face = FacePanel(gui, press)
        self._add_controls(draggable, drag)
        self._put("emptiness", html.emptiness(None))
        self._add_layers(layers)
        self._put("legend", html.legend())
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self._add_left()

    def beat(self, beat: int) -> None:
        """Tell the browsers that somebody is still there; a number other than the last one."""
        self._set("pulse", html.pulse(beat))

    def update(self, view: SessionView, tip_speed: float, note: str, *, old: bool = False) -> None:
        """Words and figures; ``old`` are those of a loop that stands still."""
        guard = view.guard
        self._set("banner", html.banner(guard, note, self._armless, old=old))
        if not self._armless:
            self._set("permit", html.permit(guard))
            self._set("figures", html.figures(guard, tip_speed, view.now))
        self._face.update(view.face, view.now)
        self._show_running(view.running)

    def update_health(self, view: SessionView, accuracy: str) -> None:
        """Tables, plots and the task's pictures; a few times a second is enough.

        Args:
            view: of the session.
            accuracy: the table of the cameras' calibration.
        """
        self._face.update_slowly(view.face)
        snapshot, guard = view.snapshot, view.guard
        self._set("emptiness", html.emptiness(snapshot))
        statuses = () if snapshot is None else snapshot.cameras
        self._set("cameras", html.cameras(statuses, view.now))
        self._set("accuracy", accuracy)
        words = html.components(view.health) + devices(view.readings, view.devices)
        self._set("components", words)
        stages = [*(() if snapshot is None else snapshot.timings)]
        stages += [*(() if guard is None else guard.timings)]
        self._set("timings", html.timings(stages))
        if self._armless:
            self._set("figures", html.map_figures(snapshot, view.now))
            return
        self._distance_plot.data = self._distances.columns()
        self._speed_plot.data = self._speeds.columns()

    def sample(self, view: SessionView, tip_speed: float) -> None:
        """Remember what the plots show; done whether somebody watches or not."""
        guard = view.guard
        if guard is None:
            return
        shown = (guard.distance, guard.protective_distance)
        if not np.isnan(shown).any():  # a plot with a single NaN in it draws nothing
            self._distances.add(view.now, *np.minimum(shown, NO_PLOT_ABOVE))
        if np.isfinite(tip_speed):
            self._speeds.add(view.now, tip_speed)

    def show_pictures(self, mosaic: ColorImage) -> None:
        """What the cameras see."""
        self._pictures.image = mosaic

    def clear(self) -> None:
        """After a reset: empty plots."""
        self._distances.clear()
        self._speeds.clear()

    # -- parts ----------------------------------------------------------------------------------

    def _put(self, key: str, content: str) -> None:
        self._texts[key] = self._gui.add_html(content)

    def _set(self, key: str, content: str) -> None:
        self._texts[key].content = content  # viser sends it only if it changed

    def _add_controls(self, draggable: Sequence[str], drag: Callable[[str], None]) -> None:
        gui, controls = self._gui, self._controls
        with gui.add_folder("Session"):
            # Two buttons: who presses Pause twice, or as somebody else does, wants it to stand.
            pause, go_on = self._controls.pause, self._controls.go_on
            gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE).on_click(lambda _: pause())
            self._go_on = gui.add_button("Go on", icon=viser.Icon.PLAYER_PLAY, disabled=True)
            self._go_on.on_click(lambda _: go_on())
            if controls.speed is not None:
                speed = gui.add_button_group(
                    "Speed", tuple(SPEEDS), hint="simulated seconds a second"
                )
                set_speed = controls.speed
                speed.on_click(lambda _: set_speed(SPEEDS.get(speed.value, 1.0)))
            if controls.reset is not None:
                reset = gui.add_button(
                    "Reset", icon=viser.Icon.REFRESH, color="gray", hint="back to t = 0"
                )
                reset_now = controls.reset
                reset.on_click(lambda _: reset_now())
            if not self._armless:
                empty = gui.add_button(
                    "Nobody is in the cell",
                    icon=viser.Icon.USER_OFF,
                    color="gray",
                    hint="you have looked: what stands there now is no person",
                )
                empty.on_click(lambda _: controls.declare_empty())
            if draggable:
                nothing = "nothing"
                choice = gui.add_dropdown(
                    "Drag",
                    (nothing, *draggable),
                    hint="move it with the arrows in the scene; of a camera the cell is not told",
                )
                choice.on_update(
                    lambda _: drag("" if choice.value == nothing else str(choice.value))
                )

    def _show_running(self, running: bool) -> None:
        if self._go_on.disabled is not running:
            self._go_on.disabled = running

    def _add_layers(self, layers: Sequence[Layer]) -> None:
        with self._gui.add_folder("Layers", expand_by_default=False):
            for layer in layers:
                box = self._gui.add_checkbox(layer.label, layer.on, hint=layer.hint)
                _switches(box, layer)

    def _add_left(self) -> None:
        gui = self._gui
        seen = gui.add_panel()
        with seen.add_tab("Cameras", viser.Icon.CAMERA):
            self._pictures = gui.add_image(np.full((216, 576, 3), 12, np.uint8), jpeg_quality=70)
            self._put("accuracy", "")
            self._put("cameras", html.cameras((), 0.0))
        with seen.add_tab("Health", viser.Icon.HEARTBEAT):
            self._put("components", html.components(()))
        with seen.add_tab("Timings", viser.Icon.CLOCK):
            self._put("timings", html.timings(()))
        seen.dock_left()
        seen.set_width(WIDTH)
        if self._armless:
            return
        plots = gui.add_panel()
        with plots.add_tab("Plots", viser.Icon.CHART_LINE):
            self._distance_plot = plot(
                gui,
                "distance and protective distance [m]",
                self._distances.columns(),
                (("distance", "#facc15"), ("protective", "#f87171")),
                SECONDS,
                top=NO_PLOT_ABOVE,
            )
            self._speed_plot = plot(
                gui,
                "tip speed [m/s]",
                self._speeds.columns(),
                (("speed", "#38bdf8"),),
                SECONDS,
            )
        plots.dock_below(seen)


def _switches(box: viser.GuiCheckboxHandle, layer: Layer) -> None:
    box.on_update(lambda _: layer.switch(bool(box.value)))

"""The page of a running calibration: board, views taken, coverage of each image, falling doubt."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from html import escape
from typing import Any

import cv2
import numpy as np
import viser

from armsight.arrays import Bytes, Floats, JointVector, Pose
from armsight.calibration import arm
from armsight.calibration.calibrate import Calibration
from armsight.calibration.live.seen import SeenView
from armsight.calibration.live.setup import Setup, lens_list
from armsight.calibration.live.watcher import Progress
from armsight.commands.serving import Page
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import to_wxyz
from armsight.viewer.html import FONT
from armsight.viewer.nodes import Line
from armsight.viewer.robot_model import RobotModel
from armsight.viewer.server import open_server, stop_server

TILE = 280
"""Width of one lens's coverage picture [px]."""
BOARD, OLD = (56, 189, 248), (71, 102, 128)
GROWN = 20.0
"""Balls of doubt are drawn this many times as large as they are."""


@dataclass
class _Camera:
    """A camera on the page, once it has been found."""

    frustum: Any
    ball: Any


class CalibrationPage:
    """Shows a calibration while it runs. Told by the procedure; the page asks nothing back.

    Args:
        setup: what is calibrated.
        title: of the page.
        page: where it is served.
    """

    def __init__(self, setup: Setup, title: str, page: Page) -> None:
        """Open the page.

        Raises:
            UsageError: beyond loopback without a token.
            ViewerError: the port is in use.
        """
        self._setup = setup
        self._lenses = lens_list(setup.cameras)
        self._server = open_server(page.host, page.port, page.token, f"armsight · {title}")
        self._host, self._token = page.host, page.token
        scene, gui = self._server.scene, self._server.gui
        scene.set_up_direction("+z")
        scene.configure_environment_map(None)
        scene.add_light_hemisphere(
            "/sky", sky_color=(225, 235, 255), ground_color=(130, 125, 118), intensity=2.0
        )
        scene.add_grid("/floor", width=4.0, height=4.0, cell_size=0.25, section_size=1.0)
        scene.add_frame("/robot", show_axes=False)
        self._robot = RobotModel(scene, "/robot", setup.robot)
        self._boards: list[Line] = []
        self._cameras: dict[int, _Camera] = {}
        self._T_flange_board = setup.T_flange_board
        self._answer: Calibration | None = None
        self._views: list[SeenView] = []
        self._doubt: list[tuple[float, float]] = []
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        gui.set_panel_label(f"armsight · {title}")
        self._words = gui.add_html(_banner("starting", ""))
        self._table = gui.add_html("")
        self._plot = self._add_plot(gui)
        self._coverage = gui.add_image(self._picture(), label="where boards were seen")
        reach = setup.robot.reach
        self._server.initial_camera.position = (1.9 * reach, -2.1 * reach, 1.3 * reach)
        self._server.initial_camera.look_at = (0.6 * reach, 0.0, 0.4 * reach)

    @property
    def url(self) -> str:
        """What to open in a browser."""
        query = f"?token={self._token}" if self._token else ""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"http://{host}:{self._server.get_port()}/{query}"

    def close(self) -> None:
        """End the page."""
        with contextlib.suppress(RuntimeError):
            stop_server(self._server)

    # ------------------------------------------------------------------ told by the procedure

    def view(self, view: SeenView) -> None:
        """A view was taken."""
        self._views.append(view)
        with self._server.atomic():
            self._robot.move(view.joints)
            self._draw_board(view.joints, len(self._boards))
            self._coverage.image = self._picture()

    def stage(self, progress: Progress) -> None:
        """A step was done; with an answer cameras and board are drawn where they were found."""
        sure = [e for e in progress.expected if np.isfinite(e)]
        words = f"{progress.views} views"
        if sure:
            words += f", points to {1e3 * max(sure):.1f} mm at worst"
            self._doubt.append((float(progress.views), 1e3 * max(sure)))
        with self._server.atomic():
            self._words.content = _banner(progress.stage, words)
            self._table.content = self._rows(progress)
            if len(self._doubt) > 1:
                self._plot.data = tuple(np.ascontiguousarray(c) for c in np.array(self._doubt).T)
            if progress.answer is not None:
                self._draw_answer(progress.answer)

    # ------------------------------------------------------------------ drawing

    def _draw_answer(self, answer: Calibration) -> None:
        if self._answer is None:
            for line in self._boards:
                line.visible = False  # drawn with a bracket that was only guessed
            self._boards.clear()
        self._answer = answer
        self._T_flange_board = answer.board_pose()
        for number, view in enumerate(self._views):
            self._draw_board(view.joints, number)
        for rig, camera in enumerate(answer.problem.rigs):
            if not any(s for s in answer.problem.sightings if self._lenses[s.lens].rig == rig):
                continue
            main = answer.main_lens(rig)
            T = answer.camera_pose(rig) @ answer.lens_pose(main)
            self._draw_camera(rig, camera.name, T, answer.lens(main), answer.target_sigma(main))

    def _draw_camera(self, rig: int, name: str, T: Pose, lens: PinholeCamera, doubt: float) -> None:
        scene = self._server.scene
        shown = self._cameras.get(rig)
        if shown is None:
            frustum = scene.add_camera_frustum(
                f"/cameras/{name}",
                fov=float(2 * np.arctan2(0.5 * lens.height, lens.fy)),
                aspect=lens.width * lens.fy / (lens.height * lens.fx),
                scale=0.12,
                color=(45, 212, 191),
            )
            scene.add_label(f"/cameras/{name}/name", name)
            ball = scene.add_icosphere(
                f"/doubt/{name}", radius=1.0, color=(251, 191, 36), opacity=0.25
            )
            shown = self._cameras[rig] = _Camera(frustum, ball)
        shown.frustum.wxyz, shown.frustum.position = to_wxyz(T), T[:3, 3]
        # Centred on the points that the figure is about: 1.25 m before the camera.
        shown.ball.position = T[:3, 3] + 1.25 * T[:3, 2]
        shown.ball.scale = float(GROWN * doubt)

    def _draw_board(self, joints: JointVector, number: int) -> None:
        """The outline of the board at a view; the newest is bright."""
        T = arm.flange_poses(self._setup.robot, joints[None])[0] @ self._T_flange_board
        p = self._setup.board.points
        low, high = p.min(0), p.max(0)
        corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]],
                            [low[0], high[1]], [low[0], low[1]]])  # fmt: skip
        outline = np.column_stack([corners, np.zeros(5)]) @ T[:3, :3].T + T[:3, 3]
        while len(self._boards) <= number:
            name = f"/boards/{len(self._boards)}"
            self._boards.append(Line(self._server.scene, name, BOARD, 0.002, 5))
        self._boards[number].show(outline)

    def _picture(self) -> Bytes:
        """All corners that each lens has seen, the last view's in bright."""
        tiles = []
        for index, lens in enumerate(self._lenses):
            camera = lens.camera
            scale = TILE / camera.width
            height = round(camera.height * scale)
            tile = np.full((height, TILE, 3), 24, np.uint8)
            count = 0
            for number, view in enumerate(self._views):
                for k, _, pixel in view.found:
                    if k == index:
                        count += 1
                        color = BOARD if number == len(self._views) - 1 else OLD
                        for u, v in np.rint(pixel * scale).astype(int):
                            cv2.circle(tile, (int(u), int(v)), 1, color, -1)
            cv2.putText(tile, f"{lens.name}: {count}", (6, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42,
                        (226, 232, 240), 1, cv2.LINE_AA)  # fmt: skip
            tiles.append(tile)
        return _mosaic(tiles)

    def _rows(self, progress: Progress) -> str:
        cells = []
        for lens, seen, doubt in zip(self._lenses, progress.seen, progress.expected):
            figure = f"{1e3 * doubt:.2f} mm" if np.isfinite(doubt) else "-"
            cells.append(
                f"<tr><td>{escape(lens.name)}</td><td style='text-align:right'>{seen}</td>"
                f"<td style='text-align:right'>{figure}</td></tr>"
            )
        head = "<tr><td>lens</td><td>boards</td><td style='text-align:right'>points to</td></tr>"
        return f"<table style='{FONT};width:100%;font-size:.85em'>{head}{''.join(cells)}</table>"

    def _add_plot(self, gui: viser.GuiApi) -> Any:
        start: Floats = np.array([0.0, 1.0])
        return gui.add_uplot(
            data=(start, np.array([np.nan, np.nan])),
            series=({"label": "views"}, {"label": "mm", "stroke": "#fbbf24", "width": 2}),
            scales={"x": {"time": False}, "y": {"distr": 3}},
            axes=({"stroke": "#94a3b8"}, {"stroke": "#94a3b8"}),
            title="doubt of points 1.0-1.5 m away [mm] over views",
            legend={"show": False},
            aspect=2.0,
        )


def _banner(title: str, words: str) -> str:
    return (
        f"<div style='{FONT};margin:0 .2em .5em;padding:.65em .8em;border-radius:.5em;"
        f"background:#0e7490;color:#fff'><div style='font-weight:700'>{escape(title)}</div>"
        f"<div style='font-size:.85em'>{escape(words)}</div></div>"
    )


def _mosaic(tiles: list[Bytes]) -> Bytes:
    """Tiles in two columns, each row as high as its highest."""
    rows = []
    for i in range(0, len(tiles), 2):
        pair = tiles[i : i + 2]
        height = max(t.shape[0] for t in pair)
        padded = [np.pad(t, ((0, height - t.shape[0]), (0, 0), (0, 0))) for t in pair]
        if len(padded) == 1:
            padded.append(np.zeros_like(padded[0]))
        rows.append(np.concatenate(padded, axis=1))
    return np.concatenate(rows, axis=0)

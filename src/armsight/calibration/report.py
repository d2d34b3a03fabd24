"""The report page: what was found, how sure it is, what was left out, and a verdict in words."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from armsight.calibration.calibrate import Calibration
from armsight.calibration.covariance import weakest_direction
from armsight.calibration.export import worst_target
from armsight.calibration.findings import Finding
from armsight.calibration.pairs import pairs
from armsight.devices.depth_model import DepthModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from armsight.calibration.recorded_set import RecordedSet

_STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse}
td,th{padding:.2rem .8rem;text-align:right;border-bottom:1px solid #ddd}
td:first-child,th:first-child{text-align:left}img{max-width:100%}.error{color:#b00020}
.warning{color:#8a5a00}"""


def verdict(calibration: Calibration, findings: Sequence[Finding] = ()) -> str:
    """One sentence on what the answer is good for."""
    errors = [f for f in findings if f.severity == "error"]
    if errors:
        cure = errors[0].cure
        return f"Do not use this calibration: {errors[0].message}. {cure[:1].upper()}{cure[1:]}."
    mm = 1e3 * worst_target(calibration)
    if mm <= 1.5:
        use = "good for precise work near the cameras"
    elif mm <= 5.0:
        use = "good for seeing obstacles and for coarse grasping"
    else:
        use = "too coarse for grasping; take more views"
    left = calibration.left_out
    unseen = (
        "" if left is None else f" Views that the solve had not seen were off by {left.mm:.2f} mm."
    )
    return (
        f"A point 1.0-1.5 m from a camera is known in the base to about {mm:.1f} mm at worst: "
        f"{use}.{unseen}"
    )


def lines(
    calibration: Calibration,
    depth: Sequence[DepthModel | None] = (),
    findings: Sequence[Finding] = (),
    names: Sequence[str] = (),
) -> list[str]:
    """The report for a terminal; ``names`` are the pictures of the views, where they have any."""
    out = [verdict(calibration, findings)]
    problem = calibration.problem
    for index, rig in enumerate(problem.rigs):
        T = calibration.camera_pose(index)
        sigma = np.sqrt(np.maximum(np.diagonal(calibration.covariance.camera_pose(index)), 0))
        _, weakest = weakest_direction(calibration.solution, index)
        out.append(
            f"camera {rig.name} in {rig.mount}: x {1e3 * T[0, 3]:.1f} y {1e3 * T[1, 3]:.1f} z "
            f"{1e3 * T[2, 3]:.1f} mm, sigma {1e3 * sigma[:3].max():.2f} mm and "
            f"{np.rad2deg(sigma[3:].max()):.3f} deg; least sure: {weakest}"
        )
        for k, lens in enumerate(problem.lenses):
            if lens.rig == index:
                c = calibration.lens(k)
                out.append(
                    f"  {lens.name}: f {c.fx:.1f} {c.fy:.1f}, centre {c.cx:.1f} {c.cy:.1f}, "
                    f"corners to {calibration.solution.rms_px(k):.2f} px, points to "
                    f"{1e3 * calibration.target_sigma(k):.2f} mm"
                )
        if index < len(depth) and depth[index] is not None:
            model = depth[index]
            assert model is not None
            out.append(
                f"  depth: offset {1e3 * model.offset:.1f} mm at {model.middle:.2f} m, "
                + (
                    f"scale {100 * model.scale:+.2f} %, "
                    if model.scale_known
                    else "scale unknown, "
                )
                + f"frames to {1e3 * model.rms:.1f} mm"
            )
    for pair in pairs(calibration):
        out.append(pair.words((problem.rigs[pair.first].name, problem.rigs[pair.second].name)))
    for k, board in enumerate(problem.boards):
        T = calibration.board_pose(k)
        scale = 100 * calibration.solution.state.shape[k, 0]
        out.append(
            f"board on {board.mount}: x {1e3 * T[0, 3]:.1f} y {1e3 * T[1, 3]:.1f} z "
            f"{1e3 * T[2, 3]:.1f} mm, print {scale:+.2f} % in size"
        )
    if calibration.selection is not None:
        from armsight.calibration.model_selection import selection_lines

        out += ["models tried (* taken):", *selection_lines(calibration.selection)]
    for s, reason in calibration.rejected[:10]:
        view = names[s.view] if s.view < len(names) else f"view {s.view}"
        out.append(f"left out: {view}, {problem.lenses[s.lens].name}: {reason}")
    if len(calibration.rejected) > 10:
        out.append(f"left out: {len(calibration.rejected) - 10} more boards")
    out += [str(f) for f in findings]
    return out


def read_lines(recorded: RecordedSet) -> list[str]:
    """The table of what was read, as what, and how else it may be read."""
    rows = recorded.read_as
    wide = max((len(r.what) for r in rows), default=0)
    out = []
    for r in rows:
        out.append(f"{r.what:{wide}s}  {r.read_as}")
        if r.otherwise:
            out.append(f"{'':{wide}s}  otherwise: {r.otherwise}")
    return out


def plots(calibration: Calibration) -> dict[str, Figure]:
    """Residuals, coverage of each image, and error ellipsoids over the image."""
    return {
        "residuals": _residuals(calibration),
        "coverage": _coverage(calibration),
        "sureness": _sureness(calibration),
    }


def _used(calibration: Calibration) -> list[int]:
    return sorted({s.lens for s in calibration.problem.sightings})


def _grid(count: int) -> tuple[Figure, list]:  # type: ignore[type-arg]
    from matplotlib.figure import Figure

    columns = min(count, 3)
    rows = -(-count // columns)
    figure = Figure(figsize=(4.2 * columns, 3.4 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel().tolist()
    for a in axes[count:]:
        a.set_axis_off()
    return figure, axes


def _residuals(calibration: Calibration) -> Figure:
    model, solution = calibration.solution.model, calibration.solution
    used = _used(calibration)
    figure, axes = _grid(len(used))
    raw = solution.residual * model.sigma[:, None, None]
    for a, lens in zip(axes, used):
        mine = (model.lens_of == lens)[:, None] & model.seen
        d = raw[mine]
        limit = max(float(np.quantile(np.abs(d), 0.99)), 0.1)
        a.scatter(d[:, 0], d[:, 1], s=3, alpha=0.5)
        a.set(
            xlim=(-limit, limit),
            ylim=(-limit, limit),
            aspect="equal",
            xlabel="u [px]",
            ylabel="v [px]",
            title=f"{calibration.problem.lenses[lens].name}: {solution.rms_px(lens):.2f} px",
        )
    return figure


def _coverage(calibration: Calibration) -> Figure:
    used = _used(calibration)
    figure, axes = _grid(len(used))
    for a, lens in zip(axes, used):
        camera = calibration.problem.lenses[lens].camera
        mine = [s for s in calibration.problem.sightings if s.lens == lens]
        for s in mine:
            a.plot(s.pixel[:, 0], s.pixel[:, 1], ".", ms=2)
        a.set(
            xlim=(0, camera.width),
            ylim=(camera.height, 0),
            aspect="equal",
            title=f"{calibration.problem.lenses[lens].name}: {len(mine)} boards",
        )
    return figure


def _sureness(calibration: Calibration) -> Figure:
    """Expected error over the image at 1.25 m, with the ellipses drawn twenty times as large."""
    from matplotlib.patches import Ellipse

    used = _used(calibration)
    figure, axes = _grid(len(used))
    for a, lens in zip(axes, used):
        camera = calibration.problem.lenses[lens].camera
        u, v = np.meshgrid(np.linspace(0.08, 0.92, 7), np.linspace(0.08, 0.92, 5))
        pixels = np.stack([u.ravel() * camera.width, v.ravel() * camera.height], 1)
        cov = calibration.covariance.points(lens, pixels, np.full(len(pixels), 1.25))
        T = calibration.camera_pose(calibration.problem.lenses[lens].rig) @ calibration.lens_pose(
            lens
        )
        R = T[:3, :3]
        size = np.sqrt(np.trace(cov, axis1=1, axis2=2))
        for p, C in zip(pixels, cov):
            local = (R.T @ C @ R)[:2, :2] * (camera.fx / 1.25) ** 2
            values, vectors = np.linalg.eigh(local)
            turn = np.rad2deg(np.arctan2(vectors[1, 1], vectors[0, 1]))
            grow = 2 * 20 * 2.45
            a.add_patch(
                Ellipse(
                    p, grow * np.sqrt(values[1]), grow * np.sqrt(values[0]), angle=turn, fill=False
                )
            )
        a.set(
            xlim=(0, camera.width),
            ylim=(camera.height, 0),
            aspect="equal",
            title=f"{calibration.problem.lenses[lens].name}: {1e3 * size.min():.1f}-"
            f"{1e3 * size.max():.1f} mm at 1.25 m",
        )
    return figure


def page(
    calibration: Calibration,
    depth: Sequence[DepthModel | None] = (),
    findings: Sequence[Finding] = (),
    title: str = "Calibration",
) -> str:
    """The report as one HTML file that needs nothing beside it."""
    body = [f"<h1>{html.escape(title)}</h1>"]
    text = lines(calibration, depth, ())
    body.append(f"<p><strong>{html.escape(verdict(calibration, findings))}</strong></p>")
    for f in findings:
        body.append(f'<p class="{f.severity}">{html.escape(str(f))}</p>')
    body.append("<pre>" + html.escape("\n".join(text[1:])) + "</pre>")
    captions = {
        "residuals": "Where corners were seen against where the answer puts them.",
        "coverage": "Where in each image boards were seen. Empty corners are lens unknown.",
        "sureness": "How sure a point 1.25 m away is over the image (95 % ellipses, 20 times as "
        "large as they are).",
    }
    for name, figure in plots(calibration).items():
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=90, metadata={"Software": None})
        data = base64.b64encode(buffer.getvalue()).decode()
        body.append(f"<h2>{name.capitalize()}</h2><p>{captions[name]}</p>")
        body.append(f'<img alt="{name}" src="data:image/png;base64,{data}">')
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{_STYLE}</style><body>{''.join(body)}</body></html>\n"
    )

"""An arm from files: a folder with ``robot.urdf`` and ``robot.toml``, or a bare URDF.

Every arm is loaded here, the catalogue's and a user's own. Its shapes are those of
``shapes.json`` beside the URDF (``NAME.shapes.json`` for a bare ``NAME.urdf``); where there is none
they are fitted, once, and kept in the user's cache under a hash of the files they are made from.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.errors import RobotError
from armsight.robots.chain import Chain, fold_chain
from armsight.robots.fit_cache import cached_shapes, fingerprint, keep_shapes
from armsight.robots.fitting import fit_chain
from armsight.robots.link_body import FitOptions
from armsight.robots.loading import joint_limits, link_meshes, load_urdf
from armsight.robots.robot import Capsules, JointLimits, Robot, Spheres
from armsight.robots.shapes import BodyShapes, FitReport, made_from, read_shapes
from armsight.robots.sheet import ArmSheet, read_sheet
from armsight.robots.urdf import read_urdf

QUICK = FitOptions(
    rounds=5,
    completions=3,
    voxel=0.005,
    spacing=0.008,
    check_spacing=0.003,
    margin=0.0015,
    configurations=60,
    most_axes=500,
    most_points=1500,
    most_around=2000,
    most_crowded=1000,
)
"""A fit that somebody waits for, in a tenth of the time of the catalogue's first arms."""

_log = logging.getLogger("armsight")


@dataclass(frozen=True)
class ArmFiles:
    """Where an arm's files lie; ``sheet`` is None without one, ``shapes`` need not exist."""

    name: str
    urdf: Path
    sheet: Path | None
    shapes: Path


def arm_files(path: Path) -> ArmFiles:
    """The files of an arm: of a folder, or of a URDF.

    Raises:
        RobotError: nothing is there, or it is neither.
    """
    if path.is_dir():
        urdf = path / "robot.urdf"
        others = sorted(path.glob("*.urdf"))
        if not urdf.is_file() and len(others) != 1:
            found = ", ".join(p.name for p in others) or "none"
            raise RobotError(
                f"{path}: no robot.urdf in this folder (URDFs: {found}); name one robot.urdf, or "
                "give the URDF itself"
            )
        urdf = urdf if urdf.is_file() else others[0]
        sheet = path / "robot.toml"
        return ArmFiles(path.name, urdf, sheet if sheet.is_file() else None, path / "shapes.json")
    if not path.exists():
        raise RobotError(f"{path}: no such folder or URDF; the path is relative to the cell file")
    if path.suffix.lower() not in (".urdf", ".xml"):
        hint = "; expand it first: xacro IN > OUT.urdf" if ".xacro" in path.name else ""
        raise RobotError(f"{path}: is no folder and no .urdf file{hint}")
    sheet = path.with_suffix(".toml")
    return ArmFiles(
        path.stem,
        path,
        sheet if sheet.is_file() else None,
        path.with_name(f"{path.stem}.shapes.json"),
    )


def load_arm(path: Path) -> Robot:
    """An arm from a folder or a URDF; its shapes are fitted where nobody has yet.

    Raises:
        RobotError: a file is missing, broken, or of another arm than the rest; names it.
    """
    files = arm_files(path)
    sheet = read_sheet(files.sheet)
    return _robot(files, sheet, _shapes(files, *_chain(files, sheet)))


def fit_arm(path: Path, options: FitOptions = QUICK) -> tuple[Robot, BodyShapes, ArmFiles]:
    """Fit an arm's shapes anew; nothing is written.

    Raises:
        RobotError: as :func:`load_arm`.
    """
    files = arm_files(path)
    sheet = read_sheet(files.sheet)
    shapes = _fit(files, *_chain(files, sheet), options)
    return _robot(files, sheet, shapes), shapes, files


def mark_of(path: Path) -> str:
    """A hash of the files that an arm's shapes are made from.

    Raises:
        RobotError: as :func:`load_arm`.
    """
    files = arm_files(path)
    return fingerprint(_chain(files, read_sheet(files.sheet))[0], files.urdf)


def shapes_lines(shapes: BodyShapes) -> list[str]:
    """How well an arm's shapes cover and fit, a line for spheres and one for capsules."""
    return fit_lines(shapes.spheres, shapes.capsules, shapes.sphere_fit, shapes.capsule_fit)


def fit_lines(
    spheres: Spheres,
    capsules: Capsules,
    sphere_fit: FitReport | None,
    capsule_fit: FitReport | None,
) -> list[str]:
    """How well shapes cover and fit, a line for spheres and one for capsules."""
    return [
        f"{len(spheres.radius)} spheres: {_fit_text(sphere_fit)}",
        f"{len(capsules.radius)} capsules: {_fit_text(capsule_fit)}",
    ]


def _fit_text(fit: FitReport | None) -> str:
    if fit is None or fit.samples == 0:
        return "fit not measured (the URDF's own)"
    return (
        f"cover {100 * fit.coverage:.2f} % of {fit.samples} surface points, stand out by "
        f"{1e3 * fit.overshoot_median:.1f} mm (median), {1e3 * fit.overshoot_p95:.1f} mm (95 %)"
    )


def _robot(files: ArmFiles, sheet: ArmSheet, shapes: BodyShapes) -> Robot:
    robot = load_urdf(
        files.urdf,
        name=files.name,
        base=sheet.base,
        flange=sheet.flange,
        held=sheet.held,
        packages=sheet.packages,
        velocity=sheet.velocity,
        acceleration=sheet.acceleration,
        jerk=sheet.jerk,
        home=sheet.home,
        reach=sheet.reach,
        shapes=shapes,
    )
    if robot.home.shape != (robot.n,):
        raise RobotError(f"{files.sheet}: home has {robot.home.size} values for {robot.n} joints")
    outside = (robot.home < robot.limits.lower) | (robot.home > robot.limits.upper)
    if outside.any():
        i = int(np.argmax(outside))
        raise RobotError(
            f"{files.sheet}: home: joint {robot.joint_names[i]} at {robot.home[i]:g} rad is not in "
            f"{robot.limits.lower[i]:g} to {robot.limits.upper[i]:g} rad"
        )
    return robot


def _chain(files: ArmFiles, sheet: ArmSheet) -> tuple[Chain, JointLimits]:
    urdf = read_urdf(files.urdf, sheet.packages)
    chain = fold_chain(urdf, sheet.base, sheet.flange, sheet.held)
    # Before a minute of fitting, not after it:
    link_meshes(chain, files.urdf)
    limits = joint_limits(chain, files.urdf, sheet.velocity, sheet.acceleration, sheet.jerk)
    return chain, limits


def _shapes(files: ArmFiles, chain: Chain, limits: JointLimits) -> BodyShapes:
    names = tuple(link.name for link in chain.links)
    if files.shapes.is_file():
        mark = made_from(files.shapes)
        if mark and mark != fingerprint(chain, files.urdf):
            raise RobotError(
                f"{files.shapes}: was fitted to other files than {files.urdf.name} and its meshes "
                f"are now; fit them anew: armsight robots fit {files.urdf}"
            )
        return read_shapes(files.shapes, names)
    mark = fingerprint(chain, files.urdf)
    shapes = cached_shapes(mark, names)
    if shapes is None:
        shapes = _fit(files, chain, limits, QUICK)
        kept = keep_shapes(mark, shapes, names)
        for line in shapes_lines(shapes):
            _log.info("  %s", line)
        _log.info("  kept in %s", kept or "nothing: the cache cannot be written")
    return shapes


def _fit(files: ArmFiles, chain: Chain, limits: JointLimits, options: FitOptions) -> BodyShapes:
    _log.info("Fitting shapes to %s, once; this takes a minute or two.", files.urdf)
    try:
        return fit_chain(
            chain,
            limits.lower,
            limits.upper,
            options,
            say=lambda line: _log.info("  %s", line),
        )
    except RobotError as error:
        text = str(error)
        raise RobotError(text if str(files.urdf) in text else f"{files.urdf}: {text}") from None

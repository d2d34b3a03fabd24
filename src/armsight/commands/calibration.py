"""``armsight calibration``: show a cell's calibration, export it, import into it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Union

import tyro

if TYPE_CHECKING:
    from armsight.workcell import Workcell
    from armsight.workcell.calibration_file.schema import CellCalibration, MeasuredSection


@dataclass(frozen=True)
class Show:
    """What a cell believes of its cameras, its board and its arm, and how sure it is.

    Example: armsight calibration show ur5_calibration

    Attributes:
        workcell: a workcell file, or the name of a packaged cell.
    """

    workcell: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="WORKCELL")]

    def run(self) -> int:
        """Print the table."""
        workcell, calibration = _load(self.workcell)
        for line in lines(workcell, calibration):
            print(line)
        return 0


@dataclass(frozen=True)
class Export:
    """Write a cell's calibration as files of ROS and OpenCV, and its transforms as tf.yaml.

    Example: armsight calibration export ur5_calibration --out exported

    Attributes:
        workcell: a workcell file, or the name of a packaged cell.
        out: folder for the files.
    """

    workcell: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="WORKCELL")]
    out: Path = Path("exported")

    def run(self) -> int:
        """Write the files."""
        from armsight.errors import CalibrationError
        from armsight.tasks.calibration_exchange import exported
        from armsight.writing import write_text

        workcell, calibration = _load(self.workcell)
        if calibration is None:
            raise CalibrationError(
                f"{workcell.name}: was never calibrated, so there is nothing to export; "
                f"'armsight calibrate {self.workcell}' does it"
            )
        for name, text in exported(calibration).items():
            write_text(self.out / name, text)
            print(self.out / name)
        return 0


@dataclass(frozen=True)
class Import:
    """Put lenses and poses from files of ROS, OpenCV, Kalibr or easy_handeye into a cell.

    Example: armsight calibration import my_cell.toml left_depth.camera_info.yaml tf.yaml
    --camera left

    Attributes:
        workcell: a workcell file, or the name of a packaged cell.
        files: lenses, and transforms (ours, TransformStamped, easy_handeye's) as YAML.
        camera: which of the cell's cameras they are of.
        sigma_mm: how sure the pose is along each axis; what the cell believes at worst if left out.
        sigma_deg: likewise of its turn.
    """

    workcell: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="WORKCELL")]
    files: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILES")]
    camera: str
    sigma_mm: float | None = None
    sigma_deg: float | None = None

    def run(self) -> int:
        """Read the files, write the cell's calibration file."""
        import numpy as np

        from armsight.errors import CalibrationError, UsageError
        from armsight.tasks.calibration_exchange import brought, covariance_of, merged
        from armsight.workcell import camera_info_of
        from armsight.workcell.calibration_file.store import store
        from armsight.workcell.calibration_file.writing import camera_entry

        workcell, calibration = _load(self.workcell)
        section = next((c for c in workcell.camera if c.name == self.camera), None)
        if section is None:
            names = ", ".join(c.name for c in workcell.camera) or "none"
            raise UsageError(f"{workcell.name}: has no camera '{self.camera}' (it has: {names})")
        if not self.files:
            raise UsageError("calibration import: name the files to import")
        if section.model is None:
            raise UsageError(
                f"{workcell.name}: camera '{self.camera}' names no model, so its resolution is not "
                "known: give it one of `armsight robots list`"
            )
        info = camera_info_of(workcell, section)
        new = brought(list(self.files), info, workcell.robot.T_world_base)
        old = None if calibration is None else calibration.of(self.camera)
        whole = merged(old, info, new)
        assert whole.T_mount_depth is not None
        assert whole.T_depth_color is not None
        assert whole.depth is not None
        mapping = workcell.mapping
        mm = mapping.calibration_mm if self.sigma_mm is None else self.sigma_mm
        deg = mapping.calibration_deg if self.sigma_deg is None else self.sigma_deg
        if not (mm > 0 and deg > 0):
            raise UsageError("--sigma-mm and --sigma-deg must be above 0")
        C = covariance_of(mm / 1e3, float(np.deg2rad(deg)))
        if old is not None and new.T_mount_depth is None:
            C = old.C
        try:
            entry = camera_entry(
                workcell,
                section,
                whole.T_mount_depth,
                C,
                whole.depth,
                whole.color,
                whole.T_depth_color,
                # What was known of the depths stays, though a new lens reads them elsewhere.
                None if old is None or old.depth_model is None else old.depth_model.model,
                source="imported from " + ", ".join(f.name for f in self.files),
            )
        except ValueError as error:
            raise CalibrationError(f"{self.camera}: {error}") from None
        print(f"{store(workcell, [entry])}: {self.camera} imported")
        return 0


@dataclass(frozen=True)
class CalibrationCommand:
    """Show, export or import what a cell believes of its cameras.

    Examples: armsight calibration show ur5_calibration;
    armsight calibration export ur5_calibration --out exported
    """

    what: Union[  # noqa: UP007
        Annotated[Show, tyro.conf.subcommand("show")],
        Annotated[Export, tyro.conf.subcommand("export")],
        Annotated[Import, tyro.conf.subcommand("import")],
    ]

    def run(self) -> int:
        """Do it."""
        return self.what.run()


def _load(name: str) -> tuple[Workcell, CellCalibration | None]:
    from armsight.workcell.calibration_file.reading import calibration_of
    from armsight.workcell.packaged import load

    workcell = load(name)
    return workcell, calibration_of(workcell)


def lines(workcell: Workcell, calibration: CellCalibration | None) -> list[str]:
    """The table of ``show``."""
    import numpy as np

    head = f"{'camera':12} {'place in mount [mm]':>25} {'sigma':>17} {'points':>8}  calibrated"
    out = [head]
    for section in workcell.camera:
        entry = None if calibration is None else calibration.of(section.name)
        if entry is None:
            out.append(f"{section.name:12} never calibrated")
            continue
        x, y, z = 1e3 * np.array(entry.position)
        sigma = np.sqrt(np.diagonal(entry.C))
        turn = np.rad2deg(sigma[3:].max())
        points = "" if entry.target_error is None else f"{1e3 * entry.target_error:.2f} mm"
        out.append(
            f"{section.name:12} {entry.mount:>6} {x:6.1f} {y:6.1f} {z:6.1f} "
            f"{1e3 * sigma[:3].max():6.2f} mm {turn:.3f}° {points:>8}  "
            f"{entry.calibrated:%Y-%m-%d %H:%M} {entry.source}"
        )
        for which, lens in (("depth", entry.depth_lens), ("color", entry.color_lens)):
            if lens is not None:
                out.append(
                    f"  {which:10} {lens.width}x{lens.height} f {lens.fx:.2f} {lens.fy:.2f} "
                    f"centre {lens.cx:.2f} {lens.cy:.2f}"
                )
        depth = entry.depth_model
        if depth is not None:
            out.append(
                f"  depth off  {1e3 * depth.offset:+.1f} mm at {depth.middle:.2f} m, scale "
                f"{100 * depth.scale:+.2f} %"
            )
    if calibration is not None and calibration.board is not None:
        x, y, z = 1e3 * np.array(calibration.board.position)
        on = calibration.board.mounted_on
        out.append(f"{'board':12} {on:>6} {x:6.1f} {y:6.1f} {z:6.1f}")
    if calibration is not None:
        out += [_placed(f"pair {p.name}", p.mount, p) for p in calibration.stereo]
        out += [] if calibration.plug is None else [_placed("plug", "flange", calibration.plug)]
    if calibration is not None and calibration.arm is not None:
        offsets = " ".join(f"{v:+.3f}" for v in calibration.arm.joint_offset_deg)
        out.append(f"{'arm':12} joint offsets {offsets} deg")
    return out


def _placed(name: str, mount: str, entry: MeasuredSection) -> str:
    """A line of what has a place and a covariance, and no lens."""
    import numpy as np

    x, y, z = 1e3 * np.array(entry.position)
    sigma = np.sqrt(np.diagonal(entry.C))
    mm, deg = 1e3 * float(sigma[:3].max()), float(np.rad2deg(sigma[3:].max()))
    return f"{name:12} {mount:>6} {x:6.1f} {y:6.1f} {z:6.1f} {mm:6.2f} mm {deg:.3f}\u00b0"

"""``armsight detect-port``."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

if TYPE_CHECKING:
    import numpy as np

    from armsight.arrays import Bytes, ColorImage, Pose
    from armsight.charging.fit import Fit
    from armsight.charging.pose import PortPose
    from armsight.geometry.camera import PinholeCamera

GREEN, RED, WHITE = (0, 200, 0), (230, 40, 40), (255, 255, 255)


@dataclass(frozen=True)
class DetectPort:
    """Find charging ports in a picture, or in a pair of pictures of two calibrated cameras.

    Examples: armsight detect-port photo.jpg --out found.png; armsight detect-port left.png
    right.png --intrinsics 1200,1200,642,478 --baseline 0.2 --toe-in-deg 9.46

    One JSON line a port goes to standard output: type, score, pixel, pose in the (left) camera with
    standard deviations, whether roll or tilt are in doubt. A score above 0.95 says that the pose is
    right to 1 mm across and 1 deg, but for one in twenty at most; no single picture scores more
    than that. Exit code 1 if none was found.

    Attributes:
        images: a picture, or the left and right one of a pair.
        out: the (left) picture with the fitted edges, seen ones green and missed ones red.
        json: the JSON lines into a file as well.
        camera: the pictures' camera, YAML in ROS's camera_info layout.
        intrinsics: instead of a file: fx,fy,cx,cy in pixels. Without either, 60 deg of view are
            assumed, and distances are only as good as that.
        baseline: distance of a pair's cameras [m].
        toe_in_deg: angle between a pair's axes, looking inward [deg].
        ports: types to look for, separated by commas: type1, type2, ccs1, ccs2, type1_plug,
            type2_plug, ccs2_plug. Only those are compared: one alone may be taken for another.
        drawing: a port of your own, TOML: it is looked for as well.
        write_drawing: print a type's drawing, to start your own from; no picture is needed.
        least_score: what scores below is not reported.
        windows: search the darker-than-average regions only, as fast as these are small.
    """

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="IMAGE")]
    out: Path | None = None
    json: Path | None = None
    camera: Path | None = None
    intrinsics: str | None = None
    baseline: float | None = None
    toe_in_deg: float = 0.0
    ports: str = "type1,type2,ccs1,ccs2"
    drawing: Path | None = None
    write_drawing: str = ""
    least_score: float = 0.55
    windows: bool = False

    def run(self) -> int:
        """Find and print; 1 where nothing was found."""
        from armsight.charging.find import ALONE, FindOptions
        from armsight.charging.ports.drawing_file import add_drawing, written
        from armsight.charging.ports.table import port
        from armsight.charging.pose import locate, locate_in_one
        from armsight.errors import UsageError
        from armsight.geometry.stereo import converging_pair
        from armsight.writing import write_atomically

        if self.write_drawing:
            print(written(port(self.write_drawing), f"my_{self.write_drawing}"), end="")
            return 0
        if len(self.images) not in (1, 2):
            raise UsageError(f"detect-port: {len(self.images)} pictures; give one, or a pair")
        if not 0.0 < self.least_score <= 1.0:
            raise UsageError(f"--least-score is {self.least_score:g}, expected above 0, at most 1")
        if len(self.images) == 1 and self.least_score >= ALONE:
            raise UsageError(
                f"--least-score is {self.least_score:g}, and one picture scores at most {ALONE:g}: "
                "give a pair, or ask for less"
            )
        names = tuple(name.strip() for name in self.ports.split(",") if name.strip())
        if not names:
            raise UsageError("--ports names no type; leave it out, or say which to look for")
        if self.drawing is not None:
            names = tuple(dict.fromkeys((*names, add_drawing(self.drawing).name)))
        for name in names:
            port(name)
        if not abs(self.toe_in_deg) < 90.0:
            raise UsageError(f"--toe-in-deg is {self.toe_in_deg:g}, expected less than 90 deg")
        grays = [_read(file) for file in self.images]
        lens = self._lens(grays[0].shape[1], grays[0].shape[0])
        least = self.least_score
        together = min(least, FindOptions.least_together)
        options = FindOptions(ports=names, least_score=least, least_together=together)
        if len(grays) == 1:
            ports = locate_in_one(grays[0], lens, options, self.windows)
        else:
            if self.baseline is None or not 0.0 < self.baseline < 10.0:
                raise UsageError("detect-port: a pair needs --baseline, its cameras' distance [m]")
            if grays[0].shape != grays[1].shape:
                raise UsageError(
                    f"{self.images[1]}: another size than {self.images[0]}; both pictures of a "
                    "pair have to come from cameras of one size"
                )
            pair = converging_pair(lens, self.baseline, self.toe_in_deg * 3.141592653589793 / 180)
            ports = locate((grays[0], grays[1]), pair, options, self.windows)
        found = [(_row(p, lens), p.T_ref_port, p.fit) for p in ports if p.score >= least]
        lines = [json.dumps(row) for row, _, _ in found]
        for line in lines:
            print(line)
        if self.json is not None:
            write_atomically(self.json, "".join(f"{line}\n" for line in lines).encode())
        if self.out is not None:
            _draw(self.out, grays[0], lens, found)
        if not found:
            print(f"no port of {', '.join(names)} found", file=sys.stderr)
        return 0 if found else 1

    def _lens(self, width: int, height: int) -> PinholeCamera:
        from armsight.calibration.layouts.lens_files import read_lenses
        from armsight.errors import UsageError
        from armsight.geometry.camera import PinholeCamera

        if self.camera is not None and self.intrinsics is not None:
            raise UsageError("detect-port: give one of --camera and --intrinsics")
        if self.camera is not None:
            lenses = read_lenses(self.camera, width, height)
            if len(lenses) != 1:
                raise UsageError(
                    f"{self.camera}: holds {len(lenses)} lenses; detect-port needs a file with one"
                )
            camera = lenses[0].camera
            if (camera.width, camera.height) != (width, height):
                raise UsageError(
                    f"{self.camera}: its lens has {camera.width}x{camera.height} pixels, the "
                    f"picture {width}x{height}; give the lens of this picture"
                )
            return camera
        if self.intrinsics is not None:
            try:
                fx, fy, cx, cy = (float(part) for part in self.intrinsics.split(","))
            except ValueError:
                raise UsageError(
                    f"--intrinsics is '{self.intrinsics}', expected fx,fy,cx,cy in pixels"
                ) from None
            if not (0.1 * width < fx < 50 * width and 0.1 * width < fy < 50 * width):
                raise UsageError(f"--intrinsics: focal lengths of {fx:g} and {fy:g} px cannot be")
            if not (-width < cx < 2 * width and -height < cy < 2 * height):
                raise UsageError(
                    f"--intrinsics: a middle at {cx:g}, {cy:g} px cannot be, the picture has "
                    f"{width}x{height}"
                )
            return PinholeCamera(width, height, fx, fy, cx, cy)
        f = 0.5 * width / 0.5773502691896257  # tan 30 deg
        return PinholeCamera(width, height, f, f, 0.5 * (width - 1), 0.5 * (height - 1))


def _read(file: Path) -> Bytes:
    """A grey picture.

    Raises:
        UsageError: it cannot be read.
    """
    import cv2
    import numpy as np

    from armsight.errors import UsageError
    from armsight.pictures import read_picture

    if not file.is_file():
        what = "is a folder, expected a picture" if file.is_dir() else "there is no such picture"
        raise UsageError(f"{file}: {what}")
    image = read_picture(file, cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise UsageError(f"{file}: is no picture that can be read (PNG, JPEG, BMP, TIFF)")
    if max(image.shape) > 8192:
        raise UsageError(f"{file}: {image.shape[1]}x{image.shape[0]} pixels; at most 8192 a side")
    return np.asarray(image, np.uint8)


def _row(p: PortPose, lens: PinholeCamera) -> dict[str, Any]:
    """What is said of a port, as JSON values."""
    import numpy as np

    from armsight.geometry.pose import to_quaternion

    T, sigma = p.T_ref_port, p.sigma
    pixel = lens.project(T[None, :3, 3])[0]
    return {
        "port": p.port,
        "score": round(p.score, 3),
        "pixel": np.round(pixel, 2).tolist(),
        "position_m": np.round(T[:3, 3], 5).tolist(),
        "quaternion_xyzw": np.round(to_quaternion(T), 5).tolist(),
        "sigma_mm": np.round(1e3 * sigma[:3], 2).tolist(),
        "sigma_deg": np.round(np.rad2deg(sigma[3:]), 2).tolist(),
        "roll_gap": round(p.roll_gap, 1) if np.isfinite(p.roll_gap) else None,
        "tilt_gap": round(p.tilt_gap, 1) if np.isfinite(p.tilt_gap) else None,
        "doubtful": p.doubtful,
    }


def _draw(
    file: Path, gray: Bytes, lens: PinholeCamera, found: list[tuple[dict[str, Any], Pose, Fit]]
) -> None:
    """Write the picture with the fitted edges."""
    import cv2
    import numpy as np

    from armsight.charging.fit import model_points
    from armsight.charging.ports.table import PORTS
    from armsight.errors import UsageError
    from armsight.writing import write_atomically

    picture: ColorImage = np.asarray(cv2.cvtColor(gray, cv2.COLOR_GRAY2RGB), np.uint8)
    for row, T, result in found:
        pixels = lens.project(model_points(result))
        mouth = lens.fx * PORTS[row["port"]].radius / T[2, 3]
        dot = round(16 * float(np.clip(0.03 * mouth, 0.5, 1.25)))  # a small port stays to be seen
        for (u, v), seen in zip(pixels, result.found[: len(pixels)]):
            at = (round(16 * float(u)), round(16 * float(v)))
            cv2.circle(picture, at, dot, GREEN if seen else RED, -1, cv2.LINE_AA, 4)
        _axes(picture, lens, T)
        u, v = row["pixel"]
        words = f"{row['port']} {100 * row['score']:.0f} %" + " doubtful" * row["doubtful"]
        cv2.putText(
            picture, words, (int(u) + 12, int(v) - 12), cv2.FONT_HERSHEY_SIMPLEX, 0.7, WHITE, 2
        )
    try:
        _, data = cv2.imencode(file.suffix or ".png", picture[:, :, ::-1])
    except cv2.error:
        raise UsageError(
            f"{file}: not a kind of picture that can be written; use .png or .jpg"
        ) from None
    write_atomically(file, data.tobytes())


def _axes(picture: np.ndarray[Any, Any], lens: PinholeCamera, T: Pose) -> None:
    """The port's frame, 3 cm long: x red, y green, z blue."""
    import cv2
    import numpy as np

    ends = T[:3, 3] + 0.03 * np.vstack([np.zeros(3), T[:3, :3].T])
    pixels = lens.project(ends)
    if not np.isfinite(pixels).all():
        return
    start = (round(float(pixels[0, 0])), round(float(pixels[0, 1])))
    for end, color in zip(pixels[1:], ((255, 0, 0), (0, 255, 0), (60, 120, 255))):
        cv2.line(picture, start, (round(float(end[0])), round(float(end[1]))), color, 2)

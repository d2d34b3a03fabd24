"""``armsight place``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from armsight.commands.picture_options import camera_of, write_png

if TYPE_CHECKING:
    from armsight.arrays import JointVector, Pose
    from armsight.geometry.camera import PinholeCamera
    from armsight.recognition.any_arm.recogniser import ArmRecogniser
    from armsight.recognition.inference.pictures import Picture
    from armsight.robots.robot import Robot


@dataclass(frozen=True)
class Place:
    """Find where a camera stood by pictures of an arm whose joints are known: no board, no marker.

    Examples: armsight place photo.jpg --robot ur5 --joints-deg 0 -90 90 -90 -90 0
    --intrinsics 1460,1460,959.5,539.5; armsight place photos --robot ur5 --joints joints.csv
    --standing --camera ros_camera_info.yaml --out placed

    One JSON line a picture goes to standard output, with the camera in the arm's base frame and
    whether that is to be believed; of a camera that stood still, one line for all.

    Attributes:
        what: picture, or folder of pictures.
        robot: the arm: a name of the catalogue, or your own arm that the network learned later.
        joints_deg: of the arm in the one picture, base first.
        joints: of several pictures: a file with a line "picture, q1, q2, ..." in degrees for each.
        standing: all pictures are by one camera that stood still: they are placed together.
        camera: the pictures' camera, YAML in ROS's camera_info layout; else what the files say.
        intrinsics: instead of a file: fx,fy,cx,cy in pixels.
        out: folder for pictures with the arm drawn in where it should be seen.
        network: a network that comes with armsight, or an .onnx file of a training.
        extension: files of robots that the network learned later (armsight extend).
        threads: of the CPU; 0 for all.
    """

    what: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="IMAGE|FOLDER")]
    robot: str
    joints_deg: tuple[float, ...] = ()
    joints: Path | None = None
    standing: bool = False
    camera: Path | None = None
    intrinsics: str | None = None
    out: Path | None = None
    network: str = "arms"
    extension: tuple[Path, ...] = ()
    threads: int = 0

    def run(self) -> int:
        """Place; 1 if a camera could not be placed for sure."""
        from armsight.errors import UsageError
        from armsight.recognition.any_arm.extension import read_extension
        from armsight.recognition.any_arm.joint_list import joints_of, read_joints
        from armsight.recognition.any_arm.model import CropModel
        from armsight.recognition.any_arm.recogniser import ArmRecogniser
        from armsight.recognition.inference.model import network_file
        from armsight.recognition.inference.pictures import pictures_in, read_picture
        from armsight.robots.catalogue import is_path, load_robot

        if bool(self.joints_deg) == (self.joints is not None):
            raise UsageError("place: give one of --joints-deg (one picture) and --joints (a file)")
        if self.camera is not None and self.intrinsics is not None:
            raise UsageError("place: give one of --camera and --intrinsics")
        if not 0 <= self.threads <= 1024:
            raise UsageError(f"--threads is {self.threads}, expected 0 (all) to 1024")
        paths = pictures_in(self.what)
        name = str(Path(self.robot).resolve()) if is_path(self.robot) else self.robot
        robot = load_robot(name)
        if self.joints is not None:
            listed = read_joints(self.joints, robot)
            paths = [path for path in paths if path.name in listed]
            if not paths:
                raise UsageError(f"{self.joints}: names none of the pictures in {self.what}")
            angles = [listed[path.name] for path in paths]
        elif len(paths) > 1:
            raise UsageError(f"{self.what}: has {len(paths)} pictures; give --joints FILE")
        else:
            angles = [joints_of(self.joints_deg, robot, "--joints-deg")]
        model = CropModel(
            network_file(self.network), self.threads, [read_extension(e) for e in self.extension]
        )
        recogniser = ArmRecogniser(model, (name,))
        shown = [(read_picture(path), q) for path, q in zip(paths, angles)]
        if self.standing:
            return self._together(recogniser, robot, shown)
        every = [self._alone(recogniser, robot, picture, q) for picture, q in shown]
        return 0 if all(every) else 1

    def _alone(
        self, recogniser: ArmRecogniser, robot: Robot, picture: Picture, q: JointVector
    ) -> bool:
        from armsight.recognition.any_arm.placing import place_camera

        lens, source = self._lens(picture)
        found = place_camera(recogniser, picture.image, lens, robot, q, recogniser.robots[0])
        line: dict[str, Any] = {"picture": picture.name, "robot": robot.name}
        if not found:
            line |= {"T_base_camera": None, "believed": False, "problem": "no arm is seen"}
        else:
            best = found[0]
            problem = best.problem or _lens_problem(source)
            line |= {
                "T_base_camera": best.T_base_camera.round(5).tolist(),
                "believed": not problem,
                "problem": problem or None,
                "outline_overlap": round(best.overlap, 3),
                "landmarks": round(best.landmarks, 3),
            }
            self._draw(picture, lens, robot, q, best.T_base_camera, not problem)
        self._say(line, source, picture)
        return bool(line["believed"])

    def _together(
        self, recogniser: ArmRecogniser, robot: Robot, shown: list[tuple[Picture, JointVector]]
    ) -> int:
        from armsight.errors import UsageError
        from armsight.recognition.any_arm.placing import guess_cameras
        from armsight.recognition.own_arm import ColorView, arm_surface, search_color
        from armsight.recognition.own_arm.search import LEAST_VIEWS

        first = shown[0][0]
        if len(shown) < LEAST_VIEWS:
            raise UsageError(
                f"--standing: {len(shown)} pictures; {LEAST_VIEWS} are needed to tell what moves"
            )
        odd = [p.name for p, _ in shown if p.image.shape != first.image.shape]
        if odd:
            raise UsageError(f"--standing: {odd[0]} has another size than {first.name}")
        lens, source = self._lens(first)
        views = [ColorView(q, picture.image) for picture, q in shown]
        guesses = guess_cameras(recogniser, lens, robot, views, recogniser.robots[0])
        answer = search_color(arm_surface(robot), lens, views, guesses=guesses)
        problem = answer.problem or _lens_problem(source)
        line = {
            "pictures": [picture.name for picture, _ in shown],
            "robot": robot.name,
            "T_base_camera": answer.T_base_camera.round(5).tolist(),
            "believed": not problem,
            "problem": problem or None,
            "sigma_m": round(answer.sigma, 4) if answer.sigma < 10.0 else None,
            "outline_seen": round(answer.seen, 3),
        }
        for picture, q in shown:
            self._draw(picture, lens, robot, q, answer.T_base_camera, not problem)
        self._say(line, source, first)
        return 0 if not problem else 1

    def _lens(self, picture: Picture) -> tuple[PinholeCamera, str]:
        """The picture's lens, and where it is from."""
        from armsight.recognition.any_arm.recogniser import assumed_lens
        from armsight.recognition.inference.intrinsics import read_camera

        lens = None if self.camera is None else read_camera(self.camera)
        found = camera_of(picture, self.intrinsics, self.camera, lens)
        if found is None:
            height, width = picture.image.shape[:2]
            return assumed_lens(width, height), "assumed"
        return found, "exif" if found is picture.camera else "given"

    def _draw(
        self,
        picture: Picture,
        lens: PinholeCamera,
        robot: Robot,
        q: JointVector,
        T_base_camera: Pose,
        believed: bool,
    ) -> None:
        """Write the picture with the arm in it, where it should be seen from there."""
        if self.out is None:
            return
        from armsight.recognition.any_arm.drawing import draw_placed

        drawing = draw_placed(picture.image, lens, robot, q, T_base_camera, believed)
        write_png(self.out / f"{picture.name}.placed.png", drawing)

    def _say(self, line: dict[str, Any], source: str, picture: Picture) -> None:
        print(json.dumps(line | {"intrinsics": source, "notes": list(picture.notes)}), flush=True)


def _lens_problem(source: str) -> str:
    """What is not known of a lens is not known of the distance."""
    if source == "given":
        return ""
    known = "not known" if source == "assumed" else "only roughly known from the picture's own file"
    return f"the lens is {known}, and with it every distance; give --camera or --intrinsics"

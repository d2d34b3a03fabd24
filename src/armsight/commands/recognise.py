"""``armsight recognise``."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from armsight.commands.picture_options import camera_of, write_png

if TYPE_CHECKING:
    from armsight.arrays import ColorImage
    from armsight.geometry.camera import PinholeCamera
    from armsight.recognition.inference.pictures import Picture
    from armsight.recognition.opening import Looks

DEFAULT_NETWORK = "arms"


@dataclass(frozen=True)
class Recognise:
    """Find robot arms in a picture, a folder of pictures or a video: types, masks, poses, joints.

    Examples: armsight recognise photo.jpg; armsight recognise photos --out found
    --camera ros_camera_info.yaml; armsight recognise film.mp4 --network runs/t7/network.onnx

    One JSON line a picture goes to standard output; drawings, masks and recognised.jsonl into
    --out. How far whoever carries the camera is from the reach of an arm stands there, and of a
    video is said on standard error when it changes. Exit code 1 if a picture could not be read.

    Attributes:
        what: picture, folder of pictures, or video.
        network: a network that comes with armsight, or an .onnx file of a training.
        out: folder for drawings, masks and JSON; nothing is written if left out.
        camera: the pictures' camera, YAML in ROS's camera_info layout; else what the files say.
        intrinsics: instead of a file: fx,fy,cx,cy in pixels.
        every: of a video, one frame in so many.
        threads: of the CPU; 0 for all.
        extension: files of robots that the network learned later (armsight extend).
        robot: the arms in the pictures are among these types; else any that it knows.
    """

    what: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="IMAGE|FOLDER|VIDEO")]
    network: str = DEFAULT_NETWORK
    out: Path | None = None
    camera: Path | None = None
    intrinsics: str | None = None
    every: int = 1
    threads: int = 0
    extension: tuple[Path, ...] = ()
    robot: tuple[str, ...] = ()

    def run(self) -> int:
        """Recognise; 1 if any picture could not be read."""
        from armsight.errors import RecognitionError, UsageError
        from armsight.recognition.inference.intrinsics import read_camera
        from armsight.recognition.inference.model import network_file
        from armsight.recognition.inference.pictures import VIDEOS, left_out, pictures_in
        from armsight.recognition.opening import open_recogniser
        from armsight.robots.catalogue import is_path

        if self.camera is not None and self.intrinsics is not None:
            raise UsageError("recognise: give one of --camera and --intrinsics")
        if self.every < 1:
            raise UsageError(f"--every is {self.every}, expected at least 1")
        if not 0 <= self.threads <= 1024:
            raise UsageError(f"--threads is {self.threads}, expected 0 (all) to 1024")
        paths = pictures_in(self.what)
        if self.what.is_dir() and (unread := left_out(self.what)):
            print(f"{self.what}: {unread}", file=sys.stderr)
        lens = None if self.camera is None else read_camera(self.camera)
        robots = [str(Path(r).resolve()) if is_path(r) else r for r in self.robot]
        network = network_file(self.network)
        looks = open_recogniser(network, self.threads, self.extension, robots)
        if self.what.suffix.lower() in VIDEOS and self.what.is_file():
            return self._video(looks, lens)
        lines: list[str] = []
        failed = 0
        names = _names(paths)
        for path in paths:
            try:
                lines.append(self._picture(looks, path, lens, names[path]))
            except RecognitionError as error:
                if len(paths) == 1:
                    raise
                failed += 1
                print(error, file=sys.stderr)
        self._finish(lines)
        return 1 if failed else 0

    def _picture(self, looks: Looks, path: Path, lens: PinholeCamera | None, name: str) -> str:
        from armsight.recognition.inference.pictures import read_picture

        picture = read_picture(path)
        shown = looks(picture, self._camera_of(picture, lens))
        print(shown.line, flush=True)
        if self.out is not None:
            write_png(self.out / f"{name}.recognised.png", shown.drawing)
            write_png(self.out / f"{name}.mask.png", shown.mask)
        return shown.line

    def _video(self, looks: Looks, lens: PinholeCamera | None) -> int:
        from armsight.recognition.inference.pictures import video_frames
        from armsight.recognition.inference.video import write_video

        lines: list[str] = []

        def drawn() -> Iterator[ColorImage]:
            warned = ""
            for picture in video_frames(self.what, self.every):
                shown = looks(picture, self._camera_of(picture, lens))
                print(shown.line, flush=True)
                if shown.warning != warned:
                    warned = shown.warning
                    words = warned or "no arm in sight may reach you"
                    print(f"{picture.name}: {words}", file=sys.stderr, flush=True)
                lines.append(shown.line)
                yield shown.drawing

        if self.out is None:
            for _ in drawn():
                pass
        else:
            write_video(self.out / f"{self.what.stem}.recognised.mp4", drawn())
        self._finish(lines)
        return 0

    def _camera_of(self, picture: Picture, lens: PinholeCamera | None) -> PinholeCamera | None:
        return camera_of(picture, self.intrinsics, self.camera, lens)

    def _finish(self, lines: list[str]) -> None:
        from armsight.writing import write_text

        if self.out is not None:
            write_text(self.out / "recognised.jsonl", "".join(f"{line}\n" for line in lines))
            print(f"written to {self.out}", file=sys.stderr)


def _names(paths: list[Path]) -> dict[Path, str]:
    """What each picture's drawings are called: a.jpg and a.png must not overwrite each other's."""
    from collections import Counter

    often = Counter(path.stem.casefold() for path in paths)
    return {p: p.stem if often[p.stem.casefold()] == 1 else p.name for p in paths}

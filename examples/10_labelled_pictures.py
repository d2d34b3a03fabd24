"""Labelled pictures of robot arms, to train recognition with: drawn, checked, and read again.

python examples/10_labelled_pictures.py [FOLDER]
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from armsight.commands.dataset import Generate
from armsight.recognition.data.labelled_set import LabelledSet


def main(folder: Path) -> None:
    Generate(out=folder, count=2, seed=1, workers=1).run()  # two of each robot, whoever draws them
    pictures = LabelledSet.open(folder)
    for index in range(0, len(pictures), 5):
        sample = pictures[index]
        height, width = sample.mask.shape
        print(
            f"{index}: {sample.robot}, {width} x {height} px, {sample.mask.mean():.1%} robot, "
            f"{len(sample.keypoints_px)} key points, {sample.keypoints_visible.sum()} visible"
        )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with TemporaryDirectory() as temporary:
            main(Path(temporary) / "set")

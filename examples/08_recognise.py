"""Which robot arms are in a picture, and where? Asked of the network that comes with armsight.

Without a file, the picture is one that armsight renders itself.

python examples/08_recognise.py [PICTURE]
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from armsight import ArmRecogniser
from armsight.commands.dataset import Generate
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.inference.model import network_file
from armsight.recognition.inference.pictures import Picture, read_picture


def rendered() -> tuple[str, Picture]:
    """The type of a robot, and a picture of it among other things."""
    with TemporaryDirectory() as folder:
        Generate(out=Path(folder) / "set", count=1, seed=3, workers=1).run()
        sample = LabelledSet.open(Path(folder) / "set")[0]
        return sample.robot, Picture("rendered", sample.image)


def main(file: str | None) -> None:
    truth, picture = rendered() if file is None else ("?", read_picture(Path(file)))
    found = ArmRecogniser(CropModel(network_file("arms"))).recognise(picture)
    print(f"{len(found.arms)} arm(s); truth: {truth}; {'; '.join(found.notes)}")
    for arm in found.arms:
        print(f"{arm.robot}, trust {arm.trust:.2f} {arm.problem}; joints in the camera [m]:")
        print(arm.joints.round(2))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)

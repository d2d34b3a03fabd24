"""Which robot is in a picture, and where? Asked of the network that comes with armsight.

Without a file, the picture is one that armsight renders itself.

python examples/08_recognise.py [PICTURE]
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from armsight import Recogniser
from armsight.commands.dataset import Generate
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.inference.model import Model, network_file
from armsight.recognition.inference.pictures import Picture, read_picture


def rendered() -> tuple[str, Picture]:
    """The type of a robot, and a picture of it among other things."""
    with TemporaryDirectory() as folder:
        Generate(out=Path(folder) / "set", count=1, seed=3, workers=1).run()
        sample = LabelledSet.open(Path(folder) / "set")[0]
        return sample.robot, Picture("rendered", sample.image)


def main(file: str | None) -> None:
    truth, picture = rendered() if file is None else ("?", read_picture(Path(file)))
    found = Recogniser(Model(network_file("multi-objective"))).recognise(picture)
    print(f"robot: {found.robot} (truth: {truth}); joints in the camera [m]:")
    print(found.joints.round(2))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)

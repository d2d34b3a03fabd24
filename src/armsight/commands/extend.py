"""``armsight extend``."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Extend:
    """Teach the recogniser a robot of your own from its URDF; nothing that it knows changes.

    Example: armsight extend --robot my_arm.urdf --samples 300 --out my_arm, then
    armsight recognise photo.jpg --extension my_arm/extension.safetensors

    Attributes:
        robot: a URDF, a robot's folder, or a name of the catalogue.
        samples: crops of it that are rendered; of other arms there are about as many.
        network: a network that comes with armsight, or an .onnx file of a training.
        out: folder for the crops and the extension; the same command goes on with its crops.
        seed: of the crops.
        workers: processes that render; one a core if left out.
    """

    robot: str
    samples: int = 300
    network: str = "arms"
    out: Path = Path("extension")
    seed: int = 0
    workers: int | None = None

    def run(self) -> int:
        """Render, fit, measure."""
        import json

        from armsight.errors import UsageError
        from armsight.recognition.any_arm.extension import read_extension
        from armsight.recognition.any_arm.learning.extend import Wish, extend
        from armsight.recognition.data.crews import Alone, Processes
        from armsight.recognition.inference.model import network_file
        from armsight.robots.catalogue import is_path

        workers = self.workers if self.workers is not None else (os.cpu_count() or 1)
        if not 1 <= workers <= 1024:
            raise UsageError(f"--workers {workers}: expected 1 to 1024")
        crew = Alone() if workers == 1 else Processes(workers)
        # Whoever opens the extension later may stand elsewhere.
        robot = str(Path(self.robot).resolve()) if is_path(self.robot) else self.robot
        wish = Wish(robot, network_file(self.network), self.out, self.samples, self.seed)
        try:
            file = extend(wish, crew, lambda words: print(words, flush=True))
        finally:
            crew.close()
        print(json.dumps(read_extension(file).card))
        print(f"{file}: armsight recognise PICTURE --extension {file}")
        return 0

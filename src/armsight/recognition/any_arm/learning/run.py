"""One training of the crop network from a plan to its files; what ``armsight train`` calls.

Into the folder go ``checkpoint.safetensors``, ``curve.json`` and ``curve.png``, and each time that
the training stops ``network.onnx`` and ``CARD.md``.
"""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

from armsight.errors import RecognitionError
from armsight.machine import usable_cores
from armsight.recognition.any_arm.learning.adopting import adopt, find_origin
from armsight.recognition.any_arm.learning.examples import pack_shards, read_examples
from armsight.recognition.any_arm.learning.network import OTHERS, CropNet
from armsight.recognition.any_arm.learning.plan import Plan
from armsight.recognition.any_arm.learning.shipping import ship
from armsight.recognition.any_arm.learning.trainer import CropTrainer
from armsight.recognition.any_arm.learning.trunk import load_pretrained, pretrained_file
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.training import curves
from armsight.recognition.training.checkpoint import Progress
from armsight.recognition.training.run import Say, Wanted, prepare
from armsight.writing import write_text

_LINE_SECONDS, _CURVE_SECONDS = 2.0, 600.0


def train_crops(
    plan: Plan,
    folder: Path,
    wanted: Wanted,
    say: Say,
    begun: Path | None = None,
    tuning: Path | None = None,
) -> bool:
    """Train from the pretrained trunk or a finished network, or go on; whether it is finished.

    Args:
        plan: how.
        folder: a labelled set of crops, finished or not, or a folder of packed ones.
        wanted: where to, how long, on what.
        say: told about the course.
        begun: ONNX file of the finished network to begin from.
        tuning: labelled set of whole pictures, finished or not, on which trust is chosen as well.

    Raises:
        RecognitionError, DatasetError: no data, no weights to begin from, a checkpoint of another
            plan, a blend with nothing, or something cannot be written.
    """
    if begun is None and plan.blend < 1.0:
        raise RecognitionError(
            "blend mixes with the network that was begun from: give it by --from"
        )
    device = prepare(wanted)
    elsewhere = None if tuning is None else LabelledSet.open(tuning, partial=True)
    origin = None if begun is None else find_origin(begun)
    data = read_examples(packed_folder(folder, say), (*plan.robots, *OTHERS))

    def start(network: CropNet) -> None:
        if origin is None:
            load_pretrained(network.trunk, pretrained_file())
        else:
            adopt(network, origin)

    wanted.out.mkdir(parents=True, exist_ok=True)
    workers = usable_cores() - 1 if device.type == "cuda" else 0
    trainer = CropTrainer(plan, data, wanted.out, device, start, workers, origin)
    say(
        f"{len(trainer.learned)} crops to learn from, {len(trainer.held)} held back; "
        f"{device}, {trainer.precision}; at update {trainer.progress.update} of {plan.updates}"
    )
    said = drawn = -math.inf

    def told(progress: Progress) -> None:
        nonlocal said, drawn
        now = time.monotonic()
        if now - said > _LINE_SECONDS:
            say(curves.line(progress.curve, "crops", plan.updates))
            said = now
        if now - drawn > _CURVE_SECONDS:
            _draw(progress, wanted.out)
            drawn = now

    finished = trainer.run(wanted.minutes, told)
    _draw(trainer.progress, wanted.out)
    labelled = (folder / "dataset.toml").is_file()
    source = LabelledSet.open(folder, partial=True) if labelled else None
    say(f"wrote {ship(trainer, wanted.out, source, elsewhere)}")
    return finished


def packed_folder(folder: Path, say: Say) -> Path:
    """Where the packed crops of a folder are; those of new shards are packed first."""
    if any(folder.glob("arms-*.safetensors")):
        return folder
    place = folder / "packed-arms"

    def told(done: int, whole: int) -> None:
        say(f"packing shard {done} of {whole}")

    pack_shards(folder, place, told, usable_cores())
    return place


def _draw(progress: Progress, out: Path) -> None:
    text = json.dumps(progress.curve, separators=(",", ":"))
    write_text(out / "curve.json", text, RecognitionError)
    if progress.curve:
        curves.draw(progress.curve, ["crops"], out / "curve.png")

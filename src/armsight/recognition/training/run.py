"""One training from a configuration to its files; what ``armsight train`` and ``transfer`` call.

Into the folder go ``checkpoint.safetensors`` (to go on from), ``curve.json`` and ``curve.png``, and
each time that the training stops or ends ``weights.safetensors``, ``network.onnx`` and ``CARD.md``.
"""

from __future__ import annotations

import importlib.util
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from armsight.errors import RecognitionError
from armsight.recognition.networks.build import build_network
from armsight.recognition.networks.multi_objective import MultiObjectiveNet
from armsight.recognition.training import curves
from armsight.recognition.training.card import card_text, make_card
from armsight.recognition.training.checkpoint import Progress
from armsight.recognition.training.config import TrainingConfig
from armsight.recognition.training.export import answers, check_parity, to_onnx
from armsight.recognition.training.figures import score
from armsight.recognition.training.onnx_file import LARGEST
from armsight.recognition.training.packed_set import PackedSet
from armsight.recognition.training.trainer import Trainer, start_at_mean
from armsight.recognition.training.transfer import extend, start_new_joints
from armsight.recognition.training.weights import Card, load_weights, save_weights
from armsight.writing import write_atomically, write_text

_PARITY_IMAGES = 8
_TIMED = 21
_CURVE_SECONDS, _LINE_SECONDS = 30.0, 2.0
Say = Callable[[str], None]


@dataclass(frozen=True)
class Wanted:
    """How a training is run.

    Attributes:
        out: folder for everything it writes.
        minutes: of wall time, then it stops and can be gone on with.
        device: ``cpu``, ``cuda``, or ``auto``.
        half: keep dense weights of the ONNX file in half precision.
        threads: of the CPU; 0 for torch's own choice.
    """

    out: Path
    minutes: float = math.inf
    device: str = "auto"
    half: bool = False
    threads: int = 0


def train(config: TrainingConfig, data: PackedSet, wanted: Wanted, say: Say) -> bool:
    """Train from nothing, or go on; whether it is finished.

    Raises:
        RecognitionError: configuration, data and an earlier checkpoint do not fit together, or
            something cannot be written.
    """
    device = prepare(wanted)
    network = build_network(config.architecture, config.seed)
    trainer = Trainer(config, data, network, wanted.out, device)
    if config.start_at_mean and not _begun(trainer.progress):
        start_at_mean(trainer.network, data, trainer.chosen)
    return _run(trainer, wanted, {}, say)


def transfer(
    config: TrainingConfig, data: PackedSet, weights: Path, wanted: Wanted, say: Say
) -> bool:
    """Teach a trained network new robots, or go on with that; whether it is finished.

    Raises:
        RecognitionError: as :func:`train`, or the weights are damaged or of another network.
    """
    device = prepare(wanted)
    old, parent = load_weights(weights)
    if not isinstance(old, MultiObjectiveNet):
        raise RecognitionError(
            f"{weights}: is a {old.architecture.kind} network; T6 and T7 transfer a "
            "multi-objective one"
        )
    known = old.architecture
    network = extend(old, config.architecture, config.seed)
    trainer = Trainer(config, data, network, wanted.out, device, parent=str(parent))
    if config.start_at_mean and not _begun(trainer.progress):
        start_new_joints(network, known, data, trainer.chosen)
    return _run(trainer, wanted, parent, say)


def prepare(wanted: Wanted) -> torch.device:
    """The device, set up so that the same seed gives the same weights on a CPU.

    Raises:
        RecognitionError: no such device here.
    """
    if wanted.threads:
        torch.set_num_threads(wanted.threads)
    name = wanted.device
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name == "cuda" and not torch.cuda.is_available():
        raise RecognitionError("there is no CUDA device here; use --device cpu")
    if name not in ("cpu", "cuda"):
        raise RecognitionError(f'device "{name}" is unknown, expected auto, cpu or cuda')
    # A GPU repeats itself to rounding only; there, speed goes first.
    torch.use_deterministic_algorithms(name == "cpu", warn_only=True)
    if name == "cuda":
        torch.backends.cuda.matmul.allow_tf32 = True
        torch.backends.cudnn.allow_tf32 = True
        torch.backends.cudnn.benchmark = True
    return torch.device(name)


def _begun(progress: Progress) -> bool:
    return bool(progress.stage or progress.update)


def _run(trainer: Trainer, wanted: Wanted, parent: Card, say: Say) -> bool:
    config = trainer.config
    if _begun(trainer.progress):
        at = trainer.progress
        say(f"going on at update {at.update} of stage {min(at.stage + 1, len(config.stages))}")
    weights = sum(p.numel() for p in trainer.network.parameters())
    say(
        f"{len(trainer.chosen)} samples of {', '.join(config.trained_robots)}; "
        f"{weights / 1e6:.1f} million weights; {trainer.device}, {trainer.precision}"
    )
    drawn = said = -math.inf

    def told(progress: Progress) -> None:
        nonlocal drawn, said
        if progress.seconds - said > _LINE_SECONDS:
            stage = config.stages[progress.stage]
            say(curves.line(progress.curve, stage.name, stage.updates))
            said = progress.seconds
        if progress.seconds - drawn > _CURVE_SECONDS:
            _draw(trainer, wanted.out)
            drawn = progress.seconds

    stopped = trainer.run(wanted.minutes, told)
    _draw(trainer, wanted.out)
    finish(trainer, wanted, stopped.finished, parent, say)
    if not stopped.finished:
        stage = config.stages[stopped.progress.stage]
        say(
            f"stopped at update {stopped.progress.update} of {stage.updates} of stage "
            f"{stage.name}; the same command goes on"
        )
    return stopped.finished


def finish(trainer: Trainer, wanted: Wanted, finished: bool, parent: Card, say: Say) -> None:
    """Measure on validation samples, write weights, card and ONNX, and prove the latter."""
    network, out, config = trainer.network, wanted.out, trainer.config
    card = make_card(trainer, finished, validation_figures(trainer), parent)
    card["training"]["ms_per_image"] = round(milliseconds(trainer), 3)
    save_weights(out / "weights.safetensors", network, card)
    write_text(out / "CARD.md", card_text(out.name, card, config.architecture), RecognitionError)
    file = out / "network.onnx"
    half = wanted.half
    if not half and 4 * sum(p.numel() for p in network.parameters()) > LARGEST:
        half = True
        say("the network is larger than an ONNX file may be: its dense weights in half precision")
    write_atomically(file, to_onnx(network, card, half), error=RecognitionError)
    if importlib.util.find_spec("onnxruntime") is None:
        say(f"wrote {file}; not compared with torch, since there is no onnxruntime here")
        return
    some = trainer.chosen[:_PARITY_IMAGES]
    parity = check_parity(network, file, trainer.data.images[some], half)
    say(
        f"wrote {file}; it differs from torch by {1e3 * parity.metres:.4f} mm and "
        f"{parity.probability:.1e} of probability at most"
    )


def validation_figures(trainer: Trainer) -> dict[str, dict[str, float]]:
    """Figures of every trained robot on its validation samples.

    Of a cascaded network also with true masks: T4's "separate" coordinate network.
    """
    network, data, config = trainer.network, trainer.data, trainer.config
    figures: dict[str, dict[str, float]] = {}
    for robot in config.trained_robots:
        samples = data.select("validation", config.split, (robot,))
        scores = score(lambda x, _: answers(network, x), config.architecture, data, samples)
        figures[robot] = _rounded(scores.summary())
        if config.architecture.kind == "cascaded":
            scores = score(
                lambda x, k: answers(network, x, data.masks(k)), config.architecture, data, samples
            )
            figures[f"{robot}, true masks"] = _rounded(scores.summary())
    return figures


def _rounded(summary: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 6) for name, value in summary.items()}


def milliseconds(trainer: Trainer) -> float:
    """Median time of one image on the device that trained, its copying there and back included."""
    image = trainer.data.images[trainer.chosen[:1]]
    times = []
    for _ in range(_TIMED):
        begun = time.perf_counter()
        answers(trainer.network, image)
        times.append(1e3 * (time.perf_counter() - begun))
    return sorted(times)[_TIMED // 2]


def _draw(trainer: Trainer, out: Path) -> None:
    curve = trainer.progress.curve
    text = json.dumps(curve, separators=(",", ":"))
    write_text(out / "curve.json", text, RecognitionError)
    if curve:
        curves.draw(curve, [s.name for s in trainer.config.stages], out / "curve.png")

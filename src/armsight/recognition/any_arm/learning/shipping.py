"""A trained crop network as one ONNX file with its card; and the card for people."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import torch

from armsight.errors import RecognitionError
from armsight.recognition.any_arm.landmarks import find_landmarks
from armsight.recognition.any_arm.learning import trunk
from armsight.recognition.any_arm.learning.adopting import blend
from armsight.recognition.any_arm.learning.export import check_parity, to_onnx
from armsight.recognition.any_arm.learning.measure import measure
from armsight.recognition.any_arm.learning.network import OTHERS, CropNet
from armsight.recognition.any_arm.learning.trainer import CropTrainer
from armsight.recognition.any_arm.learning.trusting import (
    Judged,
    choose_trust,
    judge,
    judge_pictures,
)
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.training.weights import LICENCE, Card
from armsight.robots.catalogue import load_robot
from armsight.writing import write_atomically, write_text

JUDGED = 400
"""Held-back crops on which trust is chosen."""
_PARITY = 4


def ship(
    trainer: CropTrainer,
    out: Path,
    source: LabelledSet | None,
    elsewhere: LabelledSet | None = None,
) -> Path:
    """Write ``network.onnx`` and ``CARD.md`` of the running mean, blended as planned; the file.

    What trust was chosen on is left in ``judged.json``.

    Args:
        trainer: that trained it.
        out: folder.
        source: the labelled set, for the choice of how far to trust; None keeps the defaults.
        elsewhere: pictures of another renderer, on which trust is chosen as well.

    Raises:
        RecognitionError: it cannot be written, or ONNX Runtime disagrees with torch.
    """
    card = make_card(trainer)
    file = out / "network.onnx"
    network = copy.deepcopy(trainer.mean).cpu()
    if trainer.origin is not None and trainer.plan.blend < 1.0:
        blend(network, trainer.origin, trainer.plan.blend)
        card["validation"] = _checked(network, trainer)
    write_atomically(file, to_onnx(network, card), error=RecognitionError)
    check_parity(network, file, trainer.data.images[trainer.held[:_PARITY]])
    if source is not None:
        names = (*trainer.plan.robots, *OTHERS)
        model = CropModel(file, 1)
        judged = judge(model, source, names, JUDGED)
        other = None if elsewhere is None else judge_pictures(model, elsewhere)
        write_text(out / "judged.json", _told(judged, other), RecognitionError)
        trust, figures = choose_trust(judged, other)
        card["trust"] = vars(trust) | {"chosen_on": figures}
        write_atomically(file, to_onnx(network, card), error=RecognitionError)
    write_text(out / "CARD.md", card_text(card), RecognitionError)
    return file


def _checked(network: CropNet, trainer: CropTrainer) -> dict[str, float]:
    """What is written, on the crops that the training was measured on."""
    size = trainer.plan.size
    found = measure(network, trainer.data, trainer.some_held, torch.device("cpu"), size)
    return _finite(found) | {"size": size, "update": trainer.progress.update}


def _finite(figures: dict[str, float]) -> dict[str, float]:
    """Where no crop with an arm was held back there are none of masks and landmarks."""
    return {k: v for k, v in figures.items() if math.isfinite(v)}


def _told(judged: Judged, elsewhere: Judged | None) -> str:
    """What trust was chosen on, answer by answer."""
    both = {"held_back": judged} | ({} if elsewhere is None else {"tuning": elsewhere})
    return json.dumps({k: {n: v.tolist() for n, v in vars(j).items()} for k, j in both.items()})


def make_card(trainer: CropTrainer) -> Card:
    """What a network says of itself."""
    plan, data, at = trainer.plan, trainer.data, trainer.progress
    number = data.robot[trainer.learned]
    origin = trainer.origin
    begun = {}
    if origin is not None:
        begun = {k: v for k, v in vars(origin).items() if k != "file"}
    checked = [r["validation"] | {"update": r["update"]} for r in at.curve if "validation" in r]
    return {
        "paper": "ours",
        "licence": LICENCE,
        "trunk": {"origin": trunk.ORIGIN, "licence": trunk.LICENCE},
        "robots": list(plan.robots),
        "landmarks": {name: find_landmarks(load_robot(name)).to_json() for name in plan.robots},
        "data": {name: int((number == k).sum()) for k, name in enumerate(data.names)},
        "training": {
            "begun_from": begun,
            "updates": at.update,
            "batch": plan.batch,
            "size": plan.size,
            "blend": plan.blend,
            "seconds": round(at.seconds, 1),
            "seed": plan.seed,
            "precision": trainer.precision,
            "device": trainer.device.type,
            "torch": torch.__version__,
        },
        "validation": _finite(checked[-1]) if checked else {},
    }


def card_text(card: dict[str, Any]) -> str:
    """The card in Markdown."""
    t, v = card["training"], card["validation"]
    counts = ", ".join(f"{n} {name}" for name, n in card["data"].items())
    lines = [
        "# Crop network",
        "",
        f"Knows {', '.join(card['robots'])}, `none` and `unknown`; looks at crops.",
        "",
        f"* Trunk: {card['trunk']['origin']}, licence {card['trunk']['licence']}.",
        f"* Learned from {sum(card['data'].values())} rendered crops ({counts}); no photograph.",
        f"* {t['updates']} updates of {t['batch']} crops of {t['size']} px in "
        f"{t['seconds'] / 60:.0f} minutes of wall time on {t['device']}, {t['precision']}, seed "
        f"{t['seed']}, torch {t['torch']}.",
        f"* Licence: {card['licence']}. It is no safety function.",
    ]
    if begun := t["begun_from"]:
        lines.append(
            f"* Begun from a network of {begun['updates']} updates on {begun['crops']} other "
            f"crops, sha256 {begun['sha256'][:16]}."
        )
        if t.get("blend", 1.0) < 1.0:
            lines.append(
                f"* Its weights are {t['blend']:.0%} what it learned, the rest of that one's."
            )
    if {"mask_iou", "keypoint_px"} <= set(v):
        lines.append(
            f"* In held-back rooms of the training's renderer: mask IoU {v['mask_iou']:.3f}, "
            f"landmarks {v['keypoint_px']:.1f} px of {v.get('size', t['size']):.0f} (median), "
            f"{v['type_right']:.0%} of the types right (at update {v['update']})."
        )
    if "trust" in card:
        f = card["trust"]["chosen_on"]
        lines.append(
            f"* Believed from a trust of {card['trust']['threshold']:.2f}, chosen on "
            f"{f['frames'] - f['elsewhere']} held-back crops and {f['elsewhere']} answers on "
            "tuning pictures of another renderer: "
            f"{f['believed']:.0%} believed, {f['believed_wrong']:.0%} of these off by more than "
            "100 mm or of another type."
        )
    return "\n".join(lines) + "\n"

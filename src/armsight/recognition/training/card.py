"""The card of a network: what it was trained on, for how long, how good it is, who may use it."""

from __future__ import annotations

import platform
from typing import Any

import torch

from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.training.trainer import Trainer
from armsight.recognition.training.weights import LICENCE, Card


def make_card(trainer: Trainer, finished: bool, figures: dict[str, Any], parent: Card) -> Card:
    """The card of a network as it is now.

    Args:
        trainer: that trained it.
        finished: every stage came to its end.
        figures: on validation samples, by robot.
        parent: card of the weights that a transfer began with, else empty.
    """
    config, data, at = trainer.config, trainer.data, trainer.progress
    robots = data.robot[trainer.chosen]
    counts = {
        name: int((robots == data.robots.index(name)).sum()) for name in config.trained_robots
    }
    stages: list[dict[str, Any]] = [
        {
            "name": stage.name,
            "updates": _updates(trainer, k),
            "planned": stage.updates,
            "batch": stage.batch,
            "why": at.ended[k]["why"] if k < len(at.ended) else "unfinished",
        }
        for k, stage in enumerate(config.stages)
    ]
    return {
        "paper": config.paper,
        "licence": LICENCE,
        "finished": finished,
        "data": {**data.source, "training_samples": counts, "split": config.split},
        "camera": {"K": data.mean_K().tolist()},
        "training": {
            "stages": stages,
            "images_seen": sum(s["updates"] * s["batch"] for s in stages),
            "seconds": round(at.seconds, 1),
            "seed": config.seed,
            "precision": trainer.precision,
            "device": _device(trainer.device),
            "threads": torch.get_num_threads(),
            "torch": torch.__version__,
            "foreground_share": round(trainer.share, 6),
        },
        "validation": figures,
        "parent": {k: parent[k] for k in ("paper", "data", "training") if k in parent},
    }


def card_text(name: str, card: Card, a: Architecture) -> str:
    """The card for people, in Markdown."""
    training, data = card["training"], card["data"]
    counts = ", ".join(f"{n} {robot}" for robot, n in data["training_samples"].items())
    state = "" if card["finished"] else " **Training is not finished.**"
    lines = [
        f"# {name}",
        "",
        f"{a.kind} network ({card['paper']}) for {', '.join(a.robots)}; input {a.width} x "
        f"{a.height} px, {a.filters:g} of the papers' filters, {a.dense:g} of their dense units, "
        f"{a.pools} poolings.{state}",
        "",
        f"* Data: {data['kind']}, seed {data['seed']}, {data['renderer']}; split by "
        f"{data['split']}; {counts}.",
        f"* Training: {training['images_seen']} images shown in {training['seconds'] / 60:.0f} "
        f"minutes on {training['device']}, {training['precision']}, seed {training['seed']}, torch "
        f"{training['torch']}.",
    ]
    lines += [
        f"  * stage {s['name']}: {s['updates']} of at most {s['planned']} updates of "
        f"{s['batch']} images ({s['why']})"
        for s in training["stages"]
    ]
    lines += [
        f"* Licence: {card['licence']}. Trained on rendered pictures only.",
        "* Metres hold for the camera that it was trained with; it is no safety function.",
        *_no_robot(card),
        "",
        "| validation | frames | mask IoU | pixels right | type right | joints mean, median mm "
        "| base mean, median mm | ADD-AUC |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for robot, f in card["validation"].items():
        lines.append(
            f"| {robot} | {f['frames']} | {f['mask_iou']:.3f} | {f['mask_accuracy']:.3f} "
            f"| {f['type_accuracy']:.3f} | {f['joint_mean_mm']:.0f}, {f['joint_median_mm']:.0f} "
            f"| {f['base_mean_mm']:.0f}, {f['base_median_mm']:.0f} | {f['add_auc']:.3f} |"
        )
    return "\n".join(lines) + "\n"


def _no_robot(card: Card) -> list[str]:
    """How it tells that there is no robot, if that was chosen."""
    if "no_robot" not in card:
        return []
    f = card["no_robot"]
    return [
        f"* No robot is said when less than {100 * f['share']:.2g} % of a picture looks like one: "
        f"chosen on {f['without']} pictures without an arm and {f['shown']} with one ({f['set']}), "
        f"of which it says so of {100 * f['said_without']:.0f} and {100 * f['said_shown']:.0f} %."
    ]


def _updates(trainer: Trainer, stage: int) -> int:
    at = trainer.progress
    if stage < len(at.ended):
        return int(at.ended[stage]["updates"])
    return at.update if stage == at.stage else 0


def _device(device: torch.device) -> str:
    if device.type == "cuda":
        return str(torch.cuda.get_device_name(device))
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as stream:
            found = [line.split(":", 1)[1].strip() for line in stream if "model name" in line]
    except OSError:
        found = []
    return f"{found[0] if found else platform.processor() or 'a CPU'}"

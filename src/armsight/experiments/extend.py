"""``extend``: a robot that the shipped network never saw, learned from some hundred crops."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from armsight.arrays import Floats
from armsight.errors import UsageError
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, wilson
from armsight.recognition.any_arm.evidence import STRIDE
from armsight.recognition.any_arm.extension import read_extension
from armsight.recognition.any_arm.learning.changes import Batch, Changes, make_batch
from armsight.recognition.any_arm.learning.examples import Examples, pack_shards, read_examples
from armsight.recognition.any_arm.learning.extend import FEWEST, Wish, extend
from armsight.recognition.any_arm.model import CropModel, Look
from armsight.recognition.any_arm.views import SIDE
from armsight.recognition.data.generate import generate
from armsight.recognition.data.order import make_order
from armsight.recognition.inference.model import network_file

NETWORK, ROBOT = "arms", "fr3"
CROP = 160.0
"""Side of the crop that errors of landmarks are given for [px]."""
SHOWN, OTHERS = 240, 60
"""Fresh crops of the new robot and of each known one that are looked at: with 80 and 20 the ratio
was 1.25 for one seed and 1.52 for the next."""
TIMES = 3
"""Extensions that are made, of seeds one after another; all look at the same fresh crops."""
APART = 1000
"""Between the seeds of what is learned and of what is reported."""

ABOUT = """
The Franka FR3, which the shipped network does not know (its forerunner, the Panda, it does: it
looks the same but for its paint), is added by `armsight extend` with `--runs` crops, and looked at
in fresh crops of other rooms (the training's renderer). An extension speaks for what the network
alone calls unknown; of an arm that it takes for one of its own, the extension may say that the new
robot looks alike; then no pose is believed. Three extensions are made, each of its own crops; all
look at the same fresh ones, and every look counts. `extend_ratio` is the median error of the new
robot's visible landmarks over that of the five robots that the network was trained on, in the same
set: the same robot trained in full is not there to compare with. `extend_minutes` is processor time
of one thread, rendering included.
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs``: crops of the new robot.

    Raises:
        UsageError: too few.
    """
    if runs < FEWEST:
        raise UsageError(f"--runs {runs}: so many crops of the robot; expected at least {FEWEST}")
    network = network_file(NETWORK)
    with tempfile.TemporaryDirectory() as folder:
        plain = CropModel(network, 1)
        minutes, models = [], []
        for k in range(TIMES):
            begun = time.process_time()
            wish = Wish(ROBOT, network, Path(folder) / f"new-{k}", runs, seed + k)
            file = extend(wish, None, lambda words, k=k: progress(words, 0.2 * k))  # type: ignore[misc]
            minutes.append((time.process_time() - begun) / 60.0)
            models.append(CropModel(network, 1, [read_extension(file)]))
        progress("fresh crops", 0.6)
        fresh = _fresh(Path(folder) / "fresh", plain.robots, seed + APART)
    batch = make_batch(fresh, np.arange(len(fresh)), None, 0, Changes(size=SIDE))
    seen = _Seen([], [], [], [], [], [])
    for k, image in enumerate(batch.images):
        progress("looking", 0.7 + 0.3 * k / len(fresh))
        name, before = fresh.names[batch.type[k]], plain.look(image)
        if name != ROBOT:
            seen.old.append(_errors(plain, before, name, batch, k))
        for more in models:
            _look_again(seen, more, more.look(image), before, name, batch, k)
    return Outcome(_rows(float(np.median(minutes)), seen, runs), {})


@dataclass(frozen=True)
class _Seen:
    """What was said, one entry a crop and extension.

    Attributes:
        new, old: errors of landmarks on crops of the new robot and of those known before [px].
        known: the new one is called so; named: so, or it is said to look alike.
        claimed: one of the five is called the new one; changed: one that the network alone gave an
            answer for has another one.
    """

    new: list[Floats]
    old: list[Floats]
    known: list[bool]
    named: list[bool]
    claimed: list[bool]
    changed: list[bool]


def _fresh(folder: Path, robots: tuple[str, ...], seed: int) -> Examples:
    """Crops of the new robot and of the known ones."""
    counts = {ROBOT: SHOWN} | dict.fromkeys(robots, OTHERS)
    generate(make_order("crops", counts, seed, (SIDE, SIDE)), folder, None)
    pack_shards(folder, folder / "packed")
    return read_examples(folder / "packed", tuple(counts))


def _look_again(
    seen: _Seen, model: CropModel, look: Look, before: Look, name: str, batch: Batch, k: int
) -> None:
    """Note what an extended network says of a crop."""
    said = "unknown" if look.stranger else max(look.types, key=lambda n: look.types[n])
    if name == ROBOT:
        seen.new.append(_errors(model, look, name, batch, k))
        seen.known.append(said == ROBOT)
        seen.named.append(said == ROBOT or ROBOT in look.alike)
        return
    seen.claimed.append(said == ROBOT)
    if not before.stranger:
        seen.changed.append(not _same(before, look))


def _errors(model: CropModel, look: Look, name: str, batch: Batch, k: int) -> Floats:
    """Of landmarks that lie on the arm [px of a crop of :data:`CROP`]."""
    arm = batch.links[k, 0] < 0.5
    true = batch.points[k][model.landmarks[name].slot]
    cell = np.round(np.nan_to_num(true, nan=-9.0)).astype(int)
    on = (cell >= 0).all(1) & (cell[:, 0] < arm.shape[1]) & (cell[:, 1] < arm.shape[0])
    on[on] = arm[cell[on, 1], cell[on, 0]]
    away = np.linalg.norm(look.places[name].mean[on] - true[on], axis=1)
    return np.asarray(STRIDE * CROP / SIDE * away)


def _same(a: Look, b: Look) -> bool:
    """Whether two looks say the same of all that the first one knows, bit for bit."""
    return (
        all(b.types[name] == p for name, p in a.types.items())
        and np.array_equal(a.surface.links, b.surface.links)
        and np.array_equal(a.surface.coordinates, b.surface.coordinates)
        and all(np.array_equal(p.mean, b.places[name].mean) for name, p in a.places.items())
    )


def _rows(minutes: float, seen: _Seen, samples: int) -> tuple[Row, ...]:
    where = f"{ROBOT}, {samples} crops"
    px, before = np.concatenate(seen.new), np.concatenate(seen.old)
    return (
        Row("extend_minutes", "processor time, one thread, rendering included", where, minutes,
            "min", samples, must=30.0, aim=15.0),
        Row("extend_ratio", "landmarks' median error over that of the five trained robots", where,
            float(np.median(px) / np.median(before)), "", len(seen.new), must=1.5, aim=1.2),
        _share("extend_old_changed", "crops of the five robots that the network alone does not "
               "call unknown, of which anything else is said", where, seen.changed, must=0.0),
        _share("extend_known", "crops of the new robot called so", where, seen.known, "higher"),
        _share("extend_named", "the same, or said to be one that looks alike", where, seen.named,
               "higher"),
        _share("extend_claimed", "crops of the five robots called the new one", where,
               seen.claimed),
        Row("extend_px", "landmarks' median error, crop of 160 px", where, float(np.median(px)),
            "px", len(px)),
    )  # fmt: skip


def _share(
    key: str,
    words: str,
    where: str,
    hits: list[bool],
    better: Literal["higher", "lower"] = "lower",
    must: float | None = None,
) -> Row:
    low, high = wilson(sum(hits), len(hits))
    value = float(np.mean(hits))
    return Row(
        key, words, where, value, "", len(hits), low=low, high=high, must=must, aim=must,
        better=better,
    )  # fmt: skip


EXPERIMENT = Experiment(
    "extend", "A robot that the network never saw, from some hundred crops", run, 300, ABOUT
)

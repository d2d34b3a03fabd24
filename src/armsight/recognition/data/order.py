"""What of a set each sample is: its robot and its room, from its index alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armsight.arrays import Ints
from armsight.errors import UsageError
from armsight.recognition.data.arms import mesh_hash
from armsight.recognition.data.emphasis import NO_EMPHASIS, Emphasis, parse_emphasis
from armsight.recognition.data.manifest import Manifest
from armsight.recognition.data.recipe import PAPER_COUNTS, Recipe, find_recipe
from armsight.recognition.data.recording import Place, frames_of
from armsight.recognition.data.sample import (
    KNOWN_ROBOTS,
    NO_ROBOT,
    ROBOT_TYPES,
    UNKNOWN_ROBOT,
    is_robot_type,
)
from armsight.robots.catalogue import ROBOT_NAMES
from armsight.simulation.gl import mujoco

SHARD_SIZE = 1000
NO_MESHES = (NO_ROBOT, UNKNOWN_ROBOT)
"""Types that no files belong to."""


@dataclass(frozen=True)
class Order:
    """A set to be made. Small, and the same in every worker.

    Attributes:
        manifest: of the set.
    """

    manifest: Manifest

    @property
    def recipe(self) -> Recipe:
        """Ranges of the set."""
        return find_recipe(self.manifest.kind)

    @cached_property
    def emphasis(self) -> Emphasis:
        """Which scenes are taken more often."""
        return parse_emphasis(self.manifest.settings.get("emphasis", ""))

    @cached_property
    def _places(self) -> tuple[Ints, Ints]:
        """(n,) number of each sample's robot in ``counts``, and the sample's within the robot.

        Robots take turns, each as often as its count asks for: any beginning of a set is a set of
        the same mixture.
        """
        counts = [c // self.recipe.views for c in self.manifest.counts.values()]
        when = np.concatenate([(np.arange(c) + 0.5) / c for c in counts])
        robot = np.concatenate([np.full(c, k) for k, c in enumerate(counts)])
        within = np.concatenate([np.arange(c) for c in counts])
        turn = np.lexsort((robot, when))
        return robot[turn], within[turn]

    def robot(self, index: int) -> str:
        """Robot of a sample; pictures of one scene have the same one."""
        return list(self.manifest.counts)[int(self._places[0][index // self.recipe.views])]

    @cached_property
    def _dealt(self) -> dict[str, tuple[Ints, Ints, Ints]]:
        """Of each robot, :func:`frames_of` its samples."""
        return {name: frames_of(name, count) for name, count in self.manifest.counts.items()}

    def place(self, index: int) -> Place:
        """Which frame of which recording or room a sample is."""
        within = int(self._places[1][index])
        if self.recipe.recorded:
            scene, frame, frames = self._dealt[self.robot(index)]
            k = int(scene[within])
            return Place(k, int(frame[within]), int(frames[k]))
        scenes = self.manifest.scenes
        return Place(within % scenes if scenes > 0 else 0)


def make_order(
    kind: str,
    counts: dict[str, int],
    seed: int,
    size: tuple[int, int],
    shard_size: int = SHARD_SIZE,
    emphasis: Emphasis = NO_EMPHASIS,
) -> Order:
    """A set to be made.

    Args:
        kind: ``paper-like``, ``paper-rooms``, ``wild`` or ``crops``.
        counts: samples of each robot.
        seed: everything follows from it.
        size: width, height [px].
        shard_size: samples in a shard.
        emphasis: which scenes are taken more often.

    Raises:
        UsageError: no such kind or robot, a count below 1 or of no whole number of scenes, or an
            absurd size.
    """
    recipe = find_recipe(kind)
    unknown = [name for name in counts if not is_robot_type(name)]
    if unknown:
        names = ", ".join(dict.fromkeys((*ROBOT_TYPES, *ROBOT_NAMES)))
        raise UsageError(
            f'unknown robot "{unknown[0]}"; choose from {names}, or give the path of a URDF'
        )
    if not counts or any(count < 1 for count in counts.values()):
        raise UsageError("a set needs at least one robot and one sample of each")
    odd = [c for c in counts.values() if c % recipe.views]
    if odd:
        raise UsageError(
            f"{odd[0]} samples are no whole number of scenes; {kind} has {recipe.views} pictures a "
            "scene"
        )
    if not (32 <= size[0] <= 4096 and 32 <= size[1] <= 4096):
        raise UsageError(
            f"size {size[0]}x{size[1]} is out of range; 32x32 to 4096x4096 are possible"
        )
    if not 0 <= seed < 2**63:
        raise UsageError(f"seed {seed} is out of range; 0 to 2^63 - 1 are possible")
    if not 1 <= shard_size <= 1_000_000:
        raise UsageError(f"{shard_size} samples a shard is out of range; 1 to 1000000 are possible")
    manifest = Manifest(
        kind=recipe.name,
        renderer=f"mujoco {mujoco.__version__}",
        seed=seed,
        width=size[0],
        height=size[1],
        counts=dict(counts),
        scenes=recipe.scenes,
        shard_size=shard_size,
        meshes={name: mesh_hash(name) for name in counts if name not in NO_MESHES},
        settings={"emphasis": emphasis.text()} if emphasis.bins else {},
    )
    return Order(manifest)


def counts_of(robots: list[str], count: str, kind: str) -> dict[str, int]:
    """Samples of each robot from what the command line says.

    Args:
        robots: types; empty for all of the catalogue, and in wild and crops also pictures without a
            robot and with an unknown one, a tenth of the set each.
        count: samples of each robot, or ``papers``.
        kind: of the set.

    Raises:
        UsageError: the count is neither a number above 0 nor ``papers``.
    """
    names = robots or list(KNOWN_ROBOTS)
    if count == "papers":
        lacking = [name for name in names if name not in PAPER_COUNTS]
        if lacking:
            raise UsageError(f'the papers have no count for "{lacking[0]}"; give one with --count')
        return {name: PAPER_COUNTS[name] for name in names}
    try:
        each = int(count)
    except ValueError:
        raise UsageError(f'--count "{count}": expected a number or "papers"') from None
    if each < 1:
        raise UsageError(f"--count {each}: expected at least 1")
    counts = dict.fromkeys(names, each)
    if not robots and kind in ("wild", "crops"):
        views = find_recipe(kind).views
        tenth = max(round(len(names) * each / 8 / views), 1) * views
        counts |= {NO_ROBOT: tenth, UNKNOWN_ROBOT: tenth}
    return counts

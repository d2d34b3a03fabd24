"""Which unknowns to free: those by which views gain that no similar view has told of.

The arm's independent errors are always in the model, of a size that the data tell (a rigid arm is
their limit), and so are the lenses, each held by its prior: that of a lens file is a few pixels
wide. Freedoms, the board's print and the arm's kinematics, are added one by one, the most helpful
first, while groups of similar poses that were left out are predicted better by it: on the whole by
three tenths, and in nearly all groups: what the arm does wrong looks like another print in part.
Every model that was tried is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armsight.calibration.left_out import LeftOut, left_out_errors
from armsight.calibration.noise import WHITE, exact_arm, solve_with_noise
from armsight.calibration.problem import Freedom, Priors, Problem
from armsight.calibration.solver import Solution, SolverOptions


@dataclass(frozen=True)
class Trial:
    """One model that was tried.

    Attributes:
        name: in words; freedom: what it moves.
        solution: on all views; left_out: its test; taken: whether it was better.
    """

    name: str
    freedom: Freedom
    solution: Solution
    left_out: LeftOut
    taken: bool


@dataclass(frozen=True)
class Selection:
    """All models that were tried, those taken last."""

    trials: tuple[Trial, ...]

    @property
    def best(self) -> Trial:
        """The last one taken."""
        return [t for t in self.trials if t.taken][-1]


def select_model(
    problem: Problem,
    *,
    lens: bool,
    priors: Priors | None = None,
    options: SolverOptions | None = None,
    folds: int = 5,
    gain: float = 0.3,
    progress: Callable[[str], None] | None = None,
) -> Selection:
    """Add freedoms one by one, the most helpful first, while unseen groups of views gain from them.

    Args:
        problem: with start values.
        lens: lenses are solved in every model, each held by its prior.
        priors: of the solves.
        options: of the solves.
        folds: groups for the left-out test.
        gain: a freedom must lower the left-out error by this share.
        progress: called with each model's name.
    """
    plain = Freedom(lens=lens, shape=False, white=WHITE)
    extras: dict[str, dict[str, Any]] = {"board's print": {"shape": True}}
    if problem.robot is not None:
        extras["arm's kinematics"] = {"robot": True}

    def test(names: tuple[str, ...], near: Trial | None) -> Trial:
        title = "camera and board" if not names else "+ " + ", ".join(names)
        if progress is not None:
            progress(title)
        freedom = plain
        for name in names:
            freedom = replace(freedom, **extras[name])
        start = near.solution.model.problem if near is not None else problem
        state = near.solution.state if near is not None else None
        solution, freedom = solve_with_noise(start, freedom, priors, options, state=state)
        solution, freedom = exact_arm(solution, freedom, priors, options)
        left_out = left_out_errors(
            solution.model.problem, freedom, solution, folds, priors, options
        )
        return Trial(title, freedom, solution, left_out, False)

    chosen: tuple[str, ...] = ()
    best = replace(test(chosen, None), taken=True)
    trials = [best]
    while len(chosen) < len(extras):
        more = [(name, test((*chosen, name), best)) for name in extras if name not in chosen]
        name, top = min(more, key=lambda item: item[1].left_out.mm)
        if not _better(top.left_out, best.left_out, gain):
            trials += [trial for _, trial in more]
            break
        chosen, best = (*chosen, name), replace(top, taken=True)
        trials += [best if trial is top else trial for _, trial in more]
    return Selection(tuple(trials))


def _better(new: LeftOut, old: LeftOut, gain: float) -> bool:
    """Lower on the whole, and in most groups."""
    if not new.mm < (1 - gain) * old.mm:
        return False
    a, b = np.array(new.groups), np.array(old.groups)
    return bool(np.mean(a < b) >= 0.8)


def selection_lines(selection: Selection) -> Sequence[str]:
    """The models for people, one a line."""
    return [
        f"{'*' if t is selection.best else '+' if t.taken else ' '} {t.name:40s} "
        f"seen {t.left_out.px_all:6.3f} px {t.left_out.mm_all:6.3f} mm   "
        f"left out {t.left_out.px:6.3f} px {t.left_out.mm:6.3f} mm"
        for t in selection.trials
    ]

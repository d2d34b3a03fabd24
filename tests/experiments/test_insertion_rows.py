"""The rows of plugging in: budgets are ours alone, and an ablation takes away what it says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armsight.charging.insert import Felt, Insertion, InsertOptions, Phase
from armsight.experiments import insertion
from armsight.experiments.insertion import ABLATIONS
from armsight.experiments.insertion_bench import Trial
from armsight.geometry.pose import make_pose

STIFF, BLIND = ABLATIONS["ablation_stiff_tilt_"], ABLATIONS["ablation_no_search_"]


def pressed(options: InsertOptions) -> tuple[float, list[Phase]]:
    """A plug that lies askew on a wall: how fast it turned at most, and what the law did."""
    law, turned, phases = Insertion(options), 0.0, []
    for i in range(600):
        wrench = np.array([0.0, 0.0, -10.0 if i > 30 else 0.0, 1.0 if i > 30 else 0.0, 0.0, 0.0])
        z = -options.depth + (0.0 if i > 30 else -0.01)
        answer = law.step(Felt(0.008 * i, make_pose(None, [0.0, 0.0, z]), wrench))
        turned = max(turned, float(np.linalg.norm(answer.twist[3:])))
        if not phases or phases[-1] is not answer.phase:
            phases.append(answer.phase)
    return turned, phases


def test_a_stiff_tilt_does_not_turn_and_no_search_winds_no_spiral() -> None:
    """What each ablation is without; ours has both."""
    ours, stiff, blind = (pressed(o) for o in (InsertOptions(), STIFF, BLIND))
    assert min(ours[0], blind[0]) > 0.01
    assert stiff[0] == 0.0
    search = ours[1].index(Phase.SEARCH)
    assert Phase.BACK not in ours[1][: search + 1]
    assert Phase.SEARCH in stiff[1]
    assert Phase.BACK in blind[1]


def test_budgets_hold_ours_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows of the paper and of the ablations say what they are, and no budget is on them."""
    monkeypatch.setenv("ARMSIGHT_CACHE", str(tmp_path))
    asked: list[tuple[bool, Any]] = []

    def trial(trial: Trial, paper: bool = False, options: Any = None) -> dict[str, Any]:
        asked.append((paper, options))
        good = options is None and not paper
        one = {"full": good, "said": good, "partial_as_success": False, "sunk_mm": 0.0}
        one |= {"axial_n": 80.0 if good else 200.0, "lateral_n": 20.0, "seconds": 6.0}
        return one | ({"unplugged": True, "unplug_n": 30.0} if good else {})

    monkeypatch.setattr(insertion, "run_trial", trial)
    shares: list[float] = []
    rows = {r.key: r for r in insertion.run(4, 1, lambda what, share: shares.append(share)).rows}
    assert rows["inserted"].value == 1.0
    assert rows["axial_n"].value == 80.0
    for prefix in ("paper_", *ABLATIONS):
        assert rows[f"{prefix}inserted"].value == rows[f"{prefix}near_inserted"].value == 0.0
        assert rows[f"{prefix}inserted"].must is None
        assert rows[f"{prefix}near_inserted"].n == 2
    assert rows["ablation_stiff_tilt_inserted"].n == 4
    assert rows["ablation_stiff_tilt_axial_n"].value == 200.0
    assert max(shares) < 1.0
    assert shares == sorted(shares)
    before = len(asked)
    assert before == 3 * 4 + 2 * 2 + 2 * (4 + 2)
    insertion.run(4, 1, lambda what, share: None)
    assert len(asked) == before  # everything is remembered: a long table goes on

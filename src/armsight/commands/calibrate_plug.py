"""``armsight calibrate WORKCELL --plug``: a pair and the plug calibrated by showing it the plug."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from armsight.commands.serving import Page

if TYPE_CHECKING:
    from armsight.charging.plug_procedure import PlugNews, PlugResult, PlugSetup

LOOKS = 26
"""At most, as many as the paper's."""
PATIENCE = 120.0
"""A look may take this long to be searched on a slow machine before the task is given up [s]."""


@dataclass(frozen=True)
class PlugOptions:
    """What is asked for.

    Attributes:
        out: folder for the looks and the picture; a stopped run goes on from the looks in it.
        pair: which standing pair; the first if None.
        looks: how many.
        write: whether the calibration file is changed.
        fresh: forget the looks of an earlier run.
        seed: of everything random.
        cell_is_empty: nobody was in the cell when it started: what stands there is no person.
        page: where the live page is served, or None.
    """

    out: Path
    pair: str | None
    looks: int
    write: bool
    fresh: bool
    seed: int
    cell_is_empty: bool
    page: Page | None


def calibrate_plug(workcell_name: str, options: PlugOptions) -> int:
    """Show the plug to the pair, solve, write the calibration file; the exit code.

    Args:
        workcell_name: a workcell file, or the name of a packaged cell.
        options: what is asked for.

    Raises:
        CalibrationError: the cell has no pair or no plug, or the looks cannot tell.
    """
    import numpy as np

    from armsight.charging import looks_file
    from armsight.commands.calibrating import drawn_with, result_of
    from armsight.commands.ending import EndsWhen
    from armsight.commands.running import INTERRUPTED, RunOptions, run_session
    from armsight.runtime.config import SessionConfig
    from armsight.runtime.configure import mapping_config
    from armsight.tasks.calibrate_plug import (
        CalibratePlugTask,
        plug_entries,
        plug_setup,
        without_car,
    )
    from armsight.workcell import open_cell
    from armsight.workcell.calibration_file.store import store
    from armsight.workcell.packaged import load

    original = load(workcell_name)
    workcell = without_car(original)
    log, terminal = options.out / "plug_looks.jsonl", _Terminal()
    with open_cell(workcell, options.seed, by_plug=False) as cell:
        mapping = mapping_config(workcell, cell.T_world_base, cell.robot.reach)
        setup = plug_setup(cell, mapping, options.pair, options.looks)
        about: dict[str, object] = {
            "cell": workcell.name,
            "pair": setup.pair.name,
            "plug": setup.plug,
        }
        about |= drawn_with(cell, options.seed)
        if options.fresh:
            log.unlink(missing_ok=True)
        done = looks_file.read(log, about)
        looks_file.begin(log, about)
        if done:
            print(f"going on from {len(done)} looks in {log}; --fresh starts anew")
        task = CalibratePlugTask(
            setup,
            np.random.default_rng((options.seed, len(done))),
            terminal.told,
            lambda look: looks_file.append(log, look),
            done,
        )
        session = run_session(
            cell,
            task,
            RunOptions(
                page=options.page,
                seed=options.seed,
                speed=math.inf if options.page is None else 1.0,
                observers=(EndsWhen(lambda: task.done),),
                cell_is_empty=options.cell_is_empty,
                config=SessionConfig(mapping=mapping, patience=PATIENCE),
            ),
        )
        seconds = session.now()
    result = result_of(task, session)
    if result is None:
        print(f"stopped; nothing was changed, the looks are in {log}: the same command goes on")
        return INTERRUPTED
    used = int(result.answer.used.sum())
    print(f"{used} of {setup.looks} looks used, {seconds:.0f} s of robot time")
    for line in found(setup, result):
        print(line)
    if terminal.newest is not None:
        print(f"written: {_picture(options.out, setup, result, terminal.newest)}")
    if options.write:
        stereo, plug, arm = plug_entries(original, setup, result)
        file = store(original, (), arm, stereo=(stereo,), plug=plug)
        print(f"{file}: {stereo.name}, plug{', arm' if arm is not None else ''} calibrated")
        log.unlink(missing_ok=True)  # they have told what they had to tell
    return 0


def found(setup: PlugSetup, result: PlugResult) -> list[str]:
    """What was found, for people."""
    import numpy as np

    from armsight.geometry.pose import angle_between

    answer, tool = result.answer, setup.robot.tool
    assert tool is not None
    sigma = np.sqrt(np.diagonal(answer.covariance))
    out = []
    for what, old, new, first in (
        (f"pair {setup.pair.name}", setup.pair.T_mount_camera, answer.T_base_camera, 0),
        (f"plug {setup.plug}", tool.T_flange_tcp, answer.T_flange_plug, 6),
    ):
        moved = 1e3 * float(np.linalg.norm(new[:3, 3] - old[:3, 3]))
        turned = float(np.rad2deg(angle_between(old, new)))
        place, turn = sigma[first : first + 3].max(), sigma[first + 3 : first + 6].max()
        out.append(
            f"{what}: {moved:.1f} mm, {turned:.2f} deg from where it was declared; sigma "
            f"{1e3 * place:.2f} mm, {np.rad2deg(turn):.3f} deg"
        )
    used = answer.residual[answer.used]
    mm = 1e3 * float(np.sqrt(np.mean(np.sum(used[:, :3] ** 2, axis=1))))
    deg = float(np.rad2deg(np.sqrt(np.mean(np.sum(used[:, 3:] ** 2, axis=1)))))
    out.append(
        f"looks agree to {mm:.2f} mm and {deg:.2f} deg (rms); tip to {1e3 * result.sigma:.2f} mm"
    )
    for why in sorted(set(result.dropped)):
        out.append(f"{result.dropped.count(why)} looks not used: {why}")
    return out


def _picture(folder: Path, setup: PlugSetup, result: PlugResult, news: PlugNews) -> Path:
    """The newest look with the arm as calibrated drawn over it."""
    import cv2

    from armsight.tasks.plug_picture import over_arm
    from armsight.writing import write_atomically

    assert news.picture is not None
    image = over_arm(news.picture, setup.pair.left, setup.robot, news.joints, result.answer)
    file = folder / "plug.png"
    write_atomically(file, cv2.imencode(".png", image[..., ::-1])[1].tobytes())
    return file


class _Terminal:
    """A line a look; keeps the newest with a picture."""

    def __init__(self) -> None:
        self.newest: PlugNews | None = None

    def told(self, news: PlugNews) -> None:
        from armsight.commands.running import say

        if news.picture is not None and news.seen is not None:
            self.newest = news
        words = news.problem or (f"seen, score {news.seen.score:.2f}" if news.seen else "")
        say(f"look {news.done} of {news.of}: {words}")

"""Third stage, ours: view after view the most useful one, until the goal is reached."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from armsight.calibration.calibrate import Calibration
from armsight.calibration.live.log import Log, go, look, report, solve_now
from armsight.calibration.live.seen import Request, SeenView
from armsight.calibration.views import choose, information, propose, target_weight, travel_seconds

STARTING = 0.2
"""What a move takes beside its travel: it is planned, and the arm comes to rest [s]."""


def learn(
    log: Log, answer: Calibration, rng: np.random.Generator, began: float
) -> Generator[Request, object, str]:
    """View after view, each the most useful one, until the goal (ours)."""
    setup, options = log.setup, log.options
    since, failures, checked = 0, 0, 0
    solution = answer.solution
    S = solution.normal.reduced()
    W = target_weight(solution, solution.normal.free)
    best_before = np.inf
    while True:
        if since >= 3 or (since >= 1 and len(log.views) < 18):
            answer = solve_now(log, rng)
            solution = answer.solution
            S = solution.normal.reduced()
            W = target_weight(solution, solution.normal.free)
            since = 0
            report(log, "learning", answer)
            worst = max(answer.target_sigma(k) for k in range(len(answer.problem.lenses)))
            if len(log.views) >= options.least_views:
                if worst < options.goal:
                    return f"the goal is reached: {1e3 * worst:.2f} mm"
                if len(log.views) >= checked + 3:
                    if worst > (1 - options.patience) * best_before:
                        return f"further views teach little: {1e3 * worst:.2f} mm"
                    best_before, checked = worst, len(log.views)
        if len(log.views) >= options.most_views:
            return f"{len(log.views)} views are enough"
        if log.clock() - began > options.seconds:
            return "the time is spent"
        margin = _margin(answer)
        offers = propose(
            answer.problem,
            solution.state,
            setup.robot,
            rng,
            options.candidates,
            setup.free,
            near=log.at,
            margin=margin,
        )
        if not len(offers):
            return "no further view can be reached"
        looks = information(
            answer.problem,
            solution.state,
            answer.freedom,
            setup.robot,
            offers,
            margin=margin,
            sigma=answer.corner_sigma(),
        )
        here = log.at if log.at is not None else setup.robot.home
        fixed = STARTING + options.rest + options.frames * setup.frame_seconds
        seconds = travel_seconds(setup.robot, here, offers, setup.speed, setup.acceleration) + fixed
        # The best view may lie behind something: then the next best that can be reached straight.
        left = np.arange(len(offers))
        choice, gone = None, False
        while len(left) and not gone:
            choice = choose(S, W, looks.only(left), seconds[left])
            gone = yield from go(log, offers[left[choice.index]], "learn")
            if not gone:
                left = np.delete(left, choice.index)
        if choice is None or not gone:
            failures += 1
            if failures > 5:
                return "no further view can be reached"
            continue
        taken = int(left[choice.index])
        before = len(log.views)
        view = yield from look(log, "learn")
        if len(log.views) == before:
            failures += 1
            if failures > 8:
                return f"the board is not seen where it should be ({_main_reason(view)})"
            continue
        S = S + looks.information[taken]
        since += 1


def _main_reason(view: SeenView) -> str:
    reasons = [reason for _, reason in view.missed]
    return max(set(reasons), key=reasons.count) if reasons else "no camera"


def _margin(answer: Calibration) -> float:
    """Three sigma of where the board will be in the worst lens, and 8 px [px]."""
    worst = 0.0
    for lens in range(len(answer.problem.lenses)):
        f = answer.problem.lenses[lens].camera.fx
        worst = max(worst, 3 * answer.target_sigma(lens) * f)
    return 8.0 + min(worst, 60.0)

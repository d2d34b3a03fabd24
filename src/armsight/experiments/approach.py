"""``approach``: people reach in at up to 2 m/s, and a search tries to force a contact."""

from __future__ import annotations

from armsight.experiments.approach_episode import empty, episode
from armsight.experiments.approach_people import SECONDS
from armsight.experiments.approach_plots import plot_course, plot_distances
from armsight.experiments.approach_rows import above_row, contact_rows, over_rows
from armsight.experiments.approach_use import use_rows
from armsight.experiments.episodes import find_clips, run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.hand_search import from_above, search
from armsight.experiments.reach_over import reach_over

SEARCH_SHARE, EMPTY_SHARE = 50, 20
"""One search, and one episode with nobody there, for so many episodes."""

ABOUT = """
Each episode is four seconds of patrol without rests in the packaged cell `ur5_four_cameras`, with
rendered depth, sensor noise, delays and calibration errors. In half of them somebody is near from
the start: half of those play a recorded clip, faster or slower, mirrored and placed at random
around the arm; the others play a built-in script (without the recordings, all do). In the other
half nobody is near at first, and somebody walks up to reach in. In every second one of each the
right hand leaves that motion at a random time and goes straight at a part of the arm, at full speed
from the first instant; half of these hands follow the arm, the others keep to where it was heading.
Hands are capped at 1.6 and 2.0 m/s in turn. A contact counts when the touching part of the arm
moved faster than 0.05 m/s.

The search looks for start, aim, timing and lead of a hand at full speed (both caps) that comes
nearest to a part of the arm that moves, by the cross-entropy method, in a cell without pictures but
with the same delays. It tries to break the guard, so its hands run after the arm as no recorded
person does. (Until November 2026 it counted a hand in a part that stood while another part still
moved, such as one in the upper arm while the wrist came to rest at 0.06 m/s.)
A second search has people who stand, with an arm up, lean or step over the mapped box, above which
no camera looks (`over_contacts`): shoulder, elbow, swivel, aim and timing are its genes. Four dozen
hands without anybody come at random from up there: what the proof takes for granted, broken
(`above_contacts`).

What the arm is good for stands beside it: how often it never moved; how much of the time it moved
while somebody was within 1.5 m and S_p would have allowed it with a reaction time of 0.1 s; its
goals against the same cell with nobody in it, and against two baselines with the same proof, a
monitor that slows by distance alone and a scanner's zone that stops, both counted in their favour
from the same people's true distances (`approach_use.py`).
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` episodes, and a fiftieth as many searches."""
    searches = max(2, runs // SEARCH_SHARE)

    def first(stage: str, done: float) -> None:
        progress(stage, 0.9 * done)

    def second(stage: str, done: float) -> None:
        progress(stage, 0.9 + 0.05 * done)

    def third(stage: str, done: float) -> None:
        progress(stage, 0.95 + 0.05 * done)

    part = {"clips": len(find_clips())}
    episodes = run_episodes("approach", episode, range(runs), seed, first, part)
    hunts = run_episodes("approach-search", search, range(searches), seed, second)
    over = run_episodes("approach-over", reach_over, range(searches), seed, second)
    above = run_episodes("approach-above", from_above, range(4), seed, second)
    alone = max(2, runs // EMPTY_SHARE)
    nobody = run_episodes("approach-empty", empty, range(alone), seed, third, part)
    notes = [
        f"Contact in episode {k} (cap {e['cap']} m/s, {e['how']}): "
        f"time [s], link, arm speed [m/s], part: {e['worst']}."
        for k, e in enumerate(episodes)
        if e["contacts"]
    ]
    if not find_clips():
        notes.append("The recorded clips were not there: all episodes play scripts.")
    return Outcome(
        (
            *contact_rows(episodes, hunts),
            *over_rows(over),
            above_row(above),
            *use_rows(episodes, nobody, 60.0 / SECONDS),
        ),
        {"distances": lambda: plot_distances(episodes), "course": lambda: plot_course(episodes)},
        tuple(notes),
    )


EXPERIMENT = Experiment(
    name="approach",
    title="People reach in at up to 2 m/s; a search tries to force a contact",
    run=run,
    runs=1000,
    about=ABOUT,
)

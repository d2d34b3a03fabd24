"""Write the README's table of figures from what is published in docs/results; --check only looks.

Each row names one row of one experiment, so that no figure in the README is older than its page.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- figures: scripts/readme_figures.py -->", "<!-- end of figures -->"


@dataclass(frozen=True)
class Figure:
    """A line of the table: what it says, and which row of which experiment it says it of."""

    what: str
    experiment: str
    key: str
    condition: str
    form: str = "{:.3g}"


FIGURES = (
    Figure("four cameras calibrated from cold, error of a point 1 to 1.5 m away",
           "calibration-eye-to-hand", "tre_mm",
           "ours from cold, rendered, lenses solved too; colour lenses", "{:.1f} mm"),
    Figure("robot time for that", "calibration-eye-to-hand", "robot_time_s",
           "ours from cold, rendered, lenses solved too", "{:.0f} s"),
    Figure("a set that others recorded (ABB arm, 15 images), corners of left-out images",
           "calibration-real", "ros_left_out_mm",
           "ChArUco, ABB arm, 15 images, + board's print", "{:.1f} mm"),
    Figure("contacts of a moving arm with people who reach in at up to 2 m/s", "approach",
           "contacts", "all episodes", "{:.0f}"),
    Figure("goals a minute although they come", "approach", "goals_per_minute", "all episodes",
           "{:.1f}"),
    Figure("goals a minute beside a box on the table, over an empty cell's", "things",
           "box_goals_share", "all kinds", "{:.2f}"),
    Figure("MotionBenchMaker's problems solved, seen through depth pictures", "mbm", "mbm_solved",
           "both, unseen is solid", "{:.2f}"),
    Figure("time for A-B-A around an obstacle that moves, over the direct one", "patrol",
           "patrol_ratio", "3 ours, moving", "{:.2f}"),
    Figure("a ball at rest touched", "servo-ball", "ball_success",
           "at rest, speed 1, acceleration 1", "{:.2f}"),
    Figure("a ball that wanders at up to 0.4 m/s touched", "servo-ball", "ball_success",
           "moving at up to 0.1-0.4 m/s, speed 1, acceleration 1", "{:.2f}"),
    Figure("distance from a bulls-eye's centre", "servo-bullseye", "bullseye_mm",
           "ours, speed 1, acceleration 1", "{:.1f} mm"),
    Figure("an item laid on a palm, in the gripper from the start", "servo-handover",
           "handover_success", "ours, speed 1, acceleration 1", "{:.2f}"),
    Figure("charging ports found in a pair of pictures", "port-detection", "recall", "all",
           "{:.2f}"),
    Figure("cars plugged in, fully", "charging", "seated", "pictures searched, contact physics",
           "{:.2f}"),
    Figure("from stand-by to that", "charging", "cycle_s", "pictures searched, contact physics",
           "{:.0f} s"),
    Figure("a camera placed by its own arm, by depth, one view", "own-arm", "own_depth_mm",
           "old pose 50 mm, 5 deg off; 1 view", "{:.1f} mm"),
    Figure("joints of any arm in one picture of an unknown room, median (100 mm are wanted)",
           "any-arm", "joint_median_mm",
           "second renderer, 640 x 480, base at 1.2 to 2.5 m, box not given", "{:.0f} mm"),
)  # fmt: skip


def row_of(figure: Figure) -> dict[str, Any]:
    """The published row; raises KeyError where there is none, or more than one."""
    page = json.loads((ROOT / "docs/results" / f"{figure.experiment}.json").read_text())
    named = (figure.key, figure.condition)
    rows: list[dict[str, Any]] = [r for r in page["rows"] if (r["key"], r["condition"]) == named]
    if len(rows) != 1:
        raise KeyError(f"{figure.experiment}: {len(rows)} rows {figure.key} | {figure.condition}")
    return rows[0]


def table() -> str:
    """The table as Markdown."""
    lines = ["| | ours | papers | n |", "|---|---:|---:|---:|"]
    for figure in FIGURES:
        row = row_of(figure)
        paper = "" if row["paper"] is None else figure.form.format(row["paper"])
        page = f"[{figure.form.format(row['value'])}](docs/results/{figure.experiment}.md)"
        lines.append(f"| {figure.what} | {page} | {paper} | {row['n']} |")
    return "\n".join(lines)


def main() -> int:
    """Write the table into README.md, or say whether it is the one of now."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if it is old")
    check = parser.parse_args().check
    readme = ROOT / "README.md"
    text = readme.read_text()
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    new = f"{before}{BEGIN}\n{table()}\n{END}{after}"
    if check:
        return int(new != text)
    readme.write_text(new)
    return 0


if __name__ == "__main__":
    sys.exit(main())

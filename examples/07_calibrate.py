"""Finds cameras, lenses and board from corners seen at some arm poses, and says how sure it is.

Here the corners come from a synthetic cell, so the answer can be compared with the truth.

python examples/07_calibrate.py [VIEWS]
"""

import sys

import numpy as np

from armsight import load_robot
from armsight.calibration.calibrate import calibrate
from armsight.calibration.synthetic import make_cell, observe, random_views, target_error


def main(views: int) -> None:
    rng = np.random.default_rng(0)
    cell = make_cell(load_robot("ur5"), rng)  # three cameras with colour and infrared lenses
    problem = observe(cell, random_views(cell, views, rng), rng)
    print(f"{len(problem.views)} poses of the arm, {len(problem.sightings)} boards seen")
    answer = calibrate(problem, rng)
    for k, lens in enumerate(answer.problem.lenses):
        wrong = 1e3 * target_error(cell, answer.solution.state, k)
        sure = 1e3 * answer.target_sigma(k)
        print(f"{lens.name:16} points 1 to 1.5 m away: {wrong:.1f} mm off, {sure:.1f} mm expected")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 25)

"""``python -m armsight.recognition.training``: train where only torch and numpy are.

The same as ``armsight train`` and ``armsight transfer``, without what those need of armsight.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from armsight.errors import ArmsightError


def main(words: Sequence[str] | None = None) -> int:
    """Train; 0 when finished or stopped by the time, 1 on an error."""
    parser = argparse.ArgumentParser("python -m armsight.recognition.training", description=__doc__)
    parser.add_argument("config", help="name or file of a configuration")
    parser.add_argument("--data", type=Path, required=True, help="folder of a packed set")
    parser.add_argument("--out", type=Path, required=True, help="folder for what is written")
    parser.add_argument("--from", dest="start", type=Path, help="weights that a transfer begins at")
    parser.add_argument("--minutes", type=float, default=math.inf, help="then stop; go on later")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda")
    parser.add_argument("--seed", type=int, help="instead of the configuration's")
    parser.add_argument("--samples", type=int, help="of each robot, at most")
    parser.add_argument("--threads", type=int, default=0, help="of the CPU; 0 for torch's choice")
    parser.add_argument("--half", action="store_true", help="ONNX with half-precision dense layers")
    asked = parser.parse_args(words)
    from armsight.recognition.training import entry

    try:
        entry.check_machine(asked.minutes, asked.threads)
        entry.need_torch()
        from armsight.recognition.training.run import Wanted, train, transfer

        config = entry.read(asked.config, asked.seed, asked.samples)
        data = entry.packed(asked.data, config)
        wanted = Wanted(asked.out, asked.minutes, asked.device, asked.half, asked.threads)
        if asked.start is None:
            train(config, data, wanted, entry.say)
        else:
            transfer(config, data, asked.start, wanted, entry.say)
    except ArmsightError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())

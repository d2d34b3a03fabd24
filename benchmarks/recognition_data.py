"""Labelled frames a second that ``armsight dataset generate`` draws, by CPU time and by the clock.

512 x 424 (crops: 160 x 160), full randomisation, all robots in turn, JPEG and PNG included; nothing
is written to disk but in the last lines, which time the whole command's work with two processes.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from armsight.recognition.data.crews import Processes, draw_batch
from armsight.recognition.data.generate import generate
from armsight.recognition.data.order import counts_of, make_order
from armsight.simulation.gl import check_opengl
from common import Report, measure

SIZE = (512, 424)


def main() -> None:
    """Measure everything."""
    report = Report("recognition_data", __doc__)
    renderer = check_opengl()
    rounds = report.rounds(150)
    for kind in ("wild", "paper-like"):
        order = make_order(kind, counts_of([], "1000", kind), 900, SIZE)
        indices = iter(range(rounds + 10))
        timing = measure(
            lambda order=order, indices=indices: draw_batch(order, [next(indices)]),
            rounds=rounds,
            warmup=10,
        )
        bounds = {"must": ">= 8", "aim": ">= 14"} if kind == "wild" else {}
        report.add(
            f"{kind}_per_s_two_cores_by_cpu_time",
            2.0 / timing.cpu_per_round,
            "1/s",
            note=f"{renderer}; {1e3 * timing.cpu_per_round:.0f} ms CPU a frame, one thread",
            **bounds,
        )
        report.add(
            f"{kind}_one_frame", 1e3 * timing.median, "ms", spread=timing.spread_ms, note="by clock"
        )
    order = make_order("crops", counts_of([], "1000", "crops"), 900, (160, 160))
    views = order.recipe.views
    scenes = iter(range(rounds + 10))

    def scene() -> None:
        first = views * next(scenes)
        draw_batch(order, range(first, first + views))

    timing = measure(scene, rounds=rounds // views, warmup=2)
    report.add(
        "render_per_s",
        2.0 * views / timing.cpu_per_round,
        "1/s",
        note=f"crops, by CPU time; {1e3 * timing.cpu_per_round / views:.0f} ms CPU a crop",
        must=">= 12",
        aim=">= 20",
    )
    with tempfile.TemporaryDirectory() as folder:
        count = str(report.rounds(40))
        order = make_order("wild", counts_of([], count, "wild"), 901, SIZE)
        crew = Processes(2)
        list(crew.draw(order, [[0], [1], [2], [3]]))  # both have opened OpenGL
        start = time.perf_counter()
        generate(order, Path(folder) / "set", crew)
        took = time.perf_counter() - start
        crew.close()
    report.add(
        "wild_per_s_two_processes",
        order.manifest.count / took,
        "1/s",
        must=">= 8",
        aim=">= 14",
        note=f"{order.manifest.count} frames written, by clock",
    )
    report.finish()


if __name__ == "__main__":
    main()

"""``armsight dataset``."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from armsight.recognition.data.crews import Crew


@dataclass(frozen=True)
class Generate:
    """Render a set of labelled pictures; begun again, it goes on where it stopped.

    Example: armsight dataset generate --set paper-like --count papers --out paper_like

    Attributes:
        out: folder of the set.
        robots: of the catalogue, none (no robot) or unknown (a made-up arm); all of the catalogue
            if left out, and in wild and crops a tenth of none and of unknown each.
        set: paper-like (the papers' recordings: Kinect v2, 1.2-2.5 m, few rooms, a camera that
            stands), paper-rooms (the same with a room a picture) or wild (any camera, any room),
            crops (of wild scenes, several a scene, cut to the arm).
        count: pictures of each robot, or "papers" for theirs.
        seed: everything in the set follows from it.
        size: of the pictures.
        workers: processes; one a core if left out.
        shard: pictures that are finished at once.
        emphasis: file with weights of bins of distance, elevation_deg, fov_deg, share or seen: more
            pictures where a network errs.
        ray: address of a Ray cluster that draws instead, such as auto or 10.0.0.1:6379.
    """

    out: Path
    robots: tuple[str, ...] = ()
    set: Literal["paper-like", "paper-rooms", "wild", "crops"] = "wild"
    count: str = "1000"
    seed: int = 0
    size: str = "512x424"
    workers: int | None = None
    shard: int = 1000
    emphasis: Path | None = None
    ray: str | None = None

    def run(self) -> int:
        """Make the set."""
        import time

        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        from armsight.recognition.data.emphasis import NO_EMPHASIS, read_emphasis
        from armsight.recognition.data.generate import generate
        from armsight.recognition.data.order import counts_of, make_order

        counts = counts_of(list(self.robots), self.count, self.set)
        emphasis = NO_EMPHASIS if self.emphasis is None else read_emphasis(self.emphasis)
        size = parse_size(self.size)
        order = make_order(self.set, counts, self.seed, size, self.shard, emphasis)
        crew = self._crew()
        began = time.perf_counter()
        columns = (
            TextColumn("pictures"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        try:
            with Bar(*columns) as bar:
                task = bar.add_task("", total=order.manifest.count)
                drawn = generate(
                    order,
                    self.out,
                    crew,
                    lambda done, total: bar.update(task, completed=done, total=total),
                )
        finally:
            crew.close()
        took = time.perf_counter() - began
        rate = f", {drawn / took:.1f} a second" if drawn else ", all were there"
        print(f"{self.out}: {order.manifest.count} pictures, {drawn} drawn now{rate}")
        return 0

    def _crew(self) -> Crew:
        from armsight.errors import UsageError
        from armsight.recognition.data.crews import Alone, Processes, RayCluster

        if self.ray is not None:
            return RayCluster(self.ray)
        workers = self.workers if self.workers is not None else (os.cpu_count() or 1)
        if not 1 <= workers <= 1024:
            raise UsageError(f"--workers {workers}: expected 1 to 1024")
        return Alone() if workers == 1 else Processes(workers)


@dataclass(frozen=True)
class Show:
    """Draw mask, skeleton and key points over samples of a set, as one picture.

    Example: armsight dataset show paper_like --out samples.png

    Attributes:
        folder: of the set.
        out: picture to write (.png or .jpg).
        count: samples to show, spread over the set.
        columns: of the picture.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    out: Path
    count: int = 12
    columns: int = 4

    def run(self) -> int:
        """Draw and write the picture."""
        from armsight.recognition.data.labelled_set import LabelledSet
        from armsight.recognition.data.showing import show, write_picture

        samples = LabelledSet.open(self.folder, partial=True)
        write_picture(self.out, show(samples, self.count, self.columns))
        print(f"{self.out}: {min(self.count, len(samples))} of {len(samples)} samples")
        return 0


@dataclass(frozen=True)
class CheckSet:
    """Find damage in a set and print what is in it.

    Example: armsight dataset check paper_like

    Attributes:
        folder: of the set.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]

    def run(self) -> int:
        """Read every sample; 1 if any is damaged."""
        from armsight.recognition.data.checking import check, statistics_table
        from armsight.recognition.data.manifest import read_manifest

        report = check(self.folder)
        manifest = read_manifest(self.folder)
        print(
            f"{self.folder}: {manifest.kind}, {manifest.renderer}, seed {manifest.seed}, "
            f"{manifest.width}x{manifest.height}, {report.read} of {manifest.count} samples read"
        )
        from rich.console import Console

        width = 32 + 24 * max(len(report.values), 1)  # also where no terminal says its own
        Console(width=width).print(statistics_table(report))
        for problem in report.problems[:20]:
            print(problem)
        if len(report.problems) > 20:
            print(f"... and {len(report.problems) - 20} more")
        print("no damage" if not report.problems else f"{len(report.problems)} problems")
        return 1 if report.problems else 0


@dataclass(frozen=True)
class Dataset:
    """Make, show and check sets of labelled pictures of robot arms.

    Example: armsight dataset generate --set wild --count 1000 --out wild
    """

    action: (
        Annotated[Generate, tyro.conf.subcommand("generate")]
        | Annotated[Show, tyro.conf.subcommand("show")]
        | Annotated[CheckSet, tyro.conf.subcommand("check")]
    )

    def run(self) -> int:
        """Run the action."""
        return self.action.run()


def parse_size(text: str) -> tuple[int, int]:
    """Width and height of ``WIDTHxHEIGHT``.

    Raises:
        UsageError: it is not of that form.
    """
    from armsight.errors import UsageError

    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise UsageError(f'--size "{text}": expected WIDTHxHEIGHT, such as 512x424')
    return int(width), int(height)

"""Draws ``docs/images/mapping.png``: one slice of a snapshot, states and distance field.

    python scripts/draw_map.py [FILE]

The packaged UR5 cell, four simulated Kinect v2 with their errors, a person who reaches in.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from armsight.devices.history import JointHistory
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.mapping.workspace_map import WorkspaceMap
from armsight.runtime.configure import mapping_config
from armsight.workcell import load_workcell, open_cell
from armsight.workcell.packaged import packaged

UNTIL = 6.3
"""The person's hand is in the cell then [s]."""
HEIGHT = 0.27
"""Of the slice above the robot's base [m]."""
COLORS = ("#8a8f98", "#eef5ee", "#c8452f", "#b9c4e0")
NAMES = ("unknown", "free", "occupied", "enclosed")


def watch() -> WorkspaceSnapshot:
    """The snapshot of the cell after some seconds."""
    workcell = load_workcell(packaged()["ur5_four_cameras"])
    with open_cell(workcell, seed=1000) as cell:
        assert cell.world is not None
        config = mapping_config(workcell, cell.T_world_base, cell.robot.reach)
        infos = [camera.info for camera in cell.cameras]
        world = WorkspaceMap(cell.robot, infos, cell.static, config)
        history = JointHistory()
        for now in np.arange(0.004, UNTIL, 0.004):
            cell.world.advance(float(now))
            state = cell.arm.read()
            if state is not None:
                history.add(state)
            frames = [f for f in (camera.read() for camera in cell.cameras) if f is not None]
            if frames:
                snapshot = world.update(frames, history, float(now))
        world.close()
    return snapshot


def draw(snapshot: WorkspaceSnapshot, file: Path) -> None:
    """States on the left, distances with the hazards on the right."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    grid = snapshot.grid
    k = int(grid.index(np.array([[0.0, 0.0, HEIGHT]]))[0, 2])
    low, high = np.asarray(grid.origin), grid.origin + np.asarray(grid.shape) * grid.voxel
    extent = (low[0], high[0], low[1], high[1])
    figure, axes = plt.subplots(1, 2, figsize=(12, 5.2))
    axes[0].imshow(
        snapshot.state[:, :, k].T,
        origin="lower",
        extent=extent,
        cmap=ListedColormap(COLORS),
        vmin=-0.5,
        vmax=3.5,
        interpolation="nearest",
    )
    axes[0].legend(
        handles=[Patch(color=c, label=n) for c, n in zip(COLORS, NAMES)], loc="upper left"
    )
    axes[0].set_title(f"states {HEIGHT} m above the base")
    image = axes[1].imshow(
        snapshot.distance[:, :, k].T,
        origin="lower",
        extent=extent,
        cmap="viridis",
        interpolation="nearest",
    )
    figure.colorbar(image, ax=axes[1], label="distance to what is solid, m (saturates)")
    layer = np.abs(snapshot.hazards[:, 2] - low[2] - (k + 0.5) * grid.voxel) < 0.01
    for unseen, color, name in ((False, "#ff3b1f", "person seen"), (True, "w", "unseen person?")):
        points = snapshot.hazards[layer & (snapshot.hazard_unknown == unseen)]
        axes[1].plot(points[:, 0], points[:, 1], ".", ms=2, color=color, label=name)
    axes[1].legend(loc="upper left", facecolor="#555", labelcolor="w", markerscale=4)
    axes[1].set(title="distance field and hazards", xlim=extent[:2], ylim=extent[2:])
    for axis in axes:
        axis.set(xlabel="x, m", ylabel="y, m")
    figure.tight_layout()
    figure.savefig(file, dpi=90, metadata={"Software": None})


if __name__ == "__main__":
    target = sys.argv[1] if len(sys.argv) > 1 else "docs/images/mapping.png"
    draw(watch(), Path(target))

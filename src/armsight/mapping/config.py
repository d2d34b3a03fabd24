"""What the map is told about its cell: one frozen record, every default explained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.errors import UsageError


@dataclass(frozen=True)
class MappingConfig:
    """Settings of :class:`~armsight.mapping.workspace_map.WorkspaceMap`; defaults suit a UR5 cell.

    Attributes:
        lower, upper: corners of the fine map in ``base`` [m]. Should hold all that the arm can
            reach, and exclude what nobody cares about (below the table, above the ceiling).
        voxel: edge of a fine voxel [m].
        far_lower, far_upper: how far the coarse layer goes beyond the fine map's corners [m];
            people are seen coming there. All 0 switch it off.
        far_parts: edge of a coarse voxel in fine ones (T2: coarser out of reach).
        distance_cap: where the distance field saturates [m]; at most 15 voxels.
        unknown_is_solid: the distance field keeps away from unseen space as well.
        unseen_is_empty: somebody has made sure that nobody is in the cell: what no camera sees is
            free, and only what was seen there counts. For calibration, never beside people.
        crop: radius about the base beyond which points are left out of the snapshot's cloud [m]
            (T2). They are hazards all the same.
        stale_after: a camera is not alive once its newest frame is older than this [s], or than
            its declared latency and two and a half of its periods, whichever is more.
        future: a stamp may be this far ahead of the clock [s] (clocks are never exact).
        stamp_error: greatest error of a depth stamp against the joints' stamps [s].
        min_returns: a frame with a smaller share of valid pixels is refused as empty.
        self_margin: the arm's skin: points this close to a link's surface are the arm [m] (T2).
        sigmas: how many standard deviations of depth noise count as possible.
        calibration_m, calibration_rad: greatest believable error of a camera's pose.
        aligned_m, aligned_rad: the same after fine alignment against arm and declared solids.
        align: refine each camera's pose by ICP at the start and when it seems to have moved.
        greatest_shift, greatest_turn: a camera that alignment finds farther than this from its
            declared pose must be calibrated again [m], [rad].
        support: of a pixel's 8 neighbours, how many must lie at a like depth; pixels with fewer
            are taken for flying pixels: they neither occupy nor free anything.
        strong_share: a voxel hit by at least this share of the pixels that would see one of its
            faces is occupied at once; fewer hits need a second frame within ``weak_window``.
        cluster, far_cluster: an occupied voxel with fewer occupied ones among its 26 neighbours
            is avoided but not taken for a part of a person; in the fine and in the coarse layer.
        weak_window: seconds in which two weak sightings count as one strong [s].
        hold: a voxel that one camera has hit is not cleared by another before this time [s].
        person_speed: how fast someone unseen may move through unseen space [m/s].
        hand: edge of the smallest cube that counts as room for a person [m].
        reach: how far from where somebody reaches out of the top of the map a part of them may be
            above it [m]: an arm's length, as ISO 13855 counts it, or what is left of 2.7 m from
            foot to finger where that is more (ISO 13857). 0 where nobody is above the map.
        up: away from the floor, in ``base``; its longest component tells the top of the map.
        static_margin: points this close to a declared solid are that solid [m], besides noise and
            calibration.
        threads: cameras worked on at the same time.
    """

    lower: tuple[float, float, float] = (-1.3, -1.3, -0.2)
    upper: tuple[float, float, float] = (1.3, 1.3, 1.4)
    voxel: float = 0.02
    far_lower: tuple[float, float, float] = (1.2, 1.2, 0.0)
    far_upper: tuple[float, float, float] = (1.2, 1.2, 0.0)
    far_parts: int = 3
    distance_cap: float = 0.3
    unknown_is_solid: bool = False
    unseen_is_empty: bool = False
    crop: float = 1.5
    stale_after: float = 0.1
    future: float = 0.01
    stamp_error: float = 0.005
    min_returns: float = 0.002
    self_margin: float = 0.005
    sigmas: float = 3.0
    calibration_m: float = 0.005
    calibration_rad: float = 0.00873
    aligned_m: float = 0.003
    aligned_rad: float = 0.002
    align: bool = True
    greatest_shift: float = 0.1
    greatest_turn: float = 0.06
    support: int = 3
    strong_share: float = 0.15
    cluster: int = 2
    far_cluster: int = 1
    weak_window: float = 0.15
    hold: float = 0.06
    person_speed: float = 2.0
    hand: float = 0.08
    reach: float = 0.85
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    static_margin: float = 0.01
    threads: int = 2

    @property
    def has_far_layer(self) -> bool:
        """Whether there is a coarse layer around the fine one."""
        return any(margin > 0 for margin in (*self.far_lower, *self.far_upper))

    def __post_init__(self) -> None:
        """Refuse what cannot be meant.

        Raises:
            UsageError: a value is out of its range; the message names it.
        """
        for name, value in vars(self).items():
            if not np.isfinite(value).all():
                raise UsageError(f"mapping.{name} is {value}; expected a finite number")
            if isinstance(value, int | float) and value < 0.0:
                raise UsageError(f"mapping.{name} is {value}; expected no less than 0")
        if not any(self.up):
            raise UsageError("mapping.up is 0; expected the direction away from the floor")
        if not 0.005 <= self.voxel <= 0.2:
            raise UsageError(f"mapping.voxel is {self.voxel} m; expected 0.005 to 0.2 m")
        if any(high - low < 4 * self.voxel for low, high in zip(self.lower, self.upper)):
            raise UsageError(
                f"mapping bounds {self.lower} to {self.upper} m: each upper value must exceed its "
                "lower one by at least four voxels"
            )
        count = 1.0
        for low, high in zip(self.lower, self.upper):
            count *= (high - low) / self.voxel
        if count > 6e7:
            raise UsageError(
                f"mapping bounds at {self.voxel} m make {count / 1e6:.0f} million voxels; "
                "use larger voxels or closer bounds (at most 60 million)"
            )
        if min(*self.far_lower, *self.far_upper) < 0.0:
            raise UsageError(
                f"mapping.far_lower {self.far_lower} and far_upper {self.far_upper} m must not be "
                "negative: they say how far the coarse layer goes beyond the map"
            )
        if not 1 <= self.far_parts <= 8:
            raise UsageError(f"mapping.far_parts is {self.far_parts}; expected 1 to 8 fine voxels")
        if not 0.0 <= self.reach <= 3.0:
            raise UsageError(f"mapping.reach is {self.reach} m; expected 0 to 3 m")
        if not 2 * self.voxel <= self.distance_cap <= 15 * self.voxel + 1e-9:
            raise UsageError(
                f"mapping.distance_cap is {self.distance_cap} m; expected 2 to 15 voxels "
                f"({2 * self.voxel:g} to {15 * self.voxel:g} m)"
            )

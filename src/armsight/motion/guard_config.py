"""What the guard is told about its cell: one frozen record, every default explained."""

from __future__ import annotations

from dataclasses import dataclass, field

from armsight.errors import UsageError
from armsight.motion.risk import PaperRisk
from armsight.motion.separation import Separation


@dataclass(frozen=True)
class GuardConfig:
    """Settings of :class:`~armsight.motion.guard.Guard`; defaults suit T2's cell.

    Attributes:
        period: nominal time between ticks [s].
        start_delay: command to first motion [s] (T2: 50-70 ms), counted in T_r and in tracking.
        compute_latency: of map and guard together, for the declared reaction time [s].
        speed, acceleration: share of the joint limits that the controller allows (T2: 0.5, 0.6).
        task_speed: share of that speed which tasks may use.
        brake: share of the joints' acceleration limits with which the arm stops.
        separation: constants of the protective distance.
        reaction_window: a measured reaction time counts for this long [s].
        retreat_speed: a part may always move away while no point of the arm is faster than this
            [m/s]; faster only if it could stand still before anybody reaches it. An arm below
            0.05 m/s counts as standing.
        headroom: share of speed and twice that of acceleration which planned motions leave to the
            position correction; a motion at the drives' limits could not be followed exactly.
        rise, rise_jerk: how fast the speed scale may rise [1/s], and that rate itself [1/s^2].
        gain: of the position correction while following [1/s].
        off_path: distance from the path at which it is given up and planned anew [rad].
        stale_after: image age at which the arm slows down and stops [s]; never less than a
            camera's declared latency and two and a half of its periods.
        joints_stale: age of the joint state at which the arm brakes [s].
        future: how far a stamp may lie ahead of the clock [s].
        late: time between two ticks that counts as a missed deadline [s].
        clock_jump: time between two ticks that counts as a jump of the clock [s].
        recovery: how long all must be well again before the arm goes on [s].
        reflex_distance: nearer than this, the arm leaves if it can [m]; so it does where the
            paper's risk is reached by something that comes closer.
        release: a reflex ends when the nearest hazard is this much farther than where it began,
            or farther than ``reflex_distance`` [m].
        risk: the paper's rule.
        retrace_share: share of the executed path that the reflex retraces (T2: 10 %).
        patience: standing for separation this long, another way is asked for [s].
        retry: time between two requests after a plan failed [s].
        up: unit vector against gravity, in ``base``.
        base_height: of the origin of ``base`` above the floor [m].
        head_height: permits for hands end at this height above the floor [m]: heads are above.
        thing_force, hand_force: greatest force that a permit for a thing or a hand may grant [N]:
            more only where the cell's file says that what is touched stands it.
        soft: stiffness of what the tool's tip is covered with [N/m]; 0 when it is not soft.
    """

    period: float = 0.008
    start_delay: float = 0.06
    compute_latency: float = 0.027
    speed: float = 0.5
    acceleration: float = 0.6
    task_speed: float = 1.0
    brake: float = 1.0
    separation: Separation = field(default_factory=Separation)
    reaction_window: float = 10.0
    retreat_speed: float = 0.045
    headroom: float = 0.04
    rise: float = 1.5
    rise_jerk: float = 10.0
    gain: float = 4.0
    off_path: float = 0.08
    stale_after: float = 0.1
    joints_stale: float = 0.05
    future: float = 0.01
    late: float = 0.04
    clock_jump: float = 0.5
    recovery: float = 0.25
    reflex_distance: float = 0.15
    release: float = 0.1
    risk: PaperRisk = field(default_factory=PaperRisk)
    retrace_share: float = 0.1
    patience: float = 0.8
    retry: float = 0.4
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    base_height: float = 0.0
    head_height: float = 1.2
    thing_force: float = 10.0
    hand_force: float = 30.0
    soft: float = 0.0

    @property
    def planned(self) -> tuple[float, float]:
        """Shares of the joints' speed and acceleration limits that planned motions may use."""
        return (
            self.speed * (1.0 - self.headroom),
            self.acceleration * (1.0 - 2.0 * self.headroom),
        )

    def __post_init__(self) -> None:
        """Refuse what cannot be meant.

        Raises:
            UsageError: a value is out of its range; the message names it.
        """
        for name, low, high in (
            ("period", 0.0005, 0.1),
            ("start_delay", 0.0, 1.0),
            ("compute_latency", 0.0, 1.0),
            ("speed", 0.01, 1.0),
            ("acceleration", 0.01, 1.0),
            ("task_speed", 0.01, 1.0),
            ("brake", 0.05, 1.0),
            ("retreat_speed", 0.0, 0.25),
            ("gain", 0.0, 20.0),
            ("headroom", 0.0, 0.3),
            ("stale_after", 0.02, 2.0),
            ("joints_stale", 0.005, 1.0),
            ("retrace_share", 0.0, 1.0),
            ("thing_force", 0.1, 150.0),
            ("hand_force", 0.1, 140.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise UsageError(f"guard.{name} is {value}; expected {low} to {high}")

"""How far each thing is randomised: recordings, rooms by the thousand, the wild and its crops.

In the order of importance of the design: camera and framing, tools and hoses and stands, light,
background, occluders, sensor, material, kinematics. Everything is a range, a probability or a
standard deviation; ``generate`` draws from them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from armsight.errors import UsageError

Range = tuple[float, float]

KINECT_V2_FOV_DEG: Range = (70.0, 60.0)
"""Horizontal and vertical, of the depth lens that T4 to T7 registered their colour to."""

PAPER_COUNTS = {"ur3": 926, "ur5": 2520, "ur10": 904, "iiwa": 1837, "panda": 2513}
"""Samples of each robot in T4 to T7."""


@dataclass(frozen=True)
class Recipe:
    """Ranges of one kind of set.

    Attributes:
        name: of the kind.
        scenes: rooms of each robot at most, shared by its samples; 0: every sample has its own.
        recorded: the samples of a room are a recording as the papers made them (recording.py).
        fov_deg: horizontal field of view, drawn evenly; the paper-like set's is fixed.
        distance: camera to the robot's base [m].
        elevation_deg: of the camera above the arm's middle.
        roll_deg: greatest turn about the optical axis.
        cut: probability that the frame cuts the arm.
        aim: how far from the picture's middle the arm's may lie, in halves of the picture.
        center_shift: greatest shift of the principal point, share of the width.
        distortion: standard deviation of k1 that the lens still bends.
        tool, cable, hidden_base, inverted, person, occluder, foreign_arm, random_texture,
            glossy, worn: probabilities.
        repaint: probability that an arm has other colours than the maker's, one of ``paints``.
        stickers: probability that worn paint carries labels and letters, too.
        grey: probability of a picture without colour.
        decoy: probability that a picture without a robot has something else where one might stand.
        tint: spread of hue and brightness of the maker's colours.
        jitter: greatest error of each link's length [m].
        exposure: standard deviation of the exposure [stops].
        white_balance: spread of the gains of red and blue.
        noise: greatest read noise, share of full scale.
        blur: greatest defocus [px of the finished picture].
        motion: probability of motion blur.
        quality: JPEG quality.
        clutter: least and greatest number of things in the room.
        calm_light: light of laboratories only.
        views: pictures of one scene; more than 1: square crops that follow the arm (crops.py).
        whole: share of the crops that are as wide as a whole picture of the lens.
    """

    name: str
    scenes: int
    recorded: bool
    fov_deg: Range
    distance: Range
    elevation_deg: Range
    roll_deg: float
    cut: float
    aim: float
    center_shift: float
    distortion: float
    tool: float
    cable: float
    hidden_base: float
    inverted: float
    person: float
    occluder: float
    foreign_arm: float
    random_texture: float
    glossy: float
    worn: float
    repaint: float
    tint: float
    jitter: float
    exposure: float
    white_balance: float
    noise: float
    blur: float
    motion: float
    quality: tuple[int, int]
    clutter: tuple[int, int]
    calm_light: bool
    views: int = 1
    whole: float = 0.0
    paints: tuple[str, ...] = ("white", "grey", "dark")
    stickers: float = 0.0
    grey: float = 0.0
    decoy: float = 0.0


PAPER_LIKE = Recipe(
    name="paper-like",
    scenes=14,
    recorded=True,
    fov_deg=(KINECT_V2_FOV_DEG[0], KINECT_V2_FOV_DEG[0]),
    distance=(1.2, 2.5),
    elevation_deg=(-5.0, 40.0),
    roll_deg=3.0,
    cut=0.04,
    aim=0.35,
    center_shift=0.0,
    distortion=0.0,
    tool=0.3,
    cable=0.2,
    hidden_base=0.0,
    inverted=0.0,
    person=0.15,
    occluder=0.0,
    foreign_arm=0.05,
    random_texture=0.0,
    glossy=0.3,
    worn=0.0,
    repaint=0.0,
    tint=0.03,
    jitter=0.0,
    exposure=0.25,
    white_balance=0.05,
    noise=0.012,
    blur=0.5,
    motion=0.0,
    quality=(90, 95),
    clutter=(6, 18),
    calm_light=True,
)

WILD = Recipe(
    name="wild",
    scenes=0,
    recorded=False,
    fov_deg=(40.0, 105.0),
    distance=(0.8, 3.5),
    elevation_deg=(-20.0, 65.0),
    roll_deg=15.0,
    cut=0.3,
    aim=0.55,
    center_shift=0.03,
    distortion=0.006,
    tool=0.7,
    cable=0.4,
    hidden_base=0.15,
    inverted=0.08,
    person=0.3,
    occluder=0.5,
    foreign_arm=0.1,
    random_texture=0.1,
    glossy=0.4,
    worn=0.3,
    repaint=0.45,
    tint=0.15,
    jitter=0.001,
    exposure=0.6,
    white_balance=0.18,
    noise=0.025,
    blur=1.6,
    motion=0.2,
    quality=(30, 95),
    clutter=(4, 40),
    calm_light=False,
)

PAPER_ROOMS = replace(PAPER_LIKE, name="paper-rooms", scenes=0, recorded=False)
"""The papers' lens, distances, light and paint, but every picture in a room, from a camera and with
an arm of its own: what a network needs to learn that shall work in rooms it has not seen."""

CROPS = replace(
    WILD,
    name="crops",
    views=5,
    whole=0.3,
    repaint=0.7,
    paints=("white", "white", "white", "white", "grey", "grey", "dark"),
    random_texture=0.05,
    stickers=0.5,
    foreign_arm=0.2,
    grey=0.05,
    decoy=0.6,
    center_shift=0.0,
    distortion=0.0,
)
"""For a network that looks at the arm alone: several cameras in each scene of the wild,
turned to the arm and cut to it. White in two arms of five: paint does not tell the type."""

RECIPES = {recipe.name: recipe for recipe in (PAPER_LIKE, PAPER_ROOMS, WILD, CROPS)}


def find_recipe(name: str) -> Recipe:
    """The recipe of a kind of set.

    Raises:
        UsageError: there is none.
    """
    try:
        return RECIPES[name]
    except KeyError:
        raise UsageError(f'no kind of set "{name}"; choose {" or ".join(RECIPES)}') from None

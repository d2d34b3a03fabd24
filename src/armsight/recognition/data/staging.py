"""Sets up the scene of one sample: room, stand, arm, camera and all else, from its random streams.

Every topic draws from a stream of its own, so that a change in one leaves the others as they were.
What samples of a scene share (room, stand, furniture, light, paint, tool) comes from the scene's
streams, the rest from the sample's.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Bytes, Floats, JointVector, Points, Pose, Poses
from armsight.errors import DatasetError
from armsight.recognition.data import clutter, fittings
from armsight.recognition.data.arms import Arm, catalogue_arm, made_up_arm
from armsight.recognition.data.configuration import draw_configuration
from armsight.recognition.data.decoys import draw_decoy
from armsight.recognition.data.framing import View, draw_view
from armsight.recognition.data.lighting import Light, draw_light
from armsight.recognition.data.paintwork import draw_paintwork
from armsight.recognition.data.recipe import Recipe
from armsight.recognition.data.recording import Place, Recording, record
from armsight.recognition.data.room import PAINT, Room, Stand, draw_room, draw_stand
from armsight.recognition.data.sample import KNOWN_ROBOTS, NO_ROBOT, UNKNOWN_ROBOT
from armsight.recognition.data.streams import Streams
from armsight.recognition.data.textures import draw_scratches
from armsight.recognition.data.things import Scene, Thing, yaw_pose


@dataclass(frozen=True)
class Stage:
    """A scene ready to be drawn.

    Attributes:
        scene: everything to draw, occluders included.
        view: the camera.
        arm: what is labelled, None where there is no robot.
        robot_things: the arm alone.
        occluders: what was put before the arm on purpose.
        q: (n,) joint positions [rad].
        T_world_link: (n + 1, 4, 4) true poses of the links.
        T_world_base: the arm's base.
        words: what the statistics tell of the scene.
    """

    scene: Scene
    view: View
    arm: Arm | None
    robot_things: list[Thing]
    occluders: list[Thing]
    q: JointVector
    T_world_link: Poses
    T_world_base: Pose
    words: dict[str, float | str]


@dataclass(frozen=True)
class Setting:
    """All of a scene that does not depend on where the camera stands.

    Attributes:
        robot: type of the sample.
        arm: what frames the picture; drawn unless the robot is none.
        room, stand, light: around it.
        q: (n,) joint positions [rad].
        T_world_link: (n + 1, 4, 4) true poses of the links.
        centers, radii: the arm as spheres in world [m].
        kept: the same of what furniture must leave free: more, in a recording.
        view: the recording's camera, None where the sample has its own.
        robot_things: the arm alone. worn: tool and cable, or what stands there instead of an arm.
        textures: of the scene.
        standing, people: groups that stay where they neither touch nor hide the arm.
        words: what the statistics tell of the scene.
    """

    robot: str
    arm: Arm
    room: Room
    stand: Stand
    light: Light
    q: JointVector
    T_world_link: Poses
    centers: Points
    radii: Floats
    kept: tuple[Points, Floats]
    view: View | None
    robot_things: list[Thing]
    worn: list[Thing]
    textures: list[Bytes]
    standing: list[clutter.Group]
    people: list[clutter.Group]
    words: dict[str, float | str]


def set_up(
    recipe: Recipe, robot: str, size: tuple[int, int], streams: Streams, place: Place
) -> Stage | None:
    """The scene of a sample, or None if this attempt led nowhere.

    Args:
        recipe: ranges.
        robot: type of the sample.
        size: width, height of the picture [px].
        streams: random generators.
        place: which frame of a recording the sample is.
    """
    setting = draw_setting(recipe, robot, size, streams, place)
    if setting is None:
        return None
    view = setting.view
    if view is None:
        base, rng = setting.stand.T_world_base[:3, 3], streams.of_sample("view")
        corners = setting.room.corners
        view = draw_view(recipe, size, setting.centers, setting.radii, base, corners, rng)
    return None if view is None else stage(recipe, setting, view, streams, streams)


def draw_setting(
    recipe: Recipe, robot: str, size: tuple[int, int], streams: Streams, place: Place
) -> Setting | None:
    """What every camera of a scene would see, or None if no free configuration was found."""
    # Without a robot, an arm that is not drawn frames the picture all the same.
    arm = _arm(robot, streams)
    recording = None
    if recipe.recorded:
        take, recording = _recording(recipe, arm, size, streams, place)
        streams = replace(streams, take=take)
    room = draw_room(recipe, streams.of_scene("room"))
    stand = draw_stand(recipe, room, streams.of_scene("stand"))
    q = (
        recording.q[place.frame]
        if recording is not None
        else draw_configuration(arm, stand.T_world_base, stand.blocked, streams.of_sample("pose"))
    )
    if q is None:
        return None
    geometry = _jittered(arm, recipe.jitter, streams.of_sample("jitter"))
    T_world_link = np.asarray(stand.T_world_base @ arm.link_poses(q, geometry))
    centers, radii = arm.spheres(T_world_link), arm.sphere_radius
    # What stands in a recording leaves room for all that its arm does.
    kept = (centers, radii) if recording is None else (recording.centers, recording.radii)
    light = draw_light(recipe, room, kept[0].mean(axis=0), streams.of_scene("light"))
    words: dict[str, float | str] = {
        "stand": stand.kind,
        "shadow": light.kind,
        "light": light.strength,
    }
    textures = list(room.textures)
    robot_things: list[Thing] = []
    worn: list[Thing] = []
    if robot != NO_ROBOT:
        robot_things = _painted(recipe, arm, T_world_link, textures, words, streams)
        worn = _worn(recipe, arm, T_world_link, words, streams)
    elif (rng := streams.of_scene("decoy")).random() < recipe.decoy:
        worn = draw_decoy(room, stand.T_world_base, rng)
    return Setting(
        robot,
        arm,
        room,
        stand,
        light,
        q,
        T_world_link,
        centers,
        radii,
        kept,
        None if recording is None else recording.view,
        robot_things,
        worn,
        textures,
        _standing(recipe, room, stand, streams),
        _people(recipe, room, streams),
        words,
    )


def stage(recipe: Recipe, setting: Setting, view: View, streams: Streams, own: Streams) -> Stage:
    """A setting as one camera sees it, with what stands before the arm for this camera alone.

    Args:
        recipe: ranges.
        setting: of the scene.
        view: the camera.
        streams: random generators of the scene.
        own: random generators of the picture.
    """
    centers, radii = setting.centers, setting.radii
    drawn = setting.robot != NO_ROBOT
    words = setting.words | {"cut": float(view.cut)}
    things = setting.room.things + setting.stand.things + setting.robot_things + setting.worn
    occluders: list[Thing] = []
    if drawn:
        occluders = _occluders(recipe, view, setting.stand, centers, radii, words, own)
    things += clutter.fitting(setting.standing, view, *setting.kept)
    things += clutter.fitting(setting.people, view, centers, radii)
    things += _foreign(recipe, setting.room, view, centers, radii, streams)
    things += occluders
    light = setting.light
    return Stage(
        Scene(things, light.lamps, light.ambient, setting.textures),
        view,
        setting.arm if drawn else None,
        setting.robot_things,
        occluders,
        setting.q,
        setting.T_world_link,
        setting.stand.T_world_base,
        words,
    )


def _arm(robot: str, streams: Streams) -> Arm:
    if robot == UNKNOWN_ROBOT:
        return made_up_arm(streams.of_scene("arm"))
    if robot == NO_ROBOT:
        return catalogue_arm(str(streams.of_sample("arm").choice(KNOWN_ROBOTS)))
    return catalogue_arm(robot)


_recordings: OrderedDict[tuple[object, ...], tuple[int, Recording]] = OrderedDict()
"""Of this process, since a sweep takes a second and each frame of a recording asks for it."""
_TAKES = 40


def _recording(
    recipe: Recipe, arm: Arm, size: tuple[int, int], streams: Streams, place: Place
) -> tuple[int, Recording]:
    """The first take of a sample's recording that its room allows, and which it is.

    Raises:
        DatasetError: no room allowed one, which the recipes of armsight do not cause.
    """
    key = (recipe, streams.seed, streams.robot, streams.scene, size, place.frames)
    if key not in _recordings:
        for take in range(_TAKES):
            own = replace(streams, take=take)
            room = draw_room(recipe, own.of_scene("room"))
            stand = draw_stand(recipe, room, own.of_scene("stand"))
            rng = own.of_scene("sweep")
            recording = record(recipe, arm, room, stand, size, place.frames, rng)
            if recording is not None:
                break
        else:
            raise DatasetError(
                f"recording {place.scene} of {arm.name}: no room allows {place.frames} frames; "
                "take another seed or fewer"
            )
        _recordings[key] = take, recording
        if len(_recordings) > 64:
            _recordings.popitem(last=False)
    return _recordings[key]


def _jittered(arm: Arm, greatest: float, rng: np.random.Generator) -> Poses | None:
    if greatest == 0.0:
        return None
    geometry = arm.T_link_joint.copy()
    geometry[:, :3, 3] += rng.uniform(-greatest, greatest, (arm.n, 3))
    return np.asarray(geometry)


def _painted(
    recipe: Recipe,
    arm: Arm,
    T_world_link: Poses,
    textures: list[Bytes],
    words: dict[str, float | str],
    streams: Streams,
) -> list[Thing]:
    """The arm's parts in their colours."""
    paint = draw_paintwork(recipe, streams.of_scene("paint"))
    words["paint"] = paint.style
    if paint.style != "texture":
        textures[PAINT] = draw_scratches(streams.of_scene("paint"), recipe.stickers)
    return [
        Thing(
            part.kind,
            part.size,
            T_world_link[part.link] @ part.T_link_part,
            paint.surface(part.color),
            part.link + 1,
            part.mesh,
        )
        for part in arm.parts
    ]


def _worn(
    recipe: Recipe,
    arm: Arm,
    T_world_link: Poses,
    words: dict[str, float | str],
    streams: Streams,
) -> list[Thing]:
    """Tool and cable."""
    T_flange = T_world_link[-1] @ arm.T_last_flange
    things: list[Thing] = []
    rng = streams.of_scene("tool")
    words["tool"] = "none"
    if rng.random() < recipe.tool:
        words["tool"], things = fittings.draw_tool(T_flange, rng)
    rng = streams.of_scene("cable")
    if rng.random() < recipe.cable:
        things += fittings.draw_cable(arm, T_world_link, T_flange, rng)
    return things


def _occluders(
    recipe: Recipe,
    view: View,
    stand: Stand,
    centers: Points,
    radii: Floats,
    words: dict[str, float | str],
    streams: Streams,
) -> list[Thing]:
    """What hides a part of the arm."""
    found: list[Thing] = []
    rng = streams.of_sample("occluder")
    if rng.random() < recipe.occluder:
        for _ in range(int(rng.integers(1, 4))):
            found += clutter.draw_occluder(view, centers, radii, rng) or []
    rng = streams.of_sample("ledge")
    if stand.kind != "gantry" and rng.random() < recipe.hidden_base:
        ledge = clutter.draw_ledge(view, stand, rng)
        found += clutter.fitting(
            [ledge], view, centers[len(centers) // 3 :], radii[len(radii) // 3 :], True
        )
    words["occluders"] = float(len(found))
    return found


def _standing(recipe: Recipe, room: Room, stand: Stand, streams: Streams) -> list[clutter.Group]:
    """Furniture, things on the table."""
    rng = streams.of_scene("furniture")
    count = int(rng.integers(recipe.clutter[0], recipe.clutter[1] + 1))
    groups = clutter.draw_furniture(room, count, rng)
    rng = streams.of_scene("table")
    return groups + clutter.draw_table_things(stand, int(rng.integers(0, 9)), rng)


def _people(recipe: Recipe, room: Room, streams: Streams) -> list[clutter.Group]:
    rng = streams.of_sample("person")
    if rng.random() >= recipe.person:
        return []
    return [clutter.draw_person(room, rng) for _ in range(int(rng.integers(1, 4)))]


def _foreign(
    recipe: Recipe, room: Room, view: View, centers: Points, radii: Floats, streams: Streams
) -> list[Thing]:
    """Another arm farther away, made up and not labelled, as other robots in a hall are."""
    rng = streams.of_sample("foreign")
    if rng.random() >= recipe.foreign_arm:
        return []
    other = made_up_arm(rng)
    low, high = room.corners[0, :2] + 0.5, room.corners[1, :2] - 0.5
    T = yaw_pose(rng.uniform(-np.pi, np.pi), (*rng.uniform(low, high), 0.0))
    T[2, 3] = rng.uniform(0.0, 0.9)
    links = T @ other.link_poses(rng.uniform(other.lower, other.upper))
    eye = view.T_world_camera[:3, 3]
    farthest = np.linalg.norm(centers - eye, axis=1).max()
    if np.linalg.norm(other.spheres(links) - eye, axis=1).min() < farthest + 0.3:
        return []
    paint = draw_paintwork(recipe, rng)
    parts = [
        Thing(p.kind, p.size, links[p.link] @ p.T_link_part, paint.surface(p.color))
        for p in other.parts
    ]
    return clutter.fitting([parts], view, centers, radii)

"""People: bodies, scripts, walking, recorded clips."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from simulation_cells import person

from armsight.errors import ArmsightError, UsageError
from armsight.geometry.pose import from_rpy, make_pose
from armsight.geometry.shapes import Solid
from armsight.simulation.carrier import Carrier
from armsight.simulation.clips import PERSON, load_clip
from armsight.simulation.hulls import convex_pieces, hull_vertices
from armsight.simulation.motion import finish, hand_speeds, smooth_step
from armsight.simulation.movers import Person, make_objects
from armsight.simulation.people import hand_body, person_body
from armsight.simulation.scripts import SCRIPTS, ScriptOptions, script_joints
from armsight.simulation.skeleton import INDEX, JOINTS, PARTS, Proportions, bend, standing
from armsight.simulation.spec import MovingObjectSpec, PersonSpec

P = Proportions(1.75)
TARGET = np.array([0.6, -0.1, 1.05])
BONES = {
    ("shoulder", "elbow"): P.upper_arm,
    ("elbow", "wrist"): P.forearm,
    ("wrist", "hand"): P.hand,
    ("hip", "knee"): P.thigh,
    ("knee", "ankle"): P.shin,
}


def options(period=12.0, target=TARGET, distance=2.0):
    return ScriptOptions(period, target, distance, P)


def lengths(joints, side, bone):
    a, b = (joints[:, INDEX[f"{side}_{end}"]] for end in bone)
    return np.linalg.norm(b - a, axis=1)


vectors = arrays(float, 3, elements=st.floats(-1.0, 1.0))


@settings(max_examples=150, deadline=None)
@given(start=vectors, end=vectors, toward=vectors)
def test_two_bones_keep_their_lengths(start, end, toward):
    if np.linalg.norm(end - start) < 0.01:
        return
    middle, reached = bend(start, end, 0.3, 0.25, toward)
    assert np.linalg.norm(middle - start) == pytest.approx(0.3, abs=1e-6) or _straight(
        start, end, toward
    )
    assert np.linalg.norm(reached - start) <= 0.55
    if 0.06 < np.linalg.norm(end - start) < 0.538:  # from 0.539 on it is drawn in gently
        assert np.allclose(reached, end, atol=1e-9)


def _straight(start, end, toward):
    """The bend's side is undefined when it lies along the reach."""
    axis = (end - start) / np.linalg.norm(end - start)
    return np.linalg.norm(toward - axis * (axis @ toward)) < 1e-6


def test_a_standing_person_has_human_measures():
    pose = standing(P)
    top = pose[INDEX["head"], 2] + 0.12
    assert top == pytest.approx(1.75, abs=0.03)
    assert pose[INDEX["left_shoulder"], 2] == pytest.approx(0.818 * 1.75, abs=0.02)
    assert pose[INDEX["left_hip"], 2] == pytest.approx(0.53 * 1.75, abs=0.04)
    assert pose[INDEX["left_shoulder"], 1] > 0 > pose[INDEX["right_shoulder"], 1]
    assert pose[INDEX["left_toe"], 0] > pose[INDEX["left_ankle"], 0] + 0.1


@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_scripts_move_people_smoothly_and_upright(name):
    joints = script_joints(name, options())
    assert joints.shape[1:] == (19, 3)
    assert np.isfinite(joints).all()
    for side in ("left", "right"):
        for bone, length in BONES.items():
            tolerance = 0.035 if bone[1] in ("elbow", "wrist", "hand") else 1e-6
            assert np.allclose(lengths(joints, side, bone), length, atol=tolerance)
    # nothing under the floor, nobody off it; joints do not jump
    assert joints[..., 2].min() > 0.0
    feet = joints[:, [INDEX["left_ankle"], INDEX["right_ankle"]], 2].min(axis=1)
    assert feet.max() < P.ankle + 0.08
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=2) * 100.0
    assert speed.max() < 5.5
    # once round and back to the start
    assert np.allclose(joints[0, : INDEX["left_hip"]], joints[-1, : INDEX["left_hip"]], atol=0.02)


@pytest.mark.parametrize("name", ["reach_in", "reach_and_hold"])
def test_reaching_hands_get_there(name):
    joints = script_joints(name, options())
    away = np.linalg.norm(joints[:, INDEX["right_hand"]] - TARGET, axis=1)
    assert away.min() < 0.02
    assert np.sum(away < 0.03) > 80
    far = script_joints(name, options(target=np.array([1.6, 0.0, 1.0])))
    assert np.linalg.norm(far[:, INDEX["right_hand"]] - [1.6, 0, 1.0], axis=1).min() > 0.2


def test_a_walker_covers_the_distance_in_steps():
    joints = script_joints("walk_by", options(distance=2.5))
    pelvis = joints[:, INDEX["pelvis"], 0]
    assert pelvis.max() == pytest.approx(2.5, abs=0.05)
    ankle = joints[:, INDEX["left_ankle"]]
    low = ankle[:, 2] < P.ankle + 0.002
    moving = np.linalg.norm(np.diff(ankle[:, :2], axis=0), axis=1) * 100
    planted = low[1:] & low[:-1]
    assert planted.mean() > 0.3
    assert np.median(moving[planted]) < 1e-3  # feet do not slide


def test_unknown_scripts_are_refused():
    with pytest.raises(UsageError, match="choose one of reach_and_hold, reach_in"):
        script_joints("dance", options())
    with pytest.raises(UsageError, match="no clip is given"):
        Person(person(motion="clip"))


@pytest.mark.parametrize("cap", [0.4, 1.0, 1.6])
def test_hands_keep_their_greatest_speed(cap):
    joints = script_joints("wave", options())
    motion = finish(joints, np.eye(4), scale=3.0, hand_speed=cap)
    for side in ("left", "right"):
        assert hand_speeds(motion.joints, np.diff(motion.times), side).max() <= cap + 1e-9
    free = finish(joints, np.eye(4), scale=3.0)
    assert free.times[-1] == pytest.approx((len(joints) - 1) / 300.0)
    assert motion.times[-1] > free.times[-1]


def test_mirrored_motion_is_the_mirror_image():
    joints = script_joints("reach_in", options())
    T = from_rpy((0, 0, 0.7), (1.0, 2.0, 0.0))
    plain, mirrored = finish(joints, T), finish(joints, T, mirror=True)
    local = (plain.joints - T[:3, 3]) @ T[:3, :3]
    other = (mirrored.joints - T[:3, 3]) @ T[:3, :3]
    assert np.allclose(other[:, INDEX["left_hand"]], local[:, INDEX["right_hand"]] * [1, -1, 1])
    left = mirrored.left @ T[:3, :3]
    assert np.allclose(left[0], [0, 1, 0], atol=3e-3)


def test_motions_repeat_and_turn_back():
    joints = script_joints("reach_in", options(period=4.0))
    again = finish(joints, np.eye(4), start=1.0)
    assert again.place(0.5) == again.place(1.0) == (0, 0.0)
    i, w = again.place(2.305)
    assert again.place(6.305) == (i, pytest.approx(w, abs=1e-6))
    back = finish(joints, np.eye(4), there_and_back=True)
    i, w = back.place(1.0)
    j, v = back.place(2 * back.times[-1] - 1.0)
    assert i + w == pytest.approx(j + v, abs=1e-6)


def test_minimum_jerk():
    t = np.linspace(-0.2, 1.2, 15)
    s = smooth_step(t)
    assert s[0] == 0
    assert s[-1] == 1
    assert np.all(np.diff(s) >= 0)
    slope = (smooth_step(0.5005) - smooth_step(0.4995)) / 0.001
    assert slope == pytest.approx(1.875, abs=1e-3)  # known peak of minimum-jerk motion


def test_bodies_are_closed_and_their_pieces_hold_them():
    trimesh = pytest.importorskip("trimesh")
    body = person_body("anna", P)
    assert [part.name for part in body.parts] == [name for name, *_ in PARTS]
    volume = 0.0
    for part in body.parts:
        for piece in part.lofts:
            vertices, faces = piece.mesh()
            mesh = trimesh.Trimesh(vertices, faces)
            assert mesh.is_watertight, piece.name
            assert mesh.volume > 0, piece.name  # faces look outward
            volume += mesh.volume
            hulls = convex_pieces(vertices, faces, max(piece.pieces, 1))
            inside = np.zeros(len(vertices), bool)
            total = 0.0
            for hull in hulls:
                solid = trimesh.convex.convex_hull(hull)
                total += solid.volume
                offset = solid.triangles_center
                out = np.einsum("vfk,fk->vf", vertices[:, None] - offset, solid.face_normals)
                inside |= np.all(out < 1e-6, axis=1)
            assert inside.all(), piece.name
            assert total < 1.25 * mesh.volume, piece.name
    assert 0.05 < volume < 0.09  # 50 to 90 litres
    assert [part.name for part in hand_body("h", P).parts] == ["right_forearm", "right_hand"]


def test_slices_follow_an_elbow_closer_than_one_hull():
    """An L of two boxes: its hull fills the corner, its slices hardly."""
    trimesh = pytest.importorskip("trimesh")
    ell = trimesh.util.concatenate(
        [
            trimesh.creation.box((0.1, 0.1, 0.6)),
            trimesh.creation.box((0.3, 0.1, 0.1)).apply_translation((0.2, 0, 0.25)),
        ]
    )
    pieces = convex_pieces(np.asarray(ell.vertices), np.asarray(ell.faces), 5)
    total = sum(trimesh.convex.convex_hull(p).volume for p in pieces)
    whole = trimesh.convex.convex_hull(hull_vertices(np.asarray(ell.vertices))).volume
    assert total < 0.8 * whole
    assert hull_vertices(np.zeros((10, 3))) is None


CLIPS = (
    "PickPlaceCloseHuman/1",
    "HumanRobotHandover/2",
    "CollaborativeLifting/3",
    "ObjectInspection/6",
)


@pytest.fixture(scope="module")
def clips(shared_data: Path) -> Path:
    return shared_data / "motion" / "human_motion"


@pytest.mark.parametrize("name", CLIPS)
def test_clips_are_people_on_the_floor(clips, name):
    clip = load_clip(clips / f"{name}.csv.gz")
    joints = clip.joints
    assert clip.rate == 100.0
    assert clip.name == name
    assert clip.lost < 0.05
    assert np.isfinite(joints).all()
    for side in ("left", "right"):
        arm = lengths(joints, side, ("shoulder", "elbow"))
        assert np.all(np.abs(arm - PERSON.upper_arm) < 0.04)
        forearm = lengths(joints, side, ("elbow", "wrist"))
        assert np.all(np.abs(forearm - PERSON.forearm) < 0.06)
        for bone, length in ((("hip", "knee"), PERSON.thigh), (("knee", "ankle"), PERSON.shin)):
            assert np.allclose(lengths(joints, side, bone), length, atol=1e-6)
    ankles = joints[:, [INDEX["left_ankle"], INDEX["right_ankle"]], 2]
    assert ankles.min() > 0.05
    assert np.median(ankles) < 0.08
    head = np.median(joints[:, INDEX["head"], 2])
    assert 1.45 < head < 1.65
    upright = joints[:, INDEX["neck"]] - joints[:, INDEX["pelvis"]]
    tilt = np.arccos(upright[:, 2] / np.linalg.norm(upright, axis=1))
    assert np.median(tilt) < np.deg2rad(20)
    # they stand before the robot, which is at the origin, and look at it most of the time
    pelvis = joints[:, INDEX["pelvis"]]
    assert 0.8 < np.median(pelvis[:, 0]) < 3.0
    assert abs(np.median(pelvis[:, 1])) < 0.6
    left = joints[:, INDEX["left_shoulder"]] - joints[:, INDEX["right_shoulder"]]
    facing = np.stack([left[:, 1], -left[:, 0]], axis=1)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    assert np.median(-facing[:, 0]) > 0.5


def test_hand_speeds_of_all_clips_match_the_recorded_ones(clips):
    """The design notes give, by 100 ms differences: median 0.23, p95 1.0, p99 1.6, max 3.2 m/s."""
    speeds = []
    for path in sorted(clips.glob("*/*.csv.gz")):
        joints = load_clip(path).joints
        for side in ("left", "right"):
            hand = joints[:, INDEX[f"{side}_hand"]]
            speeds.append(np.linalg.norm(hand[10:] - hand[:-10], axis=1) / 0.1)
    assert len(speeds) == 56
    speeds = np.concatenate(speeds)
    median, p95, p99 = np.percentile(speeds, [50, 95, 99])
    assert median == pytest.approx(0.23, abs=0.08)
    assert p95 == pytest.approx(1.0, abs=0.5)
    assert p99 == pytest.approx(1.6, abs=0.8)
    assert speeds.max() < 4.0


def test_a_clip_in_the_cell_is_capped(clips):
    spec = person(motion="clip", clip=clips / "PickPlaceCloseHuman/3.csv.gz", max_hand_speed=1.6)
    motion = Person(spec).motion
    for side in ("left", "right"):
        assert hand_speeds(motion.joints, np.diff(motion.times), side).max() <= 1.6 + 1e-9
    assert motion.there_and_back


def write_clip(folder, rows, header=None):
    from armsight.simulation.clips import SEGMENTS

    names = ",".join(f",,,,,Global Angle {s}:{s}" for s in SEGMENTS)
    lines = ["\ufeffObjects", "100", f",{names}", "Frame", "units", *rows]
    if header is not None:
        lines[2] = header
    path = folder / "0.csv.gz"
    path.write_bytes(gzip.compress("\n".join(lines).encode()))
    (folder / "0_info.json").write_text('{"position_offset": [0, 0, 0]}')
    return path


def row(frame, lost=()):
    cells = [str(frame), "0"]
    for s in range(9):
        cells += [""] * 6 if s in lost else ["0.0"] * 3 + [str(100.0 * s), "0.0", "500.0"]
    return ",".join(cells)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda f: f / "missing.csv.gz", "not a motion clip"),
        (lambda f: write_clip(f, [row(i) for i in range(20)] + ["1,2,3"]), "3 cells, not 56"),
        (lambda f: write_clip(f, [row(i) for i in range(9)], "a,b:c"), "segments"),
        (lambda f: write_clip(f, [row(i, lost=(3,)) for i in range(20)]), "'left_hand' was never"),
        (lambda f: write_clip(f, []), "no samples"),
        (lambda f: write_clip(f, [row(1).replace("500.0", "x")]), "not a motion clip"),
    ],
)
def test_broken_clips_say_what_is_wrong(tmp_path, make, says):
    with pytest.raises(ArmsightError, match=says):
        load_clip(make(tmp_path))


def test_a_clip_without_place_and_one_cut_short(tmp_path):
    path = write_clip(tmp_path, [row(i) for i in range(30)])
    (tmp_path / "0_info.json").write_text("{}")
    with pytest.raises(ArmsightError, match="cannot place the clip"):
        load_clip(path)
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ArmsightError, match="not a motion clip"):
        load_clip(path)


def test_lost_markers_are_bridged(tmp_path):
    rows = [row(i, lost=(2, 3) if 10 <= i < 14 else ()) for i in range(40)]
    clip = load_clip(write_clip(tmp_path, rows))
    assert clip.joints.shape == (40, len(JOINTS), 3)
    assert np.isfinite(clip.joints).all()
    assert 0.0 < clip.lost < 0.1
    assert np.allclose(clip.joints[5, INDEX["left_elbow"]], clip.joints[12, INDEX["left_elbow"]])


def test_who_carries_brings_a_thing_puts_it_down_and_goes():
    """No thing moves but in a hand, and nobody jumps."""
    table = Solid("table", "box", (1.4, 1.4, 0.75), make_pose(None, (0.35, 0.0, 0.375)))
    home = np.array([3.2, -0.45])
    box = MovingObjectSpec(
        Solid("box", "box", (0.18, 0.18, 0.18), make_pose(None, (2.75, -0.45, 0.95))),
        carried_by="mia",
    )
    mia = PersonSpec("mia", "carry", from_rpy((0, 0, np.pi), (*home, 0.0)), distance=1.8)
    carrier = Carrier(mia, [box], [table])
    bodies = np.zeros((len(PARTS), 3)), np.zeros((len(PARTS), 4))
    upper = [i for name, i in INDEX.items() if not name.endswith(("knee", "ankle", "toe"))]
    wishes = {100: (0.9, -0.45, 1.2), 1300: (0.9, 0.2, 1.0), 1340: (0.95, 0.3, 1.0)}
    before = moved = None
    for k in range(2700):
        if k in wishes:
            carrier.bring("box", np.array(wishes[k]))
        carrier.update(0.01 * k, *bodies)
        joints, place = carrier.joints.copy(), carrier.place("box").copy()
        if before is not None:
            assert np.linalg.norm(joints[upper] - before[upper], axis=1).max() < 0.02, "2 m/s"
            assert np.linalg.norm(place - moved) < 0.02
            if (place != moved).any():
                assert np.linalg.norm(joints[INDEX["right_hand"]] - place) < 0.11
        before, moved = joints, place
        for side in ("left", "right"):
            for bone, length in BONES.items():
                assert lengths(joints[None], side, bone) == pytest.approx(length, abs=0.02)
        if k == 1250:
            assert place == pytest.approx([0.9, -0.45, 0.84], abs=0.01), "on the table"
            assert joints[INDEX["pelvis"]][:2] == pytest.approx(home, abs=0.01)
    assert place == pytest.approx([0.95, 0.3, 0.84], abs=0.02), "where it was wished to be last"
    assert joints[INDEX["pelvis"]][:2] == pytest.approx(home, abs=0.01)


@pytest.mark.parametrize(
    ("wish", "stands"),
    [
        ((0.9, -0.4, 1.3), (0.9, -0.4, 0.84)),  # on the table
        ((0.6, -0.3, 0.5), (0.6, -0.3, 0.84)),  # inside the table: on it
        ((1.4, -0.9, 1.0), (1.4, -0.9, 0.69)),  # on the shelf, where it was
        ((1.03, -0.5, 1.0), None),  # half over the table's edge
        ((1.2, -0.5, 1.0), None),  # beside it, above a floor that no upright arm reaches
        ((0.1, 0.3, 1.0), None),  # on the table, too far
    ],
)
def test_what_is_put_down_stands(wish, stands):
    """The nearest place to the wish at which it stands and that her arm reaches; never in the air.

    The third pull of a parcel in a browser left it hanging beside the table.
    """
    table = Solid("table", "box", (1.4, 1.4, 0.75), make_pose(None, (0.35, 0.0, 0.375)))
    shelf = Solid("shelf", "box", (0.3, 0.3, 0.6), make_pose(None, (1.4, -0.9, 0.3)))
    box = MovingObjectSpec(
        Solid("box", "box", (0.18,) * 3, make_pose(None, (1.4, -0.9, 0.69))), carried_by="mia"
    )
    mia = PersonSpec("mia", "carry", from_rpy((0, 0, np.pi), (3.2, -0.45, 0.0)), distance=1.8)
    carrier = Carrier(mia, [box], [table, shelf])
    carrier.bring("box", np.array(wish))
    bodies = np.zeros((len(PARTS), 3)), np.zeros((len(PARTS), 4))
    for k in range(1500):
        carrier.update(0.01 * k, *bodies)
    place = carrier.place("box")
    if stands is not None:
        assert place == pytest.approx(stands, abs=0.01)
        return
    assert place[2] == pytest.approx(0.84, abs=0.01)
    assert (np.abs(place[:2] - [0.35, 0.0]) <= 0.7 - 0.09 + 0.005).all(), "all of its foot"
    nearest = np.clip(wish[:2], [-0.26, -0.61], [0.96, 0.61])
    asked, gone = np.array(wish[:2]), np.linalg.norm(place[:2] - wish[:2])
    if wish[0] > 0.9:
        assert gone < np.linalg.norm(nearest - asked) + 0.06
    else:
        assert gone < np.linalg.norm(np.array([1.05, -0.45]) - asked), "towards the wish"


def test_a_thing_is_carried_by_who_carries():
    box = MovingObjectSpec(Solid("box", "box", (0.1,) * 3, np.eye(4)), carried_by="ann")
    with pytest.raises(UsageError, match=r"box is carried by 'ann'; who carries .* nobody"):
        make_objects([box], [], 0)

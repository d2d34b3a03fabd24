"""Finding and fitting on painted pictures, whose truth no renderer of ours decides."""

from dataclasses import replace

import numpy as np
import pytest
from painted_ports import LENS, PAIR, facing, paint

from armsight.charging.coarse_to_fine import fit_at_size
from armsight.charging.find import ALONE, FindOptions, find_ports
from armsight.charging.fit import fit, model_points, turned
from armsight.charging.looks import look
from armsight.charging.matches import mirrored
from armsight.charging.plane_fit import paper_pose
from armsight.charging.ports.table import PORTS
from armsight.charging.pose import SURE, _located, fit_pose, locate, locate_in_one, wrong
from armsight.charging.rehearsal import rehearse
from armsight.charging.windows import dark_windows
from armsight.errors import UsageError
from armsight.geometry.pose import angle_between, exp, inverse, log, transform

T_LENS_REF = (np.eye(4), inverse(PAIR.T_left_right))
LENSES = (PAIR.left, PAIR.right)


def _pair(name, T, seed=0):
    return _pair_of(PORTS[name], T, seed)


def _pair_of(port, T, seed):
    return tuple(
        paint(port, T_lens @ T, lens, seed + i)
        for i, (lens, T_lens) in enumerate(zip(LENSES, T_LENS_REF))
    )


@pytest.mark.parametrize("name", ["type1", "type2", "ccs1"])
def test_a_port_is_found_with_its_type(name: str) -> None:
    T = facing(0.03, -0.02, 0.55, (0.35, -0.2), -0.3)
    found = find_ports(paint(PORTS[name], T, LENS, 1), LENS)
    assert found[0].port == name
    assert found[0].score > 0.9
    assert np.linalg.norm(found[0].pixel - LENS.project(T[None, :3, 3])[0]) < 1.0
    # one picture from far hardly tells a tilt from its mirror image
    seen = found[0].T_camera_port
    assert min(angle_between(seen, T), angle_between(mirrored(seen), T)) < np.deg2rad(4)


def test_the_rehearsal_goes_the_whole_way_to_a_pose() -> None:
    """Else something would be compiled in the first round of a perceiver, which may be given up."""
    (seen,) = rehearse()
    assert seen.port == "type2"
    np.testing.assert_allclose(seen.T_ref_port[:3, 3], (0.0, 0.0, 0.5), atol=2e-3)


def test_nothing_is_found_in_noise_or_on_a_plain_wall() -> None:
    rng = np.random.default_rng(0)
    assert find_ports(rng.integers(0, 255, (480, 640)).astype(np.uint8), LENS) == ()
    assert find_ports(np.full((480, 640), 90, np.uint8), LENS) == ()
    assert find_ports(np.zeros((480, 640), np.uint8), LENS) == ()


def test_the_dark_window_holds_the_port_and_finds_the_same() -> None:
    T = facing(0.06, 0.03, 0.7, (0.2, 0.1), 0.1)
    image = paint(PORTS["type2"], T, LENS, 2)
    windows = dark_windows(image)
    u, v = LENS.project(T[None, :3, 3])[0]
    assert any(t < v < b and le < u < r for t, b, le, r in windows)
    whole = find_ports(image, LENS)[0]
    part = find_ports(image, LENS, windows=windows)[0]
    assert part.port == whole.port == "type2"
    # one picture cannot tell a tilt from its mirror image, and the origin moves with it
    assert max(np.linalg.norm(d.pixel - (u, v)) for d in (part, whole)) < 1.0


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((480, 640, 3), np.uint8), r"shape \(480, 640, 3\)"),
        (np.zeros((480, 640)), "give a grey picture"),
        (np.zeros((240, 320), np.uint8), "the picture has 320x240 pixels, its lens 640x480"),
    ],
)
def test_pictures_that_cannot_be_searched_are_refused(image, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        find_ports(image, LENS)


def test_the_joint_fit_reaches_the_painted_pose_and_knows_how_sure_it_is() -> None:
    rng = np.random.default_rng(4)
    T = facing(-0.02, 0.01, 0.45, (-0.3, 0.25), 0.1)
    images = _pair("type2", T)
    start = T @ exp(rng.normal(0, [1e-3, 1e-3, 3e-3, 0.05, 0.05, 0.05]))
    found = fit_pose(images, LENSES, T_LENS_REF, "type2", start)
    e = log(inverse(T) @ found.T_ref_port)
    assert np.linalg.norm(e[:3]) < 0.3e-3
    assert np.linalg.norm(e[3:]) < np.deg2rad(0.4)
    assert e @ np.linalg.solve(found.covariance, e) < 22.5  # chi squared of 6, 99.9 %
    assert not found.doubtful


@pytest.mark.parametrize("name", ["type1", "type2"])
def test_a_start_on_the_wrong_roll_ends_on_the_right_one(name: str) -> None:
    T = facing(0.0, 0.0, 0.4, (0.2, 0.3), 0.0)
    turns = PORTS[name].turns
    start = turned(T, roll=2 * np.pi * 2 / turns)
    found = fit_pose(_pair(name, T, 5), LENSES, T_LENS_REF, name, start)
    assert angle_between(found.T_ref_port, T) < np.deg2rad(1.0)


@pytest.mark.parametrize("side", [0, 1])
def test_a_tilt_that_either_picture_took_for_its_mirror_image_is_set_right(side: int) -> None:
    """From far one picture cannot tell; mirrored at the other lens's sight it is 10 deg off."""
    T = facing(0.02, 0.01, 1.0, (0.1, 0.42), 0.1)
    T_lens = T_LENS_REF[side]
    start = inverse(T_lens) @ mirrored(T_lens @ T)
    assert angle_between(start, T) > np.deg2rad(30)
    found = fit_pose(_pair("type1", T, 11), LENSES, T_LENS_REF, "type1", start)
    assert angle_between(found.T_ref_port, T) < np.deg2rad(1.5)
    assert found.tilt_gap > SURE
    assert not found.doubtful


def test_a_fit_that_gets_a_little_better_when_it_is_begun_again_keeps_its_roll(monkeypatch) -> None:
    """Fine fits have more points than coarse ones and so cost more: they are never compared."""
    T = facing(0.0, 0.0, 0.4, (0.1, 0.0), 0.0)
    blank, behind = np.zeros((480, 640), np.uint8), facing(0.0, 0.0, -1.0, (0.0, 0.0), 0.0)
    nothing = fit_at_size([blank], [LENS], [np.eye(4)], PORTS["type1"], behind)
    calls = iter(range(1000))

    def fitted(images, lenses, T_lens_ref, entry, T_ref_port, blur=None):
        aside = 1.0 - float(T[:3, 0] @ T_ref_port[:3, 0])  # by its roll
        points = 100 if blur is None else 400
        upright = T_ref_port.copy()
        upright[:3, :3] = turned(T, roll=0.0 if aside < 0.1 else np.pi)[:3, :3]
        cost = points * (1.0 + aside) - 1e-3 * next(calls)
        return replace(nothing, T_ref_port=upright, points=points, cost=cost)

    monkeypatch.setattr("armsight.charging.pose.fit_at_size", fitted)
    found = fit_pose([], LENSES, T_LENS_REF, "type1", T)
    assert angle_between(found.T_ref_port, T) < 1e-6
    assert found.tilt_gap == np.inf
    assert found.roll_gap > SURE


def test_one_picture_from_far_says_that_it_cannot_tell_the_tilt() -> None:
    T = facing(0.0, 0.0, 1.1, (0.0, 0.4), 0.1)
    image = paint(PORTS["type1"], T, LENS, 12)
    found = fit_pose([image], [LENS], [np.eye(4)], "type1", T)
    assert found.tilt_gap < SURE
    assert found.doubtful
    near = facing(0.0, 0.0, 0.3, (0.0, 0.4), 0.1)
    image = paint(PORTS["type1"], near, LENS, 12)
    assert fit_pose([image], [LENS], [np.eye(4)], "type1", near).tilt_gap > found.tilt_gap


@pytest.mark.parametrize("name", ["type1", "ccs1"])
def test_one_picture_tells_a_type_from_the_one_that_holds_it(name: str) -> None:
    """The finder says Type 1 of either: it may have seen the upper half only."""
    T = facing(0.0, 0.02, 0.6, (0.2, 0.1), 0.1)
    image = paint(PORTS[name], T, LENS, 8)
    options = FindOptions(ports=("type1", "ccs1"))
    (seen,) = _located([image], [LENS], [np.eye(4)], [("type1", T)], options)
    assert seen.port == name
    (seen,) = locate_in_one(image, LENS, options)
    assert seen.port == name


def test_a_score_above_095_says_that_the_pose_is_right_and_one_picture_never_does() -> None:
    """All edges where they should be are a good fit; how makes differ is not seen by one lens."""
    T = facing(0.0, 0.0, 0.3, (0.25, -0.15), 0.1)
    images = _pair("type2", T, 7)
    (one,) = locate_in_one(images[0], LENS, FindOptions(ports=("type2",)))
    assert one.fit.score > ALONE
    assert one.score == ALONE
    (seen,) = find_ports(images[0], LENS, FindOptions(ports=("type2",)))
    assert seen.score == min(seen.match.score, ALONE)
    (both,) = locate(images, PAIR, FindOptions(ports=("type2",)))
    assert both.score == both.fit.score
    assert both.score > ALONE
    far = facing(0.0, 0.0, 1.3, (0.25, -0.15), 0.1)
    (both,) = locate(_pair("type2", far, 7), PAIR, FindOptions(ports=("type2",)))
    assert both.score <= ALONE


def test_how_likely_a_pose_is_wrong_is_what_its_covariance_says() -> None:
    """Against a hundred thousand draws; a bound, since both directions count as the worse one."""
    sigma = np.array([0.3e-3, 0.35e-3, 1e-3, np.deg2rad(0.4), np.deg2rad(0.4), 0.1])
    draws = np.random.default_rng(1).normal(0.0, sigma, (100_000, 6))
    off = np.hypot(draws[:, 0], draws[:, 1]) > 1e-3
    off |= np.hypot(draws[:, 3], draws[:, 4]) > np.deg2rad(1.0)
    said = wrong(np.diag(sigma**2))
    assert off.mean() < said < 1.5 * off.mean()
    assert wrong(np.eye(6)) == 1.0
    assert wrong(np.zeros((6, 6))) == 0.0


def test_locate_pairs_both_pictures() -> None:
    T = facing(0.05, 0.02, 0.6, (0.25, -0.15), 0.2)
    poses = locate(_pair("type2", T, 7), PAIR, FindOptions(ports=("type1", "type2")))
    assert poses[0].port == "type2"
    e = log(inverse(T) @ poses[0].T_ref_port)
    assert np.linalg.norm(e[:3]) < 1e-3
    assert np.linalg.norm(e[3:]) < np.deg2rad(1)


def test_other_sizes_than_the_table_says_are_told_apart_from_the_pose() -> None:
    """A mouth that is 0.8 mm larger: the make takes it up, the pose does not move."""
    nominal = PORTS["type2"]
    rims = tuple(
        replace(rim, outline=rim.outline.grown(0.8e-3)) if rim.kind == "mouth" else rim
        for rim in nominal.rims
    )
    T = facing(0.0, 0.0, 0.4, (0.3, 0.0), 0.0)
    image = paint(replace(nominal, rims=rims), T, LENS, 3)
    found = fit([look(image, LENS)], nominal, T)
    mouth = [rim.kind for rim in found.curves.rims].index("mouth")
    assert 0.4e-3 < found.make[mouth, 0] < 1.0e-3  # its tolerance draws it to the table a little
    assert np.linalg.norm(log(inverse(T) @ found.T_ref_port)[:3]) < 1e-3


def test_a_slot_of_other_proportions_is_not_taken_for_a_tilt() -> None:
    """DC parts 2 mm less high and as wide as the table's, as if they were tilted."""
    nominal = PORTS["ccs1"]
    rims = tuple(
        replace(
            rim,
            outline=replace(
                rim.outline, radius=rim.outline.radius - 1e-3, spread=rim.outline.spread + 1e-3
            ),
        )
        if rim.outline.spread and rim.fit
        else rim
        for rim in nominal.rims
    )
    T = facing(0.0, 0.02, 0.45, (0.25, 0.0), 0.0)
    found = fit_pose(_pair_of(replace(nominal, rims=rims), T, 3), LENSES, T_LENS_REF, "ccs1", T)
    assert angle_between(found.T_ref_port, T) < np.deg2rad(0.5)
    slots = [rim.outline.spread > 0 for rim in found.fit.curves.rims]
    assert np.allclose(found.fit.make[slots, 4], 1e-3, atol=0.4e-3)
    assert not found.fit.make[np.logical_not(slots), 4].any()


def test_edges_3_px_apart_do_not_pull_at_each_other() -> None:
    """A mouth of 18 px in radius, as from afar: place, tilt and edges in the picture's pixels."""
    T = facing(0.02, 0.01, 1.0, (0.2, -0.25), 0.1)
    found = fit_pose(_pair("type1", T, 6), LENSES, T_LENS_REF, "type1", T)
    e = log(inverse(T) @ found.T_ref_port)
    assert np.linalg.norm(e[:2]) < 0.15e-3
    assert np.linalg.norm(e[3:5]) < np.deg2rad(0.6)
    seen = found.fit.edges[0] + found.fit.corners[0]
    off = LENS.project(model_points(found.fit)) - seen
    assert np.nanmedian(np.abs(off)) < 0.15


def test_the_papers_plane_is_exact_without_noise() -> None:
    T = facing(0.02, 0.03, 0.8, (0.2, -0.3), 0.15)
    contacts = np.array([(p.x, p.y, 0.0) for p in PORTS["type2"].pins])
    in_left = transform(T, contacts)
    left = PAIR.left.project(in_left)
    right = PAIR.right.project(transform(inverse(PAIR.T_left_right), in_left))
    exact = paper_pose("type2", left, right, PAIR, exact=True)
    assert np.allclose(exact, T, atol=1e-6)
    by_equation_1 = paper_pose("type2", left, right, PAIR)
    assert by_equation_1 is not None
    assert angle_between(by_equation_1, T) > np.deg2rad(0.5)  # it holds near the axis only
    assert paper_pose("type2", left * np.nan, right, PAIR) is None

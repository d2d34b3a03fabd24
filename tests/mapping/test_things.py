"""Things told from people, in made-up scenes with known truth: each rule, and each way round it."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.mapping.hazards import UnseenPeople
from armsight.mapping.kernels.pieces import MOST_PIECES, label_pieces
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid
from armsight.mapping.things import LIVELY, LIVELY_VOXELS, MOST_THINGS, SETTLE, STILL, Things

GRID = VoxelGrid(np.zeros(3), 0.02, (60, 60, 50))
STEP = 1.0 / 15
Blob = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
BOX: Blob = ((30, 36), (30, 36), (1, 7))
PERSON: Blob = ((40, 58), (25, 45), (1, 48))  # 36 x 40 x 94 cm: larger than any thing


class Scene:
    """Perfect sight: free everywhere but in what is there and what is said to be hidden."""

    def __init__(self) -> None:
        self.table = np.zeros(GRID.shape, np.uint8)
        self.table[:, :, 0] = 1
        self.things = Things(GRID)
        self.unseen = UnseenPeople(GRID, self.table, 2.0, 0.08)
        self.now = 0.0
        self.people = np.zeros(GRID.shape, bool)

    def look(self, *blobs: Blob, hidden: tuple[Blob, ...] = (), seconds: float = STEP) -> None:
        """Let the scene stand as it is for a while; ``people`` is what counts as such."""
        for _ in range(max(round(seconds / STEP), 1)):
            self.now += STEP
            self._update(blobs, hidden)

    def _update(self, blobs: tuple[Blob, ...], hidden: tuple[Blob, ...]) -> None:
        occupied = np.zeros(GRID.shape, np.uint8)
        state = np.full(GRID.shape, FREE, np.uint8)
        for (a, b), (c, d), (e, f) in hidden:
            state[a:b, c:d, e:f] = UNKNOWN
        for (a, b), (c, d), (e, f) in blobs:
            state[a:b, c:d, e:f] = UNKNOWN  # nobody sees what is inside
            occupied[a:b, c:d, e:f] = 1
            occupied[a + 1 : b - 1, c + 1 : d - 1, e + 1 : f - 1] = 0
        state[occupied != 0] = OCCUPIED
        state[self.table != 0] = OCCUPIED
        listed = np.flatnonzero(occupied).astype(np.int32)
        self.occupied, self.listed = occupied.reshape(-1), listed
        sets = self.unseen.sets
        may = self.things.update(state, listed, listed, self.occupied, sets, self.now)
        self.people = np.zeros(GRID.shape, bool)
        self.people.reshape(-1)[listed[may]] = True
        self.unseen.update(state, listed[may], None, STEP)
        self.unseen.mark_enclosed(state)
        self.things.keep(state)

    def say_empty(self) -> None:
        self.things.begin(self.listed, self.occupied, self.now)
        self.unseen.nobody()

    def is_person(self, blob: Blob) -> bool:
        """Whether what is seen of a blob counts as a person, all of it or none."""
        (a, b), (c, d), (e, f) = blob
        seen = self.occupied.reshape(GRID.shape)[a:b, c:d, e:f] != 0
        counted = self.people[a:b, c:d, e:f][seen]
        assert counted.all() or not counted.any()
        return bool(counted.all())


def moved(blob: Blob, x: int) -> Blob:
    return ((blob[0][0] + x, blob[0][1] + x), blob[1], blob[2])


def with_box() -> Scene:
    scene = Scene()
    scene.look(BOX, seconds=2.0)
    scene.say_empty()
    scene.look(BOX, seconds=2.0)
    assert not scene.is_person(BOX)
    return scene


def test_without_a_word_everything_counts_as_a_person() -> None:
    scene = Scene()
    scene.look(BOX, seconds=30.0)
    assert scene.is_person(BOX)


def test_what_was_there_when_nobody_was_is_a_thing_for_as_long_as_it_rests() -> None:
    scene = with_box()
    scene.look(BOX, seconds=60.0)
    assert not scene.is_person(BOX)


@pytest.mark.parametrize("seconds", [1.0, 60.0])
def test_who_came_in_is_a_person_however_still(seconds: float) -> None:
    scene = with_box()
    scene.look(BOX, PERSON, seconds=seconds)
    assert scene.is_person(PERSON)
    assert not scene.is_person(BOX), "nobody touches it"


def test_a_lone_hand_that_came_by_itself_never_becomes_a_thing() -> None:
    scene = with_box()
    hand: Blob = ((50, 55), (10, 15), (10, 14))
    for x in range(8):
        scene.look(BOX, moved(hand, -x))
    scene.look(BOX, moved(hand, -7), seconds=60.0)
    assert scene.is_person(moved(hand, -7))


@pytest.mark.parametrize("gap", [0, 1])
def test_what_is_touched_is_a_person_at_once(gap: int) -> None:
    scene = with_box()
    arm: Blob = ((36 + gap, 60), (32, 35), (3, 6))
    scene.look(BOX, arm)
    assert scene.is_person(BOX)


def test_who_is_near_without_touching_does_not_end_a_thing() -> None:
    scene = with_box()
    scene.look(BOX, ((40, 60), (32, 35), (3, 6)), seconds=2.0)
    assert not scene.is_person(BOX)


def test_what_moves_is_a_person() -> None:
    scene = with_box()
    for x in range(1, 5):
        scene.look(moved(BOX, x))
    assert scene.is_person(moved(BOX, 4))
    scene.look(moved(BOX, 4), seconds=60.0)
    assert scene.is_person(moved(BOX, 4)), "nobody was seen to leave it there"


def test_noise_of_a_voxel_does_not_end_a_thing() -> None:
    scene = with_box()
    rng = np.random.default_rng(3)
    for _ in range(200):
        specks = []
        for _ in range(30):
            at = [int(rng.integers(low, high)) for low, high in BOX]
            side, axis = int(rng.integers(2)), int(rng.integers(3))
            at[axis] = BOX[axis][1] if side else max(BOX[axis][0] - 1, 1)
            specks.append(((at[0], at[0] + 1), (at[1], at[1] + 1), (at[2], at[2] + 1)))
        scene.look(BOX, *specks)
        assert not scene.people.any()


def test_where_a_thing_was_a_person_counts() -> None:
    """The place is not remembered for ever: somebody may come to stand there."""
    scene = with_box()
    scene.look(seconds=4.0)
    scene.look(BOX)
    assert scene.is_person(BOX)


def held(by: Blob, thing: Blob = BOX) -> tuple[Blob, ...]:
    """A person and a thing, joined by an arm."""
    return by, thing, ((thing[0][1] - 1, by[0][0] + 1), (32, 35), (3, 6))


def test_what_was_put_down_is_a_thing_once_it_rested() -> None:
    scene = Scene()
    scene.look(seconds=2.0)
    scene.say_empty()
    scene.look(*held(PERSON), seconds=2.0)
    assert scene.is_person(BOX)
    scene.look(BOX, PERSON, seconds=STILL + 3 * STEP)
    assert not scene.is_person(BOX)
    assert scene.is_person(PERSON)
    scene.look(BOX, seconds=1.0)
    assert not scene.people.any()


def test_what_is_still_held_by_a_string_or_a_hidden_hand_is_none() -> None:
    scene = Scene()
    scene.look(seconds=2.0)
    scene.say_empty()
    scene.look(*held(PERSON), seconds=2.0)
    string: Blob = ((35, 41), (33, 34), (5, 6))
    scene.look(BOX, PERSON, string, seconds=10.0)
    assert scene.is_person(BOX)
    hand: Blob = ((35, 41), (31, 35), (2, 6))
    scene.look(BOX, PERSON, hidden=(hand,), seconds=10.0)
    assert scene.is_person(BOX)


def test_the_unseen_layer_on_a_table_holds_nobody() -> None:
    """A camera never sees through all of a voxel that lies on a surface."""
    scene = Scene()
    layer: Blob = ((0, 60), (0, 60), (1, 3))
    scene.look(hidden=(layer,), seconds=2.0)
    scene.say_empty()
    scene.look(*held(PERSON), hidden=(layer,), seconds=2.0)
    scene.look(BOX, PERSON, hidden=(layer,), seconds=STILL + 3 * STEP)
    assert not scene.is_person(BOX)


def test_who_stays_behind_crouching_is_too_large_for_a_thing() -> None:
    """Two came, one left: what is left could be the other."""
    scene = Scene()
    scene.look(seconds=2.0)
    scene.say_empty()
    crouching: Blob = ((20, 36), (26, 44), (1, 24))  # 32 x 36 x 46 cm
    scene.look(*held(PERSON, crouching), seconds=2.0)
    scene.look(crouching, seconds=60.0)
    assert scene.is_person(crouching)


def test_a_small_thing_before_a_hollow_that_holds_somebody_is_none() -> None:
    scene = Scene()
    scene.look(seconds=2.0)
    scene.say_empty()
    scene.look(*held(PERSON), seconds=2.0)
    hollow: Blob = ((36, 56), (26, 46), (1, 30))
    scene.look(BOX, hidden=(hollow,), seconds=60.0)
    assert scene.is_person(BOX)


def test_a_thing_that_somebody_unseen_could_push_is_none() -> None:
    """From the map's edge through unseen space to the thing's back: as fast as somebody goes."""
    scene = with_box()
    way: Blob = ((36, 60), (28, 38), (1, 9))
    scene.look(BOX, hidden=(way,))
    assert not scene.is_person(BOX), "not yet there"
    scene.look(BOX, hidden=(way,), seconds=0.5)
    assert scene.is_person(BOX)


def test_what_comes_to_light_where_nobody_could_be_is_a_thing() -> None:
    """Half of a box is hidden, by the arm say, when the cell is said to be empty."""
    scene = Scene()
    shadow: Blob = ((33, 36), (30, 36), (1, 7))
    half: Blob = ((30, 33), (30, 36), (1, 7))
    scene.look(half, hidden=(shadow,), seconds=2.0)
    scene.say_empty()
    scene.look(half, hidden=(shadow,), seconds=2.0)
    scene.look(BOX, seconds=1.0)
    assert not scene.people.any()


def test_what_comes_to_light_beside_somebody_is_none() -> None:
    scene = Scene()
    pocket: Blob = ((44, 50), (30, 36), (1, 7))
    scene.look(hidden=(pocket,), seconds=2.0)
    scene.say_empty()
    scene.look(hidden=(pocket,), seconds=1.0)
    near: Blob = ((55, 60), (25, 45), (1, 40))  # 12 cm away: too far to touch it
    scene.look(pocket, near)
    assert scene.is_person(pocket)


@pytest.mark.parametrize("gap", [STEP, 0.1, 1.0])
def test_what_comes_to_light_after_a_pause_may_have_come_in_the_meantime(gap: float) -> None:
    """A map that stood still for a second knows nothing of who walked into the arm's shadow."""
    scene = Scene()
    pocket: Blob = ((44, 50), (30, 36), (1, 7))
    scene.look(hidden=(pocket,), seconds=2.0)
    scene.say_empty()
    scene.look(hidden=(pocket,), seconds=1.0)
    scene.now += gap - STEP
    scene.look(pocket)
    assert scene.is_person(pocket) == (gap > 0.5)


def test_a_cell_in_which_something_moves_is_not_empty() -> None:
    scene = Scene()
    scene.look(BOX, seconds=2.0)
    assert scene.things.moving(scene.listed, scene.occupied, scene.now) < 0
    scene.look(BOX, PERSON)
    at = scene.things.moving(scene.listed, scene.occupied, scene.now)
    assert np.unravel_index(at, GRID.shape)[0] >= 40


def came_in(scene: Scene) -> int:
    return scene.things.came_in(scene.listed, scene.occupied, scene.unseen.sets)


def test_somebody_who_came_in_and_keeps_still_is_named() -> None:
    """However long they stand; a box that was brought is none, nor is what was there at first."""
    scene = Scene()
    scene.look(PERSON, seconds=2.0)
    assert came_in(scene) < 0, "who was there when the map began is for those to see who look"
    scene = Scene()
    scene.look(seconds=2.0)
    scene.look(BOX, seconds=2.0)
    assert came_in(scene) < 0
    scene.look(BOX, PERSON, seconds=10.0)
    assert scene.things.moving(scene.listed, scene.occupied, scene.now) < 0
    i, j, k = np.unravel_index(came_in(scene), GRID.shape)
    assert 40 <= i < 58
    assert 25 <= j < 45
    assert 1 <= k < 48
    scene.look(BOX, seconds=1.0)
    assert came_in(scene) < 0, "they went"


@pytest.mark.parametrize("hidden", [True, False])
def test_what_comes_to_light_did_not_come_in(hidden: bool) -> None:
    """A cupboard as large as a person, seen when the arm gives way, or pushed in."""
    scene = Scene()
    scene.look(hidden=(PERSON,) if hidden else (), seconds=2.0)
    scene.look(PERSON, seconds=2.0)
    assert (came_in(scene) < 0) == hidden


def test_a_shadow_that_goes_before_somebody_does_not_hide_that_they_came() -> None:
    """What they will stand in is out of sight for some pictures before they are seen there."""
    scene = Scene()
    scene.look(seconds=2.0)
    around: Blob = ((38, 60), (23, 47), (1, 50))
    scene.look(hidden=(around,), seconds=0.3)
    scene.look(PERSON, seconds=3.0)
    assert came_in(scene) >= 0


def test_a_large_thing_that_somebody_touched_did_not_come_in() -> None:
    """It is a person again, as all that is touched; the word a second time makes it a thing."""
    scene = Scene()
    scene.look(PERSON, seconds=2.0)
    scene.say_empty()
    hand: Blob = ((36, 41), (30, 34), (20, 24))
    scene.look(PERSON, seconds=2.0)
    assert not scene.is_person(PERSON)
    scene.look(PERSON, hand, seconds=1.0)
    scene.look(PERSON, seconds=2.0)
    assert scene.is_person(PERSON)
    assert came_in(scene) < 0


def test_a_skin_that_noise_adds_is_the_things_at_first_and_no_longer_after_that() -> None:
    """Of a surface that flickers by a voxel all is known after a second; skin grows no skin."""
    skin: Blob = ((30, 37), (30, 36), (1, 7))
    second: Blob = ((30, 38), (30, 36), (1, 7))
    for wait, known in ((0.5 * SETTLE, True), (1.5 * SETTLE, False)):
        scene = Scene()
        scene.look(BOX, seconds=2.0)
        scene.say_empty()
        scene.look(BOX, seconds=wait)
        scene.look(skin)
        assert not scene.people.any()
        scene.look(second, seconds=2 * STEP)
        assert scene.people.any() != known


def test_what_was_held_a_moment_ago_in_part_is_still_somebodys() -> None:
    """Of a thing one half was let go long ago, the other just now."""
    scene = Scene()
    scene.look(seconds=2.0)
    scene.say_empty()
    scene.look(*held(PERSON), seconds=2.0)
    scene.look(BOX, PERSON, seconds=STILL + 3 * STEP)
    assert not scene.is_person(BOX)
    arm: Blob = ((35, 41), (31, 35), (2, 6))
    scene.look(BOX, PERSON, arm)
    assert scene.is_person(BOX), "it is held again"
    scene.look(BOX, PERSON, seconds=0.5 * STILL)
    assert scene.is_person(BOX)
    scene.look(BOX, PERSON, seconds=0.5 * STILL + 3 * STEP)
    assert not scene.is_person(BOX)


def middles(blob: Blob, count: int) -> np.ndarray:
    """Of some voxels of a blob's near side [m]."""
    (a, _), (c, d), (e, f) = blob
    y, z = np.mgrid[c:d, e:f].reshape(2, -1)
    return (np.stack([np.full(len(y), a), y, z], axis=1)[:count] + 0.5) * GRID.voxel


def test_what_is_known_to_move_by_itself_is_no_thing_for_as_long_as_that_is_said() -> None:
    scene = with_box()
    scene.things.animate(middles(BOX, 20), scene.now)
    scene.look(BOX, seconds=0.5 * LIVELY)
    assert scene.is_person(BOX)
    scene.things.animate(middles(BOX, 20), scene.now)
    scene.look(BOX, seconds=0.9 * LIVELY)
    assert scene.is_person(BOX), "said again"
    scene.look(BOX, seconds=0.1 * LIVELY + STILL + 3 * STEP)
    assert not scene.is_person(BOX), "nobody has said so for long"


def test_a_crumb_of_what_moves_by_itself_does_not_end_a_thing_beside_it() -> None:
    scene = with_box()
    beyond = np.array([[-5.0, 0.0, 0.0], [50.0, 50.0, 50.0]])
    scene.things.animate(np.vstack([middles(BOX, LIVELY_VOXELS - 1), beyond]), scene.now)
    scene.look(BOX, seconds=1.0)
    assert not scene.is_person(BOX)


def test_who_says_that_the_cell_is_empty_does_not_make_a_thing_of_another_arm() -> None:
    scene = Scene()
    scene.look(BOX, seconds=2.0)
    scene.things.animate(middles(BOX, 20), scene.now)
    scene.say_empty()
    scene.look(BOX, seconds=2.0)
    assert scene.is_person(BOX)


def test_more_pieces_than_can_be_told_apart_are_people() -> None:
    """Thousands of pieces at once are noise; one by one as many are things as have a number."""
    steps = (np.arange(1, n - 1, 3) for n in GRID.shape)
    lattice = np.stack(np.meshgrid(*steps, indexing="ij")).reshape(3, -1)
    flat = np.ravel_multi_index(tuple(lattice), GRID.shape).astype(np.int32)
    most = MOST_THINGS - 2
    for count in (most, most + 1, len(flat)):
        scene = Scene()
        listed = flat[:count]
        occupied = np.zeros(int(np.prod(GRID.shape)), np.uint8)
        occupied[listed] = 1
        state = np.where(occupied.reshape(GRID.shape) != 0, OCCUPIED, FREE).astype(np.uint8)
        look = (state, listed, listed, occupied, scene.unseen.sets)
        assert scene.things.update(*look, 1.0).all()
        scene.things.begin(listed, occupied, 1.0)
        assert len(scene.things.solid(listed)) == (count if count <= most else 0)
        for now in (1.1, 1.2):  # what nobody brought is taken for a thing, piece by piece
            may = scene.things.update(*look, now)
            assert (~may).sum() == most


def test_rounds_are_counted_for_months() -> None:
    """The marks of earlier rounds are forgotten before their numbers end."""
    scene = Scene()
    scene.things._round = 2**31 - 20
    scene.look(seconds=2.0)
    scene.say_empty()
    scene.look(*held(PERSON), seconds=2.0)
    scene.look(BOX, PERSON, seconds=STILL + 3 * STEP)
    assert not scene.is_person(BOX)
    assert scene.is_person(PERSON)
    assert scene.things._round < 2**30


def test_numbers_of_pieces_end_before_they_begin_again() -> None:
    """A number that came out as 0 would be given for ever, beyond the end of the queue."""
    shape = np.array([9, 9, 9])
    apart = (np.indices(shape) % 2 == 0).all(axis=0)
    listed = np.flatnonzero(apart).astype(np.int32)
    occupied, core = np.zeros(729, np.uint8), np.zeros(729, np.uint16)
    occupied[listed] = 1
    queue = np.zeros(729, np.int32)
    first = MOST_PIECES - 5
    ended = label_pieces(listed, len(listed), occupied, shape, core, first, queue)
    assert ended == MOST_PIECES
    assert sorted(core[core != 0].tolist()) == list(range(first, MOST_PIECES))

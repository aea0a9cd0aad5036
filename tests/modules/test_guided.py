"""Guided recognition: the guides learn from what was found, say where to look, and never cost the find."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from handeye.modules.guide import Guess, Guide, Imagination, reduced
from handeye.modules.guided import REACHES, Guesses, GuidedRecogniser
from handeye.modules.object_model import ObjectModel
from handeye.modules.recognition import NotSeen, Recogniser, Windows
from handeye.modules.spaces import HeadAngles, ImagePoint
from handeye.modules.window import Image

from . import conftest
from .conftest import Artist, Thing, marker_warp

CUP = Thing(0, 0, (24, 16), ((25, 60, 190),))
HEAD = HeadAngles(0.0, 0.0)
ARM = Thing(0, 0, (40, 12), ((60, 60, 62),), "rectangle")
Pair = tuple[Image, Image]


class Watched(Recogniser):
    """Notes where it was asked to search."""

    def __init__(self) -> None:
        super().__init__()
        self.searched: list[Windows | None] = []

    def see_object(
        self, left: Image, right: Image, name: str, windows: Windows | None = None
    ) -> tuple[ImagePoint, float]:
        self.searched.append(windows)
        return super().see_object(left, right, name, windows)


def model() -> ObjectModel:
    artist = Artist()
    places = ((120, 100), (150, 220), (90, 240), (170, 130))
    return ObjectModel.learn([artist.picture()], [artist.picture([CUP.moved(*place)]) for place in places])


def scene(artist: Artist, random: np.random.Generator) -> Pair:
    """A cup and a hand on an arm somewhere, the same in both pictures but for the disparity."""
    row, column, hand_row, hand_column = random.uniform((150, 120, 60, 120), (190, 260, 90, 260))

    def picture(shift: float) -> Image:
        things = [ARM.moved(hand_row - 40, hand_column - shift), CUP.moved(row, column - shift)]
        plain = artist.picture(things)
        return artist.with_marker(plain, 7, marker_warp(hand_row, hand_column - shift, 15, 0.1, 0.5))

    return picture(0), picture(60)


@pytest.fixture(scope="module", autouse=True)
def drawn_coarsely() -> Iterator[None]:
    """Many pictures, and no fraction of a pixel matters here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conftest, "FINE", 2)
        yield


def rebuilt(guided: GuidedRecogniser) -> None:
    """All guides made anew that are due; some must be."""
    made = 0
    while guided.due:
        guided.rebuild()
        made += 1
    assert made


@pytest.fixture(scope="module")
def taught() -> tuple[GuidedRecogniser, Watched]:
    """Guides that saw thirty scenes."""
    watched = Watched()
    guided = GuidedRecogniser(watched)
    guided.register("cup", model())
    artist, random = Artist(), np.random.default_rng(1)
    assert guided.guesses(*scene(artist, random), "cup") is None
    for _ in range(30):
        guided.see(*scene(artist, random), "cup")
    rebuilt(guided)
    return guided, watched


def test_guesses_are_near_and_trusted(artist: Artist, taught: tuple[GuidedRecogniser, Watched]) -> None:
    (guided, watched), random = taught, np.random.default_rng(2)
    for _ in range(10):
        pair = scene(artist, random)
        for name in ("cup", None):
            said = guided.guesses(*pair, name)
            assert said is not None
            assert said.trusted
            found = (watched.see_hand(*pair) if name is None else watched.see_object(*pair, name))[0]
            assert abs(said.left.row - found.row) < 25
            assert abs(said.left.column - found.column) < 25
            assert abs(said.right.column - (found.column - found.disparity)) < 25


def test_guesses_are_not_trusted_where_the_head_never_pointed(
    artist: Artist, taught: tuple[GuidedRecogniser, Watched]
) -> None:
    """A picture from elsewhere may be like a taught one by chance."""
    (guided, watched), random = taught, np.random.default_rng(5)
    for pan, tilt, known in ((0.0, 0.0, True), (0.03, -0.03, True), (0.06, 0.0, False), (0.0, -0.2, False)):
        pair, head = scene(artist, random), HeadAngles(pan, tilt)
        for name in ("cup", None):
            said = guided.guesses(*pair, name, head)
            assert said is not None
            assert said.trusted is known
        watched.searched.clear()
        guided.see_object(*pair, "cup", head)
        assert (watched.searched[0] is not None) is known


def test_what_is_found_by_guide_is_what_is_found_without(
    artist: Artist, taught: tuple[GuidedRecogniser, Watched]
) -> None:
    guided, watched = taught
    pair = scene(artist, np.random.default_rng(3))
    watched.searched.clear()
    seen = guided.see(*pair, "cup")
    assert watched.searched[0] is not None
    plain = watched.see(*pair, "cup")
    assert seen.object == plain.object
    assert seen.hand.array() == pytest.approx(plain.hand.array(), abs=1e-3)
    assert seen.object_confidence == plain.object_confidence


def misled(guided: GuidedRecogniser, guess: Guess, monkeypatch: pytest.MonkeyPatch) -> None:
    """The guides say `guess`, 30 px to the right and to the left of it."""
    said = itertools.cycle([replace(guess, column=guess.column + shift) for shift in (30, -30)])
    monkeypatch.setattr(Guide, "guess", lambda *_seen: next(said))


@pytest.mark.parametrize(
    ("guess", "searches"),
    [
        (
            lambda row, column: Guess(row - 45, column, 1.0, trusted=True),
            2,
        ),  # in the wide window
        (lambda _row, _column: Guess(10.0, 10.0, 1.0, trusted=True), 3),
        (lambda _row, _column: Guess(-400.0, 900.0, 1.0, trusted=True), 1),  # beyond the picture: there is no window
        (lambda row, column: Guess(row, column, 0.001, trusted=False), 1),
    ],
    ids=["wide window", "200 px off", "out of the picture", "low support"],
)
def test_a_wrong_guess_costs_searches_and_never_the_find(
    artist: Artist,
    taught: tuple[GuidedRecogniser, Watched],
    monkeypatch: pytest.MonkeyPatch,
    guess: Callable[[float, float], Guess],
    searches: int,
) -> None:
    guided, watched = taught
    pair = scene(artist, np.random.default_rng(4))
    whole = watched.see_object(*pair, "cup")
    misled(guided, guess(whole[0].row, whole[0].column - whole[0].disparity / 2), monkeypatch)
    watched.searched.clear()
    assert guided.see_object(*pair, "cup") == whole
    assert len(watched.searched) == searches
    if searches in (1, 3):
        assert watched.searched[-1] is None


def test_guesses_that_cannot_be_one_point_are_not_trusted() -> None:
    sure = Guess(100.0, 100.0, 1.0, trusted=True)
    assert Guesses(sure, sure, agree=True).trusted
    assert not Guesses(sure, sure, agree=False).trusted
    assert not Guesses(sure, Guess(100.0, 100.0, 0.0, trusted=False), agree=True).trusted
    assert tuple(sorted(REACHES)) == REACHES


def test_guides_that_contradict_each_other_are_not_trusted(
    artist: Artist, taught: tuple[GuidedRecogniser, Watched], monkeypatch: pytest.MonkeyPatch
) -> None:
    pair = scene(artist, np.random.default_rng(7))
    said: Iterator[Guess] = iter(())
    monkeypatch.setattr(Guide, "guess", lambda *_seen: next(said))
    for rows, disparity, trusted in ((0, 60, True), (10, 70, True), (40, 60, False), (0, 120, False), (0, 0, False)):
        places = (100, 200), (100 + rows, 200 - disparity)
        said = iter([Guess(float(row), float(column), 1.0, trusted=True) for row, column in places])
        guesses = taught[0].guesses(*pair, "cup")
        assert guesses is not None
        assert guesses.trusted == trusted


def test_absence_lowers_support_and_is_said_of_the_whole_picture(
    artist: Artist, taught: tuple[GuidedRecogniser, Watched]
) -> None:
    guided, watched = taught
    pair = artist.picture(), artist.picture()
    said = guided.guesses(*pair, "cup")
    assert said is not None
    assert not said.trusted
    watched.searched.clear()
    with pytest.raises(NotSeen, match="object 'cup' is not seen in the left picture"):
        guided.see_object(*pair, "cup")
    assert watched.searched == [None]


def test_a_picture_from_elsewhere_has_low_support(artist: Artist, taught: tuple[GuidedRecogniser, Watched]) -> None:
    wall = Thing(120, 60, (120, 60), ((60, 70, 60),), "rectangle")
    cupboard = Thing(60, 250, (60, 60), ((120, 90, 60),), "rectangle")
    left, right = (artist.picture([wall.moved(0, -shift), cupboard.moved(0, -shift)]) for shift in (0, 40))
    said = taught[0].guesses(left, right, None)
    assert said is not None
    assert not said.trusted


def test_an_object_that_is_learned_anew_has_guides_to_learn_anew(artist: Artist) -> None:
    guided = GuidedRecogniser(Recogniser())
    guided.register("cup", model())
    pair = scene(artist, np.random.default_rng(6))
    for number in range(24):
        left, right = (np.roll(image, (3 * (number % 5) - 6, 4 * (number % 7) - 12), (0, 1)) for image in pair)
        guided.see_object(left, right, "cup")
    rebuilt(guided)
    assert guided.guesses(*pair, "cup") is not None
    guided.register("cup", model())
    assert guided.guesses(*pair, "cup") is None
    guided.forget("cup")
    with pytest.raises(KeyError, match="no object named 'cup'"):
        guided.see_object(*pair, "cup")


def test_pictures_of_other_sizes_have_guides_of_their_own(
    artist: Artist, taught: tuple[GuidedRecogniser, Watched]
) -> None:
    larger = artist.picture([CUP.moved(200, 300)], (480, 640)), artist.picture([CUP.moved(200, 240)], (480, 640))
    assert taught[0].guesses(*larger, "cup") is None
    assert taught[0].see_object(*larger, "cup")[0].array() == pytest.approx([200, 300, 60], abs=0.5)
    with pytest.raises(ValueError, match="differ in size"):
        taught[0].see_object(larger[0], artist.picture(), "cup")


def test_a_guide_keeps_so_many_pictures_and_asks_for_time_ever_less_often() -> None:
    guide, random = Guide((240, 320, 3), Imagination(1, 1 / 16)), np.random.default_rng(0)
    built_at = []
    for number in range(600):
        if guide.due:
            built_at.append(number)
            guide.rebuild()
        picture = random.integers(0, 255, (6, 8), dtype=np.uint8)
        guide.teach(picture, float(random.uniform(0, 240)), float(random.uniform(0, 320)), number, HEAD)
    assert built_at == [24, 36, 54, 81, 122, 183, 275, 413, 573]  # by half of what is kept, at most 320
    assert guide.guess(random.integers(0, 255, (6, 8), dtype=np.uint8), HEAD) is not None


@pytest.mark.parametrize(
    ("off", "trusted", "due"), [(0.0, True, False), (15.0, True, False), (25.0, True, True), (0.0, False, True)]
)
def test_what_is_found_where_it_was_expected_is_nothing_new(off: float, trusted: bool, due: bool) -> None:
    guide = Guide((240, 320, 3), Imagination(1, 1 / 16))
    picture = np.arange(48, dtype=np.uint8).reshape(6, 8)
    for number in range(24):
        guide.teach(picture, 100.0 + number, 150.0, number, HEAD)
    guide.rebuild()
    assert not guide.due
    for number in range(12):
        guide.teach(picture, 100.0, 150.0, number, HEAD, Guess(100.0, 150.0 + off, 0.5, trusted=trusted))
    assert guide.due is due


def test_reduced_pictures_have_forty_cells() -> None:
    assert reduced(np.zeros((480, 640, 3), np.uint8)).shape == (30, 40, 3)
    assert reduced(np.zeros((333, 500, 3), np.uint8)).shape == (27, 40, 3)

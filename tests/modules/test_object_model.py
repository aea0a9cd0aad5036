"""Learning and locating objects on drawn pictures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from handeye.modules.object_model import ObjectModel

from .conftest import Artist, Thing

BLUE, RED, YELLOW, GREY, WHITE = (25, 60, 190), (200, 30, 30), (225, 190, 30), (120, 120, 122), (238, 238, 235)
ARM = Thing(30, 160, (28, 12), ((90, 92, 95),), "rectangle")
PLACES = ((120.4, 100.1), (150.0, 220.6), (90.7, 240.3), (170.2, 130.8))


def thing(*colours: tuple[int, int, int], shape: str = "ellipse", half: tuple[float, float] = (24, 16)) -> Thing:
    return Thing(0, 0, half, colours, shape)


def learned(artist: Artist, item: Thing) -> ObjectModel:
    return ObjectModel.learn(
        [artist.picture([ARM]), artist.picture([ARM])], [artist.picture([ARM, item.moved(*place)]) for place in PLACES]
    )


@pytest.fixture(scope="module")
def blue() -> ObjectModel:
    return learned(Artist(), thing(BLUE))


@pytest.mark.parametrize(
    "item",
    [
        thing(BLUE),
        thing(RED, shape="rectangle"),
        thing(YELLOW, BLUE),
        thing(GREY, shape="rectangle", half=(14, 26)),
        thing(WHITE),
    ],
    ids=["blue", "red box", "two colours", "grey, wide", "white on a light table"],
)
def test_any_colour_and_shape_is_located(artist: Artist, item: Thing) -> None:
    found = learned(artist, item).locate(artist.picture([ARM, item.moved(133.3, 171.7)]))
    assert found
    assert [found[0].row, found[0].column] == pytest.approx([133.3, 171.7], abs=0.3)
    assert found[0].size == pytest.approx(item.half, rel=0.08)
    assert found[0].score > 0.9
    assert not found[0].cut


@given(rows=st.floats(-3, 3), columns=st.floats(-3, 3))
@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_shift_of_the_object_shifts_its_reference_point(
    artist: Artist, blue: ObjectModel, rows: float, columns: float
) -> None:
    first = blue.locate(artist.picture([thing(BLUE).moved(120, 160)]))[0]
    second = blue.locate(artist.picture([thing(BLUE).moved(120 + rows, 160 + columns)]))[0]
    assert (second.row - first.row, second.column - first.column) == pytest.approx((rows, columns), abs=0.1)


def test_noise_moves_the_reference_point_by_less_than_a_twentieth_of_a_pixel(artist: Artist, blue: ObjectModel) -> None:
    points = [blue.locate(artist.picture([thing(BLUE).moved(120.4, 160.2)]))[0] for _ in range(12)]
    assert np.std([(point.row, point.column) for point in points], axis=0).max() < 0.05


@pytest.mark.parametrize("scale", [0.85, 1.2])
def test_nearer_and_farther_objects_are_located(artist: Artist, blue: ObjectModel, scale: float) -> None:
    item = thing(BLUE, half=(24 * scale, 16 * scale)).moved(120, 160)
    found = blue.locate(artist.picture([item]))
    assert [found[0].row, found[0].column] == pytest.approx([120, 160], abs=0.2)
    assert found[0].size == pytest.approx(item.half, rel=0.05)


def test_a_finger_before_the_object_hardly_moves_it(artist: Artist, blue: ObjectModel) -> None:
    item = thing(BLUE).moved(120, 160)
    finger = Thing(115, 145, (12, 5), ((50, 50, 52),), "rectangle")
    hidden = artist.picture([item, finger])
    found = blue.locate(hidden)
    columns = np.nonzero((hidden[..., 2] > 150) & (hidden[..., 0] < 80))[1]
    assert abs(found[0].column - 160) < abs(columns.mean() - 160) / 2
    assert [found[0].row, found[0].column] == pytest.approx([120, 160], abs=0.8)
    assert found[0].score < blue.locate(artist.picture([item]))[0].score


def test_a_handle_hardly_moves_it(artist: Artist, blue: ObjectModel) -> None:
    handle = Thing(120, 178, (8, 5), (BLUE,), "rectangle")
    found = blue.locate(artist.picture([thing(BLUE).moved(120, 160), handle]))
    assert [found[0].row, found[0].column] == pytest.approx([120, 160], abs=0.7)


def test_other_things_are_not_the_object(artist: Artist, blue: ObjectModel) -> None:
    others = [thing(RED).moved(100, 80), thing(YELLOW).moved(150, 200), Thing(200, 100, (8, 60), (BLUE,), "rectangle")]
    assert blue.locate(artist.picture([ARM, *others])) == []
    found = blue.locate(artist.picture([ARM, *others, thing(BLUE).moved(120, 260)]))
    assert [round(one.column) for one in found] == [260]


def test_two_of_a_kind_are_both_reported(artist: Artist, blue: ObjectModel) -> None:
    found = blue.locate(artist.picture([thing(BLUE).moved(100, 80), thing(BLUE).moved(140, 220)]))
    assert sorted(round(one.column) for one in found) == [80, 220]


def test_an_object_cut_by_the_border_says_so(artist: Artist, blue: ObjectModel) -> None:
    found = blue.locate(artist.picture([thing(BLUE).moved(120, 5)]))
    assert all(one.cut for one in found)
    found = blue.locate(artist.picture([thing(BLUE).moved(120, 12)]))
    assert found
    assert found[0].cut


def test_pictures_of_both_cameras_may_be_mixed(artist: Artist) -> None:
    item = thing(RED)
    other_view = Thing(40, 60, (36, 20), ((90, 92, 95),), "rectangle")
    model = ObjectModel.learn(
        [artist.picture([other_view]), artist.picture([ARM])],
        [
            artist.picture([ARM, item.moved(120, 100)]),
            artist.picture([other_view, item.moved(121, 180)]),
            artist.picture([ARM, item.moved(160, 220)]),
        ],
    )
    found = model.locate(artist.picture([other_view, item.moved(140, 150)]))
    assert [found[0].row, found[0].column] == pytest.approx([140, 150], abs=0.2)


def test_learning_says_what_is_wrong_with_the_pictures(artist: Artist) -> None:
    empty, full = artist.picture([ARM]), artist.picture([ARM, thing(BLUE).moved(120, 100)])
    with pytest.raises(ValueError, match="at least one picture without it"):
        ObjectModel.learn([], [full])
    with pytest.raises(ValueError, match="at least one picture without it"):
        ObjectModel.learn([empty], [])
    with pytest.raises(ValueError, match=r"example 2: .* nothing of at least"):
        ObjectModel.learn([empty], [full, artist.picture([ARM])])
    with pytest.raises(ValueError, match="more than a fifth"):
        ObjectModel.learn([empty], [255 - empty])
    with pytest.raises(ValueError, match="cut by the picture's border"):
        ObjectModel.learn([empty], [artist.picture([ARM, thing(BLUE).moved(120, 5)])])
    with pytest.raises(ValueError, match="same size"):
        ObjectModel.learn([empty], [full[:200]])

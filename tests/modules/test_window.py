"""Searching in a window of a picture finds what searching the whole picture finds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from handeye.modules.marker import Marker
from handeye.modules.object_model import ObjectModel
from handeye.modules.window import Image, Window

from .conftest import SIZE, Artist, Thing, marker_warp

CUP = Thing(0, 0, (24, 16), ((25, 60, 190),))
PLACES = ((120.4, 100.1), (150.0, 220.6), (90.7, 240.3), (170.2, 130.8))
REACH = 30

quick = settings(
    max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
off_by = st.floats(-REACH + 1, REACH - 1)


@pytest.fixture(scope="module")
def cup() -> ObjectModel:
    artist = Artist()
    return ObjectModel.learn([artist.picture()], [artist.picture([CUP.moved(*place)]) for place in PLACES])


@given(row=st.floats(0, 239), column=st.floats(0, 319), rows=off_by, columns=off_by)
@quick
def test_the_object_is_found_as_in_the_whole_picture(
    artist: Artist, cup: ObjectModel, row: float, column: float, rows: float, columns: float
) -> None:
    picture = artist.picture([CUP.moved(row, column)])
    window = Window.around(row + rows, column + columns, REACH + 6, SIZE)
    whole = cup.locate(picture)
    found = [] if window is None else cup.locate(picture, window)
    # At the border the best place for a cut silhouette may lie beyond the window; nothing else may be said then.
    for one in found:
        assert one in whole
    if whole and not whole[0].cut:
        assert found == whole


@given(row=st.floats(40, 200), column=st.floats(40, 280), rows=off_by, columns=off_by)
@quick
def test_the_marker_is_found_as_in_the_whole_picture(
    artist: Artist, row: float, column: float, rows: float, columns: float
) -> None:
    marker = Marker(7)
    picture = artist.with_marker(artist.picture(), 7, marker_warp(row, column, 15, 0.2, 0.5))
    window = Window.around(row + rows, column + columns, REACH, SIZE)
    whole, found = marker.locate(picture), marker.locate(picture, window)
    assert whole is not None
    assert found is not None
    assert (found.row, found.column) == pytest.approx((whole.row, whole.column), abs=1e-3)
    np.testing.assert_allclose(found.outline, whole.outline, atol=0.02)
    assert found.correlation == pytest.approx(whole.correlation, abs=1e-4)


def test_what_lies_beyond_a_window_is_not_found_in_it(artist: Artist, cup: ObjectModel) -> None:
    picture = artist.with_marker(artist.picture([CUP.moved(150, 250)]), 7, marker_warp(60, 250, 15, 0.1, 0.5))
    elsewhere = Window(20, 20, 200, 120)
    assert cup.locate(picture, elsewhere) == []
    assert Marker(7).locate(picture, elsewhere) is None


def test_of_two_of_a_kind_the_one_in_the_window_is_found(artist: Artist, cup: ObjectModel) -> None:
    picture = artist.picture([CUP.moved(100, 80), CUP.moved(140, 220)])
    window = Window.around(140, 220, REACH, SIZE)
    assert window is not None
    assert [round(one.column) for one in cup.locate(picture, window)] == [220]


def test_a_window_at_the_border_is_as_far_as_the_picture_reaches() -> None:
    assert Window.around(2.5, 318.0, 10, SIZE) == Window(0, 308, 14, 320)
    assert Window.around(-40, 100, 30, SIZE) is None
    assert Window(0, 0, 10, 20).grown(5, SIZE) == Window(0, 0, 15, 25)
    picture: Image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    assert Window(1, 2, 3, 4).of(picture).shape == (2, 2, 3)

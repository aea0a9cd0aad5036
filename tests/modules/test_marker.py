"""The hand's marker on drawn pictures whose sub-pixel truth is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from handeye.modules.marker import Marker

from .conftest import Artist, marker_warp

quick = settings(
    max_examples=15, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def marker() -> Marker:
    return Marker(7)


@given(
    row=st.floats(60, 180),
    column=st.floats(60, 260),
    half=st.floats(12, 20),
    turn=st.floats(-0.6, 0.6),
    oblique=st.floats(0, 0.78),
)
@quick
def test_centre_is_found_to_a_tenth_of_a_pixel(
    artist: Artist, marker: Marker, row: float, column: float, half: float, turn: float, oblique: float
) -> None:
    picture = artist.with_marker(artist.picture(), 7, marker_warp(row, column, half, turn, oblique))
    found = marker.locate(picture)
    assert found is not None
    assert [found.row, found.column] == pytest.approx([row, column], abs=0.1)
    assert found.correlation > 0.95


def test_scatter_is_far_below_that_of_refined_corners(artist: Artist, marker: Marker) -> None:
    random = np.random.default_rng(3)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    aligned, corners = [], []
    for _ in range(25):
        row, column = random.uniform(80, 160), random.uniform(80, 240)
        picture = artist.with_marker(artist.picture(), 7, marker_warp(row, column, 14, random.uniform(-0.2, 0.2), 0.5))
        found = marker.locate(picture)
        assert found is not None
        aligned.append((found.row - row, found.column - column))
        grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        quads, _, _ = detector.detectMarkers(grey)
        if quads:
            stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01)
            x, y = cv2.cornerSubPix(grey, quads[0].reshape(-1, 1, 2), (3, 3), (-1, -1), stop)[:, 0].mean(axis=0)
            corners.append((y - row, x - column))
    assert np.std(aligned, axis=0).max() < 0.04
    assert np.std(aligned, axis=0).max() < np.std(corners, axis=0).min() / 2


@given(shift=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)))
@quick
def test_shift_of_the_picture_shifts_the_centre(artist: Artist, marker: Marker, shift: tuple[float, float]) -> None:
    first = marker.locate(artist.with_marker(artist.picture(), 7, marker_warp(100, 150, 15, 0.2, 0.6)))
    second = marker.locate(
        artist.with_marker(artist.picture(), 7, marker_warp(100 + shift[0], 150 + shift[1], 15, 0.2, 0.6))
    )
    assert first is not None
    assert second is not None
    moved = (second.row - first.row, second.column - first.column)
    assert moved == pytest.approx(shift, abs=0.08)


def test_outline_holds_the_black_square(artist: Artist, marker: Marker) -> None:
    found = marker.locate(artist.with_marker(artist.picture(), 7, marker_warp(100, 150, 15, 0.0, 0.0)))
    assert found is not None
    low, high = found.outline.min(axis=0), found.outline.max(axis=0)
    # half a module of white margin on each side: 15 px / 6
    assert low == pytest.approx([100 - 17.5, 150 - 17.5], abs=0.3)
    assert high == pytest.approx([100 + 17.5, 150 + 17.5], abs=0.3)


def test_other_markers_and_none_are_not_the_hand(artist: Artist, marker: Marker) -> None:
    assert marker.locate(artist.picture()) is None
    assert marker.locate(artist.with_marker(artist.picture(), 8, marker_warp(100, 150, 15, 0.1, 0.3))) is None
    assert Marker(8).locate(artist.with_marker(artist.picture(), 8, marker_warp(100, 150, 15, 0.1, 0.3))) is not None


def test_half_hidden_marker_is_not_seen(artist: Artist, marker: Marker) -> None:
    picture = artist.with_marker(artist.picture(), 7, marker_warp(100, 150, 15, 0.1, 0.3))
    picture[98:125, 125:180] = 90
    assert marker.locate(picture) is None


def test_unknown_number_is_refused() -> None:
    with pytest.raises(ValueError, match="0 to 49"):
        Marker(50)

"""Arrays on their way: what was sent is what arrives, and damage is noticed."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from handeye.client import UnexpectedAnswer, WrongArrays, _arrays
from handeye.client._arrays import QueryAnswers
from handeye.client._foreign import readable

finite = st.floats(allow_nan=False, allow_infinity=False)
names = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=8)


@st.composite
def taught(draw: st.DrawFn) -> tuple[NDArray[np.float64], NDArray[np.float64], list[str] | None]:
    count, ins, outs = draw(st.integers(1, 12)), draw(st.integers(1, 5)), draw(st.integers(1, 3))
    labels = draw(st.none() | st.lists(names, min_size=count, max_size=count))
    return (
        draw(hnp.arrays(np.float64, (count, ins), elements=finite)),
        draw(hnp.arrays(np.float64, (count, outs), elements=finite)),
        labels,
    )


@given(taught())
def test_samples_arrive_as_they_were_to_the_last_bit(
    given_samples: tuple[NDArray[np.float64], NDArray[np.float64], list[str] | None],
) -> None:
    inputs, outputs, labels = given_samples
    samples = _arrays.samples(inputs, outputs, labels)
    pieces = [_arrays.decode(_arrays.encode_samples(samples, part)) for part in _arrays.batches(inputs, outputs)]
    assert np.concatenate([piece["inputs"] for piece in pieces]).tobytes() == inputs.tobytes()
    assert np.concatenate([piece["outputs"] for piece in pieces]).tobytes() == outputs.tobytes()
    if labels is None:
        assert all("demonstrations" not in piece for piece in pieces)
    else:
        assert np.concatenate([piece["demonstrations"] for piece in pieces]).tolist() == labels


def answers_of(count: int, near: int, outs: int, labels: list[str], random: np.random.Generator) -> dict[str, Any]:
    return {
        "outputs": random.normal(size=(count, outs)),
        "support": random.uniform(size=count),
        "expected_error": random.uniform(size=(count, outs)),
        "samples": random.integers(-1, 100, (count, near)),
        "distances": random.uniform(size=(count, near)),
        "weights": random.uniform(size=(count, near)),
        "demonstrations": random.integers(-1, len(labels), (count, near)),
        "names": np.array(labels, dtype=np.str_),
    }


shapes = st.tuples(st.integers(1, 6), st.integers(0, 5), st.integers(1, 3))


@given(shapes, st.lists(names, max_size=4, unique=True), st.integers(0, 2**32 - 1))
def test_answers_arrive_with_names(shape: tuple[int, int, int], labels: list[str], seed: int) -> None:
    arrays = answers_of(*shape, labels, np.random.default_rng(seed))
    answers = _arrays.decode_answers(_arrays.encode(arrays))
    assert np.array_equal(answers.outputs, arrays["outputs"])
    assert np.array_equal(answers.samples, arrays["samples"])
    expected = [["" if i < 0 else labels[i] for i in row] for row in arrays["demonstrations"]]
    assert answers.demonstrations.tolist() == expected


@given(shapes, st.integers(1, 4))
def test_parts_are_joined_in_order(shape: tuple[int, int, int], parts: int) -> None:
    random = np.random.default_rng(0)
    count, near, outs = shape
    pieces = [
        _arrays.decode_answers(_arrays.encode(answers_of(count, near + i, outs, ["a"], random))) for i in range(parts)
    ]
    whole = _arrays.join(pieces)
    assert len(whole) == parts * count
    for i, piece in enumerate(pieces):
        rows = slice(i * count, (i + 1) * count)
        assert np.array_equal(whole.samples[rows, : near + i], piece.samples)
        assert (whole.samples[rows, near + i :] == -1).all()
        assert (whole.demonstrations[rows, near + i :] == "").all()


@settings(max_examples=300)
@given(st.integers(0, 10_000), st.integers(1, 255), st.booleans())
def test_damage_is_noticed_as_what_it_is(position: int, change: int, cut: bool) -> None:
    whole = bytearray(_arrays.encode(answers_of(3, 2, 1, ["a", "b"], np.random.default_rng(1))))
    position %= len(whole)
    if cut:
        del whole[position:]
    else:
        whole[position] ^= change
    try:
        with readable("http://coordinator"):
            answers = _arrays.decode_answers(bytes(whole))
    except UnexpectedAnswer:
        return
    assert isinstance(answers, QueryAnswers)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("support", np.ones(2)),
        ("weights", np.ones((3, 1))),
        ("expected_error", np.ones((3, 2))),
        ("demonstrations", np.full((3, 2), 2)),
        ("demonstrations", np.full((3, 2), -2)),
        ("outputs", np.ones(3)),
    ],
)
def test_answers_that_do_not_fit_are_noticed(name: str, value: NDArray[Any]) -> None:
    arrays = answers_of(3, 2, 1, ["a", "b"], np.random.default_rng(1)) | {name: value}
    with pytest.raises((ValueError, LookupError)):
        _arrays.decode_answers(_arrays.encode(arrays))


def test_nothing_is_unpickled() -> None:
    file = io.BytesIO()
    np.savez(file, outputs=np.array([{"not": "numbers"}], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle=False"):
        _arrays.decode_answers(file.getvalue())
    file = io.BytesIO()
    np.save(file, np.array([{}], dtype=object))
    with pytest.raises(ValueError, match="Object arrays"):
        _arrays.decode_image(file.getvalue())


def test_a_picture_has_three_colours() -> None:
    file = io.BytesIO()
    np.save(file, np.zeros((4, 5), np.uint8))
    with pytest.raises(ValueError, match=r"\(rows, columns, 3\)"):
        _arrays.decode_image(file.getvalue())


@pytest.mark.parametrize("values", [[[1.0]], [np.nan], ["a"], 1.0, [[1.0], 2.0]])
def test_what_is_no_row_of_numbers_moves_nothing(values: Any) -> None:
    with pytest.raises(WrongArrays, match="joints must be"):
        _arrays.vector(values, "joints")

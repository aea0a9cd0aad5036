"""What demonstrations imply beyond what was shown: the object might have stood elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from handeye.modules import asm
from handeye.modules.module import Module
from handeye.modules.spaces import HeadAngles
from handeye.server.demonstration import Action, Demonstration, Observation
from handeye.server.pairs import Pairs, pairs
from tests.modules.hands import FACING, WAY, look, metric_css, turned

HEAD = HeadAngles(0.1, -0.5)
HANDS = [
    (np.array([0.0, 0.0, 1.0]), FACING),
    (np.array([0.05, -0.02, 0.95]), turned((0.0, 0.2, 0.0)) @ FACING),
    (np.array([-0.04, 0.03, 1.05]), turned((0.1, 0.0, -0.1)) @ FACING),
]
"""Places and axes of the hand in three looks; in the last one it is where it has to be."""
SUBTASKS: dict[str, tuple[str, Action | None]] = {
    "grasp": ("cup", "close_gripper"),
    "hold": ("cup", None),
    "deliver": ("jar", "open_gripper"),
    "leave": ("cup", None),
}

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def css() -> Module:
    return metric_css()


def joints(number: int) -> Array:
    return np.full(6, 0.1 * number**2)


def shown(head: HeadAngles | None = HEAD) -> Demonstration:
    """The same three looks in each subtask."""
    observations = [
        Observation(0, subtask, towards, 1.0, look(*hand), joints(number), number == len(HANDS) - 1, False, head)
        for subtask, (towards, _) in SUBTASKS.items()
        for number, hand in enumerate(HANDS)
    ]
    return Demonstration(
        id="one",
        task="task",
        object="cup",
        observations=tuple(replace(each, number=number) for number, each in enumerate(observations)),
        actions={subtask: action for subtask, (_, action) in SUBTASKS.items() if action},
        finished=True,
        outcome=None,
        created=0.0,
    )


def taught(css: Module, demonstration: Demonstration, *, key_only: bool = False) -> Pairs:
    return pairs([demonstration], demonstration.subtasks, css, key_only=key_only)


def counts(found: Pairs) -> list[int]:
    return [int(np.sum(found.inputs[:, 0] == code)) for code in range(len(SUBTASKS))]


def test_had_the_object_stood_elsewhere_the_hand_would_have_gone_there(css: Module) -> None:
    found = taught(css, shown())
    for start, (place, axes) in enumerate(HANDS):
        for end, (there, there_axes) in enumerate(HANDS):
            way = axes.T @ (there + there_axes @ WAY - place)
            turn = joints(end) - joints(start)
            expected = np.concatenate([[0.0], way, joints(start), turn])
            off = np.abs(np.column_stack([found.inputs, found.outputs]) - expected).max(axis=1)
            assert off.min() < 3e-3  # CSS is not exact


def test_nothing_is_implied_of_what_is_in_the_grip(css: Module) -> None:
    """It hangs in the hand, and a look at it tells whether it still does."""
    implied = counts(taught(css, shown()))
    assert implied[0] == implied[2] == implied[3] > len(HANDS)
    assert implied[1] == len(HANDS)


def test_nothing_is_implied_when_it_is_not_known_where_the_head_was(css: Module) -> None:
    assert counts(taught(css, shown(head=None))) == [len(HANDS)] * 4


def test_nothing_is_implied_between_looks_from_which_the_head_has_turned(css: Module) -> None:
    still = shown()
    observations = [replace(each, head=HeadAngles(0.01 * each.number, -0.5)) for each in still.observations]
    found = taught(css, replace(still, observations=tuple(observations)))
    assert not np.any(found.outputs[len(observations) :])


def test_the_thesiss_bare_pairs_are_bare(css: Module) -> None:
    demonstration = shown()
    keyed = tuple(replace(each, key=True) for each in demonstration.observations)
    assert counts(taught(css, replace(demonstration, observations=keyed), key_only=True)) == [len(HANDS)] * 4


def test_several_demonstrations_imply_less_each(css: Module) -> None:
    demonstration = shown()
    many = pairs([demonstration] * 8, demonstration.subtasks, css, key_only=False)
    alone = taught(css, demonstration)
    assert len(many.inputs) / 8 < len(alone.inputs)


def test_in_the_picture_nothing_is_implied() -> None:
    demonstration = shown()
    found = pairs([demonstration], demonstration.subtasks, key_only=False)
    assert counts(found) == [len(HANDS)] * 4
    np.testing.assert_allclose(found.inputs[0, 1:4], asm.in_picture(look(*HANDS[0])).array())

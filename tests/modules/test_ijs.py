"""The IJS declaration, and what it is worth in a closed loop with a small arm and two cameras, both invented here."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from handeye.modules import ijs
from handeye.modules.declaration import ApproximatorSettings
from handeye.modules.module import Module
from handeye.modules.spaces import ImageVector, JointAngles

Floats = NDArray[np.float64]


def test_the_declaration_is_the_thesis_module() -> None:
    names = [component.name for component in ijs.DECLARATION.inputs]
    assert names[:4] == ["subtask", "delta row", "delta column", "delta disparity"]
    assert names[4:] == [f"joint {i}" for i in range(1, 7)]
    assert [output.name for output in ijs.DECLARATION.outputs] == [f"delta joint {i}" for i in range(1, 7)]
    assert [component.categorical for component in ijs.DECLARATION.inputs] == [True] + [False] * 9
    assert [component.unit for component in ijs.DECLARATION.inputs] == [""] + ["px"] * 3 + ["rad"] * 6
    assert {output.unit for output in ijs.DECLARATION.outputs} == {"rad"}


def test_the_input_vector_has_the_declared_order() -> None:
    vector = ijs.input_vector(2, ImageVector(3, 4, 5), JointAngles(np.arange(6.0)))
    assert vector.tolist() == [2, 3, 4, 5, 0, 1, 2, 3, 4, 5]


def test_there_are_settings_for_every_method() -> None:
    methods = get_args(ApproximatorSettings.model_fields["method"].annotation)
    assert set(ijs.APPROXIMATORS) == set(methods)
    assert ijs.DECLARATION.approximator == ijs.APPROXIMATORS["local_quadratic"]


# --- a closed loop --------------------------------------------------------------------------------------------------

CENTRE = np.array([0.6, 0.0, 0.05])
MARKER = np.array([0.0, 0.0, 0.08])
PARK = np.array([0.0, 1.9, -2.2, 0.0, 0.0, 0.0])


def hand(joints: Floats) -> Floats:
    """Where the hand is, m: two links of 0.45 m on a turning shoulder 0.3 m above the table; joints 4 to 6 are idle."""
    azimuth, shoulder, elbow = joints[..., 0], joints[..., 1], joints[..., 2]
    reach = 0.45 * np.cos(shoulder) + 0.45 * np.cos(shoulder + elbow)
    height = 0.3 + 0.45 * np.sin(shoulder) + 0.45 * np.sin(shoulder + elbow)
    return np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth), height], axis=-1)


def posture(point: Floats) -> Floats:
    """The joints that bring the hand to `point`, elbow up."""
    reach, height = np.hypot(point[0], point[1]), point[2] - 0.3
    length = np.hypot(reach, height)
    bend = np.arccos(length / 0.9)
    return np.array([np.arctan2(point[1], point[0]), np.arctan2(height, reach) + bend, -2 * bend, 0, 0, 0])


def seen(point: Floats) -> Floats:
    """(row, column, disparity) in two cameras 0.3175 m apart, 0.8 m in front of the workspace and 0.6 m above."""
    forward = np.array([-0.8, 0.0, -0.6])
    right, down = np.array([0.0, 1.0, 0.0]), np.array([-0.6, 0.0, 0.8])
    offset = point - (CENTRE - 1.0 * forward)
    depth = offset @ forward
    return np.array([-600 * (offset @ down) / depth, 600 * (offset @ right) / depth, 600 * 0.3175 / depth])


def look(cup: Floats, joints: Floats, rng: np.random.Generator) -> Floats:
    """IJS's input with 0.1 px of noise. What is seen of the hand lies 8 cm above its point."""
    vector = seen(cup) - seen(hand(joints) + MARKER) + rng.normal(0, 0.1, 3)
    return ijs.input_vector(0, ImageVector(*vector), JointAngles(joints))


def place(rng: np.random.Generator) -> Floats:
    return CENTRE + rng.uniform([-0.15, -0.15, 0.0], [0.15, 0.15, 0.0])


def taught(method: ApproximatorSettings | None = None) -> Module:
    """Ten demonstrations: the way from park to the cup and ten small motions around it."""
    rng = np.random.default_rng(1)
    inputs, outputs, names = [], [], []
    for demonstration in range(10):
        cup = place(rng)
        goal = posture(cup)
        way = [PARK + share * (goal - PARK) for share in np.linspace(0, 1, 5)]
        small = [posture(cup + rng.uniform(-0.02, 0.02, 3)) for _ in range(10)]
        for joints in [*way, *small]:
            inputs.append(look(cup, joints, rng))
            outputs.append(goal - joints)
            names.append(str(demonstration))
    declaration = ijs.DECLARATION
    if method is not None:
        declaration = declaration.model_copy(update={"approximator": method})
    module = Module(declaration)
    module.train(inputs, outputs, names)
    return module


def misses(module: Module) -> tuple[Floats, list[float]]:
    """How far the hand is from new cups after six looks, m; and the support of every look."""
    rng = np.random.default_rng(2)
    found, supports = [], []
    for _ in range(25):
        cup, joints = place(rng), PARK.copy()
        for _ in range(6):
            answer = module.answer(look(cup, joints, rng))
            joints = joints + answer.output
            supports.append(answer.support)
        found.append(float(np.linalg.norm(hand(joints) - cup)))
    return np.array(found), supports


def test_it_reaches_new_places_in_a_closed_loop() -> None:
    found, supports = misses(taught())
    assert np.median(found) < 0.002
    assert found.max() < 0.008
    assert min(supports) > 0.25


def test_its_defaults_beat_the_thesis_s_approximator() -> None:
    found, _ = misses(taught(ijs.APPROXIMATORS["kndb"]))
    assert np.median(found) > 0.005


def test_a_cup_far_outside_has_little_support() -> None:
    module, rng = taught(), np.random.default_rng(3)
    far = np.array([0.5, 0.65, 0.05])
    answer = module.answer(look(far, posture(far), rng))
    assert answer.support < 0.35


def test_a_subtask_that_was_not_shown_is_an_error() -> None:
    with pytest.raises(ValueError, match="subtask"):
        taught().answer(ijs.input_vector(1, ImageVector(0, 0, 0), JointAngles(PARK)))

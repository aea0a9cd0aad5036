from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from handeye.simulation import puma
from handeye.simulation.motion import JointMotion
from handeye.simulation.scene import STEP

joints = hnp.arrays(np.float64, 6, elements=st.floats(-1.5, 1.5))
shares = st.floats(0.1, 1.0)


def walk(motion: JointMotion, start: NDArray[np.float64], brake_at: int = -1) -> NDArray[np.float64]:
    path = [start]
    while not motion.finished:
        if len(path) == brake_at:
            motion.brake()
        path.append(motion.advance())
    return np.array(path)


@settings(max_examples=60, deadline=None)
@given(joints, joints, shares, shares)
def test_motion_keeps_its_limits_and_arrives(
    start: NDArray[np.float64], goal: NDArray[np.float64], speed: float, acceleration: float
) -> None:
    motion = JointMotion(start, goal, speed_share=speed, acceleration_share=acceleration, step=STEP)
    path = walk(motion, start)
    np.testing.assert_allclose(path[-1], goal, atol=1e-12)
    assert motion.fraction == 1.0
    velocity = np.diff(path, axis=0) / STEP
    assert np.all(np.abs(velocity) <= speed * puma.SPEED * (1 + 1e-9) + 1e-9)
    still = np.zeros((1, 6))
    change = np.diff(np.concatenate([still, velocity, still]), axis=0) / STEP
    assert np.all(np.abs(change) <= acceleration * puma.ACCELERATION * (1 + 1e-6) + 1e-6)


@settings(max_examples=60, deadline=None)
@given(joints, joints, st.floats(0.05, 0.95))
def test_brake_stays_on_the_path_within_the_limits(
    start: NDArray[np.float64], goal: NDArray[np.float64], when: float
) -> None:
    motion = JointMotion(start, goal, speed_share=1.0, acceleration_share=1.0, step=STEP)
    path = walk(motion, start, brake_at=max(1, int(when * motion.duration / STEP)))
    delta = goal - start
    length = np.linalg.norm(delta)
    if length < 1e-6:
        return
    share = (path - start) @ delta / length**2
    np.testing.assert_allclose(path, start + share[:, None] * delta, atol=1e-9)
    assert share.max() <= 1 + 1e-9
    assert np.all(np.diff(share) >= -1e-12)
    change = np.diff(np.diff(path, axis=0), axis=0) / STEP**2
    # The last step of a brake ends inside a step.
    assert np.all(np.abs(change) <= puma.ACCELERATION * (1 + 1e-6) + 1e-6)


def test_motion_of_no_length_is_over_at_once() -> None:
    motion = JointMotion(np.ones(6), np.ones(6), speed_share=1, acceleration_share=1, step=STEP)
    assert motion.finished
    motion.brake()
    assert motion.finished
    assert np.array_equal(motion.advance(), np.ones(6))

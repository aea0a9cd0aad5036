"""What an acting task may do to robot and head, and the bounds within which it does it."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from handeye.camera_bridge.driver import Course, HeadDriver, HeadState, Tick
from handeye.modules.spaces import HeadAngles, JointDifference
from handeye.robot_bridge.driver import Joints, Pace, RobotDescription, RobotState, Watch
from handeye.rpc.errors import Busy, OutOfLimits
from handeye.server.problem import Conflict

_LEAST_PACE = 0.001  # of `Pace`
_LONGEST_ADVANCE = 60.0  # s that a bridge lets pass by one command
_TURN_LIMIT = 30.0  # s that the head may take to turn
_FOLLOW_LIMIT = 2.0  # s that the head may take to answer when it is not waited for
_REST_STEP = 0.05  # s of world time to wait before asking again whether the arm has come to rest
_REST_LIMIT = 2.0  # s of world time after which an arm that still moves is an error
_PEAK = 1.875  # greatest by mean speed of a smooth motion (minimum jerk: Flash and Hogan, 1985)


class OutsideTaughtRegion(Conflict):
    """The query lies where nothing was taught: the arm holds instead of guessing."""

    code = "outside_taught_region"


class ActingSettings(BaseModel):
    """How an acting task looks and moves."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    max_looks: int = Field(default=8, ge=1)
    """Looks per subtask before it gives up, or goes on with what is acceptable."""
    tolerance: float = Field(default=0.0015, gt=0.0)
    """A subtask is aligned when no joint of the answer is larger, in rad."""
    last_tolerance: float = Field(default=0.01, gt=0.0)
    """The same for the last subtask if it has neither a way nor a gripper action (the lift): nothing follows that its
    error could spoil."""
    noise: float = Field(default=0.012, ge=0.0)
    """Answers of one subtask that would have no joint elsewhere by more than this, in rad, are taken for one goal that
    was seen several times: the arm goes to their mean. The further an answer goes beyond this, the less it weighs."""
    acceptable: float = Field(default=0.006, gt=0.0)
    """When the looks have run out, way and gripper still follow if no joint of the last answer was larger, in rad: then
    it is noise that keeps the answers above the tolerance, and looking longer would not help. Where the arm is
    stretched out, so that what it turned brought the hand nowhere, five times as much will do."""
    thinking: float = Field(default=0.05, ge=0.0)
    """World time that each look is charged in lockstep, in s: thinking is not free there either."""
    settle: float = Field(default=0.02, ge=0.0)
    """World time waited beyond the cameras' latency, in s: the right picture is taken a little after the left."""
    least_support: float = Field(default=0.2, ge=0.0, le=1.0)
    """An answer with less support lies outside the taught region: the task holds."""
    largest_move: float = Field(default=2.5, gt=0.0)
    """No joint is turned further by one answer, in rad; an answer that asks for more is wrong."""
    hold: float = Field(default=2.5, ge=0.0)
    """World time waited after the last subtask, in s."""
    attempts: int = Field(default=3, ge=1)
    """How often a task is begun. It is begun again where it began when what is seen in a later subtask is not what was
    taught: the object was moved, or has slipped in the hand or out of it. What is held is put back before."""
    least_grip: float = Field(default=0.002, ge=0.0)
    """A gripper that has closed further than this holds nothing, in m."""
    grip_slack: float = Field(default=0.005, gt=0.0)
    """A gripper that has closed on by so much since it gripped has lost what it held, in m."""
    slip_slack: float = Field(default=0.0008, gt=0.0)
    """By so much it closes on when what it holds begins to slip, in m: then it is let go, before it is pinched away."""
    pace: float = Field(default=0.5, ge=_LEAST_PACE, le=1.0)
    """Share of the joints' speed and acceleration limits."""


class LeasedRobot(Protocol):
    """What the acting side holds of a robot; `handeye.robot_bridge.remote.RemoteRobot` has it, and more.

    Moves need the control lease. There is no way from here to *move to point*, *move to joints* or *park*: a task acts
    by what it was taught, not by inverse kinematics.
    """

    @property
    def description(self) -> RobotDescription:
        """What the robot is; does not change."""
        ...

    @property
    def lease_id(self) -> str:
        """The secret of the lease that is held, for the head's turns; empty without one."""
        ...

    def lease(self) -> AbstractContextManager[None]:
        """Holds the control lease; `Busy` while another holder is alive."""
        ...

    def beat(self) -> None:
        """Shows that the lease holder lives: a lease that is silent for too long may be taken over."""
        ...

    def state(self) -> RobotState:
        """The newest state; answers also while a motion is under way."""
        ...

    def adjust_joints(
        self, delta: Joints, pace: Pace = ..., watch: Watch = ..., least_opening: float = ...
    ) -> RobotState:
        """Changes the joints by `delta` (rad); `Slipping` if the gripper is closed further than `least_opening` (m)."""
        ...

    def open_gripper(self, watch: Watch = ...) -> RobotState:
        """Opens the gripper fully."""
        ...

    def close_gripper(self, watch: Watch = ...) -> RobotState:
        """Closes the gripper until the fingers meet something or each other."""
        ...

    def advance(self, duration: float, watch: Watch = ...) -> RobotState:
        """Lets `duration` s of world time pass while the arm holds still."""
        ...

    def stop(self, reason: str = ...) -> RobotState:
        """Brakes a motion under way, from another thread too, and latches the software stop."""
        ...

    def reset(self) -> RobotState:
        """Clears the software stop; the next move is ramped."""
        ...


def too_far(answered: str, turn: JointDifference, most: float) -> OutOfLimits | None:
    """Why the arm is not moved by an answer that turns a joint by more than `most` rad; None when it may be.

    `answered`: whose answer it is, for the sentence.
    """
    joint = int(np.argmax(np.abs(turn.angles)))
    largest = float(abs(turn.angles[joint]))
    if largest <= most:  # not true of nan
        return None
    return OutOfLimits(
        f"The answer of {answered} would turn joint {joint + 1} by {largest:.2f} rad; one answer may turn a joint by "
        f"{most:.2f} rad at most."
    )


class ActingRobot:
    """A robot as an acting task sees it: it adjusts joints, moves the gripper, waits and stops. Nothing else.

    `watch` is called at every control step; raising from it brakes the arm.
    """

    __slots__ = ("__driver", "__pace", "__watch")

    def __init__(self, driver: LeasedRobot, watch: Watch, pace: Pace) -> None:
        self.__driver = driver
        self.__watch = watch
        self.__pace = pace

    @property
    def lockstep(self) -> bool:
        """World time passes only while the robot moves or waits."""
        return self.__driver.description.clock == "lockstep"

    def beat(self) -> None:
        """Keeps the control lease while the task does something else than moving: it looks."""
        self.__driver.beat()

    def state(self) -> RobotState:
        """What the robot's own sensors say now."""
        return self.__driver.state()

    def adjust_joints(self, delta: Joints, seconds: float | None = None, least_opening: float = 0.0) -> RobotState:
        """Changes the joints by `delta` (rad); returns what was reached.

        With `seconds` so slowly that it takes about so much world time; not faster than its own pace. `Slipping` once
        the gripper is closed further than `least_opening`, in m.
        """
        pace = self.__pace
        if seconds is not None:
            slowest = float(np.max(np.abs(delta) / self.__driver.description.speed))
            share = _PEAK * slowest / max(seconds, 1e-3)
            pace = Pace(min(pace.speed, max(_LEAST_PACE, share)), pace.acceleration)
        return self.__driver.adjust_joints(delta, pace, self.__watch, least_opening)

    def open_gripper(self) -> RobotState:
        """Opens the gripper."""
        return self.__driver.open_gripper(self.__watch)

    def close_gripper(self) -> RobotState:
        """Closes the gripper until the fingers meet something or each other."""
        return self.__driver.close_gripper(self.__watch)

    def wait(self, duration: float) -> RobotState:
        """Lets `duration` s of world time pass."""
        state = self.__driver.advance(min(duration, _LONGEST_ADVANCE), self.__watch)
        return state if duration <= _LONGEST_ADVANCE else self.wait(duration - _LONGEST_ADVANCE)

    def stop(self, reason: str) -> RobotState:
        """Brakes the arm and latches the software stop."""
        return self.__driver.stop(reason)

    def at_rest(self) -> RobotState:
        """The state once arm and gripper stand still; `Busy` when they do not within 2 s of world time."""
        state = self.state()
        deadline = state.world_time + _REST_LIMIT
        while state.moving or not math.isfinite(state.still_since):
            if state.world_time > deadline:
                raise Busy(f"the arm has not come to rest within {_REST_LIMIT} s of world time")
            state = self.wait(_REST_STEP)
        return state


class ActingHead:
    """A head as an acting task sees it: it turns, and says where it points."""

    __slots__ = ("__driver", "__robot", "__tick")

    def __init__(self, driver: HeadDriver, robot: LeasedRobot, tick: Tick) -> None:
        """It turns under `robot`'s lease; `tick` is called about every 20 ms meanwhile, raising from it ends a turn."""
        self.__driver = driver
        self.__robot = robot
        self.__tick = tick

    def state(self) -> HeadState:
        """Where it points now."""
        return self.__driver.state()

    def turn(self, to: HeadAngles) -> HeadState:
        """Turns to `to`; returns where it stands then. `OutOfLimits` beyond its range."""
        return self.__driver.move(to.pan, to.tilt, self.__robot.lease_id, _TURN_LIMIT, self.__tick)

    def follow(self, course: Course, lasting: float) -> HeadState:
        """Turns along a course for at most `lasting` s and is not waited for; returns where it points now."""
        return self.__driver.follow(course, lasting, self.__robot.lease_id, _FOLLOW_LIMIT)

    def halt(self) -> HeadState:
        """Stands still, as soon as it can; returns where it points now."""
        here = self.state()
        return self.follow(Course(here.pan, here.tilt, 0.0, 0.0, here.world_time), 0.0)

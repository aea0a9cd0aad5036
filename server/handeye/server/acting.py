"""What an acting task may do to the robot, and the bounds within which it does it."""

from __future__ import annotations

import math

from pydantic import BaseModel, ConfigDict, Field

from handeye.robot_bridge.driver import Joints, Pace, RobotDriver, RobotState, Watch
from handeye.rpc.errors import Busy

_REST_STEP = 0.05  # s of world time to wait before asking again whether the arm has come to rest
_REST_LIMIT = 2.0  # s of world time after which an arm that still moves is an error


class ActingSettings(BaseModel):
    """How an acting task looks and moves."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    max_looks: int = Field(default=8, ge=1)
    """Looks per subtask before it goes on anyway."""
    tolerance: float = Field(default=0.0015, gt=0.0)
    """A subtask is aligned when no joint of the answer is larger, in rad."""
    last_tolerance: float = Field(default=0.01, gt=0.0)
    """The same for the last subtask (the lift): nothing follows that its error could spoil."""
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
    pace: float = Field(default=0.5, gt=0.0, le=1.0)
    """Share of the joints' speed and acceleration limits."""


class ActingRobot:
    """A robot as an acting task sees it: it adjusts joints, moves the gripper, waits and stops. Nothing else.

    There is no way from here to *move to point*, *move to joints* or *park*: a task acts by what it was taught, not
    by inverse kinematics. `watch` is called at every control step; raising from it brakes the arm.
    """

    __slots__ = ("__driver", "__pace", "__watch")

    def __init__(self, driver: RobotDriver, watch: Watch, pace: Pace) -> None:
        self.__driver = driver
        self.__watch = watch
        self.__pace = pace

    @property
    def lockstep(self) -> bool:
        """World time passes only while the robot moves or waits."""
        return self.__driver.description.clock == "lockstep"

    def state(self) -> RobotState:
        """What the robot's own sensors say now."""
        return self.__driver.state()

    def adjust_joints(self, delta: Joints) -> RobotState:
        """Changes the joints by `delta` (rad); returns what was reached."""
        return self.__driver.adjust_joints(delta, self.__pace, self.__watch)

    def open_gripper(self) -> RobotState:
        """Opens the gripper."""
        return self.__driver.open_gripper(self.__watch)

    def close_gripper(self) -> RobotState:
        """Closes the gripper until the fingers meet something or each other."""
        return self.__driver.close_gripper(self.__watch)

    def wait(self, duration: float) -> RobotState:
        """Lets `duration` s of world time pass."""
        return self.__driver.advance(duration, self.__watch)

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

"""What the gripper holds, as far as the robot's own sensors tell, and the way that it was carried."""

from __future__ import annotations

from handeye.robot_bridge.driver import Joints, RobotState
from handeye.rpc.errors import Slipping
from handeye.server.acting import ActingRobot, ActingSettings
from handeye.server.problem import Conflict


class LostGrip(Conflict):
    """The gripper holds nothing, or nothing any more."""

    code = "lost_grip"


class Grip:
    """The gripper of an acting task."""

    def __init__(self, robot: ActingRobot, settings: ActingSettings) -> None:
        self._robot = robot
        self._settings = settings
        self._opening: float | None = None
        """How far it was open when it had closed, in m; None while it is open."""
        self._came: list[Joints] = []
        """Where the arm has stopped since the gripper was opened, in rad, until it was closed."""
        self._carried: list[Joints] = []
        """Where it has stopped since then."""
        self._slipped = False
        """What it held has begun to slip, and was let go."""
        self.lets_go = True
        """Whether what begins to slip is let go: only where it can be taken again, for an object may also settle in the
        fingers."""

    def close(self) -> None:
        """Closes it."""
        closed = self._robot.close_gripper()
        self._opening, self._carried = closed.gripper_opening, [closed.joints]
        self._slipped = False

    def open(self) -> None:
        """Opens it; `LostGrip` when something should have been held until now and was not."""
        self.require()
        self._robot.open_gripper()
        self._opening, self._came, self._carried = None, [], []

    def carry(self, start: Joints, delta: Joints, seconds: float | None = None) -> RobotState:
        """Changes the joints from `start`, where they are, by `delta` (rad), with what is held; returns where it came.

        When that begins to slip, it is let go before the way is gone to its end: fingers that close over the rim of
        something pinch it away. `require` tells.
        """
        least = 0.0
        if self.lets_go and self._opening is not None:
            least = max(0.0, self._opening - self._settings.slip_slack)
        try:
            reached = self._robot.adjust_joints(delta, seconds, least)
        except Slipping:
            self._slipped, self._opening = True, None
            opened = self._robot.open_gripper()  # fully: the bridge has begun to
            reached = self._robot.adjust_joints(start + delta - opened.joints, seconds)
        (self._carried or self._came).append(reached.joints)
        return reached

    def require(self) -> None:
        """`LostGrip` when something should be held and is not."""
        if self._slipped or (self._opening is not None and self._holds_nothing(self._opening)):
            raise LostGrip(
                "The gripper has closed on nothing, or what it held has slipped out of it: see where the object is."
            )

    def holds(self) -> bool:
        """Whether the gripper has closed on something that it still feels."""
        return self._opening is not None and not self._holds_nothing(self._opening)

    def go_back(self) -> None:
        """Carries what is held back where it was gripped, lets go, and goes back from there: the way that it came,
        which was free. An arm that has lost what it carried is elsewhere: it opens the gripper and stays."""
        lost = not self.holds() and len(self._carried) > 1
        if not lost:
            self._retrace(self._carried)
        self._robot.open_gripper()
        if not lost:
            self._retrace(self._came)
        self._opening, self._slipped = None, False
        self._came, self._carried = [], []

    def _retrace(self, stops: list[Joints]) -> None:
        for joints in reversed(stops):
            self._robot.adjust_joints(joints - self._robot.at_rest().joints)

    def _holds_nothing(self, gripped: float) -> bool:
        """Closed that far that nothing is between the fingers, or further than when it had gripped."""
        least = max(self._settings.least_grip, gripped - self._settings.grip_slack)
        return self._robot.state().gripper_opening < least

"""What the gripper holds, as far as the robot's own sensors tell, and the way that it was carried."""

from __future__ import annotations

from handeye.robot_bridge.driver import Joints
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
        self._carried: list[Joints] = []
        """Where the arm has stopped since then, in rad."""

    def close(self) -> None:
        """Closes it."""
        closed = self._robot.close_gripper()
        self._opening, self._carried = closed.gripper_opening, [closed.joints]

    def open(self) -> None:
        """Opens it; `LostGrip` when something should have been held until now and was not."""
        self.require()
        self._robot.open_gripper()
        self._opening = None

    def carried_to(self, joints: Joints) -> None:
        """The arm has stopped at (joints,) rad."""
        self._carried.append(joints)

    def require(self) -> None:
        """`LostGrip` when something should be held and is not."""
        if self._opening is not None and self._holds_nothing(self._opening):
            raise LostGrip(
                "The gripper has closed on nothing, or what it held has slipped out of it: see where the object is."
            )

    def holds(self) -> bool:
        """Whether the gripper has closed on something that it still feels."""
        return self._opening is not None and not self._holds_nothing(self._opening)

    def put_back(self) -> None:
        """Carries what is held back where it was gripped, the way that it came: there it was free; and lets go."""
        if self.holds():
            for joints in reversed(self._carried):
                self._robot.adjust_joints(joints - self._robot.at_rest().joints)
        self._robot.open_gripper()
        self._opening = None

    def _holds_nothing(self, gripped: float) -> bool:
        """Closed that far that nothing is between the fingers, or further than when it had gripped."""
        least = max(self._settings.least_grip, gripped - self._settings.grip_slack)
        return self._robot.state().gripper_opening < least

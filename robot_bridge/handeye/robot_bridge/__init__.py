"""The robot bridge: owns a robot, exposes the thesis's six actions (4.2.2) on the bus and guards its motion.

`driver` says what a robot is; `guard` checks what it is asked; `lease` keeps who may move it; `service` serves it;
`remote` is the same robot seen from elsewhere on the bus.
"""

from handeye.robot_bridge.driver import Joints, Pace, RobotDescription, RobotDriver, RobotState, Watch, unwatched

__all__ = ["Joints", "Pace", "RobotDescription", "RobotDriver", "RobotState", "Watch", "unwatched"]

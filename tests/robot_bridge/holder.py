"""A controller of its own process: takes the lease, says so, and moves at the pace of its argument."""

from __future__ import annotations

import sys

from handeye.robot_bridge.driver import Pace
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus, BusSettings
from handeye.rpc.errors import RpcError


def main() -> None:
    with Bus.open(BusSettings(), "holder") as bus:
        robot = RemoteRobot(bus, "holder")
        with robot.lease():
            print("moving", flush=True)
            target = robot.description.park.copy()
            target[0] += 1.0
            try:
                robot.move_to_joints(target, Pace(float(sys.argv[1]), 0.5))
            except RpcError as error:
                print(type(error).__name__, error, flush=True)


if __name__ == "__main__":
    main()

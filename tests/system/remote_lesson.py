"""A person's day at another machine: teaches the grasp over HTTP alone, trains, runs it, reads back why it moved.

The laboratory itself is asked through stdin and stdout, one JSON object a line: a person stands in it, sees where the
cup is, and puts it down. Everything else goes through `handeye.client`. Prints {"report": …} in the end.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from handeye.client import Client, Control
from handeye.client.models import Robot, TrainStatistics
from handeye.robot_bridge.driver import Pace
from handeye.robot_bridge.remote import RemoteRobot
from handeye.simulation.lab import LabClient
from handeye.simulation.lessons import grasp
from handeye.simulation.objects import CUPS, ObjectSpec
from handeye.simulation.places import Purpose, draw, generator
from handeye.simulation.teacher import Teacher

TASK, OBJECT, SEED = "grasp", "blue cup", 3


def in_lab(**request: object) -> Any:
    """Has something done in the laboratory."""
    print(json.dumps(request), flush=True)
    return json.loads(sys.stdin.readline())


class Lab:
    """What a person in the laboratory does and sees."""

    def reset(self, seed: int) -> None:
        in_lab(do="reset", seed=seed)

    def place(self, spec: ObjectSpec, xy: tuple[float, float], yaw: float) -> None:
        in_lab(do="place", name=spec.name, xy=[float(v) for v in xy], yaw=yaw)

    def world(self) -> SimpleNamespace:
        return SimpleNamespace(object=self._object)

    def _object(self, name: str) -> SimpleNamespace:
        return SimpleNamespace(pose=SimpleNamespace(position=np.array(in_lab(do="see", name=name))))


class Arm:
    """The arm as the teacher moves it: over HTTP."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._control: Control | None = None

    @contextmanager
    def lease(self) -> Iterator[None]:
        with self._client.control("remote teacher") as self._control:
            yield

    @property
    def control(self) -> Control:
        assert self._control is not None
        return self._control

    def state(self) -> SimpleNamespace:
        return _state(self._client.robot())

    def advance(self, duration: float, _watch: Callable[[float], None]) -> SimpleNamespace:
        return _state(self.control.advance(duration))

    def move_to_joints(self, joints: NDArray[np.float64], pace: Pace, _watch: Callable[[float], None]) -> None:
        self.control.move_to_joints(joints, pace.speed, pace.acceleration)

    def close_gripper(self, _watch: Callable[[float], None]) -> None:
        self.control.close_gripper()


def _state(robot: Robot) -> SimpleNamespace:
    still = np.inf if robot.still_since is None else robot.still_since
    return SimpleNamespace(joints=np.array(robot.joints), world_time=robot.world_time, still_since=still)


def main() -> None:
    with Client(os.environ["HANDEYE_URL"], os.environ["HANDEYE_TOKEN"]) as client:
        client.wait_ready(60.0)
        arm, lab = cast("RemoteRobot", Arm(client)), cast("LabClient", Lab())
        teacher = Teacher(arm, lab, client, grasp(CUPS[OBJECT]), TASK, lambda _share: None)
        teacher.register_objects(SEED)
        motions = generator(SEED, Purpose.MOTIONS)
        places = draw(SEED, Purpose.TEACHING, 2)
        for place in places:
            teacher.demonstrate((place,), motions, lambda: None)
        statistics = client.train(TASK)
        assert isinstance(statistics, TrainStatistics)

        in_lab(do="reset", seed=5)
        in_lab(do="place", name=OBJECT, xy=[places[0].x, places[0].y], yaw=0.4)
        job = client.run_task(TASK, OBJECT).raise_for_failure()
        looks = [look for subtask in job.result.subtasks for look in subtask.looks]
        report = {
            "pairs": statistics.pairs,
            "moves": sum(bool(look.moved) for look in looks),
            "reasons": sorted({str(n.demonstration) for look in looks for n in look.neighbours}),
            "support": min(look.support for look in looks),
            "pictures": [len(client.picture(look.picture)) for look in looks],
            "lifted": in_lab(do="see", name=OBJECT)[2],
        }
        print(json.dumps({"report": report}), flush=True)


if __name__ == "__main__":
    main()

"""The teacher: plays the person with the teach pendant, in a process of its own.

It may use truth (where things stand) and inverse kinematics, because a person sees the cup and leads the arm by
hand. The coordinator gets from it only "look now", what the gripper does, and where demonstrations begin and end:
images and joint readings it takes itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from handeye.client import ApiError, Client
from handeye.robot_bridge.driver import Pace, Watch
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc.errors import DeadlineExceeded, Unreachable
from handeye.simulation import kinematics
from handeye.simulation.lab import LabClient
from handeye.simulation.lessons import Lesson, Move
from handeye.simulation.places import Place
from handeye.simulation.scatter import STEADY, Clumsiness
from handeye.simulation.scene import WORKSPACE_CENTRE, WORKSPACE_SIZE

Array = NDArray[np.float64]

FRESH = 0.08
"""World time in s that passes at rest before each look, so that the cameras have a picture of the arm at rest."""

REST_LIMIT = 2.0
"""An arm that still moves after so many s of world time is an error."""

PACE = Pace(0.6, 0.6)

BACKGROUNDS = 2
"""Pictures of the empty table: they differ by their noise."""

WAY_PACE = Pace(0.2, 0.5)
"""Of a way that nobody looks at: liquid is poured."""


class Teacher:
    """Shows a lesson to a coordinator, on a robot whose control lease it holds meanwhile."""

    def __init__(
        self,
        robot: RemoteRobot,
        lab: LabClient,
        client: Client,
        lesson: Lesson,
        task: str,
        watch: Watch,
        clumsiness: Clumsiness = STEADY,
    ) -> None:
        """`task`: what the coordinator calls it; `watch` is called at every control step, raising ends the teaching."""
        self._robot = robot
        self._lab = lab
        self._client = client
        self._lesson = lesson
        self._task = task
        self._watch = watch
        self._clumsiness = clumsiness

    def register_objects(self, seed: int) -> None:
        """Shows the coordinator the empty table, then each object at a few places: it learns what they look like."""
        for spec in self._lesson.objects:
            self._lab.reset(seed)
            with self._robot.lease():
                for _ in range(BACKGROUNDS):
                    self._client.add_background(spec.name, self._fresh())
                for number, (x, y) in enumerate(registration_places()):
                    self._lab.place(spec, (x, y), yaw=0.5 + 1.3 * number)
                    self._client.add_example(spec.name, self._fresh())

    def demonstrate(self, places: Sequence[Place], random: np.random.Generator, on_look: Callable[[], None]) -> str:
        """The lesson once with its objects at `places`. `random` draws the small motions.

        Returns the demonstration's id. `ApiError` with the code "not_seen" when a subtask's start or goal is not seen
        there; then the demonstration is taken back.
        """
        self._lab.reset(places[0].seed)
        for spec, place in zip(self._lesson.objects, places, strict=True):
            self._lab.place(spec, (place.x, place.y), place.yaw)
        moves = self._lesson.plan(self._lab.world())
        with self._robot.lease():
            shown = self._client.begin_demonstration(self._task, self._lesson.objects[0].name).id
            recorder = _Recorder(self._client, shown, self._settle, on_look)
            try:
                for move in moves:
                    self._show(recorder, self._led(move, random), random)
            except ApiError:
                self._client.delete_demonstration(shown)
                raise
            recorder.finish()
        return shown

    def _led(self, move: Move, random: np.random.Generator) -> Move:
        """The move as this teacher makes it."""
        if self._clumsiness == STEADY or move.goal is None:
            return move
        return replace(move, goal=near(self._clumsiness.off(kinematics.forward(move.goal), random), move.goal))

    def _show(self, recorder: _Recorder, move: Move, random: np.random.Generator) -> None:
        """Looks at the start, then the way to the goal, then what follows it without looking."""
        recorder.look(move, key=True)
        if move.goal is None:
            recorder.look(move, goal=True)
        else:
            self._lead(recorder, move, move.goal, random)
        if move.way:
            recorder.look(move)  # the way's time counts from here
        for step in move.way:
            if isinstance(step, float):
                self._robot.advance(step, self._watch)
            else:
                self._robot.move_to_joints(step, WAY_PACE, self._watch)
            recorder.pass_by(move)
        if move.action == "close_gripper":
            self._robot.close_gripper(self._watch)
        elif move.action == "open_gripper":
            self._robot.open_gripper(self._watch)
        if move.action is not None:
            recorder.action(move.subtask, move.action)

    def _lead(self, recorder: _Recorder, move: Move, goal: Array, random: np.random.Generator) -> None:
        """From where the arm is to the goal: looks on the way, at the goal, around it, elsewhere."""
        start = self._robot.state().joints
        for share in np.linspace(0.0, 1.0, move.looks + 2)[1:-1]:
            self._move(start + share * (goal - start))
            recorder.look_if_seen(move)
        self._move(goal)
        recorder.look(move, goal=True)
        if move.scatter is not None:
            for pose in move.scatter.draw(kinematics.forward(goal), random):
                self._move(near(pose, goal))
                recorder.look_if_seen(move)
            self._move(goal)
        if move.elsewhere is not None:
            for joints in move.elsewhere.draw(goal, random):
                self._move(joints)
                recorder.look_if_seen(move)
            self._move(goal)

    def _move(self, joints: Array) -> None:
        self._robot.move_to_joints(joints, PACE, self._watch)

    def _settle(self) -> None:
        """Lets the cameras catch up with the arm at rest; `DeadlineExceeded` when it does not come to rest."""
        state = self._robot.advance(FRESH, self._watch)
        limit = state.world_time + REST_LIMIT
        while state.world_time < state.still_since + FRESH:
            if state.world_time > limit:
                raise DeadlineExceeded(f"the arm has not come to rest within {REST_LIMIT} s of world time")
            state = self._robot.advance(FRESH, self._watch)

    def _fresh(self) -> float:
        """World time of now; the pictures of it can be had when this returns."""
        now = self._robot.state().world_time
        self._settle()
        return now


class _Recorder:
    """One demonstration as the coordinator is told of it."""

    def __init__(
        self, client: Client, demonstration: str, settle: Callable[[], None], on_look: Callable[[], None]
    ) -> None:
        self._client = client
        self._demonstration = demonstration
        self._settle = settle
        self._on_look = on_look

    def look(self, move: Move, *, goal: bool = False, key: bool = False) -> None:
        self._settle()
        self._client.observe(self._demonstration, move.subtask, object_name=move.towards, goal=goal, key=key)
        self._on_look()

    def look_if_seen(self, move: Move) -> None:
        """Where the hand is too far aside to be seen whole, or hides the object, there is nothing to record."""
        try:
            self.look(move)
        except ApiError as error:
            if error.code != "not_seen":
                raise

    def pass_by(self, move: Move) -> None:
        self._client.add_waypoint(self._demonstration, move.subtask)

    def action(self, subtask: str, action: Literal["close_gripper", "open_gripper"]) -> None:
        self._client.mark_action(self._demonstration, subtask, action)

    def finish(self) -> None:
        self._client.finish_demonstration(self._demonstration)


def near(pose: Array, joints: Array) -> Array:
    """The joints that reach `pose`, on the branch nearest to `joints`."""
    solutions = kinematics.inverse(pose)
    if not len(solutions):
        raise Unreachable(f"no joint position reaches a small motion around {np.round(joints, 3).tolist()}")
    return kinematics.nearest(solutions, joints)


def registration_places() -> list[Array]:
    """Four places of the workspace, away from its edges and from each other."""
    offsets = np.array([[-0.25, -0.3], [0.3, -0.15], [-0.1, 0.3], [0.15, 0.1]])
    return list(WORKSPACE_CENTRE + WORKSPACE_SIZE * offsets)

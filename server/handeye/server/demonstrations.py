"""Records demonstrations and keeps them in the store.

The teacher moves the robot; the coordinator watches. It keeps what it recognised in each stereo pair and the joints,
not the pictures.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from handeye.modules.spaces import HeadAngles, ImagePair
from handeye.server.demonstration import Action, Demonstration, Observation, Outcome
from handeye.server.problem import Conflict, NotFound
from handeye.server.store import Store
from handeye.server.store import demonstrations as stored


class Incomplete(Conflict):
    """A demonstration lacks something that training needs."""

    code = "incomplete"


class Demonstrations:
    """The demonstrations in a store. What a method has returned from is durable. Safe among threads."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def begin(self, task: str, object_name: str) -> Demonstration:
        """A new, empty demonstration; its id is '<task>-<n>' with n counting the task's demonstrations from 1."""
        with self._store.write() as connection:
            return self.get(stored.create(connection, task, object_name))

    def get(self, demonstration_id: str) -> Demonstration:
        """The demonstration of that id; `NotFound` when there is none."""
        with self._store.read() as connection:
            found = stored.read(connection, demonstration_id)
        if found is None:
            raise NotFound(f"There is no demonstration '{demonstration_id}'; begin one by POST /v1/demonstrations.")
        return found

    def known(self, ids: Iterable[str]) -> list[Demonstration]:
        """Those of these ids that there still are."""
        with self._store.read() as connection:
            found = [stored.read(connection, each) for each in ids]
        return [each for each in found if each is not None]

    def page(self, after: tuple[float, str] | None, limit: int) -> tuple[Demonstration, ...]:
        """At most `limit` demonstrations begun after (created, id), in the order they were begun."""
        with self._store.read() as connection:
            return stored.page(connection, after, limit)

    def trainable(self, task: str) -> tuple[Demonstration, ...]:
        """The finished demonstrations of a task that nobody called a failure, in the order they were begun."""
        with self._store.read() as connection:
            shown = stored.of_task(connection, task)
        return tuple(d for d in shown if d.finished and d.outcome != "failure")

    def recordable(self, demonstration_id: str, subtask: str, object_name: str | None, *, goal: bool) -> Demonstration:
        """The demonstration, if an observation of `subtask`, towards an object, may be added to it now.

        `Conflict` when it is finished, when `goal` and the subtask already has its goal, when the subtask is towards
        another object, or when its way has begun.
        """
        demonstration = self._open(demonstration_id)
        towards = demonstration.towards(subtask)
        if towards not in (None, object_name or demonstration.object):
            raise Conflict(
                f"Subtask '{subtask}' of demonstration '{demonstration_id}' is towards '{towards}'; "
                f"a subtask is towards one object, not also towards '{object_name or demonstration.object}'."
            )
        if demonstration.way(subtask):
            raise Conflict(
                f"Subtask '{subtask}' of demonstration '{demonstration_id}' is on its way already: nobody looks there."
            )
        if goal and (before := demonstration.goal(subtask)):
            raise Conflict(
                f"Subtask '{subtask}' of demonstration '{demonstration_id}' already has its goal "
                f"(observation {before.number})."
            )
        return demonstration

    def observe(
        self,
        demonstration_id: str,
        subtask: str,
        found: ImagePair,
        joints: NDArray[np.float64],
        world_time: float,
        *,
        goal: bool,
        key: bool,
        object_name: str | None = None,
        head: HeadAngles | None = None,
    ) -> Observation:
        """Adds an observation, towards the demonstration's own object for None; raises as `recordable` does."""
        with self._store.write() as connection:
            demonstration = self.recordable(demonstration_id, subtask, object_name, goal=goal)
            number, towards = len(demonstration.observations), object_name or demonstration.object
            observation = Observation(number, subtask, towards, world_time, found, joints.copy(), goal, key, head)
            stored.add_observation(connection, demonstration_id, observation)
            return observation

    def pass_by(
        self, demonstration_id: str, subtask: str, joints: NDArray[np.float64], still_since: float, world_time: float
    ) -> Observation:
        """Adds a way-point: the arm stands at `joints` since `still_since`, and it is `world_time`, both in s.

        `Conflict` when the demonstration is finished or the subtask has no goal yet, which its way begins at.
        """
        with self._store.write() as connection:
            demonstration = self._open(demonstration_id)
            if demonstration.goal(subtask) is None:
                raise Conflict(
                    f"Subtask '{subtask}' of demonstration '{demonstration_id}' has no goal yet; look there with "
                    '"goal": true, then show the way that goes on from it.'
                )
            before = demonstration.observations[-1].world_time
            # An arm that has not moved since has waited: that is shown, too.
            seconds = max(0.0, (still_since if still_since > before else world_time) - before)
            number, towards = len(demonstration.observations), demonstration.towards(subtask) or demonstration.object
            observation = Observation(number, subtask, towards, world_time, None, joints.copy(), seconds=seconds)
            stored.add_observation(connection, demonstration_id, observation)
            return observation

    def act(self, demonstration_id: str, subtask: str, action: Action) -> Demonstration:
        """Marks what the person did with the gripper at the end of a subtask."""
        with self._store.write() as connection:
            demonstration = self._open(demonstration_id)
            if subtask not in demonstration.subtask_names:
                raise Conflict(
                    f"Demonstration '{demonstration_id}' has no observation of subtask '{subtask}' yet; "
                    "record the subtask first, then its action."
                )
            if before := demonstration.actions.get(subtask):
                raise Conflict(f"Subtask '{subtask}' already ends with '{before}'; a subtask has one action.")
            stored.add_action(connection, demonstration_id, subtask, action)
            return self.get(demonstration_id)

    def finish(self, demonstration_id: str) -> Demonstration:
        """Closes a complete demonstration for training; `Incomplete` says what is missing."""
        with self._store.write() as connection:
            demonstration = self._open(demonstration_id)
            if not demonstration.observations:
                raise Incomplete(f"Demonstration '{demonstration_id}' is empty; record observations first.")
            without_goal = [name for name in demonstration.subtask_names if demonstration.goal(name) is None]
            if without_goal:
                raise Incomplete(
                    f"Demonstration '{demonstration_id}' has no goal for {', '.join(map(repr, without_goal))}; record "
                    'one observation with "goal": true where each subtask ends.'
                )
            stored.mark(connection, demonstration_id, finished=True)
            return self.get(demonstration_id)

    def judge(self, demonstration_id: str, outcome: Outcome | None) -> Demonstration:
        """Writes down whether it was a success; the next training goes by it."""
        with self._store.write() as connection:
            self.get(demonstration_id)
            stored.mark(connection, demonstration_id, outcome=outcome)
            return self.get(demonstration_id)

    def delete(self, demonstration_id: str) -> None:
        """Deletes it; its samples in modules are their owner's to take out."""
        with self._store.write() as connection:
            self.get(demonstration_id)
            stored.drop(connection, demonstration_id)

    def _open(self, demonstration_id: str) -> Demonstration:
        demonstration = self.get(demonstration_id)
        if demonstration.finished:
            raise Conflict(f"Demonstration '{demonstration_id}' is finished; begin a new one.")
        return demonstration

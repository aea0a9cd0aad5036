"""Records the learner's sensorimotor set: the taught grasp, as samples of what module IJS has to learn.

    python benchmarks/record_lab.py --output benchmarks/data/lab_grasp.npz

Starts the simulated lab as `handeye up` does, with a state directory of its own, and lets the teacher show the grasp
again and again at random places. What the coordinator sees at each look becomes one sample: the vector from hand to
object in the stereo image and the joints in, the joint changes to the subtask's end out. Same seed, same samples. Takes
about 10 s per demonstration.
"""

import argparse
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from rich.console import Console

from handeye.cli.progress import progress
from handeye.cli.supervisor import signals_unwind
from handeye.cli.up import Stack
from handeye.client import Client
from handeye.client.models import Observation
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus
from handeye.simulation.lab import LabClient
from handeye.simulation.lessons import grasp
from handeye.simulation.objects import CUPS
from handeye.simulation.places import Purpose, draw, generator
from handeye.simulation.teacher import Teacher
from handeye.simulation.teaching import acting_settings, lab_settings

TASK = "grasp"
OBJECT = "blue cup"
INPUTS = ("delta row", "delta column", "delta disparity", *(f"joint {i}" for i in range(1, 7)))
OUTPUTS = tuple(f"delta joint {i}" for i in range(1, 7))


class Look(NamedTuple):
    """What the coordinator saw and read at one moment of a demonstration, counted from 0."""

    demonstration: int
    observation: Observation


class Listener(Client):
    """A client that keeps what the coordinator answers to each look that the teacher asks for."""

    def __init__(self, url: str, token: str) -> None:
        super().__init__(url, token)
        self.looks: list[Look] = []
        self._numbers: dict[str, int] = {}

    def observe(
        self,
        demonstration_id: str,
        subtask: str,
        *,
        object_name: str | None = None,
        goal: bool = False,
        key: bool = False,
        object_at: ArrayLike | None = None,
    ) -> Observation:
        observation = super().observe(
            demonstration_id, subtask, object_name=object_name, goal=goal, key=key, object_at=object_at
        )
        number = self._numbers.setdefault(demonstration_id, len(self._numbers))
        self.looks.append(Look(number, observation))
        return observation


def record(seed: int, demonstrations: int, console: Console) -> list[Look]:
    """Starts the lab, shows the grasp `demonstrations` times, ends the lab; every look, in order."""
    with ExitStack() as opened:
        opened.enter_context(signals_unwind())
        state_dir = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="handeye-record-")))
        stack = opened.enter_context(Stack(state_dir, console=console))
        bus = opened.enter_context(Bus.open(acting_settings(stack.acting), name="teacher"))
        lab = LabClient(opened.enter_context(Bus.open(lab_settings(stack.lab), name="teacher")))
        client = Listener(stack.url, stack.token)
        opened.enter_context(client)
        robot = RemoteRobot(bus, holder="teacher")
        teacher = Teacher(robot, lab, client, grasp(CUPS[OBJECT]), TASK, lambda _share: stack.check())
        teacher.register_objects(seed)
        motions = generator(seed, Purpose.MOTIONS)
        bar = opened.enter_context(progress(console))
        work = bar.add_task(f"recording {TASK!r}", total=demonstrations)
        for place in draw(seed, Purpose.TEACHING, demonstrations):
            teacher.demonstrate((place,), motions, lambda: None)
            bar.advance(work)
        return client.looks


def write(looks: list[Look], seed: int, path: Path) -> None:
    """The looks as samples, in a compressed .npz of plain arrays."""
    subtasks = tuple(dict.fromkeys(seen.subtask for _number, seen in looks))
    goals = {(number, seen.subtask): np.array(seen.joints) for number, seen in looks if seen.goal}
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        path,
        demonstration=np.array([number for number, _seen in looks], np.int16),
        subtask=np.array([subtasks.index(seen.subtask) for _number, seen in looks], np.int16),
        inputs=np.array([[*np.subtract(seen.object or (), seen.hand or ()), *seen.joints] for _number, seen in looks]),
        outputs=np.array([goals[number, seen.subtask] - seen.joints for number, seen in looks]),
        subtask_names=np.array(subtasks),
        input_names=np.array(INPUTS),
        output_names=np.array(OUTPUTS),
        seed=np.array(seed),
    )


def main() -> None:
    """Records and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=201, help="of places, small motions and all noises")
    parser.add_argument("--demonstrations", type=int, default=30)
    parser.add_argument("--output", type=Path, required=True, help="the .npz file to write")
    arguments = parser.parse_args()
    console = Console(stderr=True)
    looks = record(arguments.seed, arguments.demonstrations, console)
    write(looks, arguments.seed, arguments.output)
    console.print(f"{len(looks)} samples: {arguments.output}")


if __name__ == "__main__":
    main()

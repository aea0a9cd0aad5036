"""`handeye record` and `handeye replay`: demonstrations that a person shows, and the arm showing them again."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal, NamedTuple

import typer
from rich.console import Console
from rich.progress import Progress

from handeye.client import Client, HandeyeError
from handeye.client.models import Demonstration, Observation
from handeye.client.verbs_common import Token, Url, connect, signals_unwind

STEPS = "look SUBTASK, key SUBTASK, goal SUBTASK, way SUBTASK, close SUBTASK, open SUBTASK, finish"

_LOOK = re.compile(r"(?P<subtask>[^@(]+)(@(?P<towards>[^(]+))?(\((?P<marked>.*)\))?")
"""SUBTASK @ OBJECT (ROW, COLUMN, DISPARITY): the object and the point are optional."""


class WrongStep(HandeyeError):
    """A line that is none of the steps of a demonstration."""


def register(app: typer.Typer) -> None:
    """Adds the verbs `record` and `replay`."""
    app.command()(record)
    app.command()(replay)


def record(
    task: Annotated[str, typer.Argument(help="The task that is going to be shown.")],
    object_name: Annotated[str, typer.Option("--object", help="What it is shown with.")],
    url: Url = "",
    token: Token = "",
) -> None:
    """Record a demonstration: lead the arm, and at each stop say in a line what happens there.

    `look S`: look, in subtask S. `key S`: the same where the subtask begins. `goal S`: the same where it ends.
    `way S`: do not look, the arm goes on through here after the goal. `close S`, `open S`: what the gripper did at
    its end. `finish`. `look S @ OBJECT`, also with key and goal: S is towards another object. An object that is not
    recognised is marked: `look S (ROW, COLUMN, DISPARITY)`, in px, where its middle is in the left picture, and by how
    much further to the left it is in the right one. Lines come from the terminal or from stdin.
    """
    with connect(url, token) as client, signals_unwind():
        shown = client.begin_demonstration(task, object_name)
        typer.echo(f"Recording '{shown.id}': {STEPS}.", err=True)
        finished = False
        try:
            finished = _record(client, shown.id)
        finally:
            if not finished:
                typer.echo(f"Demonstration '{shown.id}' stays unfinished: nothing is learned from it.", err=True)
        if not finished:
            raise typer.Exit(1)
    typer.echo(f"Demonstration '{shown.id}' is finished; `handeye train {task}` learns from it.")


def _record(client: Client, demonstration: str) -> bool:
    """Does the steps as they are said; False when they end without `finish`."""
    interactive = _interactive()
    for line in _lines(interactive):
        try:
            if _step(client, demonstration, line):
                return True
        except HandeyeError as error:
            if not interactive:
                raise
            typer.echo(f"{error}", err=True)
    return False


def _interactive() -> bool:
    """A person sits at a terminal."""
    return sys.stdin.isatty()


def _lines(interactive: bool) -> Iterator[str]:
    while True:
        try:
            line = input("> ") if interactive else sys.stdin.readline()
        except EOFError:
            return
        if not line and not interactive:
            return
        if line.strip():
            yield line.strip()


def _step(client: Client, demonstration: str, line: str) -> bool:
    """One step; True when it was the last one."""
    word, _, rest = line.partition(" ")
    subtask = rest.strip()
    if line == "finish":
        client.finish_demonstration(demonstration)
        return True
    if not subtask or word not in ("look", "key", "goal", "way", "close", "open"):
        raise WrongStep(f"{line!r} is no step; the steps are: {STEPS}")
    if word in ("close", "open"):
        client.mark_action(demonstration, subtask, "close_gripper" if word == "close" else "open_gripper")
        typer.echo(f"  '{subtask}' ends with the gripper {'closed' if word == 'close' else 'opened'}", err=True)
    elif word == "way":
        passed = client.add_waypoint(demonstration, subtask)
        typer.echo(f"  {passed.number}: '{subtask}' goes on through here, {passed.seconds:.1f} s later", err=True)
    else:
        _look(client, demonstration, word, rest)
    return False


def _look(client: Client, demonstration: str, word: str, rest: str) -> None:
    """Looks as the rest of a line after the word `look`, `key` or `goal` says."""
    said = _LOOK.fullmatch(rest)
    if said is None:
        raise WrongStep(f"'{word} {rest}' is no step; a look is: {word} SUBTASK @ OBJECT (ROW, COLUMN, DISPARITY)")
    subtask, towards, marked = said["subtask"].strip(), said["towards"], said["marked"]
    seen = client.observe(
        demonstration,
        subtask,
        object_name=None if towards is None else towards.strip(),
        goal=word == "goal",
        key=word == "key",
        object_at=None if marked is None else _point(marked),
    )
    typer.echo(
        f"  {seen.number}: '{subtask}', object at {_pixels(seen.object)}, hand at {_pixels(seen.hand)}", err=True
    )


def _point(marked: str) -> list[float]:
    try:
        row, column, disparity = (float(each) for each in marked.split(","))
    except ValueError:
        raise WrongStep(f"({marked}) is no point; one is three numbers, in px: (ROW, COLUMN, DISPARITY)") from None
    return [row, column, disparity]


def _pixels(point: Sequence[float] | None) -> str:
    if point is None:
        return "no place"
    return f"row {point[0]:.1f}, column {point[1]:.1f}, disparity {point[2]:.1f}"


class Step(NamedTuple):
    """Something that the arm did in a demonstration: joints in rad to go to, or what the gripper did."""

    joints: tuple[float, ...] | None
    action: Literal["close_gripper", "open_gripper"] | None = None


def replay(
    demonstration: Annotated[str, typer.Argument(help="Id of the demonstration.")],
    speed: Annotated[float, typer.Option(min=0.001, max=1.0, help="Share of the joints' speed limits.")] = 0.3,
    url: Url = "",
    token: Token = "",
) -> None:
    """Move the arm through the joints of a demonstration, gripper included. It moves at once. Ctrl-C brakes it."""
    with connect(url, token) as client, signals_unwind():
        steps = retrace(client.demonstration(demonstration), client.observations(demonstration))
        with client.control("handeye replay") as arm, Progress(console=Console(stderr=True)) as bar:
            for step in bar.track(steps, description=f"replaying {demonstration}"):
                if step.joints is not None:
                    arm.move_to_joints(step.joints, speed)
                elif step.action == "close_gripper":
                    arm.close_gripper()
                else:
                    arm.open_gripper()
    typer.echo(f"'{demonstration}' was replayed in {len(steps)} motions.")


def retrace(shown: Demonstration, observations: Sequence[Observation]) -> list[Step]:
    """What the arm did: through all observations in order; each subtask ends at its goal or its way's end, and acts."""
    steps = []
    for subtask in shown.subtasks:
        mine = [each for each in observations if each.subtask == subtask.name]
        steps += [Step(each.joints) for each in mine]
        goal = next((each for each in mine if each.goal), None)
        if goal is not None and not mine[-1].goal and not subtask.way:
            steps.append(Step(goal.joints))
        if subtask.action is not None:
            steps.append(Step(None, subtask.action))
    return steps

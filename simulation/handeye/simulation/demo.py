"""The demonstration: start the lab, teach ten sequences, train, test, and report beside the thesis's Table 4.1."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console

from handeye.cli.progress import progress
from handeye.cli.up import Stack
from handeye.client import Client, HandeyeError
from handeye.rpc import Bus
from handeye.rpc.errors import RpcError
from handeye.simulation.lab import LabClient
from handeye.simulation.objects import CUPS
from handeye.simulation.places import Place, Purpose, draw
from handeye.simulation.report import Picture, Report, Series
from handeye.simulation.teaching import lab_settings
from handeye.simulation.trying import Judged, Trials

TASK = "grasp"
OBJECT = "blue cup"
TAUGHT = 10
"""Taught sequences, as in Table 4.1."""
PLAIN_TRIALS = 10
"""The plain variant is tried at so many of the random places at most."""
PICTURED_TRIALS = 2
"""So many random trials are shown with pictures."""


class Demonstration:
    """Teaching and trials on a running stack, with progress on `console`."""

    def __init__(self, stack: Stack, client: Client, lab: LabClient, console: Console) -> None:
        self._stack = stack
        self._client = client
        self._lab = lab
        self._console = console
        self._spec = CUPS[OBJECT]
        self._trials = Trials(client, lab, self._spec, TASK, stack.check)

    def run(self, seed: int, trials: int, started: float) -> Report:
        """Everything, in order, on the clock since `started` (of `time.monotonic`).

        Raises when a process dies or a service is lost; a failed job is a failed trial.
        """
        taught = draw(seed, Purpose.TEACHING, TAUGHT)
        tests = draw(seed, Purpose.TESTING, trials)
        self._teach(seed)
        samples = self._client.train(TASK).pairs
        resubstitution = self._series("re-substitution", taught)
        pictures: list[Picture] = []

        def picture(judged: Judged) -> None:
            if judged.trial.number <= PICTURED_TRIALS:
                pictures.extend(self._pictures(judged))

        random = self._series("random places", tests, picture)
        # The thesis's own variant: bare key pairs, interpolated by KNDB.
        self._client.train(TASK, pairs="key", approximator="kndb")
        plain = self._series("plain variant", tests[:PLAIN_TRIALS], one_look=True)
        return Report(
            seed=seed,
            taught=taught,
            object=self._spec.name,
            random=random,
            resubstitution=resubstitution,
            plain=plain,
            samples=samples,
            seconds=time.monotonic() - started,
            pictures=pictures,
        )

    def _teach(self, seed: int) -> None:
        """The teacher is a process of its own and shows its own progress."""
        child = self._stack.start_verb(
            "teach",
            *("--state-dir", str(self._stack.state_dir), "--seed", str(seed), "--demonstrations", str(TAUGHT)),
            *("--task", TASK, "--object", OBJECT),
            environment={},
            name="teacher",
            logged=False,
        )
        self._stack.supervisor.finish(child)

    def _series(
        self,
        title: str,
        places: Sequence[Place],
        on_trial: Callable[[Judged], None] = lambda _judged: None,
        *,
        one_look: bool = False,
    ) -> Series:
        trials = []
        with progress(self._console) as bar:
            task = bar.add_task(title, total=len(places))
            for number, place in enumerate(places, start=1):
                judged = self._trials.at(number, place, one_look=one_look)
                on_trial(judged)
                trials.append(judged.trial)
                bar.update(task, advance=1, description=f"{title}: {sum(each.well for each in trials)} passed")
        return Series(tuple(trials))

    def _pictures(self, judged: Judged) -> Iterator[Picture]:
        """First and last look of each subtask of a trial, and the observer's view of its end."""
        number = judged.trial.number
        marks = "left and right picture; red cross: cup, green cross: hand"
        for part in judged.job.result.subtasks:
            for look in dict.fromkeys((*part.looks[:1], *part.looks[-1:])):
                caption = f"Trial {number}, {part.name}, look {look.number + 1} at {look.world_time:.2f} s: {marks}."
                yield Picture(self._client.picture(look.picture), caption)
        yield Picture(self._client.frame("observer"), f"Trial {number}, at its end, from the observer’s camera.")


def run_demo(trials: int, seed: int, directory: Path, console: Console) -> Report:
    """Runs the demonstration and writes its report into `directory`.

    The stack has a state directory of its own, so that it does not meet a running `handeye up`; its logs are kept in
    `directory`/logs, also when it fails.
    """
    started = time.monotonic()
    with ExitStack() as opened:
        state_dir = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="handeye-demo-")))
        opened.callback(_keep_logs, state_dir / "logs", directory / "logs")
        stack = opened.enter_context(Stack(state_dir, console=console))
        client = opened.enter_context(Client(stack.url, stack.token))
        lab_bus = opened.enter_context(Bus.open(lab_settings(stack.lab), name="demo"))
        try:
            report = Demonstration(stack, client, LabClient(lab_bus), console).run(seed, trials, started)
        except (HandeyeError, RpcError):
            # Say which process died rather than what that did to a call.
            stack.check()
            raise
    report.write(directory)
    return report


def _keep_logs(source: Path, target: Path) -> None:
    if source.is_dir():
        shutil.copytree(source, target, dirs_exist_ok=True)

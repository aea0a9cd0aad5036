"""`handeye train` and `handeye query`."""

from __future__ import annotations

import math
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, Literal

import typer

from handeye.client import Client, QueryAnswers
from handeye.client._tables import read_queries, write_table
from handeye.client.errors import ApiError, WrongArrays
from handeye.client.models import Declaration, ModuleStatistics, OnEvent, TrainStatistics
from handeye.client.verbs_common import Token, Url, connect, job_bar, show, signals_unwind

Pairs = Literal["all", "key"]
Method = Literal["local_quadratic", "local_linear", "kndb", "kndb2", "nearest"]


def register(app: typer.Typer) -> None:
    """Adds the verbs `train` and `query`."""
    app.command()(train)
    # A negative number looks like an option.
    app.command(context_settings={"ignore_unknown_options": True})(query)


def train(
    name: Annotated[str, typer.Argument(metavar="MODULE_OR_TASK", help="The task or the module.")],
    approximator: Annotated[Method | None, typer.Option(help="How answers are made; default: as it was.")] = None,
    key_pairs: Annotated[bool, typer.Option("--key-pairs", help="A task: the thesis's bare pairs only.")] = False,
    timeout: Annotated[float, typer.Option(help="Give up after so many seconds.", min=0.1)] = 600.0,
    url: Url = "",
    token: Token = "",
) -> None:
    """Train a task from its demonstrations, or build a module anew from its samples. Ctrl-C cancels it."""
    with connect(url, token) as client, signals_unwind(), job_bar(f"training {name!r}") as on_event:
        learned = _train(client, name, approximator, key_pairs, timeout, on_event)
    if isinstance(learned, TrainStatistics):
        show(
            f"Task '{name}', from {len(learned.demonstrations)} demonstrations",
            ("subtask", "then", "pairs", "nodes", "levels"),
            [(s.name, s.action, s.pairs, s.nodes, s.levels) for s in learned.subtasks],
        )
    else:
        show(
            f"Module '{name}'",
            ("category", "samples", "demonstrations", "nodes", "levels"),
            [(c.category or None, c.samples, c.demonstrations, c.nodes, c.levels) for c in learned.categories],
        )


def _train(
    client: Client, name: str, approximator: Method | None, key_pairs: bool, timeout: float, on_event: OnEvent
) -> TrainStatistics | ModuleStatistics:
    if not key_pairs and _is_module(client, name):
        settings = None if approximator is None else {"method": approximator}
        return client.train_module(name, settings, timeout=timeout, on_event=on_event)
    pairs: Pairs = "key" if key_pairs else "all"
    return client.train(name, pairs=pairs, approximator=approximator, timeout=timeout, on_event=on_event)


def _is_module(client: Client, name: str) -> bool:
    """Whether there is a module of that name and no task, trained or shown."""
    try:
        client.module(name)
    except ApiError as error:
        if error.status == HTTPStatus.NOT_FOUND:
            return False
        raise
    tasks = {task.name for task in client.tasks()} | {shown.task for shown in client.demonstrations()}
    return name not in tasks


def query(
    module: Annotated[str, typer.Argument(help="Name of the module.")],
    values: Annotated[list[float] | None, typer.Argument(help="One query: the inputs in the declared order.")] = None,
    file: Annotated[
        Path | None, typer.Option(exists=True, dir_okay=False, help="Many queries, .csv or .npz; answers come as CSV.")
    ] = None,
    neighbours: Annotated[int, typer.Option(min=0, max=1000, help="Show so many of the nearest samples.")] = 5,
    url: Url = "",
    token: Token = "",
) -> None:
    """Ask a module: its answer, how sure it is, and which samples and demonstrations it came from."""
    if bool(values) == (file is not None):
        raise typer.BadParameter("give the values of one query, or --file with many")
    with connect(url, token) as client:
        declaration = client.module(module).declaration
        if file is not None:
            answers = client.query(module, read_queries(file, declaration), neighbours=0)
        else:
            names = ", ".join(component.name for component in declaration.inputs)
            if len(values or ()) != len(declaration.inputs):
                raise WrongArrays(f"module '{module}' has {len(declaration.inputs)} inputs: {names}")
            answers = client.query(module, values or (), neighbours)
    if file is not None:
        typer.echo(_as_csv(declaration, answers), nl=False)
    else:
        _show_answer(declaration, answers)


def _as_csv(declaration: Declaration, answers: QueryAnswers) -> str:
    names = [output.name for output in declaration.outputs]
    columns = (*names, *(f"expected error of {name}" for name in names), "support")
    rows = zip(answers.outputs.tolist(), answers.expected_error.tolist(), answers.support.tolist(), strict=True)
    return write_table(columns, ((*output, *error, support) for output, error, support in rows))


def _show_answer(declaration: Declaration, answers: QueryAnswers) -> None:
    outputs = zip(declaration.outputs, answers.outputs[0].tolist(), answers.expected_error[0].tolist(), strict=True)
    show(
        f"Answer, support {answers.support[0]:.2f}",
        ("output", "value", "± (90 %)", "unit"),
        [
            (output.name, value, error if math.isfinite(error) else None, output.unit)
            for output, value, error in outputs
        ],
    )
    found = zip(
        answers.samples[0].tolist(),
        answers.demonstrations[0].tolist(),
        answers.distances[0].tolist(),
        answers.weights[0].tolist(),
        strict=True,
    )
    show(
        "From",
        ("sample", "demonstration", "distance", "weight"),
        [(number, name or None, distance, weight) for number, name, distance, weight in found if number >= 0],
    )

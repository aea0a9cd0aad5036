"""`handeye module …`: modules, their samples, their kept states."""

from __future__ import annotations

import json
import tomllib
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import typer

from handeye.client._tables import read_samples
from handeye.client.errors import WrongArrays
from handeye.client.models import ModuleInfo
from handeye.client.verbs_common import Token, Url, Yes, connect, show

Name = Annotated[str, typer.Argument(metavar="MODULE", help="Name of the module.")]
File = Annotated[Path, typer.Argument(exists=True, dir_okay=False)]


def register(app: typer.Typer) -> None:
    """Adds the verb `module`."""
    group = typer.Typer(no_args_is_help=True, help="Modules: declare them, teach them samples, keep them.")
    group.command("create")(create)
    group.command("list")(list_modules)
    group.command("show")(show_module)
    group.command("delete")(delete)
    group.command("add")(add)
    group.command("samples")(samples)
    group.command("forget")(forget)
    group.command("snapshot")(snapshot)
    group.command("rollback")(rollback)
    group.command("export")(export)
    group.command("import")(import_module)
    app.add_typer(group, name="module")


def create(
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="The declaration, .json or .toml.")],
    url: Url = "",
    token: Token = "",
) -> None:
    """Make a module as a file declares it: name, inputs and outputs with name, unit and scale, approximator."""
    declaration = _declaration(file)
    with connect(url, token) as client:
        made = client.create_module(declaration)
    typer.echo(f"Module '{made.name}' is there; teach it by `handeye module add {made.name} FILE`.")


def list_modules(url: Url = "", token: Token = "") -> None:
    """All modules."""
    with connect(url, token) as client:
        found = client.modules()
    show(
        "Modules",
        ("name", "inputs", "outputs", "samples", "demonstrations", "created"),
        [
            (m.name, len(m.declaration.inputs), len(m.declaration.outputs), m.samples, m.demonstrations, m.created)
            for m in found
        ],
    )


def show_module(name: Name, url: Url = "", token: Token = "") -> None:
    """What a module declares, what it has learned, and its snapshots."""
    with connect(url, token) as client:
        module, learned, kept = client.module(name), client.statistics(name), client.snapshots(name)
    _show_declaration(module)
    show(
        "Learned",
        ("category", "samples", "demonstrations", "nodes", "levels"),
        [(c.category or None, c.samples, c.demonstrations, c.nodes, c.levels) for c in learned.categories],
    )
    show("Snapshots", ("name", "samples", "created"), [(s.name, s.samples, s.created) for s in kept])


def delete(name: Name, yes: Yes = False, url: Url = "", token: Token = "") -> None:
    """Delete a module with its samples and snapshots."""
    if not yes:
        typer.confirm(f"Delete module '{name}' with all its samples and snapshots?", abort=True)
    with connect(url, token) as client:
        client.delete_module(name)
    typer.echo(f"Module '{name}' is deleted.")


def add(
    name: Name,
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="The samples, .csv or .npz.")],
    demonstration: Annotated[str | None, typer.Option(help="Label all of them as from this demonstration.")] = None,
    url: Url = "",
    token: Token = "",
) -> None:
    """Teach a module samples: a .csv with inputs and outputs by name, or an .npz with arrays inputs and outputs."""
    with connect(url, token) as client:
        given = read_samples(file, client.module(name).declaration, demonstration)
        labels = None if given.demonstrations is None else given.demonstrations.tolist()
        numbers = client.add_samples(name, given.inputs, given.outputs, labels)
    typer.echo(f"Module '{name}' has {len(numbers)} samples more, {numbers[0]} to {numbers[-1]}.")


def samples(
    name: Name,
    limit: Annotated[int, typer.Option(min=1, help="Show so many of them at most.")] = 20,
    url: Url = "",
    token: Token = "",
) -> None:
    """The first samples of a module; `handeye module export` writes all of them into a file."""
    with connect(url, token) as client:
        declaration = client.module(name).declaration
        found = list(islice(client.samples(name), limit))
    columns = [*(each.name for each in declaration.inputs), *(each.name for each in declaration.outputs)]
    show(
        f"Samples of '{name}'",
        ("number", *columns, "demonstration"),
        [(s.number, *s.input, *s.output, s.demonstration) for s in found],
    )


def forget(
    name: Name,
    sample: Annotated[list[int] | None, typer.Option(help="Number of a sample; may be given often.")] = None,
    demonstration: Annotated[str | None, typer.Option(help="All samples of this demonstration.")] = None,
    url: Url = "",
    token: Token = "",
) -> None:
    """Take samples out of a module; the next query is answered without them."""
    if not sample and demonstration is None:
        raise typer.BadParameter("say what to forget: --sample NUMBER or --demonstration ID")
    with connect(url, token) as client:
        removed = client.remove_samples(name, sample or (), demonstration=demonstration)
    typer.echo(f"Module '{name}' has {removed} samples fewer.")


def snapshot(
    name: Name,
    kept: Annotated[str, typer.Argument(metavar="SNAPSHOT", help="The snapshot's name.")],
    delete: Annotated[bool, typer.Option("--delete", help="Forget it instead of taking it.")] = False,
    url: Url = "",
    token: Token = "",
) -> None:
    """Remember a module's samples and declaration as they are now."""
    with connect(url, token) as client:
        if delete:
            client.delete_snapshot(name, kept)
            typer.echo(f"Snapshot '{kept}' is forgotten; module '{name}' stays as it is.")
        else:
            taken = client.take_snapshot(name, kept)
            typer.echo(f"Snapshot '{kept}' has {taken.samples} samples of module '{name}'.")


def rollback(
    name: Name,
    kept: Annotated[str, typer.Argument(metavar="SNAPSHOT", help="The snapshot's name.")],
    url: Url = "",
    token: Token = "",
) -> None:
    """Make a module what it was when a snapshot was taken."""
    with connect(url, token) as client:
        module = client.roll_back(name, kept)
    typer.echo(f"Module '{name}' is as it was, with {module.samples} samples.")


def export(
    name: Name,
    file: Annotated[Path, typer.Argument(dir_okay=False, help="The .npz file to write; numpy reads it too.")],
    url: Url = "",
    token: Token = "",
) -> None:
    """Write a module with its samples into one file."""
    with connect(url, token) as client:
        client.export_module(name, file)
    typer.echo(f"Module '{name}' is in {file}.")


def import_module(
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="What `handeye module export` wrote.")],
    name: Annotated[str | None, typer.Option(help="Another name for the module.")] = None,
    url: Url = "",
    token: Token = "",
) -> None:
    """Make a module from a file."""
    with connect(url, token) as client:
        made = client.import_module(file, name)
    typer.echo(f"Module '{made.name}' is there with {made.samples} samples.")


def _declaration(file: Path) -> dict[str, Any]:
    text = file.read_text(encoding="utf-8")
    try:
        declaration = tomllib.loads(text) if file.suffix == ".toml" else json.loads(text)
    except ValueError as error:
        raise WrongArrays(f"{file} cannot be read: {error}") from error
    if not isinstance(declaration, dict):
        raise WrongArrays(f"{file} declares no module: it holds {declaration!r}")
    return declaration


def _show_declaration(module: ModuleInfo) -> None:
    declared = module.declaration
    rows: list[tuple[object, ...]] = [
        ("input", each.name, each.unit, "category" if each.categorical else each.scale) for each in declared.inputs
    ]
    rows += [("output", each.name, each.unit, None) for each in declared.outputs]
    show(f"Module '{module.name}'", ("", "name", "unit", "scale"), rows)
    if declared.approximator is not None:
        show("Approximator", ("setting", "value"), [(key, str(value)) for key, value in declared.approximator.items()])
    typer.echo(f"{module.samples} samples of {module.demonstrations} demonstrations")

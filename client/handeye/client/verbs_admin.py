"""`handeye token …`, `handeye backup` and `handeye restore`: what an administrator does."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from handeye.client.errors import HandeyeError
from handeye.client.models import Role
from handeye.client.verbs_common import Token, Url, Yes, connect, show


class FileExists(HandeyeError):
    """A file would be overwritten."""


def register(app: typer.Typer) -> None:
    """Adds the verbs `token`, `backup` and `restore`."""
    group = typer.Typer(no_args_is_help=True, help="Tokens: who may look, operate and administer.")
    group.command("create")(create)
    group.command("list")(list_tokens)
    group.command("revoke")(revoke)
    app.add_typer(group, name="token")
    app.command()(backup)
    app.command()(restore)


def create(
    name: Annotated[str, typer.Argument(help="Whose it is.")],
    role: Annotated[Role, typer.Option(help="viewer: reads and stops; operator: moves and teaches; admin: all.")],
    days: Annotated[float | None, typer.Option(min=0.0, help="How long it is valid; default: for ever.")] = None,
    url: Url = "",
    token: Token = "",
) -> None:
    """Make a token. It is printed now, on stdout, and never again."""
    with connect(url, token) as client:
        made = client.create_token(name, role, days)
    typer.echo(f"Token {made.id} of '{made.name}' ({made.role}); it is shown only this once:", err=True)
    typer.echo(made.token)


def list_tokens(url: Url = "", token: Token = "") -> None:
    """All tokens, without their secrets."""
    with connect(url, token) as client:
        found = client.tokens()
    show(
        "Tokens",
        ("id", "name", "role", "created", "expires"),
        [(t.id, t.name, t.role, t.created, t.expires or "never") for t in found],
    )


def revoke(
    token_id: Annotated[str, typer.Argument(metavar="ID", help="As `handeye token list` shows it.")],
    url: Url = "",
    token: Token = "",
) -> None:
    """Make a token worthless, at once."""
    with connect(url, token) as client:
        client.revoke_token(token_id)
    typer.echo(f"Token {token_id} is worthless now.")


def backup(
    file: Annotated[Path, typer.Argument(dir_okay=False, help="The file to write.")], url: Url = "", token: Token = ""
) -> None:
    """Write all that the coordinator knows into one file, while it goes on working."""
    if file.exists():
        raise FileExists(f"{file} is there already; a backup overwrites nothing")
    with connect(url, token) as client, Console(stderr=True).status("backing up"):
        client.backup(file)
    typer.echo(f"All is in {file} ({file.stat().st_size / 2**20:.1f} MiB); `handeye restore {file}` brings it back.")


def restore(
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="What `handeye backup` wrote.")],
    yes: Yes = False,
    url: Url = "",
    token: Token = "",
) -> None:
    """Replace all that the coordinator knows by a backup; only the tokens stay."""
    if not yes:
        typer.confirm(f"Replace all modules, demonstrations and jobs by what is in {file}?", abort=True)
    with connect(url, token) as client, Console(stderr=True).status("restoring"):
        there = client.restore(file)
    typer.echo(f"The coordinator knows what is in {file}: {there.modules} modules with {there.samples} samples.")

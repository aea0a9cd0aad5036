"""The typer application: verbs by entry point, and errors as one line."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points, version
from typing import Annotated

import typer
from rich.markup import escape

from handeye.cli import doctor, up

GROUP = "handeye.verbs"


@dataclass(frozen=True, slots=True)
class RoleVerbs:
    """What is known of a role before its code is loaded: its verbs and the extra that installs it."""

    verbs: tuple[str, ...]
    extra: str


KNOWN = {
    "bus": RoleVerbs(("router",), "rpc,cli"),
    "robot": RoleVerbs(("robot-bridge",), "robot"),
    "camera": RoleVerbs(("camera-bridge",), "camera"),
    "server": RoleVerbs(("server", "verify", "repair"), "server"),
    "client": RoleVerbs(
        (
            *("module", "train", "query", "run", "record", "replay", "demonstration"),
            *("job", "token", "backup", "restore", "stop", "reset"),
        ),
        "client",
    ),
    "simulation": RoleVerbs(("teach", "place", "collect", "evaluate", "demo"), "all"),
}
"""The roles by the names of their entry points. A role that is not here may still register verbs."""

OWN_VERBS = ("up", "doctor")
"""The verbs of this package."""

_OPTIONS = {"--url": "HANDEYE_URL", "--token": "HANDEYE_TOKEN"}
"""The options of all verbs that talk to a coordinator, and where those read them from when they are given before."""

_UNKNOWN = RoleVerbs((), "all")


def build_app(roles: Iterable[EntryPoint] | None = None) -> typer.Typer:
    """The application with the verbs of `roles` (default: all installed entry points of `handeye.verbs`).

    A known verb whose role can't be imported becomes a stub that names the extra to install.
    """
    app = typer.Typer(
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        help="Teach a robot hand-eye coordination by showing it, and run it as a service.",
    )
    app.callback()(_root)
    up.register(app)
    doctor.register(app)
    found = entry_points(group=GROUP) if roles is None else roles
    for role in sorted(found, key=lambda role: role.name):
        _register(app, role)
    return app


def run(arguments: list[str]) -> int:
    """Runs the command line `arguments` and returns the exit code.

    Errors of the project and of settings become one line on stderr and exit code 1; Ctrl-C is 130 and TERM 143, as
    shells have it; what remains is a bug and keeps its traceback.
    """
    try:
        build_app(needed(arguments))(args=arguments, prog_name="handeye")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except Exception as error:
        message = explain(error, arguments)
        if message is None:
            raise
        sys.stderr.write(f"handeye: {message}\n")
        return 1
    return 0


def needed(arguments: list[str]) -> list[EntryPoint]:
    """The roles to load for the command line `arguments`: the one that has the verb, or all when that is not known.

    Loading a role's verbs costs some tenths of a second, and `handeye up` starts four processes at once.
    """
    found = list(entry_points(group=GROUP))
    verb = verb_of(arguments)
    if verb in OWN_VERBS:
        return []
    return [role for role in found if verb in KNOWN.get(role.name, _UNKNOWN).verbs] or found


def verb_of(arguments: list[str]) -> str:
    """The verb among `arguments`: the first that is neither a global option nor its value; empty without one."""
    rest = iter(arguments)
    for argument in rest:
        if argument in _OPTIONS:
            next(rest, None)
        elif not argument.startswith("-"):
            return argument
    return ""


def explain(error: Exception, arguments: list[str]) -> str | None:
    """The sentence for people that `error` stands for; None when it is a bug."""
    if isinstance(error, ModuleNotFoundError) and not (error.name or "handeye").startswith("handeye"):
        return _not_installed(verb_of(arguments), error)
    if type(error).__module__.startswith("handeye."):
        return str(error) or type(error).__name__
    if type(error).__module__.startswith("pydantic") and hasattr(error, "errors"):
        problems = (f"{'.'.join(map(str, e['loc'])) or 'setting'}: {e['msg']}" for e in error.errors())
        return f"wrong settings ({getattr(error, 'title', 'settings')}): {'; '.join(problems)}"
    if isinstance(error, OSError) and error.filename is not None:
        return str(error)
    return None


def _register(app: typer.Typer, role: EntryPoint) -> None:
    try:
        register = role.load()
    except ImportError as error:
        for verb in KNOWN.get(role.name, _UNKNOWN).verbs:
            _add_stub(app, verb, error)
        return
    register(app)


def _add_stub(app: typer.Typer, verb: str, error: ImportError) -> None:
    @app.command(
        verb,
        help=escape(f"(not installed: pip install 'handeye[{_extra(verb)}]')"),
        context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
    )
    def stub() -> None:
        sys.stderr.write(f"handeye: {_not_installed(verb, error)}\n")
        raise typer.Exit(1)


def _extra(verb: str) -> str:
    return next((role.extra for role in KNOWN.values() if verb in role.verbs), _UNKNOWN.extra)


def _not_installed(verb: str, error: ImportError) -> str:
    missing = error.name or str(error)
    return f"`handeye {verb}` needs {missing!r}, which is not installed: pip install 'handeye[{_extra(verb)}]'"


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"handeye {version('handeye')}")
        raise typer.Exit


def _root(
    url: Annotated[str, typer.Option(help="The coordinator to talk to; default: the one of `handeye up`.")] = "",
    token: Annotated[str, typer.Option(help="Its token; others on this machine see it: better HANDEYE_TOKEN.")] = "",
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    given = {"--url": url, "--token": token}
    os.environ.update({_OPTIONS[option]: value for option, value in given.items() if value})

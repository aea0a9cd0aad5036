"""`handeye up`: router, robot bridge, camera bridge and server as processes of one machine."""

from __future__ import annotations

import json
import os
import secrets
import socket
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Annotated, Self

import typer
from rich.console import Console

from handeye.cli import state
from handeye.cli.supervisor import Child, Supervisor, signals_unwind

LOOPBACK = "127.0.0.1"

ROUTER_TIMEOUT = 20.0
"""How long the router may take until it accepts connections, in s."""

READY_TIMEOUT = 120.0
"""How long all the rest may take until the server reports ready, in s; the first start compiles kernels."""


class Clock(StrEnum):
    """How world time passes in simulation."""

    LOCKSTEP = "lockstep"
    REALTIME = "realtime"


class Profile(StrEnum):
    """How far the simulated lab is from ideal."""

    DEFAULT = "default"
    IDEAL = "ideal"


class Stack:
    """The four processes of one cell. Entering starts them and returns when the server is ready.

    `url` and `token` reach the server; `acting` and `lab` are the settings of the two buses as environment
    variables. Credentials are made anew for every stack and travel by environment only. The server gets none of
    `lab`: the acting side can't reach the truth.
    """

    def __init__(
        self,
        state_dir: Path,
        *,
        clock: Clock = Clock.LOCKSTEP,
        profile: Profile = Profile.DEFAULT,
        port: int = 0,
        database_url: str = "",
        console: Console | None = None,
    ) -> None:
        """Nothing is started yet. `port` is the server's, 0 for a free one.

        What is taught goes to `database_url`; when it is empty, to a file in the state directory, where the next stack
        of that directory finds it.
        """
        self.state_dir = state_dir
        self._console = console if console is not None else Console(stderr=True, quiet=True)
        bus_port, lab_port, free_port = free_ports(3)
        self.acting = _bus("HANDEYE_BUS_", bus_port, "acting")
        self.lab = _bus("HANDEYE_LAB_BUS_", lab_port, "lab")
        self._bus_port = bus_port
        self.token = secrets.token_urlsafe(24)
        self._port = port or free_port
        self.url = f"http://{LOOPBACK}:{self._port}"
        self.server = self.acting | {
            "HANDEYE_SERVER_HOST": LOOPBACK,
            "HANDEYE_SERVER_PORT": str(self._port),
            "HANDEYE_SERVER_TOKEN": self.token,
            "HANDEYE_SERVER_DATA_DIR": str(state_dir / "data"),
            "HANDEYE_DATABASE_URL": database_url or f"sqlite:///{state_dir.absolute() / 'data' / 'handeye.db'}",
        }
        self._settings = {"HANDEYE_ROBOT_CLOCK": clock.value, "HANDEYE_ROBOT_PROFILE": profile.value}
        self.supervisor = Supervisor(state_dir / "logs")
        self._open = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            opened.enter_context(state.exclusive(self.state_dir))
            # Of a stack that was killed: nobody must take it for this one's.
            self._forget()
            opened.enter_context(self.supervisor)
            self._start()
            opened.callback(self._forget)
            state.write_private(self.state_dir / state.SERVER_FILE, {"url": self.url, "token": self.token})
            state.write_private(self.state_dir / state.LAB_FILE, {"acting": self.acting, "lab": self.lab})
            self._open = opened.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def check(self) -> None:
        """`ProcessDied` if one of the processes has ended."""
        self.supervisor.check()

    def start_verb(
        self, verb: str, *arguments: str, environment: Mapping[str, str], name: str = "", logged: bool = True
    ) -> Child:
        """Starts `handeye VERB --watch-parent ARGUMENTS` with only `environment` of the stack's settings."""
        command = [sys.executable, "-m", "handeye.cli.main", verb, "--watch-parent", *arguments]
        return self.supervisor.start(name or verb, command, clean_environment() | dict(environment), logged=logged)

    def wait_ready(self, tell: Callable[[str], None] = lambda _answer: None) -> None:
        """Returns once the server is ready; `tell` is given what is missing until then."""

        def ready() -> bool:
            answer = _readiness(self.url)
            if answer:
                tell(answer)
            return answer == ""

        self.supervisor.wait_until(ready, READY_TIMEOUT, "the server")

    def _start(self) -> None:
        supervisor = self.supervisor
        with self._console.status("starting the router") as status:
            self.start_verb("router", environment=self._router())
            supervisor.wait_until(lambda: _accepts(self._bus_port), ROUTER_TIMEOUT, "the router")
            status.update("starting robot bridge, camera bridge and server")
            self.start_verb("robot-bridge", environment=self.acting | self.lab | self._settings, name="robot bridge")
            self.start_verb("camera-bridge", environment=self.acting | self.lab, name="camera bridge")
            self.start_verb("server", environment=self.server)
            self.wait_ready(lambda answer: status.update(f"waiting: {answer}"))

    def _router(self) -> dict[str, str]:
        credentials = {self.acting["HANDEYE_BUS_USER"]: self.acting["HANDEYE_BUS_PASSWORD"]}
        return {
            "HANDEYE_ROUTER_LISTEN": self.acting["HANDEYE_BUS_ENDPOINT"],
            "HANDEYE_ROUTER_CREDENTIALS": json.dumps(credentials),
        }

    def _forget(self) -> None:
        for name in (state.SERVER_FILE, state.LAB_FILE):
            (self.state_dir / name).unlink(missing_ok=True)


def register(app: typer.Typer) -> None:
    """Adds the verb `up`."""

    @app.command("up")
    def up(
        clock: Annotated[Clock, typer.Option(help="How world time passes.")] = Clock.LOCKSTEP,
        profile: Annotated[Profile, typer.Option(help="Real lab effects, or none.")] = Profile.DEFAULT,
        port: Annotated[int, typer.Option(min=0, max=65535, help="The server's port; 0: a free one.")] = 0,
        state_dir: Annotated[
            Path | None, typer.Option(help="Where logs and the state file go (default: ~/.local/state/handeye).")
        ] = None,
    ) -> None:
        """Start router, robot bridge, camera bridge and server here, until Ctrl-C."""
        console = Console(stderr=True)
        directory = state_dir if state_dir is not None else state.default_state_dir()
        database_url = os.environ.get("HANDEYE_DATABASE_URL", "")
        starting = Stack(directory, clock=clock, profile=profile, port=port, database_url=database_url, console=console)
        with signals_unwind(), starting as stack:
            console.print(f"[green]ready[/]: {stack.url}  (token and settings: {directory}; Ctrl-C ends it)")
            stack.supervisor.run_forever()


def free_ports(count: int) -> list[int]:
    """`count` different TCP ports of the loopback interface that nobody listens on now."""
    with ExitStack() as opened:
        sockets = [opened.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind((LOOPBACK, 0))
        return [int(each.getsockname()[1]) for each in sockets]


def clean_environment() -> dict[str, str]:
    """This process's environment without the settings of any bus, which a stack hands out itself.

    Other settings of the roles pass, for instance HANDEYE_SERVER_ACTING__MAX_LOOKS.
    """
    buses = ("HANDEYE_BUS_", "HANDEYE_LAB_BUS_", "HANDEYE_ROUTER_")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(buses)}
    return kept | {"PYTHONUNBUFFERED": "1"}


def _bus(prefix: str, port: int, user: str) -> dict[str, str]:
    return {
        f"{prefix}ENDPOINT": f"tcp/{LOOPBACK}:{port}",
        f"{prefix}USER": user,
        f"{prefix}PASSWORD": secrets.token_urlsafe(24),
    }


def _accepts(port: int) -> bool:
    try:
        with socket.create_connection((LOOPBACK, port), timeout=0.5):
            return True
    except OSError:
        return False


_DIRECT = urllib.request.build_opener(urllib.request.ProxyHandler({}))
"""Opens URLs of this machine; a proxy of the environment is not asked."""


def _readiness(url: str) -> str:
    """Empty when the server is ready, else why not."""
    try:
        with _DIRECT.open(f"{url}/readyz", timeout=2.0):
            return ""
    except urllib.error.HTTPError as error:
        with error:
            return _reason(error.read()) or f"HTTP status {error.code}"
    except OSError:
        return "the server does not answer yet"


def _reason(body: bytes) -> str:
    try:
        content = json.loads(body)
    except ValueError:
        return ""
    return str(content.get("detail", "")) if isinstance(content, dict) else ""

"""The `handeye router` command: the process between the others, so that each of them can restart alone."""

from typing import Annotated

import structlog
import typer

from handeye.rpc.bus import Bus
from handeye.rpc.errors import RpcError
from handeye.rpc.process import configure_logging, until_stopped
from handeye.rpc.settings import BusSettings, RouterSettings


def router(watch_parent: Annotated[bool, typer.Option("--watch-parent", help="End when stdin ends.")] = False) -> None:
    """Route messages between the other processes until TERM or Ctrl-C (settings: HANDEYE_ROUTER_*)."""
    configure_logging()
    settings = RouterSettings()
    credentials = {user: password.get_secret_value() for user, password in settings.credentials.items()}
    try:
        with until_stopped(watch_parent) as stop, Bus.host(BusSettings(endpoint=settings.listen), credentials):
            structlog.get_logger().info("router listens", endpoint=settings.listen, credentials=bool(credentials))
            stop.wait()
    except RpcError as error:
        raise SystemExit(str(error)) from error


def register(app: typer.Typer) -> None:
    """Adds the verb `router` to the `handeye` command."""
    app.command()(router)

"""The `handeye server` command."""

from __future__ import annotations

from typing import Annotated

import typer
from pydantic import SecretStr


def register(app: typer.Typer) -> None:
    """Adds the verb `server` to the `handeye` command."""

    @app.command()
    def server(
        watch_parent: Annotated[bool, typer.Option("--watch-parent", help="End when stdin ends.")] = False,
    ) -> None:
        """Run the coordinator until TERM or Ctrl-C (settings: HANDEYE_SERVER_*, HANDEYE_BUS_*)."""
        # Here, not above: every `handeye` command imports this module, few need what the server needs.
        from handeye.rpc import BusSettings
        from handeye.rpc.process import configure_logging, until_stopped
        from handeye.server.serve import serve
        from handeye.server.settings import ServerSettings

        configure_logging()
        with until_stopped(watch_parent) as stop:
            serve(ServerSettings(), BusSettings(), stop, _announce)


def _announce(url: str, made_token: SecretStr | None) -> None:
    typer.echo(f"The coordinator listens at {url}", err=True)
    if made_token is not None:
        typer.echo(f"Its token, made for this run: {made_token.get_secret_value()}", err=True)

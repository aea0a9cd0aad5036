"""The `handeye server`, `handeye verify` and `handeye repair` commands."""

from __future__ import annotations

from typing import Annotated

import typer

DatabaseUrl = Annotated[
    str,
    typer.Option(
        envvar="HANDEYE_DATABASE_URL",
        show_envvar=True,
        help="The store, sqlite:////folder/file.db or postgresql+psycopg://…; default: the one of `handeye server`.",
    ),
]


def register(app: typer.Typer) -> None:
    """Adds the verbs `server`, `verify` and `repair` to the `handeye` command."""

    @app.command()
    def server(
        watch_parent: Annotated[bool, typer.Option("--watch-parent", help="End when stdin ends.")] = False,
    ) -> None:
        """Run the coordinator until TERM or Ctrl-C (settings: HANDEYE_SERVER_*, _BUS_*, HANDEYE_DATABASE_URL)."""
        # Here, not above: every `handeye` command imports this module, few need what the server needs.
        from handeye.rpc import BusSettings
        from handeye.rpc.process import configure_logging, until_stopped
        from handeye.server.access.logs import configure_level
        from handeye.server.serve import serve
        from handeye.server.settings import ServerSettings

        settings = ServerSettings()
        configure_logging()
        configure_level(settings.log_level)
        with until_stopped(watch_parent) as stop:
            serve(settings, BusSettings(), stop, _tell)

    @app.command()
    def verify(database_url: DatabaseUrl = "") -> None:
        """Look for damage in the store and change nothing; the exit code is 0 when there is none. A server may run."""
        from handeye.server.maintenance import verify_store

        if not verify_store(database_url):
            raise typer.Exit(1)

    @app.command()
    def repair(database_url: DatabaseUrl = "") -> None:
        """Mend a damaged store; what cannot be mended is set aside, never dropped. No server may run on it."""
        from handeye.server.maintenance import repair_store

        repair_store(database_url)


def _tell(sentence: str) -> None:
    typer.echo(sentence, err=True)

"""Brings a store to the present form: makes a new one, or migrates an older one (Alembic)."""

from __future__ import annotations

from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, inspect

from handeye.server.store.tables import metadata


def upgrade(engine: Engine) -> None:
    """Makes the tables in an empty database, or applies what migrations are missing; all or nothing."""
    with engine.connect().execution_options(handeye_write=True) as connection, connection.begin():
        if _revision(connection) == newest():
            return
        if not inspect(connection).get_table_names():
            # The same as all migrations one after the other (a test compares them), and much faster.
            metadata.create_all(connection)
            command.stamp(_config(connection), "head")
            return
        command.upgrade(_config(connection), "head")


def newest() -> str:
    """The revision that this version of the code works with."""
    head = ScriptDirectory(str(_FOLDER)).get_current_head()
    return str(head)


_FOLDER = Path(__file__).parent / "migrations"


def _revision(connection: Connection) -> str | None:
    if not inspect(connection).has_table("alembic_version"):
        return None
    return MigrationContext.configure(connection).get_current_revision()


def _config(connection: Connection) -> Config:
    config = Config()
    config.set_main_option("script_location", str(_FOLDER))
    config.attributes["connection"] = connection
    return config

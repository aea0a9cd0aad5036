"""`handeye verify`: finds what is wrong in a store, whatever state it is in, and changes nothing."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import URL, Connection, inspect

from handeye.server.store.engine import StoreError, parse
from handeye.server.store.findings import Finding, shown
from handeye.server.store.reading import Unreadable, Watch, reading, unwatched
from handeye.server.store.rules import troubles
from handeye.server.store.survey import Survey, Trouble
from handeye.server.store.tables import metadata
from handeye.server.store.upgrade import newest
from handeye.server.store.wal import read_log

_MOST = 100  # complaints of the database about itself that are told


class Examination:
    """What an examination of a store has found."""

    def __init__(self) -> None:
        self.file: list[Finding] = []
        """In its file or files, below its rows."""
        self.form: list[tuple[Finding, Any]] = []
        """In its tables, with Alembic's word for it."""
        self.survey = Survey()
        self.troubles: list[Trouble] = []
        """In its rows."""

    @property
    def findings(self) -> list[Finding]:
        """All of them."""
        form = [finding for finding, _ in self.form]
        return [*self.file, *form, *self.survey.unreadable, *(trouble.finding for trouble in self.troubles)]

    @property
    def is_torn(self) -> bool:
        """Bytes have changed on the disk, or are gone."""
        return bool(self.file or self.form or self.survey.unreadable or self.survey.changed)


def verify(url: str, watch: Watch = unwatched) -> list[Finding]:
    """Everything that is wrong in the store at an SQLAlchemy URL; others may go on using it.

    `StoreError` when there is no store, or one of another version.
    """
    return examine(parse(url), watch).findings


def examine(url: URL, watch: Watch = unwatched, *, alone: bool = False) -> Examination:
    """The same in detail; `alone`: the caller owns the store."""
    found = Examination()
    if url.get_backend_name() == "sqlite":
        file = Path(str(url.database))
        require(file)
        with nullcontext(True) if alone else _undisturbed(file) as undisturbed:
            found.file += _beneath(file, undisturbed)
    try:
        with reading(url) as connection:
            if url.get_backend_name() == "sqlite":
                said = connection.exec_driver_sql(f"PRAGMA integrity_check({_MOST})").scalars().all()
                lines = [line for each in said for line in each.splitlines() if not line.startswith("***")]
                found.file += [Finding("", "", f"SQLite says: {shown(line)}") for line in lines if line != "ok"]
            found.form = list(_differences(connection))
            _check_version(connection, found)
            without = {finding.table for finding, _ in found.form}
            found.survey.read(connection, watch, without)
            found.troubles = [*found.survey.troubles, *([] if without else troubles(found.survey))]
    except Unreadable as error:
        if url.get_backend_name() != "sqlite":
            raise
        found.file.append(Finding("", "", f"SQLite cannot read it: {error.reason}"))
    return found


def require(file: Path) -> None:
    """`StoreError` when there is no file, or nothing in it."""
    if not file.is_file():
        raise StoreError(f"there is no store {file}; HANDEYE_DATABASE_URL says where it is")
    if not file.stat().st_size:
        raise StoreError(f"the store {file} is an empty file: nothing was ever in it, or all is lost; restore a backup")


def _beneath(file: Path, undisturbed: bool) -> Iterator[Finding]:
    """What SQLite overlooks: a header by which it cannot write, or skips the log; a log damaged in its midst."""
    with file.open("rb") as content:
        header = content.read(20)
    if header.startswith(b"SQLite format 3\0") and header[18:20] not in (b"\1\1", b"\2\2"):
        yield Finding("", "", "its header does not say whether it has a write-ahead log")
    # While a server writes, the log is in motion.
    log = read_log(Path(f"{file}-wal")) if undisturbed else None
    if log is not None and log.read < len(log.frames):
        yield Finding(
            "",
            "",
            f"its write-ahead log is damaged: of the pages written to it SQLite reads {log.read}, and not the "
            f"{len(log.frames) - log.read} behind the damage",
        )


@contextmanager
def _undisturbed(path: Path) -> Iterator[bool]:
    """Whether no process owns the store; none does until the end."""
    try:
        lock = os.open(f"{path}.lock", os.O_RDONLY)
    except OSError:
        yield True
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        yield True
    except BlockingIOError:
        yield False
    finally:
        os.close(lock)


def version(connection: Connection) -> str | None:
    """The revision that the store is of; None when it does not say it."""
    if not inspect(connection).has_table("alembic_version"):
        return None
    return MigrationContext.configure(connection).get_current_revision()


def _check_version(connection: Connection, found: Examination) -> None:
    """`StoreError` when it is of another version. Where there is other damage, this may be damage too."""
    revision = version(connection)
    if revision == newest():
        return
    if not set(inspect(connection).get_table_names()) & set(metadata.tables):
        if not found.file:
            raise StoreError("this is no store of handeye: it has none of its tables")
    elif revision is not None and not found.file:
        raise StoreError(
            f"the store is of version {revision!r}, this handeye works with {newest()!r}: an older one is brought "
            "up to date when the server starts, a newer one needs a newer handeye"
        )
    found.form.append((Finding("alembic_version", "", f"it says {revision!r} and not {newest()!r}"), None))


def _differences(connection: Connection) -> Iterator[tuple[Finding, Any]]:
    """Where the tables are not as they should be, as Alembic sees it."""
    context = MigrationContext.configure(connection, opts={"compare_type": True})
    for difference in compare_metadata(context, metadata):
        for change in difference if isinstance(difference, list) else [difference]:
            verb, *what = change
            if verb == "add_table":
                yield Finding(what[0].name, "", "the table is missing"), change
            elif verb == "add_index":
                yield Finding(what[0].table.name, "", f"its index {what[0].name} is missing"), change
            elif verb in ("add_column", "remove_column"):
                state = "is missing" if verb == "add_column" else "is none of ours"
                yield Finding(what[1], "", f"its column {shown(what[2].name)} {state}"), change
            elif verb.startswith("modify_"):
                yield Finding(what[1], "", f"its column {shown(what[2])} is declared in another way"), change
            elif verb in ("add_constraint", "add_fk"):
                yield Finding(what[0].table.name, "", "one of its constraints is missing"), change

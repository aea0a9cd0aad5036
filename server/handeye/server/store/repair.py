"""`handeye repair`: mends a store. What cannot be mended goes to table `set_aside`; nothing is dropped silently."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection
from sqlalchemy.exc import DBAPIError

from handeye.server.store.check import Examination, examine, require
from handeye.server.store.engine import StoreError, connect, explain, own, parse
from handeye.server.store.findings import Finding, Repaired
from handeye.server.store.reading import Watch, unwatched
from handeye.server.store.rules import troubles
from handeye.server.store.salvage import salvage
from handeye.server.store.survey import Survey
from handeye.server.store.tables import metadata
from handeye.server.store.wal import PAGE_SIZE, read_log

_ROUNDS = 4
"""What is mended may show what else does not fit; more often than this, mending does not help."""


@dataclass(frozen=True, slots=True)
class Report:
    """What a repair did."""

    done: tuple[Repaired, ...]
    """Nothing when the store was well."""
    original: Path | None
    """Where the damaged file is kept, when the store was written anew."""


def repair(url: str, watch: Watch = unwatched) -> Report:
    """Mends the store at an SQLAlchemy URL; `verify` finds nothing afterwards.

    `StoreBusy` while a server has it open. `StoreError` when nothing can be saved or there is no store; then nothing
    has been changed.
    """
    parsed = parse(url)
    file = Path(str(parsed.database)) if parsed.get_backend_name() == "sqlite" else None
    if file is not None:
        require(file)
    owner = own(parsed)
    try:
        if file is not None:
            _give(Path(f"{file}.lock"), like=file)
        found = examine(parsed, watch, alone=True)
        if file is not None and found.is_torn:
            return _rewrite(file, found, watch)
        return Report(tuple(_mend(parsed, found, watch)) if found.findings else (), None)
    finally:
        owner.release()


def _mend(url: URL, found: Examination, watch: Watch) -> list[Repaired]:
    """Restores what must hold between the rows, in one transaction."""
    engine = connect(url)
    done: list[Repaired] = []
    try:
        with engine.connect().execution_options(handeye_write=True) as connection, connection.begin():
            for finding, change in found.form:
                done.append(Repaired(finding, _restore_form(connection, finding, change)))
            for _ in range(_ROUNDS):
                survey = Survey()
                survey.read(connection, watch)
                if survey.unreadable:
                    raise StoreError(f"{survey.unreadable[0]}; nothing was changed: restore a backup")
                todo = [*survey.troubles, *troubles(survey)]
                if not todo:
                    return done
                done += [Repaired(trouble.finding, trouble.mend(connection)) for trouble in todo]
            raise StoreError(f"{todo[0].finding}; it cannot be mended, nothing was changed: restore a backup")
    except DBAPIError as error:
        raise StoreError(f"{explain(url, error)}; nothing was changed") from error
    finally:
        engine.dispose()


def _restore_form(connection: Connection, finding: Finding, change: Any) -> str:
    """Makes a table or an index that is missing."""
    if change is not None and change[0] == "add_table":
        metadata.create_all(connection, tables=[change[1]])
        return "it was made anew, empty"
    if change is not None and change[0] == "add_index":
        change[1].create(connection)
        return "it was made anew"
    raise StoreError(f"{finding}; it cannot be mended, nothing was changed: restore a backup")


def _rewrite(file: Path, found: Examination, watch: Watch) -> Report:
    """Makes a new file of what is whole in a damaged one, and puts it in its place."""
    log_file = Path(f"{file}-wal")
    with _temporary(file, "image") as image, _temporary(file, "repaired") as new:
        newest = _write_image(file, log_file, image)
        url = parse(f"sqlite:///{new}")
        done = salvage(image, newest, new, watch)
        done += _mend(url, Examination(), watch)
        left = examine(url, watch, alone=True).findings
        if left:
            raise StoreError(f"{left[0]}; it cannot be mended, nothing was changed: restore a backup")
        kept = _free_name(file)
        for path in (image, new):
            _give(path, like=file)
            _sync(path)
        _keep(file, kept)
        if newest:
            _keep(log_file, Path(f"{kept}-wal"))
        _sync(file.parent)
        # The log must never stand beside the new file: it would be written into that. The image holds all that the log
        # holds, so whatever this is interrupted by, the store is as it was, or whole.
        image.replace(file)
        _sync(file.parent)
        for suffix in ("-wal", "-shm"):
            Path(f"{file}{suffix}").unlink(missing_ok=True)
        _sync(file.parent)
        new.replace(file)
        _sync(file.parent)
    written = "the store was written anew with all rows that are whole"
    form = [finding for finding, _ in found.form]
    file_findings = [Repaired(finding, written) for finding in [*found.file, *form, *found.survey.unreadable]]
    return Report((*file_findings, *done), kept)


def _write_image(file: Path, log_file: Path, image: Path) -> dict[int, int]:
    """The database as file and log have it together; returns how young each page from the log is."""
    shutil.copyfile(file, image)
    # Of the last page of a file that was cut off, a part may be there.
    os.truncate(image, -(-image.stat().st_size // PAGE_SIZE) * PAGE_SIZE)
    log = read_log(log_file)
    newest: dict[int, int] = {}
    if log.frames:
        with image.open("r+b") as written, log_file.open("rb") as source:
            for age, frame in enumerate(log.frames, start=1):
                source.seek(frame.content)
                written.seek((frame.page - 1) * log.page_size)
                written.write(source.read(log.page_size))
                newest[frame.page] = age
            written.truncate(log.frames[-1].size * log.page_size)
    return newest


@contextmanager
def _temporary(file: Path, purpose: str) -> Iterator[Path]:
    """A name beside the file, free now; what stands there at the end is deleted."""
    path = file.with_name(f"{file.name}.{purpose}-{os.getpid()}")
    everything = [Path(f"{path}{suffix}") for suffix in ("", "-wal", "-shm", "-journal")]
    try:
        for each in everything:
            each.unlink(missing_ok=True)
        yield path
    finally:
        for each in everything:
            each.unlink(missing_ok=True)


def _free_name(file: Path) -> Path:
    stamp = time.strftime("%Y%m%d-%H%M%S")
    names = (file.with_name(f"{file.name}.damaged-{stamp}{extra}") for extra in ("", *(f"-{n}" for n in range(2, 100))))
    return next(name for name in names if not name.exists())


def _keep(file: Path, kept: Path) -> None:
    """Gives a file a second name, or copies it where a file can have only one."""
    try:
        os.link(file, kept)
    except OSError:
        shutil.copy2(file, kept)
        _sync(kept)


def _give(path: Path, like: Path) -> None:
    """Owner and mode of another file: whoever repairs a store may be another user than who serves it."""
    there = like.stat()
    if os.geteuid() == 0:
        os.chown(path, there.st_uid, there.st_gid)
    path.chmod(there.st_mode & 0o777)


def _sync(path: Path) -> None:
    """A file or folder is as it is on the disk too."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

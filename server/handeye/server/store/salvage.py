"""Makes a new store of what is whole in a damaged SQLite file.

Whatever page it stands on, a row is taken for one when its checksum fits. Cells that their page has lost are looked for
at every place of it; a row of which one byte has changed is put right; the others are set aside.
"""

from __future__ import annotations

import mmap
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from sqlalchemy import Table

from handeye.server.store.engine import StoreError, connect, parse
from handeye.server.store.findings import Finding, Repaired, entry
from handeye.server.store.mending import mended
from handeye.server.store.pages import INTERIOR_INDEX, INTERIOR_TABLE, LEAF_INDEX, LEAF_TABLE, Cell, Pages
from handeye.server.store.reading import Watch, damage, key_of, misfit, row_from
from handeye.server.store.rows import kind_of
from handeye.server.store.tables import metadata, samples, set_aside
from handeye.server.store.upgrade import newest as newest_version
from handeye.server.store.upgrade import upgrade
from handeye.server.store.wal import PAGE_SIZE

_BEGINNING = 40  # bytes of a cell that say how long what is, at most
_UNREAD = 12  # so many bytes together that belong to nothing are no leftovers of free space
_HOLDS_ROWS = (LEAF_TABLE, LEAF_INDEX, INTERIOR_INDEX)

_TREES = {table for table in metadata.sorted_tables if table.dialect_options["sqlite"]["with_rowid"] is False}
_BY_SHAPE: dict[tuple[bool, int], list[Table]] = {}
for _table in metadata.sorted_tables:
    _BY_SHAPE.setdefault((_table not in _TREES, len(_table.columns)), []).append(_table)

_OTHERS = {"alembic_version", *(str(index.name) for table in metadata.sorted_tables for index in table.indexes)}


def salvage(image: Path, newest: Mapping[int, int], target: Path, watch: Watch) -> list[Repaired]:
    """Writes what is whole in the database file `image` into a new store `target`.

    Pages with higher values in `newest` are younger, for where two have the same row. `StoreError` when nothing of a
    store is found, or when it is of another version.
    """
    engine = connect(parse(f"sqlite:///{target}"))
    try:
        upgrade(engine)
    finally:
        engine.dispose()
    with image.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        said = int.from_bytes(content[16:18])
        sizes = dict.fromkeys((said, PAGE_SIZE) if said in {1 << n for n in range(9, 16)} else (PAGE_SIZE,))
        for size in sizes:
            if len(content) < size:
                continue
            with closing(sqlite3.connect(target, isolation_level=None)) as connection:
                work = _Salvage(Pages(content, size), connection, watch)
                if work.run(newest):
                    return work.done
    raise StoreError("nothing of a store can be found in the file; nothing was changed: restore a backup")


class _Salvage:
    def __init__(self, pages: Pages, target: sqlite3.Connection, watch: Watch) -> None:
        self.done: list[Repaired] = []
        self._pages = pages
        self._target = target
        self._watch = watch
        self._owners: dict[int, str] = {}
        """Page → the table or index in whose tree it is."""
        self._overflow: set[int] = set()
        self._index_keys: list[tuple[Table, tuple[Any, ...]]] = []
        self._lost = False
        self._rows = 0

    def run(self, newest: Mapping[int, int]) -> bool:
        """Whether anything of a store was found."""
        self._target.execute("BEGIN")
        self._find_owners()
        self._check_version()
        order = sorted(range(1, self._pages.count + 1), key=lambda number: newest.get(number, 0), reverse=True)
        suspects = [number for number in order if not self._take_page(number)]
        for number in suspects:
            if number not in self._overflow:
                self._rescue(number)
        if self._pages.expected > self._pages.count:
            said = f"its header says that the file has {self._pages.expected} pages, and it has {self._pages.count}"
            self._aside("", "", f"{said}: what was on the others is lost", {})
            self._lost = True
        if self._lost:
            self._name_lost_rows()
        self._target.execute("COMMIT" if self._rows else "ROLLBACK")
        return self._rows > 0

    def _find_owners(self) -> None:
        pages, shared = self._pages, set[int]()
        roots = {1: "sqlite_schema"}
        for number in pages.below(1) & set(range(1, pages.count + 1)):
            page = pages.page(number)
            for place in pages.pointers(number, page):
                cell = pages.cell(page, place, LEAF_TABLE)
                if cell is not None and len(cell.values) == 5 and _is_known(cell.values[1]):
                    roots[cell.values[3]] = cell.values[1]
        for root, name in roots.items():
            for number in pages.below(root):
                if self._owners.setdefault(number, name) != name:
                    shared.add(number)
        for number in shared:
            del self._owners[number]

    def _check_version(self) -> None:
        """`StoreError` when the store is of another version: the table and its index say the same."""
        pages, said = self._pages, set[Any]()
        for number, name in self._owners.items():
            if name in ("alembic_version", "sqlite_autoindex_alembic_version_1") and number <= pages.count:
                page, kind = pages.page(number), pages.kind(number)
                cells = [pages.cell(page, place, kind) for place in pages.pointers(number, page)]
                said.update(cell.values[0] for cell in cells if cell is not None and cell.values)
        if len(said) == 1 and said != {newest_version()}:
            raise StoreError(
                f"the store is of version {said.pop()!r}, not {newest_version()!r}: repair it with the handeye that "
                "wrote it"
            )

    def _table_of(self, number: int) -> Table | None:
        return metadata.tables.get(self._owners.get(number, ""))

    def _take_page(self, number: int) -> bool:
        """Takes the rows that the page itself shows; False when there may be more on it."""
        pages, table, kind = self._pages, self._table_of(number), self._pages.kind(number)
        page = pages.page(number)
        if kind not in _HOLDS_ROWS:
            if table is None:
                return kind in (0, INTERIOR_TABLE)
            return kind == INTERIOR_TABLE and bool(pages.children(number))
        cells = [pages.cell(page, place, kind) for place in pages.pointers(number, page)]
        there = [cell for cell in cells if cell is not None]
        fitting = [self._take(cell, kind) for cell in there]
        if table is None and number in self._owners:
            self._note_keys(self._owners[number], there)
            return True
        if table is None and not any(fitting) and not any(self._candidates(None, kind, cell) for cell in there):
            return len(there) == len(cells)
        return len(there) == len(cells) and all(fitting) and pages.is_filled(number, page, there)

    def _rescue(self, number: int) -> None:
        """Takes what else is on a page: cells it does not show, rows that can be put right; sets the rest aside."""
        pages, table, kind = self._pages, self._table_of(number), self._pages.kind(number)
        page = bytearray(pages.page(number))
        start = pages.content_start(number, page)
        covered = bytearray(b"\x01" * start + bytes(pages.size - start))
        shown = [(place, kind) for place in pages.pointers(number, page)] if kind in _HOLDS_ROWS else []
        anywhere = [(place, form) for place in range(start, pages.size - 3) for form in (LEAF_TABLE, LEAF_INDEX)]
        found = 0
        for place, form in shown + anywhere:
            cell = None if covered[place] else pages.cell(page, place, form)
            if cell is not None and self._take(cell, form):
                found += 1
                _cover(covered, cell)
        for place, form in shown:
            cell = None if covered[place] else self._mend(number, page, place, form)
            if cell is not None:
                found += 1
                _cover(covered, cell)
        if (table is None or kind == INTERIOR_TABLE) and not found:
            return
        left = bytes(byte for byte, known in zip(page, covered, strict=True) if not known)
        if not any(page):
            self._lose(number, b"", "is empty")
        elif any(len(piece) > _UNREAD for piece in left.split(bytes(4))):
            self._lose(number, bytes(page), "is damaged")

    def _candidates(self, table: Table | None, kind: int, cell: Cell) -> list[Table]:
        """The tables that a record can be of; `table`: that of the page, where it is known."""
        if table is not None:
            return [table] if len(table.columns) == len(cell.values) else []
        possible = _BY_SHAPE.get((kind == LEAF_TABLE, len(cell.values)), [])
        return [each for each in possible if misfit(each, row_from(each, cell.values)) is None]

    def _take(self, cell: Cell, kind: int) -> bool:
        """Writes the row in a cell into the new store, if it is a whole one of ours."""
        if cell.whole:
            for table in _BY_SHAPE.get((kind == LEAF_TABLE, len(cell.values)), ()):
                row = row_from(table, cell.values)
                if damage(table, row) is None:
                    self._overflow.update(cell.overflow)
                    self._insert(table, row)
                    return True
        return False

    def _mend(self, number: int, page: bytearray, place: int, kind: int) -> Cell | None:
        """Puts the cell at that place right, or sets it aside; None when it cannot even be read."""
        cell = self._pages.cell(page, place, kind)
        candidates = [] if cell is None else self._candidates(self._table_of(number), kind, cell)
        rows = [] if cell is None else [(table, row_from(table, cell.values)) for table in candidates]
        for table, row in rows:
            better = mended(table, row) if cell is not None and cell.whole else None
            if cell is not None and better is not None:
                self._overflow.update(cell.overflow)
                self._insert(table, better)
                self._did(table.name, key_of(table, better), "one byte of it had changed", "it was put right")
                return cell
        # Where a row goes on over many pages, this would take long, and it can be read as it is.
        if cell is None or not cell.overflow or all(misfit(table, row) is not None for table, row in rows):
            other = self._with_another_beginning(number, page, place, kind)
            if other is not None:
                return other
        if not rows:
            return None
        table, row = rows[0]
        self._aside(table.name, key_of(table, row), damage(table, row) or "it is damaged", row)
        return cell

    def _with_another_beginning(self, number: int, page: bytearray, place: int, kind: int) -> Cell | None:
        """Takes the row of a cell in which one byte has changed of those that say what is where."""
        for i in range(place, min(place + _BEGINNING, self._pages.size)):
            for change in range(1, 256):
                page[i] ^= change
                cell = self._pages.cell(page, place, kind)
                page[i] ^= change
                if cell is not None and self._take(cell, kind):
                    problem = f"one byte of a row on page {number} of the file had changed"
                    self._did(self._owners.get(number, ""), "", problem, "it was put right")
                    return cell
        return None

    def _insert(self, table: Table, row: Mapping[str, Any]) -> None:
        names = ", ".join(f'"{name}"' for name in row)
        holders = ", ".join("?" * len(row))
        done = self._target.execute(
            f'INSERT OR IGNORE INTO "{table.name}" ({names}) VALUES ({holders})',  # noqa: S608 # names of ours
            tuple(row.values()),
        )
        self._rows += done.rowcount
        if self._rows % 1000 == 0:
            self._watch(table.name, self._rows)
        if not done.rowcount and self._stored_checksum(table, row) != row["checksum"]:
            self._aside(table.name, key_of(table, row), "there is a younger row of the same key", row)

    def _stored_checksum(self, table: Table, row: Mapping[str, Any]) -> int | None:
        key = [column.name for column in table.primary_key.columns]
        where = " AND ".join(f'"{name}" = ?' for name in key)
        found = self._target.execute(
            f'SELECT checksum FROM "{table.name}" WHERE {where}',  # noqa: S608 # names of ours
            [row[name] for name in key],
        ).fetchone()
        return None if found is None else int(found[0])

    def _note_keys(self, index: str, cells: list[Cell]) -> None:
        """Remembers the rows that an index names: the table must have them."""
        for table in metadata.sorted_tables:
            key = list(table.primary_key.columns)
            if index == f"sqlite_autoindex_{table.name}_1":
                keys = [tuple(cell.values[: len(key)]) for cell in cells if len(cell.values) == len(key) + 1]
            elif table is samples and index == "ix_samples_module_demonstration":
                keys = [(cell.values[0], cell.values[2]) for cell in cells if len(cell.values) == 3]
            else:
                continue
            kinds = [kind_of(column) for column in key]
            self._index_keys.extend((table, each) for each in keys if [type(value) for value in each] == kinds)

    def _name_lost_rows(self) -> None:
        for table, key in self._index_keys:
            row = dict(zip((column.name for column in table.primary_key.columns), key, strict=True))
            if self._stored_checksum(table, row) is None:
                self._aside(
                    table.name, key_of(table, row), "it could not be read any more; an index still names it", row
                )

    def _lose(self, number: int, content: bytes, state: str) -> None:
        self._lost = True
        name = self._owners.get(number, "")
        self._aside(name, "", f"page {number} of the file {state}: rows on it may be lost", {"page": content})

    def _aside(self, table: str, key: str, problem: str, content: Mapping[str, Any]) -> None:
        self._insert(set_aside, entry(table, key, problem, content))
        self._rows -= 1
        self._did(table, key, problem, "what could be read of it was set aside")

    def _did(self, table: str, key: str, problem: str, remedy: str) -> None:
        self.done.append(Repaired(Finding(table, key, problem), remedy))


def _is_known(name: Any) -> bool:
    """Whether a store has a table or an index of that name."""
    return name in metadata.tables or name in _OTHERS or str(name).startswith("sqlite_autoindex_")


def _cover(covered: bytearray, cell: Cell) -> None:
    covered[cell.start : cell.end] = bytes([1]) * (cell.end - cell.start)

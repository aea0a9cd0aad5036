from __future__ import annotations

import string
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import Table

from handeye.server.store import Store
from handeye.server.store.mending import mended
from handeye.server.store.reading import damage
from handeye.server.store.rows import add, change, checksum, find, kind_of, put, seal
from handeye.server.store.tables import counters, demonstrations, metadata, observations, samples

TABLES = list(metadata.sorted_tables)
VALUES: dict[type, st.SearchStrategy[Any]] = {
    str: st.text(max_size=40),
    bytes: st.binary(max_size=40),
    bool: st.booleans(),
    int: st.integers(-(2**31), 2**31 - 1),
    float: st.floats(allow_nan=False),
}


def row_of(table: Table) -> st.SearchStrategy[dict[str, Any]]:
    """Any sealed row of a table."""
    columns = list(table.columns)[:-1]
    return st.fixed_dictionaries(
        {
            column.name: st.none() | VALUES[kind_of(column)] if column.nullable else VALUES[kind_of(column)]
            for column in columns
        }
    ).map(lambda row: seal(table, row))


ANY_ROW = st.sampled_from(TABLES).flatmap(lambda table: st.tuples(st.just(table), row_of(table)))


class TestChecksum:
    @given(ANY_ROW)
    def test_a_row_fits_its_own(self, table_and_row: tuple[Table, dict[str, Any]]) -> None:
        table, row = table_and_row
        assert damage(table, row) is None

    @given(ANY_ROW, st.data())
    def test_another_value_does_not_fit(self, table_and_row: tuple[Table, dict[str, Any]], data: st.DataObject) -> None:
        table, row = table_and_row
        column = data.draw(st.sampled_from(list(table.columns)[:-1]))
        other = data.draw(VALUES[kind_of(column)].filter(lambda value: repr(value) != repr(row[column.name])))
        assert damage(table, {**row, column.name: other}) is not None

    @pytest.mark.parametrize(("name", "value"), [("created", 1), ("finished", 1), ("number", True), ("id", b"a-1")])
    def test_what_would_be_read_back_as_something_else_is_refused(self, name: str, value: object) -> None:
        row = {
            "id": "a-1",
            "task": "a",
            "object": "cup",
            "number": 1,
            "finished": True,
            "outcome": None,
            "created": 1.0,
        }
        assert damage(demonstrations, seal(demonstrations, row)) is None
        with pytest.raises(TypeError, match=f"demonstrations.{name} takes"):
            seal(demonstrations, {**row, name: value})

    def test_values_do_not_run_together(self) -> None:
        one = {"demonstration": "a", "number": 1, "content": "bc"}
        assert checksum(observations, one) != checksum(observations, {**one, "demonstration": "ab", "content": "c"})

    def test_what_is_missing_is_not_what_is_empty(self) -> None:
        row = {"module": "m", "number": 1, "input": b"", "output": b"", "live": True}
        assert checksum(samples, {**row, "demonstration": None}) != checksum(samples, {**row, "demonstration": ""})

    def test_types_are_checked_before_sums(self) -> None:
        row = seal(counters, {"name": "jobs", "next": 1})
        assert damage(counters, {**row, "next": True}) == "its next is no whole number"
        assert damage(counters, {**row, "name": None}) == "its name is missing"
        assert damage(counters, {**row, "name": b"jobs"}) == "its name is no text"
        assert damage(counters, {**row, "name": "j\udcffbs"}) == "a text in it is no UTF-8"


class TestRows:
    def test_what_is_written_is_read_and_fits(self, store: Store) -> None:
        row: dict[str, Any] = {"task": "grasp", "object": "blue cup", "number": 1, "finished": False, "outcome": None}
        with store.write() as connection:
            add(connection, demonstrations, id="grasp-1", created=17.0, **row)
            change(connection, demonstrations, "grasp-1", finished=True, outcome="success")
            put(connection, counters, name="jobs", next=2**40)
            put(connection, counters, name="jobs", next=2**40 + 1)
        with store.read() as connection:
            found = find(connection, demonstrations, "grasp-1")
            counter = find(connection, counters, "jobs")
        assert found is not None
        assert counter is not None
        assert damage(demonstrations, found) is None
        assert damage(counters, counter) is None
        assert (found["finished"], found["outcome"], counter["next"]) == (True, "success", 2**40 + 1)

    def test_there_is_nothing_to_change_where_there_is_none(self, store: Store) -> None:
        with pytest.raises(KeyError), store.write() as connection:
            change(connection, demonstrations, "grasp-1", finished=True)

    @settings(max_examples=25, deadline=None)
    @given(row=row_of(samples))
    def test_the_database_gives_back_what_it_got(self, sqlite_store: Store, row: dict[str, Any]) -> None:
        with sqlite_store.write() as connection:
            connection.exec_driver_sql("PRAGMA defer_foreign_keys=ON")
            connection.execute(samples.insert(), row)
            found = find(connection, samples, row["module"], row["number"])
            connection.execute(samples.delete())
        assert found is not None
        assert damage(samples, found) is None


class TestMending:
    """One byte of a row changes."""

    @given(ANY_ROW, st.data())
    def test_it_is_put_right_or_left_alone(
        self, table_and_row: tuple[Table, dict[str, Any]], data: st.DataObject
    ) -> None:
        table, row = table_and_row
        name = data.draw(st.sampled_from([column.name for column in table.columns]))
        changed = {**row, name: data.draw(one_byte_of(row[name]))}
        if damage(table, changed) is not None:
            assert mended(table, changed) in (row, None)

    @pytest.mark.parametrize("place", range(3))
    @pytest.mark.parametrize("error", [1, 0x80, 0xFF])
    def test_content_and_key_and_sum_are_put_right(self, place: int, error: int) -> None:
        row = seal(observations, {"demonstration": "grasp-1", "number": 3, "content": string.printable * 20})
        text = bytearray(row["content"].encode())
        text[700] ^= error
        name = bytearray(b"grasp-1")
        name[2] ^= error
        changed = (
            {**row, "content": text.decode("utf-8", "surrogateescape")},
            {**row, "demonstration": name.decode("utf-8", "surrogateescape")},
            {**row, "checksum": row["checksum"] ^ error << 16},
        )[place]
        assert damage(observations, changed) is not None
        assert mended(observations, changed) == row

    @pytest.mark.parametrize(("number", "read"), [(117, -9), (300, -32468), (70_000, 70_000 - 2**23)])
    def test_a_sign_is_put_right(self, number: int, read: int) -> None:
        # SQLite keeps a number in as many bytes as it needs: the sign may be one bit, and all that is in front of it.
        row = seal(observations, {"demonstration": "grasp-1", "number": number, "content": "{}"})
        assert mended(observations, {**row, "number": read}) == row

    def test_more_than_a_byte_is_not_guessed(self) -> None:
        row = seal(observations, {"demonstration": "grasp-1", "number": 3, "content": "x" * 1000})
        assert mended(observations, {**row, "content": "y" * 500 + "x" * 500}) is None

    def test_in_a_large_row_a_bit_is_and_a_byte_is_not(self) -> None:
        content = bytes(range(256)) * 400
        row = {"module": "m", "number": 1, "input": content, "output": b"", "demonstration": None, "live": True}
        row = seal(samples, row)
        for error, wanted in ((0x10, row), (0x13, None)):
            damaged = bytearray(content)
            damaged[50_000] ^= error
            assert mended(samples, {**row, "input": bytes(damaged)}) == wanted


def one_byte_of(value: Any) -> st.SearchStrategy[Any]:
    """The value with one of its bytes changed, as it might be read."""
    if isinstance(value, str) and value:
        content = value.encode()
        return changed_byte(content).map(lambda changed: changed.decode("utf-8", "surrogateescape"))
    if isinstance(value, bytes) and value:
        return changed_byte(value)
    if isinstance(value, int) and not isinstance(value, bool):
        return st.integers(0, 31).map(lambda bit: value ^ 1 << bit)
    return st.just(value)


def changed_byte(content: bytes) -> st.SearchStrategy[bytes]:
    return st.tuples(st.integers(0, len(content) - 1), st.integers(1, 255)).map(
        lambda change: content[: change[0]] + bytes([content[change[0]] ^ change[1]]) + content[change[0] + 1 :]
    )

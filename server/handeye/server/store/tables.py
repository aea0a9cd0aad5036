"""What is in the store. Every table ends with `checksum`, which `rows.seal` fills in.

Vectors are little-endian float64. Times are seconds since 1970, UTC. JSON is text.
"""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Table,
    Text,
)

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
    }
)


def _checksum() -> Column[int]:
    return Column("checksum", BigInteger, nullable=False)


modules = Table(
    "modules",
    metadata,
    Column("name", Text, primary_key=True),
    Column("declaration", Text, nullable=False),
    # The next sample's number: numbers are never used twice.
    Column("next_number", BigInteger, nullable=False),
    Column("created", Float, nullable=False),
    _checksum(),
)

samples = Table(
    "samples",
    metadata,
    Column("module", Text, ForeignKey("modules.name", ondelete="CASCADE"), primary_key=True),
    Column("number", BigInteger, primary_key=True, autoincrement=False),
    Column("input", LargeBinary, nullable=False),
    Column("output", LargeBinary, nullable=False),
    Column("demonstration", Text),
    # False: it was taken out, and is kept for a snapshot that has it.
    Column("live", Boolean, nullable=False),
    _checksum(),
    Index("ix_samples_module_demonstration", "module", "demonstration"),
    # One tree, in the order in which samples are read; the key would else stand in an index of its own.
    sqlite_with_rowid=False,
)

snapshots = Table(
    "snapshots",
    metadata,
    Column("module", Text, ForeignKey("modules.name", ondelete="CASCADE"), primary_key=True),
    Column("name", Text, primary_key=True),
    Column("declaration", Text, nullable=False),
    # The samples' numbers, int64, ascending, zlib.
    Column("numbers", LargeBinary, nullable=False),
    Column("count", Integer, nullable=False),
    Column("created", Float, nullable=False),
    _checksum(),
)

objects = Table(
    "objects",
    metadata,
    Column("name", Text, primary_key=True),
    Column("created", Float, nullable=False),
    _checksum(),
)

object_pictures = Table(
    "object_pictures",
    metadata,
    Column("object", Text, ForeignKey("objects.name", ondelete="CASCADE"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("kind", Text, nullable=False),
    # PNG files.
    Column("left_image", LargeBinary, nullable=False),
    Column("right_image", LargeBinary, nullable=False),
    _checksum(),
)

demonstrations = Table(
    "demonstrations",
    metadata,
    Column("id", Text, primary_key=True),
    Column("task", Text, nullable=False),
    Column("object", Text, nullable=False),
    # Counts the task's demonstrations from 1, those that were deleted too.
    Column("number", Integer, nullable=False),
    Column("finished", Boolean, nullable=False),
    Column("outcome", Text),
    Column("created", Float, nullable=False),
    _checksum(),
    Index("ix_demonstrations_task", "task"),
)

observations = Table(
    "observations",
    metadata,
    Column("demonstration", Text, ForeignKey("demonstrations.id", ondelete="CASCADE"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("content", Text, nullable=False),
    _checksum(),
)

gripper_actions = Table(
    "gripper_actions",
    metadata,
    Column("demonstration", Text, ForeignKey("demonstrations.id", ondelete="CASCADE"), primary_key=True),
    Column("subtask", Text, primary_key=True),
    Column("action", Text, nullable=False),
    _checksum(),
)

tasks = Table(
    "tasks",
    metadata,
    Column("name", Text, primary_key=True),
    Column("module", Text, nullable=False),
    Column("content", Text, nullable=False),
    Column("trained", Float, nullable=False),
    _checksum(),
)

jobs = Table(
    "jobs",
    metadata,
    Column("id", Text, primary_key=True),
    # Orders the jobs by their beginning.
    Column("number", BigInteger, nullable=False, unique=True),
    Column("kind", Text, nullable=False),
    Column("subject", Text, nullable=False),
    Column("object", Text),
    Column("state", Text, nullable=False),
    Column("error", Text),
    Column("result", Text),
    Column("created", Float, nullable=False),
    Column("started", Float),
    Column("ended", Float),
    _checksum(),
)

job_events = Table(
    "job_events",
    metadata,
    Column("job", Text, ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("kind", Text, nullable=False),
    Column("data", Text, nullable=False),
    _checksum(),
)

look_pictures = Table(
    "look_pictures",
    metadata,
    Column("job", Text, ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    # A JPEG file.
    Column("image", LargeBinary, nullable=False),
    _checksum(),
)

tokens = Table(
    "tokens",
    metadata,
    Column("id", Text, primary_key=True),
    Column("name", Text, nullable=False),
    Column("role", Text, nullable=False),
    # SHA-256 of the secret, in hex: the secret itself is nowhere.
    Column("digest", Text, nullable=False, unique=True),
    Column("created", Float, nullable=False),
    Column("expires", Float),
    _checksum(),
)

replies = Table(
    "replies",
    metadata,
    # The Idempotency-Key of a request that was done, what was asked, and what was answered.
    Column("key", Text, primary_key=True),
    Column("fingerprint", Text, nullable=False),
    Column("status", Integer, nullable=False),
    Column("location", Text),
    Column("body", Text, nullable=False),
    Column("created", Float, nullable=False, index=True),
    _checksum(),
)

counters = Table(
    "counters",
    metadata,
    # Numbers that are never given twice: "jobs", "demonstrations/<task>".
    Column("name", Text, primary_key=True),
    Column("next", BigInteger, nullable=False),
    _checksum(),
)

set_aside = Table(
    "set_aside",
    metadata,
    # What `handeye repair` found damaged: nothing is dropped silently.
    Column("id", Text, primary_key=True),
    Column("of_table", Text, nullable=False),
    Column("row_key", Text, nullable=False),
    Column("reason", Text, nullable=False),
    # JSON of what could be read of the row; bytes as base64.
    Column("content", Text, nullable=False),
    Column("found", Float, nullable=False),
    _checksum(),
)

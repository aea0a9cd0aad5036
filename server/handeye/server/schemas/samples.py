"""The bodies of samples and of queries, one or many at once."""

from __future__ import annotations

from typing import Annotated

from pydantic import FailFast, Field

from handeye.modules.declaration import MOST_COMPONENTS
from handeye.server.schemas.base import Body, DemonstrationName, Number

SampleNumber = Annotated[int, Field(ge=0, lt=2**63)]

MOST_AT_ONCE = 10_000
"""Samples or queries of one request."""

# They end at the first wrong value: one error for each of millions would fill the memory.
Vector = Annotated[tuple[Number, ...], FailFast(), Field(min_length=1, max_length=MOST_COMPONENTS)]
"""Numbers in the order in which a module declares its inputs or outputs."""


class Sample(Body):
    """One example: input and output vector in the declared order and units."""

    input: Vector
    output: Vector
    demonstration: DemonstrationName | None = None
    """What it came from; samples of one demonstration are left out together when support is calibrated."""


class SamplesRequest(Body):
    """Samples to be learned; all of them or none."""

    samples: Annotated[tuple[Sample, ...], FailFast()] = Field(min_length=1, max_length=MOST_AT_ONCE)


class SamplesAdded(Body):
    """What was learned: the samples have the numbers first … first + count - 1."""

    first: int
    count: int
    samples: int
    """How many the module has now."""


class SampleInfo(Body):
    """A sample as it is stored."""

    number: int
    input: tuple[float, ...]
    output: tuple[float, ...]
    demonstration: str | None


class SamplePage(Body):
    """Samples, by number."""

    samples: tuple[SampleInfo, ...]
    next: str | None
    """The cursor of the next page; null at the end."""


class SamplesRemoved(Body):
    """How many samples were taken out."""

    removed: int


class QueryRequest(Body):
    """One query or many, each a vector in the declared order and units."""

    inputs: Annotated[tuple[Vector, ...], FailFast()] = Field(min_length=1, max_length=MOST_AT_ONCE)
    neighbours: int = Field(default=10, ge=0, le=1000, strict=True)
    """So many of the samples that each answer came from are named, nearest first."""


class NeighbourInfo(Body):
    """A sample that an answer came from."""

    sample: int
    demonstration: str | None
    distance: float
    """From the query, after each component was divided by its scale."""
    weight: float
    """Its share in the answer; those of all samples add up to 1."""


class AnswerInfo(Body):
    """What a module says to one query."""

    output: tuple[float, ...]
    """In the declared order and units."""
    support: float
    """1: amid what was taught; 1/2: as far from it as one demonstration is from the others; towards 0: outside."""
    expected_error: tuple[float | None, ...]
    """What the error of each output should not exceed in nine of ten cases; null while that is not known."""
    neighbours: tuple[NeighbourInfo, ...]


class AnswerList(Body):
    """The answers, in the order of the queries."""

    answers: tuple[AnswerInfo, ...]

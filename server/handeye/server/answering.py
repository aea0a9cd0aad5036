"""From queries to answers as callers see them. Not through the schemas: an answer of 10 000 queries is large."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from handeye.modules.answers import Answers, Floats
from handeye.modules.module import Module
from handeye.rpt import NotTaught
from handeye.server.problem import Conflict, Invalid, sentence

_MOST_NEIGHBOURS = 1_000_000
"""Neighbours that the answers to one request name together: all of them are in memory at once."""

_NUMBERS_AT_ONCE = 2_000_000
"""That answers may consist of before they are cut to what was asked for."""

_TOLD_AT_ONCE = 20_000
"""Neighbours that are written as JSON at a time."""

_QUICK = 300_000
"""Operations that take about as long as it takes to find a thread for them; finding neighbours is not among them."""

_QUICK_QUERIES = 16


class NothingTaught(Conflict):
    """The module has no sample that could answer."""

    code = "not_taught"


def ask(module: Module, queries: Floats, most: int) -> Answers:
    """The module's answers to queries (q, N), each with its nearest `most` neighbours.

    `NothingTaught`; `Invalid` when the queries do not fit the module's declaration, or ask for too much at once.
    """
    k = min(most, _neighbours(module))
    if len(queries) * k > _MOST_NEIGHBOURS:
        raise Invalid(
            f"{len(queries)} answers with {k} neighbours each are too much at once, {_MOST_NEIGHBOURS} neighbours are "
            "told in one answer: ask for fewer neighbours, or in several requests."
        )
    # An answer may be made from all samples, and tell few of them.
    at_once = max(1, _NUMBERS_AT_ONCE // _numbers(module))
    try:
        parts = [module.answers(queries[i : i + at_once]).nearest(most) for i in range(0, len(queries), at_once)]
    except NotTaught as error:
        raise NothingTaught(sentence(error)) from error
    except ValueError as error:
        raise Invalid(sentence(error)) from error
    return Answers.joined(parts)


def ask_one(module: Module, query: Sequence[float], most: int) -> bytes:
    """The JSON of `schemas.samples.AnswerList` for one query; raises as `ask` does.

    The way of a controller that asks again and again: by arrays it would take several times as long.
    """
    try:
        answer = module.answer(query, most)
    except NotTaught as error:
        raise NothingTaught(sentence(error)) from error
    except ValueError as error:
        raise Invalid(sentence(error)) from error
    near = [
        {
            "sample": each.sample_id,
            "demonstration": each.demonstration,
            "distance": each.distance,
            "weight": each.weight,
        }
        for each in answer.neighbours
    ]
    told = {
        "output": answer.output.tolist(),
        "support": answer.support,
        "expected_error": answer.expected_error.tolist(),
        "neighbours": near,
    }
    return orjson.dumps({"answers": [told]})


def quick(module: Module, count: int) -> bool:
    """Whether so many queries are answered before a thread is found for them."""
    return count <= _QUICK_QUERIES and count * module.operations <= _QUICK


def _neighbours(module: Module) -> int:
    """How many samples an answer is made from."""
    return min(module.declaration.approximator.most_neighbours, module.samples)


def _numbers(module: Module) -> int:
    """How many numbers an answer consists of, about."""
    inputs, outputs = len(module.declaration.inputs), len(module.declaration.outputs)
    return (inputs + 1) * (outputs + 1) + 4 * _neighbours(module)


def to_json(answers: Answers) -> bytes:
    """The JSON of `schemas.samples.AnswerList`. An expected error that is not known is infinite, hence null."""
    count = len(answers.outputs)
    at_once = max(1, _TOLD_AT_ONCE // max(1, answers.samples.shape[1]))
    pieces = (orjson.dumps(_told(answers, slice(i, i + at_once)))[1:-1] for i in range(0, count, at_once))
    return b'{"answers":[' + b",".join(pieces) + b"]}"


def _told(answers: Answers, rows: slice) -> list[dict[str, Any]]:
    names: list[str | None] = [*answers.names, None]  # -1 is the last one

    def listed(*arrays: NDArray[Any]) -> Iterator[Sequence[Any]]:
        return zip(*(array[rows].tolist() for array in arrays), strict=True)

    return [
        {
            "output": output,
            "support": support,
            "expected_error": expected,
            "neighbours": [
                {"sample": sample, "demonstration": names[shown], "distance": distance, "weight": weight}
                for sample, shown, distance, weight in zip(*neighbours, strict=True)
                if sample >= 0
            ],
        }
        for output, support, expected, *neighbours in listed(
            answers.outputs,
            answers.support,
            answers.expected_error,
            answers.samples,
            answers.demonstrations,
            answers.distances,
            answers.weights,
        )
    ]


def matrix(rows: tuple[tuple[float, ...], ...], what: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Vectors of a JSON body as a matrix; `Invalid` when they differ in length."""
    widths = {len(row) for row in rows}
    if len(widths) != 1:
        raise Invalid(f"The {what} differ in length: some have {min(widths)} components, others {max(widths)}.")
    return np.array(rows, np.float64)

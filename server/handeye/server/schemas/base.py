"""What the bodies have in common: their base, names, numbers and keys."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, Strict

from handeye.server.results import THREE

# Ranges, because what \w means differs between JSON Schema, Python and pydantic.
_LETTERS = r"0-9A-Z_a-z\u00c0-\u1fff\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\uffef"

Name = Annotated[str, Field(pattern=rf"^[{_LETTERS}][{_LETTERS} .-]{{0,62}}$", examples=["blue cup"])]
"""A name of an object, task or subtask: letters, digits, '_', '.', '-', and spaces; at most 63 characters."""

LONG_NAME = rf"^[{_LETTERS}][{_LETTERS} .-]{{0,78}}$"

ModuleName = Annotated[str, Field(pattern=LONG_NAME, examples=["CSS"])]
"""The same for a module, which may be longer: a task's is called 'IJS.<task>'."""

DemonstrationName = Annotated[str, Field(pattern=LONG_NAME, examples=["grasp-1"])]
"""The same for a demonstration: '<task>-<number>', or what somebody calls the origin of samples."""

LATEST = 1e9
"""World time in s that may be asked for: 30 years."""

Key = Annotated[str, Field(pattern=r"^[!-~]{1,128}$", examples=["3f0c4c1e-6f0b-4a58-9d3e-4f3b7ad2b7f1"])]
"""An Idempotency-Key: up to 128 visible ASCII characters, such as a UUID."""

# Strict: neither "1" nor true is a number.
Number = Annotated[FiniteFloat, Strict()]

_Pixels = Annotated[Number, Field(ge=-100_000.0, le=100_000.0)]
MarkedPoint = Annotated[tuple[_Pixels, _Pixels, _Pixels], THREE]
"""A point of the stereo image that somebody marked: (row, column, disparity) in px."""


class Body(BaseModel):
    """The base of them all; what was made of it does not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)

"""The one place where errors of other libraries, and refusals, become this package's own."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from email.utils import parsedate_to_datetime
from typing import Any, NamedTuple, TypeVar

import httpx2
from pydantic import BaseModel, ValidationError

from handeye.client.errors import ApiError, NotConfigured, Silent, UnexpectedAnswer, Unreachable

M = TypeVar("M", bound=BaseModel)


class Answer(NamedTuple):
    """A response that was read to its end."""

    status: int
    title: str
    headers: httpx2.Headers
    content: bytes

    @property
    def done(self) -> bool:
        """The coordinator did what was asked."""
        return 200 <= self.status < 300


@contextmanager
def foreign(url: str) -> Iterator[None]:
    """Inside, what the HTTP library raises about the coordinator at `url` becomes ours."""
    try:
        yield
    except (httpx2.InvalidURL, httpx2.UnsupportedProtocol) as error:
        raise NotConfigured(f"{url!r} is no address of a coordinator: {error}") from error
    except httpx2.ReadTimeout as error:
        raise Silent(f"The coordinator at {url} does not answer in time. Is it overloaded?") from error
    except (httpx2.DecodingError, httpx2.SSEError) as error:
        raise UnexpectedAnswer(_stranger(url, error)) from error
    except (httpx2.HTTPError, httpx2.StreamError) as error:
        reason = str(error) or type(error).__name__
        raise Unreachable(f"The coordinator at {url} cannot be reached: {reason}. Is it running?") from error


@contextmanager
def readable(url: str) -> Iterator[None]:
    """Inside, what pydantic, json and numpy raise when they read an answer of the coordinator at `url` becomes ours."""
    try:
        yield
    except (ValidationError, ValueError, LookupError) as error:
        raise UnexpectedAnswer(_stranger(url, error)) from error


def _stranger(url: str, error: Exception) -> str:
    return f"What answers at {url} is no coordinator of this version: {error}"


def parse(model: type[M], content: bytes, url: str) -> M:
    """The JSON of an answer as a model; `UnexpectedAnswer` when it is none."""
    with readable(url):
        return model.model_validate_json(content)


def parse_object(text: str | bytes) -> dict[str, Any]:
    """A JSON object; `ValueError` when it is none."""
    data = json.loads(text)
    if not isinstance(data, dict):
        raise ValueError(f"this is a JSON object, not {data!r}")  # noqa: TRY004 # a wrong text, not a wrong type
    return data


def refusal(answer: Answer) -> ApiError:
    """The problem+json (RFC 9457) of a refused request as an error."""
    again = _retry_after(answer.headers.get("retry-after", ""))
    try:
        problem = parse_object(answer.content)
    except ValueError:
        said = answer.content[:200].decode(errors="replace")
        return ApiError(answer.status, answer.title, f"No explanation: {said!r}", retry_after=again)
    return ApiError(
        answer.status,
        str(problem.get("title", answer.title)),
        str(problem.get("detail", "no detail")),
        str(problem.get("code", "")),
        again,
    )


def _retry_after(value: str) -> float | None:
    """The header's s from now, whether it says so or gives a date; None when it says nothing."""
    if value.strip().isdigit():
        return float(value)
    try:
        return max(0.0, parsedate_to_datetime(value).timestamp() - time.time())
    except ValueError:
        return None

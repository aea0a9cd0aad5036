# Made by tools/make_sync.py from client/handeye/client/_async/calls.py: change that, then `make sync`.
"""How the client asks: deadlines, retries, errors; JSON, streams and files."""

from __future__ import annotations

import uuid
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self, TypeVar
from urllib.parse import quote

import httpx2

from handeye.client._files import CHUNK, written
from handeye.client._foreign import Answer, M, foreign, parse, refusal
from handeye.client._model import PageModel
from handeye.client._retries import ONCE, Deadline, Retries
from handeye.client._waiting import sync_sleep
from handeye.client.errors import Closed, HandeyeError, UnexpectedAnswer, Unreachable

Page = TypeVar("Page", bound=PageModel)

Query = Mapping[str, str | list[str]]

FILE_SILENCE = 600.0
"""s without a byte after which a file's way is given up: before it answers, the coordinator reads or writes it all."""


class SyncCalls:
    """A connection to a coordinator at `url` with its bearer `token`; the base of the clients.

    `timeout` s bound each call with its retries; a network that falls silent in the midst of an answer may take as
    much again. `transport` replaces the network, for tests; `retries` say how patient to be.
    """

    def __init__(
        self,
        url: str,
        token: str = "",
        timeout: float = 30.0,
        transport: httpx2.BaseTransport | None = None,
        retries: Retries | None = None,
    ) -> None:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._url = url
        self._timeout = timeout
        self._retries = Retries() if retries is None else retries
        with foreign(url):
            self._http = httpx2.Client(base_url=url, headers=headers, timeout=timeout, transport=transport)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    # Reading may be repeated, and so may what a key or its nature makes the coordinator do only once.

    def _get(self, model: type[M], path: str, params: Query | None = None, timeout: float | None = None) -> M:
        answer = self._call("GET", path, params=params, retries=self._retries, timeout=timeout)
        return parse(model, answer.content, self._url)

    def _post(
        self,
        model: type[M],
        path: str,
        body: Mapping[str, object] | None = None,
        *,
        headers: Mapping[str, str] | None = None,
        retries: Retries = ONCE,
        timeout: float | None = None,
    ) -> M:
        answer = self._call("POST", path, body=body, headers=headers, retries=retries, timeout=timeout)
        return parse(model, answer.content, self._url)

    def _post_once(
        self,
        model: type[M],
        path: str,
        body: Mapping[str, object] | None = None,
        *,
        headers: Mapping[str, str] | None = None,
        timeout: float | None = None,
    ) -> M:
        """With a key by which the coordinator knows a repeated request and does it once."""
        keyed = {**(headers or {}), **key()}
        return self._post(model, path, body, headers=keyed, retries=self._retries, timeout=timeout)

    def _patch(self, model: type[M], path: str, body: Mapping[str, object]) -> M:
        answer = self._call("PATCH", path, body=body, retries=self._retries)
        return parse(model, answer.content, self._url)

    def _delete(self, path: str) -> None:
        # Of a repeated one "there is no such thing" means that the first one did it and only its answer was lost.
        self._call("DELETE", path, retries=self._retries, settled=httpx2.codes.NOT_FOUND)

    def _call(
        self,
        method: str,
        path: str,
        *,
        body: Mapping[str, object] | None = None,
        content: bytes | None = None,
        params: Query | None = None,
        headers: Mapping[str, str] | None = None,
        retries: Retries = ONCE,
        timeout: float | None = None,
        settled: int | None = None,
    ) -> Answer:
        """The answer to a request; `ApiError` when it was refused, `Unreachable` when none came in time.

        `settled` is a status that is as good as done when a repeated request gets it.
        """
        deadline = Deadline(self._timeout if timeout is None else timeout)
        tried = 0
        while True:
            tried += 1
            limit = (
                deadline.left() if retries.longest_attempt is None else min(deadline.left(), retries.longest_attempt)
            )
            waits = httpx2.Timeout(limit, connect=min(limit, retries.longest_connect))
            request = self._http.build_request(
                method, path, json=body, content=content, params=params, headers=headers, timeout=waits
            )
            failure: HandeyeError
            try:
                answer = self._send(request, Deadline(limit))
                if answer.done or (answer.status == settled and tried > 1):
                    return answer
                failure = refusal(answer)
            except Unreachable as error:
                failure = error
            pause = retries.pause(tried, failure)
            if pause is None or pause >= deadline.left():
                raise failure
            sync_sleep(pause)

    def _send(self, request: httpx2.Request, deadline: Deadline) -> Answer:
        self._check_open()
        with foreign(self._url):
            response = self._http.send(request, stream=True)
            try:
                return self._read(response, deadline)
            finally:
                response.close()

    def _check_open(self) -> None:
        if self._http.is_closed:
            raise Closed(f"This client of {self._url} was closed; make another one.")

    def _read(self, response: httpx2.Response, deadline: Deadline) -> Answer:
        """Reads a response to its end; `Unreachable` when that takes too long, however steadily it trickles in."""
        parts = []
        for part in response.iter_bytes():
            parts.append(part)
            if deadline.passed():
                raise Unreachable(f"The coordinator at {self._url} did not answer within {deadline.seconds:g} s.")
        return Answer(response.status_code, response.reason_phrase, response.headers, b"".join(parts))

    @contextmanager
    def _stream(
        self,
        method: str,
        path: str,
        *,
        silence: float,
        headers: Mapping[str, str] | None = None,
        params: Query | None = None,
        content: Iterator[bytes] | None = None,
    ) -> Generator[httpx2.Response]:
        """An answer that is read as it comes; `Silent` when nothing comes for `silence` s."""
        self._check_open()
        with foreign(self._url):
            request = self._http.build_request(
                method, path, headers=headers, params=params, content=content, timeout=silence
            )
            response = self._http.send(request, stream=True)
            try:
                if not response.is_success:
                    raise refusal(self._read(response, Deadline(silence)))
                yield response
            finally:
                response.close()

    def _download(self, path: str, target: Path) -> None:
        """An answer as a file; an existing one is replaced once the new one is complete."""
        with self._stream("GET", path, silence=FILE_SILENCE) as response, written(target) as file:
            for part in response.iter_bytes():
                file.write(part)

    def _upload(self, path: str, source: Path, media_type: str, params: Query | None = None) -> Answer:
        """Sends a file as it is read."""
        with source.open("rb") as file:
            headers = {"Content-Type": media_type, "Content-Length": str(source.stat().st_size)}
            sent = self._stream(
                "POST", path, silence=FILE_SILENCE, headers=headers, params=params, content=chunks(file)
            )
            with sent as response:
                return self._read(response, Deadline(FILE_SILENCE))

    def _pages(self, model: type[Page], path: str, params: Query | None = None) -> Generator[Page]:
        """All pages of a list, from the first."""
        cursor: str | None = None
        while True:
            more = {} if cursor is None else {"cursor": cursor}
            page = self._get(model, path, {**(params or {}), **more})
            yield page
            if page.next is None:
                return
            if page.next == cursor:
                raise UnexpectedAnswer(f"The list {path} of {self._url} does not come to its end.")
            cursor = page.next


def chunks(file: BinaryIO) -> Generator[bytes]:
    """What is left of `file`, in pieces."""
    while part := file.read(CHUNK):
        yield part


def key() -> dict[str, str]:
    """The header by which a request is known when it is repeated."""
    return {"Idempotency-Key": str(uuid.uuid4())}


def part(name: str) -> str:
    """A name as one part of a path."""
    return quote(name, safe="")

"""What the tests of the REST interface share: problems, jobs, a module of their own, arrays as files."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from sqlalchemy import event
from sqlalchemy.exc import OperationalError

if TYPE_CHECKING:
    import httpx2
    from starlette.testclient import TestClient

    from handeye.server.store import Store

NPZ = {"Content-Type": "application/x-npz"}


def problem(response: httpx2.Response, status: int, code: str) -> str:
    """Checks that `response` is a problem (RFC 9457) and returns its sentence."""
    assert response.headers["content-type"] == "application/problem+json", response.text
    body: dict[str, Any] = response.json()
    assert (response.status_code, body["status"], body["code"]) == (status, status, code), body
    assert body["type"] == "about:blank"
    assert body["title"]
    return str(body["detail"])


def ended(http: TestClient, accepted: httpx2.Response) -> dict[str, Any]:
    """The job that was accepted, once it has ended."""
    assert accepted.status_code == 202, accepted.text
    at = accepted.headers["location"]
    http.get(f"{at}/events")  # ends with the job
    job: dict[str, Any] = http.get(at).json()
    return job


def done(response: httpx2.Response, status: int = 200) -> Any:
    """The JSON of an answer that has to have this status."""
    assert response.status_code == status, response.text
    return response.json()


def declaration(name: str = "map", category: bool = False, **approximator: Any) -> dict[str, Any]:
    """A module of x (m) and y (rad) to u and v, perhaps with a category before them."""
    inputs = [{"name": "x", "unit": "m", "scale": 0.3}, {"name": "y", "unit": "rad", "scale": 1.7}]
    if category:
        inputs.insert(0, {"name": "part", "unit": "", "categorical": True})
    outputs = [{"name": "u", "unit": "m"}, {"name": "v", "unit": "m"}]
    return {"name": name, "inputs": inputs, "outputs": outputs, "approximator": approximator}


def taught(count: int, seed: int = 0) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Inputs (n, 2) and outputs (n, 2) of a smooth map."""
    inputs = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2))
    return inputs, np.column_stack([np.sin(inputs[:, 0]) + inputs[:, 1], inputs[:, 0] * inputs[:, 1]])


def samples(count: int, seed: int = 0, demonstration: str | None = None) -> dict[str, Any]:
    """The body of a request that teaches `count` of them."""
    inputs, outputs = taught(count, seed)
    pairs = zip(inputs.tolist(), outputs.tolist(), strict=True)
    return {"samples": [{"input": i, "output": o, "demonstration": demonstration} for i, o in pairs]}


def packed(**arrays: Any) -> bytes:
    """Arrays as a .npz file."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=True, **{name: np.asarray(array) for name, array in arrays.items()})
    return file.getvalue()


def unpacked(content: bytes) -> dict[str, np.ndarray[Any, Any]]:
    """The arrays of a .npz file."""
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


@contextmanager
def broken(store: Store) -> Iterator[None]:
    """No statement that writes succeeds: the disk is full."""

    def fail(_connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        if statement.startswith(("INSERT", "UPDATE", "DELETE")):
            raise OperationalError(statement, None, Exception("database or disk is full"))

    event.listen(store.engine, "before_cursor_execute", fail)
    try:
        yield
    finally:
        event.remove(store.engine, "before_cursor_execute", fail)

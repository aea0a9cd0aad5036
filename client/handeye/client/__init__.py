"""The Python client of the coordinator: HTTP only, needs httpx2, pydantic and numpy.

with Client(url, token) as client:
    job = client.run_task("grasp", "blue cup")
    job.raise_for_failure()

`AsyncClient` has the same methods to be awaited.
"""

from handeye.client._arrays import Image, QueryAnswers
from handeye.client._async.client import AsyncClient
from handeye.client._async.control import AsyncControl
from handeye.client._retries import Retries
from handeye.client._sync.client import Client
from handeye.client._sync.control import Control
from handeye.client.errors import (
    ApiError,
    Closed,
    HandeyeError,
    JobFailed,
    LeaseLost,
    NotConfigured,
    PartlyAdded,
    Silent,
    TimedOut,
    UnexpectedAnswer,
    Unreachable,
    WrongArrays,
)

__all__ = [
    "ApiError",
    "AsyncClient",
    "AsyncControl",
    "Client",
    "Closed",
    "Control",
    "HandeyeError",
    "Image",
    "JobFailed",
    "LeaseLost",
    "NotConfigured",
    "PartlyAdded",
    "QueryAnswers",
    "Retries",
    "Silent",
    "TimedOut",
    "UnexpectedAnswer",
    "Unreachable",
    "WrongArrays",
]

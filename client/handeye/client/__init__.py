"""The Python client of the coordinator: HTTP only, needs httpx2 and pydantic.

with Client(url, token) as client:
    job = client.run_task("grasp", "blue cup")
    job.raise_for_failure()
"""

from handeye.client.client import Client
from handeye.client.errors import (
    ApiError,
    HandeyeError,
    JobFailed,
    NotConfigured,
    TimedOut,
    UnexpectedAnswer,
    Unreachable,
)

__all__ = [
    "ApiError",
    "Client",
    "HandeyeError",
    "JobFailed",
    "NotConfigured",
    "TimedOut",
    "UnexpectedAnswer",
    "Unreachable",
]

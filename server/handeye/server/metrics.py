"""What the server counts for Prometheus, and the bus that counts its calls."""

from __future__ import annotations

import time
from typing import Self

import prometheus_client
from prometheus_client import CollectorRegistry, Counter, Histogram, ProcessCollector

from handeye.rpc import Bus, BusSettings, Method
from handeye.rpc.bus import Progress, Tick
from handeye.rpc.method import Req, Res
from handeye.server.problem import error_code

_FAST = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)  # s
_LONG = (0.0002, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.1, 0.5, 1.0, 5.0, 30.0)  # s; a motion is one call
_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})  # a caller can invent others

prometheus_client.disable_created_metrics()  # type: ignore[no-untyped-call] # a series more for each series, which nobody asks for


class Metrics:
    """The counters of one application; times are in s. Labels are given in the order of their names here."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self._requests = self._counter("requests", "HTTP requests", "method", "route", "status")
        self._request_seconds = Histogram(
            "handeye_request_seconds",
            "Time until the answer began",
            ("method", "route"),
            buckets=_FAST,
            registry=self.registry,
        )
        self._of_requests: dict[tuple[str, str, int], tuple[Counter, Histogram]] = {}
        self._rpc_seconds = Histogram(
            "handeye_rpc_seconds",
            "Calls to the bridges",
            ("method", "outcome"),
            buckets=_LONG,
            registry=self.registry,
        )
        self.queries = self._counter("queries", "Queries answered", "module")
        self.samples = self._counter("samples_written", "Samples made durable", "module")
        self.frames = self._counter("frames", "Pictures taken from the cameras", "camera")
        self.motions = self._counter("motions", "Motions of arm, gripper and head", "action", "outcome")
        self.jobs = self._counter("jobs", "Jobs that have ended", "kind", "state")

    def _counter(self, name: str, meaning: str, *labels: str) -> Counter:
        return Counter(f"handeye_{name}", meaning, labels, registry=self.registry)

    def request(self, method: str, route: str, status: int, seconds: float) -> None:
        """A request was answered; `route` is the route's template, never the path."""
        key = method if method in _METHODS else "other", route, status
        series = self._of_requests.get(key)
        if series is None:
            series = self._requests.labels(*key), self._request_seconds.labels(*key[:2])
            self._of_requests[key] = series
        series[0].inc()
        series[1].observe(seconds)

    def rpc(self, method: str, outcome: str, seconds: float) -> None:
        """A call to a bridge has ended: `ok`, or the error's code."""
        self._rpc_seconds.labels(method, outcome).observe(seconds)

    def forget_module(self, module: str) -> None:
        """Drops the series of a module that was deleted."""
        for counter in (self.queries, self.samples):
            counter.remove_by_labels({"module": module})


class MeteredBus(Bus):
    """A bus that counts and times its calls. Open it with `joined`."""

    _metrics: Metrics

    @classmethod
    def joined(cls, settings: BusSettings, name: str, timeout: float, metrics: Metrics) -> Self:
        """As `Bus.open`."""
        bus = cls.open(settings, name, timeout)
        bus._metrics = metrics
        return bus

    def call(
        self,
        method: Method[Req, Res],
        request: Req,
        timeout: float,
        on_progress: Progress | None = None,
        on_tick: Tick | None = None,
        idempotency_id: str = "",
    ) -> Res:
        """As `Bus.call`."""
        began, outcome = time.perf_counter(), "ok"
        try:
            return super().call(method, request, timeout, on_progress, on_tick, idempotency_id)
        except BaseException as error:
            outcome = _outcome(error)
            raise
        finally:
            self._metrics.rpc(str(method), outcome, time.perf_counter() - began)


def _outcome(error: BaseException) -> str:
    """The error's code; what a callback raised has none and means that the caller left."""
    code = error_code(error)
    return "left" if code == "internal" else code

"""The calling side, streams and liveliness: one Zenoh session with the contract of `handeye.rpc` on it."""

from __future__ import annotations

import queue
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Generic, Self, TypeVar
from weakref import WeakSet

import structlog
import zenoh
from google.protobuf.message import DecodeError

from handeye.proto.v1.rpc_pb2 import CallReply, CallRequest, CancelRequest
from handeye.rpc.errors import DeadlineExceeded, Internal, Unavailable, from_status
from handeye.rpc.method import Closing, Method, Req, Res, Stream, key
from handeye.rpc.server import Handler, Server
from handeye.rpc.settings import LEASE, BusSettings, client_config, host_config, refusal

BLOCK, DROP = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
TICK = 0.02
"""Seconds between two calls of `on_tick`."""

Progress = Callable[[Any], None]
Tick = Callable[[], None]
Replies = queue.SimpleQueue["zenoh.Reply | None"]
"""What Zenoh got for one request; None: no more will come."""

T = TypeVar("T")


def _on_open_bus(act: Callable[..., T], *arguments: Any, **options: Any) -> T:
    try:
        return act(*arguments, **options)
    except zenoh.ZError as error:
        raise Unavailable(f"the bus is closed: {error}") from error


def _final_answer(
    method: Method[Any, Any], replies: Replies, deadline: float, on_progress: Progress | None, on_tick: Tick | None
) -> CallReply | None:
    """The last reply, None when none can come any more; calls back until then. Raises DeadlineExceeded."""
    tick = deadline if on_tick is None else time.monotonic()
    while (now := time.monotonic()) < deadline:
        if on_tick is not None and now >= tick:
            on_tick()
            tick = max(tick + TICK, now)
        try:
            reply = replies.get(timeout=max(min(tick, deadline) - time.monotonic(), 0.0))
        except queue.Empty:
            continue
        answer = None if reply is None or reply.ok is None else CallReply.FromString(reply.ok.payload.to_bytes())
        if answer is None or not answer.HasField("progress"):
            return answer
        if on_progress is not None and method.progress is not None:
            on_progress(method.progress.FromString(answer.progress))
    raise DeadlineExceeded(f"{method} did not answer within the time it was given")


class Subscription(Closing, Generic[Res]):
    """The newest message of a stream, or a callback for each; made by `Bus.subscribe`."""

    def __init__(self, session: zenoh.Session, where: str, stream: Stream[Res], callback: Callable[[Res], None] | None):
        self._stream = stream
        self._callback = callback or self._keep
        self._arrived = threading.Condition()
        self._newest: Res | None = None
        self._subscriber = session.declare_subscriber(where, zenoh.handlers.RingChannel(1))
        self._thread = threading.Thread(target=self._run, name=f"stream {stream}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the subscription and its thread; returns when a callback under way has returned."""
        with suppress(zenoh.ZError):
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]
        self._thread.join()

    def newest(self, timeout: float) -> Res | None:
        """The newest message that was not returned before; waits up to `timeout` s for one, then returns None."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._newest is not None, timeout)
            message, self._newest = self._newest, None
        return message

    def _keep(self, message: Res) -> None:
        with self._arrived:
            self._newest = message
            self._arrived.notify()

    def _run(self) -> None:
        for sample in self._subscriber.handler:  # until the subscriber is undeclared or the session closed
            try:
                self._callback(self._stream.message.FromString(sample.payload.to_bytes()))
            except Exception:
                structlog.get_logger().exception("stream callback failed", stream=str(self._stream))


class Bus(Closing):
    """A session on the bus. Use it in a `with` block: an unclosed session keeps the interpreter from ending."""

    def __init__(self, session: zenoh.Session, cell: str, name: str) -> None:
        self._session, self._cell, self._name = session, cell, name
        self._opened: WeakSet[Any] = WeakSet()
        self._publishers: dict[str, zenoh.Publisher] = {}

    @classmethod
    def open(cls, settings: BusSettings, name: str, timeout: float = 3.0) -> Self:
        """Joins the bus as `name`, trying for `timeout` s.

        Raises Unavailable when nobody listens there, Unauthorised when the listener does not admit us or when the
        endpoint is off loopback and the settings hold no credentials.
        """
        try:
            return cls(zenoh.open(client_config(settings, timeout)), settings.cell, name)
        except zenoh.ZError:
            raise refusal(settings, timeout) from None

    @classmethod
    def host(cls, settings: BusSettings, credentials: Mapping[str, str], name: str = "host") -> Self:
        """Listens at `settings.endpoint` itself and admits who is in `credentials` (user: password).

        Without credentials everybody is admitted, which is refused (Unauthorised) off loopback. Raises Unavailable when
        the address cannot be listened at.
        """
        with TemporaryDirectory(prefix="handeye-") as folder:
            try:
                return cls(zenoh.open(host_config(settings, credentials, Path(folder))), settings.cell, name)
            except zenoh.ZError as error:
                raise Unavailable(f"cannot listen at {settings.endpoint}: {error}") from None

    def close(self) -> None:
        """Closes its servers and subscriptions, then the session; calls under way end as Unavailable."""
        for opened in list(self._opened):
            opened.close()
        with suppress(zenoh.ZError):
            self._session.close()  # type: ignore[no-untyped-call]

    def call(
        self,
        method: Method[Req, Res],
        request: Req,
        timeout: float,
        on_progress: Progress | None = None,
        on_tick: Tick | None = None,
        idempotency_id: str = "",
    ) -> Res:
        """Calls `method` and waits up to `timeout` s for its response.

        `on_progress` gets the progress messages in order; `on_tick` is called at once and then every 20 ms. Both run in
        this thread; an exception that either raises cancels the call on the server and leaves here. Equal
        `idempotency_id`s (make them with uuid4) are executed once. `request_id` of structlog's context variables goes
        along into the handler's log lines. Raises the errors of `handeye.rpc.errors` only.
        """
        call_id, deadline = uuid.uuid4().hex, time.monotonic() + timeout
        envelope = CallRequest(call_id=call_id, idempotency_id=idempotency_id, caller=self._name, time_left=timeout)
        envelope.payload = request.SerializeToString()
        envelope.request_id = structlog.contextvars.get_contextvars().get("request_id", "")
        where, data = key(self._cell, method.service, method.name), envelope.SerializeToString()
        # Other consolidations drop replies of one key, which is the progress. Our deadline ends before Zenoh's.
        options = {"consolidation": zenoh.ConsolidationMode.NONE, "congestion_control": BLOCK, "payload": data}
        replies = self._ask(self._session.get, where, max(timeout, 0.0) + 1.0, **options)
        try:
            answer = _final_answer(method, replies, deadline, on_progress, on_tick)
            if answer is not None and answer.HasField("result"):
                return method.response.FromString(answer.result)
        except BaseException as error:
            note = CancelRequest(call_id=call_id).SerializeToString()
            with suppress(zenoh.ZError):  # a closed bus ends its calls anyway
                self._session.put(key(self._cell, method.service, "@cancel"), note, congestion_control=BLOCK)
            if isinstance(error, DecodeError):
                raise Internal(f"{method}: the server speaks another version: {error}") from error
            raise
        if answer is None:
            raise Unavailable(f"{method}: nobody serves it, or its server died or was cut off during the call")
        raise from_status(answer.error)

    def serve(self, handlers: Mapping[Method[Any, Any], Handler]) -> Server:
        """Serves methods until the result is closed. A handler gets (request, Call) and returns the response."""
        return self._declare(Server, self._cell, handlers)

    def publish(self, stream: Stream[Res], message: Res) -> None:
        """Publishes best effort: a message that the network cannot take at once is dropped. Raises Unavailable."""
        where, data = key(self._cell, stream.service, stream.name), message.SerializeToString()
        priority = zenoh.Priority.INTERACTIVE_HIGH if stream.urgent else zenoh.Priority.DATA_LOW
        _on_open_bus(self._session.put, where, data, congestion_control=DROP, priority=priority, express=stream.urgent)

    def subscribe(self, stream: Stream[Res], callback: Callable[[Res], None] | None = None) -> Subscription[Res]:
        """Receives a stream; a slow receiver misses messages and sees the newest. See `Subscription`."""
        return self._declare(Subscription[Res], key(self._cell, stream.service, stream.name), stream, callback)

    def _declare(self, kind: Callable[..., T], *arguments: Any) -> T:
        declared = _on_open_bus(kind, self._session, *arguments)
        self._opened.add(declared)
        with suppress(queue.Empty):  # a round trip that nobody answers: then the router knows what was declared
            self._ask(self._session.get, key(self._cell, "router", "@nobody"), LEASE).get(timeout=LEASE)
        return declared

    def is_watched(self, stream: Stream[Any]) -> bool:
        """Whether anybody subscribes to `stream` now, so that it is worth making."""
        where = key(self._cell, stream.service, stream.name)
        if where not in self._publishers:
            self._publishers[where] = _on_open_bus(self._session.declare_publisher, where)
        return bool(self._publishers[where].matching_status.matching)  # type: ignore[attr-defined]

    def is_alive(self, service: str, timeout: float = 1.0) -> bool:
        """Whether somebody serves `service` now; False when the bus does not say so within `timeout` s."""
        with suppress(Unavailable, queue.Empty):
            replies = self._ask(self._session.liveliness().get, key(self._cell, service, "@alive"), timeout)
            reply = replies.get(timeout=timeout)
            return reply is not None and reply.ok is not None
        return False

    def _ask(self, get: Callable[..., object], where: str, timeout: float, **options: Any) -> Replies:
        replies: Replies = queue.SimpleQueue()
        receive = zenoh.handlers.Callback(replies.put, lambda: replies.put(None), indirect=False)
        _on_open_bus(get, where, receive, timeout=timeout, **options)
        return replies

    def wait_for(self, service: str, timeout: float) -> None:
        """Returns as soon as somebody serves `service`; raises Unavailable after `timeout` s."""
        deadline = time.monotonic() + timeout
        while not self.is_alive(service, max(deadline - time.monotonic(), TICK)):
            if time.monotonic() >= deadline:
                raise Unavailable(f"nobody served {service} within {timeout:g} s: is its process running?")
            time.sleep(TICK)

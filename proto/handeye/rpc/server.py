"""The serving side: handlers run in worker threads, and every call is answered."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any

import structlog
import zenoh
from google.protobuf.message import DecodeError, Message

from handeye.proto.v1.rpc_pb2 import CallReply, CallRequest, CancelRequest
from handeye.rpc.errors import Cancelled, DeadlineExceeded, InvalidArgument, RpcError, Unavailable, to_status
from handeye.rpc.method import Closing, Method, key

REMEMBERED, MEMORY = 300.0, 256
"""Seconds for which the answer to an idempotency id is kept, and how many such answers."""
WORKERS, GRACE = 32, 5.0
"""Handlers that run at a time, and seconds that `Server.close` waits for them to notice that their calls are over."""

Handler = Callable[[Any, "Call"], Message]
Job = Callable[["Call"], Message]
log = structlog.get_logger()


class Call:
    """One execution of a handler, as the handler sees it. Repeated calls with one idempotency id share it."""

    def __init__(self, method: Method[Any, Any], request: CallRequest) -> None:
        self.method, self.caller = method, request.caller
        self._deadline, self._ended, self._expired = time.monotonic() + request.time_left, 0.0, False
        self._logged = {"request_id": request.request_id} if request.request_id else {}
        self._waiting: dict[str, zenoh.Query] = {}
        self._halt: RpcError | None = None
        self._answer: CallReply | None = None

    def time_left(self) -> float:
        """Seconds that the caller still waits; negative when it has given up."""
        return self._deadline - time.monotonic()

    def cancelled(self) -> bool:
        """Nobody wants the result any more: the callers cancelled, or the server is closing."""
        return self._halt is not None

    def check(self) -> None:
        """Raises Cancelled (Unavailable when the server is closing) or DeadlineExceeded; call it in long loops."""
        if self._halt is not None:
            raise self._halt
        self._expired = self.time_left() <= 0  # who asks again from now on wants it done after all
        if self._expired:
            raise DeadlineExceeded(f"{self.method}: the caller's time ran out")

    def progress(self, message: Message) -> None:
        """Sends a progress message to whoever waits; all arrive, in order, so send no more than people can use."""
        if self.method.progress is None or not isinstance(message, self.method.progress):
            raise TypeError(f"{self.method} reports {self.method.progress}, not {type(message).__name__}")
        self._send(CallReply(progress=message.SerializeToString()))

    def _send(self, reply: CallReply) -> None:
        for query in list(self._waiting.values()):
            _reply(query, reply)


class Server(Closing):
    """Serves methods until it is closed; made by `Bus.serve`."""

    def __init__(self, session: zenoh.Session, cell: str, handlers: Mapping[Method[Any, Any], Handler]) -> None:
        self._closed, self._lock = False, threading.Condition()
        self._under_way: dict[str, Call] = {}
        self._remembered: dict[tuple[str, str], Call] = {}
        self._pool = ThreadPoolExecutor(WORKERS, thread_name_prefix="rpc")
        # Direct callbacks keep the order of a call and its cancellation; they only take notes and never wait.
        cancel = zenoh.handlers.Callback(self._cancel, indirect=False)
        self._declared = ExitStack()
        declare = self._declared.enter_context
        for method, handler in handlers.items():
            receive = zenoh.handlers.Callback(partial(self._receive, method, handler), indirect=False)
            declare(session.declare_queryable(key(cell, method.service, method.name), receive, complete=True))
        for service in {method.service for method in handlers}:
            declare(session.declare_subscriber(key(cell, service, "@cancel"), cancel))
            # Last, so that a service that is alive can be called.
            declare(session.liveliness().declare_token(key(cell, service, "@alive")))

    def close(self) -> None:
        """Takes the methods off the bus, ends the calls under way (Unavailable) and waits up to GRACE for them."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            for call in self._under_way.values():
                call._halt = Unavailable(f"{call.method}: the server was closed during the call")
        self._declared.close()
        with self._lock:
            if not self._lock.wait_for(lambda: not self._under_way, GRACE):
                log.error("handlers ignore that their calls are over", calls=len(self._under_way))
        self._pool.shutdown(wait=False)

    def _receive(self, method: Method[Any, Any], handler: Handler, query: zenoh.Query) -> None:
        try:
            request = CallRequest.FromString(query.payload.to_bytes() if query.payload else b"")
            job = partial(handler, method.request.FromString(request.payload))
            with self._lock:
                answer = self._admit(Call(method, request), request, job, query)
        except RpcError as error:
            answer = CallReply(error=to_status(error))
        except DecodeError as error:
            answer = CallReply(error=to_status(InvalidArgument(f"{method}: the request is malformed: {error}")))
        if answer is not None:
            _reply(query, answer)

    def _admit(self, new: Call, request: CallRequest, job: Job, query: zenoh.Query) -> CallReply | None:
        """Lets the query wait for its call, new or of the same idempotency id, unless that has its answer already."""
        if self._closed:
            raise Unavailable(f"{new.method}: the server is closing")
        name = (str(new.method), request.idempotency_id)
        call = next(known for known in (self._remembered.get(name, new), new) if not known._expired)
        if call._answer is None:
            self._under_way[request.call_id] = call
            call._waiting[request.call_id] = query
            call._deadline = max(call._deadline, new._deadline)
        if call is new:
            if request.idempotency_id:
                self._remember(name, new)
            self._pool.submit(self._run, job, new)
        return call._answer

    def _remember(self, name: tuple[str, str], call: Call) -> None:
        oldest = time.monotonic() - REMEMBERED
        for other, old in list(self._remembered.items()):
            if old._answer is not None and (old._ended < oldest or len(self._remembered) >= MEMORY):
                del self._remembered[other]
        self._remembered[name] = call

    def _run(self, job: Job, call: Call) -> None:
        with structlog.contextvars.bound_contextvars(**call._logged):
            try:
                call.check()
                response = job(call)
                if not isinstance(response, call.method.response):
                    raise TypeError(f"the handler of {call.method} returned {type(response).__name__}")  # noqa: TRY301
                answer, call._expired = CallReply(result=response.SerializeToString()), False
            except BaseException as error:  # whatever the handler raises, the caller gets an answer
                if not isinstance(error, RpcError):
                    log.exception("handler failed", method=str(call.method), caller=call.caller)
                answer = CallReply(error=to_status(error))
        with self._lock:
            call._answer, call._ended = answer, time.monotonic()
        call._send(answer)
        with self._lock:
            self._under_way = {name: other for name, other in self._under_way.items() if other is not call}
            call._waiting.clear()
            self._lock.notify_all()

    def _cancel(self, sample: zenoh.Sample) -> None:
        call_id = CancelRequest.FromString(sample.payload.to_bytes()).call_id
        with self._lock:
            call = self._under_way.get(call_id)
            if call is not None and call._waiting.pop(call_id, None) is not None and not call._waiting:
                call._halt = call._halt or Cancelled(f"{call.method}: cancelled by {call.caller or 'the caller'}")
                # Whoever asks again wants it done after all.
                self._remembered = {name: other for name, other in self._remembered.items() if other is not call}


def _reply(query: zenoh.Query, reply: CallReply) -> None:
    with suppress(zenoh.ZError):  # the caller has gone
        query.reply(query.key_expr, reply.SerializeToString())

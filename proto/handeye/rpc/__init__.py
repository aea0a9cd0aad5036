"""Calls and streams between processes, over Zenoh: a thin contract, not a framework.

A `Method` is one `rpc` of a `.proto` file (constants: `handeye.proto.methods`). Server and client each open a `Bus`:

    with Bus.open(BusSettings(), name="robot") as bus, bus.serve({ROBOT_GET_STATE: handler}):
        ...
    with Bus.open(BusSettings(), name="coordinator") as bus:
        state = bus.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0)

**Every call ends**, with the response or with one error of `handeye.rpc.errors`, never with silence:

* `Unavailable`: at once when nobody serves the method or the server's process died; within the lease (1 s) when server,
  router or link froze. A bus reconnects by itself: call again.
* `DeadlineExceeded`: the timeout ran out. The time that remains travels with the call, never a clock reading.
* What the handler raised, class, message and detail; `Internal` (with the class name, logged there with its traceback)
  when that was no `RpcError`.

**Long calls.** `call.progress(message)` on the server reaches `on_progress` in order. Leaving the call early (deadline,
an exception from `on_progress` or `on_tick`, Ctrl-C) cancels it: the handler sees `call.cancelled()`, or `call.check()`
raises. `on_tick` runs every 20 ms while the call waits: heartbeats go there. Handlers run in worker threads, so a slow
call blocks no other.

**Idempotency.** Calls with one `idempotency_id` are executed once by a server process, also when the second comes while
the first runs; the answer, an error too, is remembered for five minutes (the newest 256). Such a call is cancelled when
all its callers have left.

**Request ids.** What `request_id` is among structlog's context variables where the call is made, it is in the handler.

**Streams** are best effort, newest wins: a slow subscriber misses messages and delays nobody.

**Liveliness.** A served service declares a token: `bus.is_alive("Robot")`. It reports; it does not guard.

**Who may join.** The router (`handeye router`) or a hosting bus (`Bus.host`) admits the users it was given; off
loopback it refuses to start without any, as a client refuses to connect without. There is no multicast and no gossip.
"""

from handeye.rpc.bus import Bus, Subscription
from handeye.rpc.method import Method, Stream
from handeye.rpc.server import Call, Handler, Server
from handeye.rpc.settings import BusSettings, LabBusSettings

__all__ = ["Bus", "BusSettings", "Call", "Handler", "LabBusSettings", "Method", "Server", "Stream", "Subscription"]

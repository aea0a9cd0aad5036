"""Round trips of handeye.rpc, gRPC and HTTP with the same messages, in one run.

    python benchmarks/rpc.py

Every server is a process of its own, every call comes from this one; handeye.rpc goes through a router, one more
process, and directly to a server that hosts its bus. Two calls: a request and a response of about 200 bytes each, and a
stereo pair of 1.8 MB as response. Rounds alternate between the systems, so that whatever else the machine does hits all
of them.
"""

import argparse
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

from handeye.proto.methods import CAMERA_GRAB_STEREO, ROBOT_STOP
from handeye.proto.v1.camera_pb2 import Frame, GrabStereoRequest, StereoPair
from handeye.proto.v1.robot_pb2 import RobotState, StopRequest
from handeye.rpc import Bus, BusSettings, Handler, Method
from handeye.rpc.process import until_stopped

# A process imports only what it plays: the libraries compared are imported in the functions that use them.

START = 30.0  # s; a server that is not there by then has failed
ROUNDS = 20
CALLS = {"200 B": 100, "1.8 MB": 8}  # in each round, so 2000 and 160 in all
WARM_UP = {"200 B": 100, "1.8 MB": 5}
STOP = StopRequest(reason="x" * 197)
STATE = RobotState(world_time=1.0, joints=[0.1] * 6, velocities=[0.2] * 6, lease_holder="x" * 84)
_PICTURE = Frame(width=640, height=480, encoding="rgb8", data=bytes(640 * 480 * 3))
PAIR = StereoPair(left=_PICTURE, right=_PICTURE)

Calls = dict[str, Callable[[], Any]]


# ---- servers, each in its own process


def wait_until_stopped() -> None:
    """Returns on SIGTERM."""
    with until_stopped() as stop:
        stop.wait()


def serve_router(port: int) -> None:
    """The router between the handeye.rpc server and its caller."""
    with Bus.host(BusSettings(endpoint=f"tcp/127.0.0.1:{port}"), {}):
        wait_until_stopped()


HANDLERS: dict[Method[Any, Any], Handler] = {
    ROBOT_STOP: lambda _request, _call: STATE,
    CAMERA_GRAB_STEREO: lambda _request, _call: PAIR,
}


def serve_handeye(port: int) -> None:
    """handeye.rpc behind the router."""
    with Bus.open(BusSettings(endpoint=f"tcp/127.0.0.1:{port}"), "server", timeout=START) as bus, bus.serve(HANDLERS):
        wait_until_stopped()


def serve_hosted(port: int) -> None:
    """handeye.rpc without a router, as the lab bus has it."""
    with Bus.host(BusSettings(endpoint=f"tcp/127.0.0.1:{port}"), {}) as bus, bus.serve(HANDLERS):
        wait_until_stopped()


def serve_grpc(port: int) -> None:
    """gRPC with a pool of threads."""
    import grpc

    methods = {
        "Stop": grpc.unary_unary_rpc_method_handler(
            lambda _request, _context: STATE, StopRequest.FromString, RobotState.SerializeToString
        ),
        "GrabStereo": grpc.unary_unary_rpc_method_handler(
            lambda _request, _context: PAIR, GrabStereoRequest.FromString, StereoPair.SerializeToString
        ),
    }
    server = grpc.server(ThreadPoolExecutor(32))
    server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler("bench", methods),))
    server.add_insecure_port(f"127.0.0.1:{port}")
    server.start()
    wait_until_stopped()
    server.stop(None).wait()


def serve_http(port: int) -> None:
    """FastAPI on uvicorn; the bodies are the same protobuf messages."""
    import uvicorn
    from fastapi import FastAPI, Request, Response

    app = FastAPI()

    @app.post("/stop")
    async def stop(request: Request) -> Response:
        StopRequest.FromString(await request.body())
        return Response(STATE.SerializeToString(), media_type="application/x-protobuf")

    @app.post("/grab_stereo")
    async def grab_stereo(request: Request) -> Response:
        GrabStereoRequest.FromString(await request.body())
        return Response(PAIR.SerializeToString(), media_type="application/x-protobuf")

    uvicorn.run(app, host="127.0.0.1", port=port, log_level="error", access_log=False)


SERVERS = {
    "router": serve_router,
    "handeye": serve_handeye,
    "hosted": serve_hosted,
    "grpc": serve_grpc,
    "http": serve_http,
}


# ---- clients, all in this process


@contextmanager
def handeye_calls(port: int) -> Iterator[Calls]:
    """The calls over handeye.rpc."""
    with Bus.open(BusSettings(endpoint=f"tcp/127.0.0.1:{port}"), "benchmark", timeout=START) as bus:
        bus.wait_for("Camera", START)
        yield {
            "200 B": lambda: bus.call(ROBOT_STOP, STOP, timeout=5.0),
            "1.8 MB": lambda: bus.call(CAMERA_GRAB_STEREO, GrabStereoRequest(), timeout=5.0),
        }


@contextmanager
def grpc_calls(port: int) -> Iterator[Calls]:
    """The calls over gRPC."""
    import grpc

    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        grpc.channel_ready_future(channel).result(timeout=START)
        stop = channel.unary_unary("/bench/Stop", StopRequest.SerializeToString, RobotState.FromString)
        grab = channel.unary_unary("/bench/GrabStereo", GrabStereoRequest.SerializeToString, StereoPair.FromString)
        yield {"200 B": lambda: stop(STOP, timeout=5.0), "1.8 MB": lambda: grab(GrabStereoRequest(), timeout=5.0)}


@contextmanager
def http_calls(port: int) -> Iterator[Calls]:
    """The calls over HTTP/1.1 on one kept-alive connection."""
    import httpx2

    wait_for_port(port)
    with httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=5.0) as client:

        def stop() -> RobotState:
            return RobotState.FromString(
                client.post("/stop", content=STOP.SerializeToString()).raise_for_status().content
            )

        def grab() -> StereoPair:
            reply = client.post("/grab_stereo", content=GrabStereoRequest().SerializeToString())
            return StereoPair.FromString(reply.raise_for_status().content)

        yield {"200 B": stop, "1.8 MB": grab}


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for_port(port: int, timeout: float = START) -> None:
    """Returns when somebody listens at the port; raises OSError after `timeout` s."""
    deadline = time.monotonic() + timeout
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.05)
        else:
            return


@contextmanager
def server(kind: str, port: int) -> Iterator[None]:
    """A server process, ended in order."""
    with subprocess.Popen([sys.executable, __file__, "--serve", kind, "--port", str(port)]) as process:
        try:
            yield
        finally:
            process.terminate()
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()


def microseconds(call: Callable[[], Any]) -> float:
    """How long one call took."""
    begin = time.perf_counter()
    call()
    return (time.perf_counter() - begin) * 1e6


def measure(systems: dict[str, Calls]) -> dict[tuple[str, str], list[float]]:
    """Microseconds of every call, by system and payload."""
    taken: dict[tuple[str, str], list[float]] = {(name, size): [] for name in systems for size in CALLS}
    from rich.console import Console
    from rich.progress import track

    for calls in systems.values():
        for size, call in calls.items():
            for _ in range(WARM_UP[size]):
                call()
    for _ in track(range(ROUNDS), "round trips", console=Console(stderr=True)):
        for name, calls in systems.items():
            for size, call in calls.items():
                taken[name, size] += [microseconds(call) for _ in range(CALLS[size])]
    return taken


def report(taken: dict[tuple[str, str], list[float]]) -> None:
    """Prints p50 and p99."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="RPC round trip (µs)")
    table.add_column("")
    for size, count in CALLS.items():
        for share in ("p50", "p99"):
            table.add_column(f"{size}\n{share} of {count * ROUNDS}", justify="right")
    for name in dict.fromkeys(name for name, _size in taken):
        percentiles = [statistics.quantiles(taken[name, size], n=100, method="inclusive") for size in CALLS]
        table.add_row(name, *[f"{each[share - 1]:.0f}" for each in percentiles for share in (50, 99)])
    Console().print(table)


def main() -> None:
    """Runs the benchmark, or with --serve one of its servers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--serve", choices=SERVERS, help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        SERVERS[arguments.serve](arguments.port)
        return
    bus, lab, remote, web = (free_port() for _ in range(4))
    with ExitStack() as stack:
        for kind, port in (("router", bus), ("handeye", bus), ("hosted", lab), ("grpc", remote), ("http", web)):
            stack.enter_context(server(kind, port))
        systems = {
            "handeye.rpc through the router": stack.enter_context(handeye_calls(bus)),
            "handeye.rpc, hosting server": stack.enter_context(handeye_calls(lab)),
            "gRPC": stack.enter_context(grpc_calls(remote)),
            "HTTP (FastAPI, uvicorn, httpx2)": stack.enter_context(http_calls(web)),
        }
        taken = measure(systems)
    report(taken)


if __name__ == "__main__":
    main()

"""Who may join a bus."""

from __future__ import annotations

import glob
import socket
import stat
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zenoh
from pydantic import SecretStr, ValidationError

from handeye.proto.methods import LAB_GET_WORLD, ROBOT_GET_STATE, ROBOT_STATE
from handeye.proto.v1.lab_pb2 import GetWorldRequest, WorldState
from handeye.proto.v1.robot_pb2 import GetStateRequest, RobotState
from handeye.rpc import Bus, BusSettings, LabBusSettings, errors
from handeye.rpc.settings import client_config, host_config

PASSWORD = "not a word of this may be seen"


@pytest.fixture
def admitted(settings: BusSettings) -> BusSettings:
    return settings.model_copy(update={"user": "coordinator", "password": SecretStr(PASSWORD)})


@pytest.fixture
def guarded(admitted: BusSettings) -> Iterator[Bus]:
    with Bus.host(admitted, {"coordinator": PASSWORD, "robot": "other"}) as bus:
        yield bus


def test_password_admits(admitted: BusSettings, guarded: Bus) -> None:
    with Bus.open(admitted, "coordinator") as bus, guarded.serve({ROBOT_GET_STATE: lambda *_: RobotState()}):
        bus.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0)


@pytest.mark.parametrize("wrong", [{"password": SecretStr("guess")}, {"user": "nobody"}, {"user": ""}])
def test_wrong_credentials_are_refused_in_time(
    admitted: BusSettings, guarded: Bus, wrong: dict[str, object], capfd: pytest.CaptureFixture[str]
) -> None:
    begin = time.monotonic()
    with pytest.raises(errors.Unauthorised, match=r"did not admit user .* wrong password") as caught:
        Bus.open(admitted.model_copy(update=wrong), "intruder", timeout=1.0)
    assert time.monotonic() - begin < 3.0
    shown = str(caught.value) + "".join(capfd.readouterr())
    assert PASSWORD not in shown
    assert "guess" not in shown


def test_an_absent_router_is_unavailable_in_time(settings: BusSettings) -> None:
    begin = time.monotonic()
    with pytest.raises(errors.Unavailable, match="nobody answered at tcp/127"):
        Bus.open(settings, "early", timeout=0.5)
    assert time.monotonic() - begin < 2.0


def test_a_bus_waits_for_its_host(settings: BusSettings) -> None:
    hosts: list[Bus] = []
    late = threading.Timer(0.5, lambda: hosts.append(Bus.host(settings, {})))
    late.start()
    try:
        with Bus.open(settings, "early", timeout=5.0):
            pass
    finally:
        late.join()
        hosts[0].close()


def test_what_is_not_admitted_receives_nothing(admitted: BusSettings, guarded: Bus) -> None:
    """A raw Zenoh session that keeps trying without a password: no stream, no answer, no liveliness."""
    config = client_config(admitted.model_copy(update={"user": "", "password": SecretStr("")}), 1.0)
    for path, value in {"mode": '"peer"', "connect/exit_on_failure": "false", "connect/timeout_ms": "-1"}.items():
        config.insert_json5(path, value)  # a peer need not be connected to open
    with (
        zenoh.open(config) as intruder,
        Bus.open(admitted, "coordinator") as friend,
        friend.subscribe(ROBOT_STATE) as states,
        guarded.serve({ROBOT_GET_STATE: lambda *_: RobotState()}),
    ):
        got: list[zenoh.Sample] = []
        with intruder.declare_subscriber("**", got.append):
            for number in range(10):
                guarded.publish(ROBOT_STATE, RobotState(world_time=number))
                time.sleep(0.05)
            assert states.newest(2.0) is not None
            assert list(intruder.get("**", timeout=1.0)) == []
            assert list(intruder.liveliness().get("**", timeout=1.0)) == []
        assert got == []


def test_credentials_of_one_bus_do_not_open_the_other(
    admitted: BusSettings, guarded: Bus, settings: BusSettings
) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        lab = LabBusSettings(
            endpoint=f"tcp/127.0.0.1:{probe.getsockname()[1]}", user="lab", password=SecretStr("truth")
        )
    with Bus.host(lab, {"lab": "truth"}) as lab_bus, lab_bus.serve({LAB_GET_WORLD: lambda *_: WorldState()}):
        with pytest.raises(errors.Unauthorised):
            Bus.open(admitted.model_copy(update={"endpoint": lab.endpoint}), "coordinator", timeout=0.5)
        with Bus.open(lab, "teacher") as teacher:
            teacher.call(LAB_GET_WORLD, GetWorldRequest(), timeout=2.0)
        with Bus.open(admitted, "coordinator") as bus, pytest.raises(errors.Unavailable):
            bus.call(LAB_GET_WORLD, GetWorldRequest(), timeout=2.0)


@pytest.mark.parametrize("host", ["0.0.0.0", "[::]", "192.0.2.1", "router", "127.0.0.1.evil.example", "127"])
def test_off_loopback_needs_credentials(host: str) -> None:
    settings = BusSettings(endpoint=f"tcp/{host}:7447")
    with pytest.raises(errors.Unauthorised, match="set a user and a password"):
        Bus.open(settings, "coordinator")
    for none in ({}, {"": ""}, {"user": ""}, {"": "password"}):
        with pytest.raises(errors.Unauthorised, match="set a user and a password"):
            Bus.host(settings, none)
    client_config(settings.model_copy(update={"user": "a", "password": SecretStr("b")}), 1.0)


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:1", "tcp/127.8.8.8:1", "tcp/[::1]:1", "tcp/localhost:1"])
def test_loopback_needs_none(endpoint: str) -> None:
    client_config(BusSettings(endpoint=endpoint), 1.0)


@pytest.mark.parametrize("endpoint", ["", "127.0.0.1:7447", "tcp/127.0.0.1", "udp/127.0.0.1:1", "tcp/127.0.0.1:1#a=b"])
def test_malformed_endpoints(endpoint: str) -> None:
    with pytest.raises(errors.InvalidArgument, match="an endpoint looks like"):
        Bus.open(BusSettings(endpoint=endpoint), "coordinator")


@pytest.mark.parametrize(("user", "password"), [("a:b", "c"), ("a\nb", "c"), ("a", "c\nroot:d"), ("a", "c\n")])
def test_credentials_cannot_add_lines_to_the_dictionary(settings: BusSettings, user: str, password: str) -> None:
    with pytest.raises(errors.InvalidArgument, match="line break"):
        Bus.host(settings, {user: password})


def test_the_dictionary_is_private_and_gone(
    settings: BusSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    host_config(settings, {"a": "b"}, tmp_path)
    assert stat.S_IMODE((tmp_path / "credentials").stat().st_mode) == 0o600
    empty = tmp_path / "empty"
    empty.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(empty))
    with Bus.host(settings, {"a": "b"}):
        assert glob.glob(f"{empty}/**", recursive=True) == [f"{empty}/"]


def test_an_address_in_use_is_unavailable(settings: BusSettings, host: Bus) -> None:
    with pytest.raises(errors.Unavailable, match="cannot listen at tcp/127"):
        Bus.host(settings, {})


def test_settings_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"ENDPOINT": "tcp/h:1", "USER": "u", "PASSWORD": "p", "CELL": "c"}.items():
        monkeypatch.setenv(f"HANDEYE_LAB_BUS_{name}", value)
    lab = LabBusSettings()
    assert (lab.endpoint, lab.user, lab.password.get_secret_value(), lab.cell) == ("tcp/h:1", "u", "p", "c")
    assert BusSettings().endpoint == "tcp/127.0.0.1:7447"
    assert "p" not in repr(lab.password)
    with pytest.raises(ValidationError):
        BusSettings(pasword="p")  # type: ignore[call-arg]


@pytest.mark.system
def test_router_process_with_credentials(
    admitted: BusSettings, start_router: Callable[..., subprocess.Popen[bytes]]
) -> None:
    start_router(admitted.endpoint, {"coordinator": PASSWORD})
    with Bus.open(admitted, "coordinator", timeout=20.0), pytest.raises(errors.Unauthorised):
        Bus.open(admitted.model_copy(update={"password": SecretStr("guess")}), "intruder", timeout=1.0)

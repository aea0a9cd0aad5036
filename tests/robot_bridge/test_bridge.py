"""What the bridge needs and what it does without."""

from __future__ import annotations

import subprocess
import sys
import threading

import pytest
from pydantic import ValidationError

from handeye.robot_bridge.settings import RobotBridgeSettings


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30.0, check=False)


def test_the_remote_robot_and_the_bridge_load_no_simulator() -> None:
    ended = run_python(
        "import sys, handeye.robot_bridge.remote, handeye.robot_bridge.bridge, handeye.robot_bridge.verbs\n"
        "wrong = [m for m in sys.modules if m == 'pybullet' or m.startswith(('handeye.simulation', 'handeye.server',"
        " 'handeye.rpt', 'handeye.modules'))]\n"
        "sys.exit(repr(wrong) if wrong else 0)"
    )
    assert ended.returncode == 0, ended.stderr


def test_without_the_simulator_the_error_names_the_extra() -> None:
    ended = run_python(
        "import sys; sys.modules['pybullet'] = None\nfrom handeye.cli.app import run\nsys.exit(run(['robot-bridge']))"
    )
    assert ended.returncode == 1
    assert "handeye[robot]" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_settings_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    assert RobotBridgeSettings().model_dump() == {
        "driver": "simulated",
        "clock": "lockstep",
        "profile": "default",
        "seed": 0,
    }
    monkeypatch.setenv("HANDEYE_ROBOT_CLOCK", "realtime")
    monkeypatch.setenv("HANDEYE_ROBOT_SEED", "7")
    settings = RobotBridgeSettings()
    assert (settings.clock, settings.seed) == ("realtime", 7)


@pytest.mark.parametrize("wrong", [{"driver": "toy"}, {"clock": "sun"}, {"seed": -1}, {"colour": "red"}])
def test_wrong_settings_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        RobotBridgeSettings(**wrong)  # type: ignore[arg-type]


def test_nothing_is_left_of_a_bridge_that_finds_no_router(monkeypatch: pytest.MonkeyPatch) -> None:
    from handeye.robot_bridge import bridge
    from handeye.rpc.errors import Unavailable
    from tests.robot_bridge.conftest import free_endpoint

    monkeypatch.setenv("HANDEYE_BUS_ENDPOINT", free_endpoint())
    monkeypatch.setenv("HANDEYE_LAB_BUS_ENDPOINT", free_endpoint())
    monkeypatch.setenv("HANDEYE_LAB_BUS_USER", "lab")
    monkeypatch.setenv("HANDEYE_LAB_BUS_PASSWORD", "secret of the lab")
    monkeypatch.setattr(bridge, "ROUTER_TIMEOUT", 0.2)
    with pytest.raises(Unavailable):
        bridge.run(RobotBridgeSettings(), threading.Event())


@pytest.mark.parametrize("given", [{}, {"USER": "lab"}, {"PASSWORD": "secret of the lab"}])
def test_no_lab_bus_without_credentials_of_its_own(given: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    from handeye.robot_bridge import bridge
    from handeye.rpc.errors import Unauthorised

    for name in ("USER", "PASSWORD"):
        monkeypatch.delenv(f"HANDEYE_LAB_BUS_{name}", raising=False)
    for name, value in given.items():
        monkeypatch.setenv(f"HANDEYE_LAB_BUS_{name}", value)
    with (
        pytest.raises(Unauthorised, match="set HANDEYE_LAB_BUS_USER and HANDEYE_LAB_BUS_PASSWORD"),
        bridge.open_robot(RobotBridgeSettings()),
    ):
        pass

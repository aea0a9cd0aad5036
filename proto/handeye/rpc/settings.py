"""Where the bus is, who may join it, and how Zenoh is told."""

import json
import os
import re
import socket
from collections.abc import Mapping
from pathlib import Path

import zenoh
from pydantic import SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from handeye.rpc.errors import InvalidArgument, RpcError, Unauthorised, Unavailable

LEASE = 1.0
"""Seconds of silence after which a peer is dead: calls to it end, its liveliness tokens go. Each announces its own."""

SECRETS = [folder for folder in os.environ.get("HANDEYE_SECRETS_DIR", "").split(":") if folder]
"""Folders of this process whose files are settings too: handeye_bus_password stands for HANDEYE_BUS_PASSWORD."""


class BusSettings(BaseSettings):
    """The acting bus, from HANDEYE_BUS_ENDPOINT, _USER, _PASSWORD and _CELL."""

    model_config = SettingsConfigDict(env_prefix="HANDEYE_BUS_", extra="forbid", secrets_dir=SECRETS)
    endpoint: str = "tcp/127.0.0.1:7447"
    user: str = ""
    password: SecretStr = SecretStr("")
    cell: str = "cell"


class LabBusSettings(BusSettings):
    """The lab bus (simulation only), from HANDEYE_LAB_BUS_ENDPOINT, _USER, _PASSWORD and _CELL."""

    model_config = SettingsConfigDict(env_prefix="HANDEYE_LAB_BUS_", extra="forbid")
    endpoint: str = "tcp/127.0.0.1:7448"


class RouterSettings(BaseSettings):
    """From HANDEYE_ROUTER_LISTEN (an endpoint) and HANDEYE_ROUTER_CREDENTIALS (JSON, {"user": "password"})."""

    model_config = SettingsConfigDict(env_prefix="HANDEYE_ROUTER_", extra="forbid", secrets_dir=SECRETS)
    listen: str = "tcp/127.0.0.1:7447"
    credentials: dict[str, SecretStr] = {}


def address(endpoint: str) -> tuple[str, int]:
    """Host and port of a Zenoh endpoint such as `tcp/127.0.0.1:7447`; raises InvalidArgument."""
    if not (parts := re.fullmatch(r"tcp/(\[[^]]+\]|[^][:/?#]+):(\d+)", endpoint)):
        raise InvalidArgument(f"an endpoint looks like tcp/127.0.0.1:7447, not like {endpoint!r}")
    return parts[1].strip("[]"), int(parts[2])


def client_config(settings: BusSettings, timeout: float) -> zenoh.Config:
    """Configuration of a session that joins a bus. Never log it: its text holds the password."""
    user, password = settings.user, settings.password.get_secret_value()
    _require_credentials(settings.endpoint, {user: password})
    retry = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
    connect = {"endpoints": [settings.endpoint], "timeout_ms": round(timeout * 1000), "retry": retry}
    return _config("client", {"connect": connect}, {"user": user, "password": password} if user else {})


def host_config(settings: BusSettings, credentials: Mapping[str, str], folder: Path) -> zenoh.Config:
    """Configuration of the session that others join; Zenoh reads their credentials from a file in `folder`."""
    _require_credentials(settings.endpoint, credentials)
    dictionary = folder / "credentials"
    dictionary.touch(mode=0o600)
    dictionary.write_text("".join(f"{user}:{password}\n" for user, password in credentials.items()))
    authentication = {"dictionary_file": str(dictionary)} if credentials else {}
    return _config("router", {"listen": {"endpoints": [settings.endpoint]}}, authentication)


def refusal(settings: BusSettings, timeout: float) -> RpcError:
    """Why a bus could not be joined. Zenoh says only that it could not, so this knocks at the port."""
    try:
        socket.create_connection(address(settings.endpoint), timeout=1.0).close()
    except OSError as error:
        return Unavailable(f"nobody answered at {settings.endpoint} within {timeout:g} s ({error})")
    return Unauthorised(f"{settings.endpoint} did not admit user {settings.user!r} ({timeout:g} s): wrong password?")


def _require_credentials(endpoint: str, credentials: Mapping[str, str]) -> None:
    local = re.fullmatch(r"localhost|127(\.\d{1,3}){3}|::1", address(endpoint)[0])
    if not local and not (credentials and all(user and password for user, password in credentials.items())):
        raise Unauthorised(f"{endpoint} can be reached from other machines: set a user and a password for it")
    if any(re.search("[:\r\n]", user) or re.search("[\r\n]", password) for user, password in credentials.items()):
        raise InvalidArgument("a user's name has no colon, and neither name nor password a line break")


def _config(mode: str, links: Mapping[str, object], authentication: dict[str, str]) -> zenoh.Config:
    transport: dict[str, object] = {"link": {"tx": {"lease": round(LEASE * 1000)}}, "auth": {"usrpwd": authentication}}
    transport["unicast"] = {"open_timeout": 2000, "accept_timeout": 2000}  # a frozen peer is given up after 2 s, not 10
    # It would save 1 ms for a stereo pair, but its watchdog takes buffers away from a process that pauses.
    transport["shared_memory"] = {"enabled": False}
    scouting = {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}}
    return zenoh.Config.from_json5(json.dumps({"mode": mode, "scouting": scouting, "transport": transport, **links}))

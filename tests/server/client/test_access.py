"""The Python client against the real application: access, refusals, pages."""

from __future__ import annotations

import socket
from contextlib import closing
from typing import TYPE_CHECKING

import pytest

from handeye.client import (
    ApiError,
    Client,
    TimedOut,
    Unreachable,
)
from tests.server.conftest import TOKEN

if TYPE_CHECKING:
    from tests.server.conftest import Lab


def test_tokens_have_roles(url: str, client: Client) -> None:
    made = client.create_token("guest", "viewer", days=1)
    assert made.id in [token.id for token in client.tokens()]
    with Client(url, made.token) as guest:
        assert guest.stop_robot("a guest saw a cat").stopped
        with pytest.raises(ApiError, match="role operator") as refused:
            guest.reset_robot()
        assert (refused.value.status, refused.value.code) == (403, "forbidden")
    client.revoke_token(made.id)
    with Client(url, made.token) as guest, pytest.raises(ApiError) as refused:
        guest.robot()
    assert refused.value.status == 401


def test_refusals_keep_the_servers_sentence(client: Client, url: str) -> None:
    with pytest.raises(ApiError, match="not trained") as refusal:
        client.start_run("pour", "blue cup")
    assert (refusal.value.status, refusal.value.code, refusal.value.title) == (404, "not_found", "Not Found")
    with Client(url, "another") as stranger, pytest.raises(ApiError, match="Nobody has this token") as refusal:
        stranger.robot()
    assert (refusal.value.status, refusal.value.code) == (401, "token_wrong")
    with pytest.raises(ApiError, match="There is no job"):
        list(client.events("none"))


def test_lists_longer_than_a_page_come_whole(lab: Lab, client: Client) -> None:
    lab.coordinator.show_object("blue cup", "backgrounds", 0.0)
    lab.coordinator.show_object("blue cup", "examples", 0.0)
    for _ in range(150):
        lab.coordinator.demonstrations.begin("grasp", "blue cup")
    assert [shown.id for shown in client.demonstrations()] == [f"grasp-{n}" for n in range(1, 151)]


def test_not_ready_names_what_is_missing(lab: Lab, client: Client) -> None:
    lab.missing.append("nobody serves Camera on the bus")
    assert "Camera" in (client.not_ready() or "")
    with pytest.raises(TimedOut, match="Camera"):
        client.wait_ready(0.2)


def test_nobody_at_the_address() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
    with Client(f"http://127.0.0.1:{port}", TOKEN) as client, pytest.raises(Unreachable, match=f"{port}.*running"):
        client.robot()

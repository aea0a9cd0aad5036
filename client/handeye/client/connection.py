"""Where the coordinator is and which token it wants, when nobody says so."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import NamedTuple

from handeye.client.errors import NotConfigured


class Connection(NamedTuple):
    """A coordinator's address and token."""

    url: str
    token: str


def state_file() -> Path:
    """Where `handeye up` writes the address and token of what it started."""
    state_home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state_home, "handeye", "handeye.json")


def find(url: str = "", token: str = "") -> Connection:
    """Fills in what is not given: from HANDEYE_URL and HANDEYE_TOKEN, else from the state file of `handeye up`.

    The file's token goes with the file's address only: no other host gets it. `NotConfigured` when one is missing.
    """
    url = url or os.environ.get("HANDEYE_URL", "")
    token = token or os.environ.get("HANDEYE_TOKEN", "")
    if not url or not token:
        kept = _kept()
        url = url or (kept.url if kept else "")
        if kept and url.rstrip("/") == kept.url.rstrip("/"):
            token = token or kept.token
    if not url:
        raise NotConfigured("No coordinator is known: start one with `handeye up`, or give --url and --token.")
    if not token:
        raise NotConfigured(f"The token of {url} is not known: give --token or set HANDEYE_TOKEN.")
    return Connection(url, token)


def _kept() -> Connection | None:
    path = state_file()
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        return Connection(str(kept["url"]), str(kept["token"]))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise NotConfigured(
            f"{path} cannot be read ({error}); restart `handeye up`, or give --url and --token."
        ) from error

"""Who may ask what of the server, how much and how often; and what is told about it in log and metrics.

`roles` says which role a request needs, `tokens` keeps the tokens, `limits` has the bounds, `gate` decides, and
`middleware` puts all of it around every request. `protocol` guards what comes before there is a request.
"""

from __future__ import annotations

from dataclasses import dataclass

from fastapi import FastAPI

from handeye.server.access.gate import Gate
from handeye.server.access.limits import LimitSettings
from handeye.server.access.middleware import AccessMiddleware
from handeye.server.access.roles import Role
from handeye.server.access.tokens import Token, Tokens, show_first_token
from handeye.server.metrics import Metrics


@dataclass(frozen=True, slots=True)
class Access:
    """What an application's access is made of."""

    tokens: Tokens
    limits: LimitSettings
    metrics: Metrics

    def install(self, app: FastAPI) -> None:
        """Puts the gate before `app`; call it after all other middleware was added, so that it is the outermost."""
        app.state.access = self
        gate = Gate(self.tokens, self.limits)
        app.add_middleware(AccessMiddleware, gate=gate, limits=self.limits, metrics=self.metrics)


__all__ = ["Access", "LimitSettings", "Role", "Token", "Tokens", "show_first_token"]

"""Tokens: who may use the server, and as what. For admins."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from pydantic import BaseModel, ConfigDict, Field

from handeye.server.access import Role, Token, Tokens
from handeye.server.problem_responses import responses
from handeye.server.schemas.base import Name

router = APIRouter(prefix="/v1/tokens", tags=["tokens"])


class TokenRequest(BaseModel):
    """What the new token is to be."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    """Whose it is, or what for; log lines tell it."""
    role: Role
    days: float | None = Field(gt=0.0, le=36500.0, allow_inf_nan=False, strict=True, examples=[30])
    """How long it counts, in days; null: until it is revoked."""


class TokenInfo(BaseModel):
    """A token, without its secret."""

    id: str
    name: str
    role: Role
    created: datetime
    expires: datetime | None


class NewToken(TokenInfo):
    """A token that was just made."""

    token: str
    """The secret, for the header Authorization; it is shown this once and kept nowhere."""


class TokenList(BaseModel):
    """The tokens, the oldest first."""

    tokens: tuple[TokenInfo, ...]


async def _tokens(request: Request) -> Tokens:
    tokens: Tokens = request.app.state.access.tokens
    return tokens


TokensDep = Annotated[Tokens, Depends(_tokens)]


@router.get("", responses=responses())
async def list_tokens(tokens: TokensDep) -> TokenList:
    """The tokens that were made and not revoked, expired ones too. A configured one is not among them."""
    return TokenList(tokens=tuple(_info(token) for token in tokens.all()))


@router.post("", status_code=201, responses=responses())
def make_token(request: TokenRequest, tokens: TokensDep) -> NewToken:
    """Makes a token. Without Idempotency-Key: repeating its answer would mean to keep the secret."""
    token, secret = tokens.create(request.name, request.role, request.days)
    return NewToken(**_info(token).model_dump(), token=secret)


@router.delete("/{token_id}", status_code=204, responses=responses(404, 409))
def revoke_token(token_id: str, tokens: TokensDep) -> None:
    """Revokes a token: it does not count from now on, and what is being sent to its holder is cut off."""
    tokens.revoke(token_id)


def _info(token: Token) -> TokenInfo:
    return TokenInfo(
        id=token.id,
        name=token.name,
        role=token.role,
        created=datetime.fromtimestamp(token.created, UTC),
        expires=None if token.expires is None else datetime.fromtimestamp(token.expires, UTC),
    )

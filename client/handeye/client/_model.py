"""What all models of answers have in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Model(BaseModel):
    """Part of an answer: immutable; keys that this version does not know are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class PageModel(Model):
    """Part of a list; `next` is the cursor of the following page, None on the last one."""

    next: str | None = None

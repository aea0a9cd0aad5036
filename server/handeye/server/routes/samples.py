"""A module's samples and what it answers by them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Annotated, Any, TypeVar

import numpy as np
from anyio import to_thread
from fastapi import APIRouter, Query, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel, ValidationError
from starlette.requests import ClientDisconnect
from starlette.types import Receive, Scope, Send

from handeye.modules.answers import Floats
from handeye.server import answering
from handeye.server.arrays import MEDIA_TYPE, QUERIES, SAMPLES, Arrays, answers_file, floats, names, read_arrays
from handeye.server.problem import Invalid, Malformed, UnsupportedMediaType
from handeye.server.problem_responses import responses
from handeye.server.routes import (
    CoordinatorDep,
    Cursor,
    Limit,
    MetricsDep,
    coordinator_of,
    cursor_at,
    media_type,
    metrics_of,
    place,
)
from handeye.server.routes.once import OnceDep
from handeye.server.schemas.base import DemonstrationName, ModuleName
from handeye.server.schemas.samples import (
    MOST_AT_ONCE,
    AnswerList,
    QueryRequest,
    SampleInfo,
    SampleNumber,
    SamplePage,
    SamplesAdded,
    SamplesRemoved,
    SamplesRequest,
)

router = APIRouter(prefix="/v1/modules", tags=["samples and queries"])

B = TypeVar("B", bound=BaseModel)

_NEIGHBOURS = QueryRequest.model_fields["neighbours"].default
_MOST_NEIGHBOURS = 1000
_MOST_KEYS = 4 * MOST_AT_ONCE  # of a body that is as expected
_BINARY = {"type": "string", "format": "binary"}


def _bodies(schema: type[BaseModel]) -> dict[str, object]:
    """The two forms of a body, for the OpenAPI document."""
    reference = {"$ref": f"#/components/schemas/{schema.__name__}"}
    content = {"application/json": {"schema": reference}, MEDIA_TYPE: {"schema": _BINARY}}
    return {"requestBody": {"required": True, "content": content}}


async def _content(request: Request) -> bytes:
    """The whole body. Nearly all come in one piece, which `Request.body` goes a long way for."""
    pieces = []
    more = True
    while more:
        message = await request.receive()
        if message["type"] == "http.disconnect":
            raise ClientDisconnect
        pieces.append(message.get("body", b""))
        more = message.get("more_body", False)
    return pieces[0] if len(pieces) == 1 else b"".join(pieces)


async def _body(request: Request, content: bytes, schema: type[B], arrays: frozenset[str]) -> B | Arrays:
    """The request's body in one of its two forms."""
    kind = media_type(request)
    if kind == MEDIA_TYPE:
        return await to_thread.run_sync(read_arrays, content, arrays)
    if kind not in ("application/json", ""):
        raise UnsupportedMediaType(f"Send application/json or {MEDIA_TYPE}, not {kind}.")
    if content.count(b":") > _MOST_KEYS:
        # Each unknown key makes an error: millions of them would fill the memory.
        raise Invalid(f"The body has more keys than {MOST_AT_ONCE} samples or queries have.")
    try:
        return schema.model_validate_json(content)
    except ValidationError as error:
        wrong = error.errors()
        if wrong[0]["type"] == "json_invalid":
            raise Malformed(f"The body is not JSON: {wrong[0]['ctx']['error']}.") from error
        # A list that ends at its first wrong value is also called too short.
        told = [each for each in wrong if each["type"] != "too_short"] or wrong
        raise RequestValidationError([{**each, "loc": ("body", *each["loc"])} for each in told]) from error


async def query_module(module: ModuleName, request: Request) -> Response:
    """Asks a module one query or many, at most 10 000.

    As JSON, or as a .npz file with the array `inputs` (q, N) and perhaps `neighbours`, a number; the answer comes in
    the same form: outputs (q, M), support (q,), expected_error (q, M), and of the k nearest samples each answer came
    from samples, distances, weights and demonstrations (q, k), the latter as indices into `names`, -1 for none.
    """
    coordinator, metrics = coordinator_of(request), metrics_of(request)
    live = coordinator.modules.live(module)
    body = await _body(request, await _content(request), QueryRequest, QUERIES)
    if isinstance(body, QueryRequest) and len(body.inputs) == 1 and answering.quick(live, 1):
        content = answering.ask_one(live, body.inputs[0], body.neighbours)
        metrics.queries.labels(module).inc()
        return Response(content, media_type="application/json")
    queries, most = _queries(body)

    def work() -> Response:
        answers = answering.ask(live, queries, most)
        if isinstance(body, QueryRequest):
            return Response(answering.to_json(answers), media_type="application/json")
        return Response(answers_file(answers), media_type=MEDIA_TYPE)

    response = work() if answering.quick(live, len(queries)) else await to_thread.run_sync(work)
    metrics.queries.labels(module).inc(len(queries))
    return response


class _AskedMost(APIRoute):
    """Documented as all routes are, but served without the framework, which takes longer than the module to answer."""

    def __init__(self, path: str, endpoint: Callable[[str, Request], Awaitable[Response]], **documented: Any) -> None:
        super().__init__(path, endpoint, **documented)

        async def serve(scope: Scope, receive: Receive, send: Send) -> None:
            response = await endpoint(scope["path_params"]["module"], Request(scope, receive))
            await response(scope, receive, send)

        self.app = serve


QUERY = _AskedMost(
    "/v1/modules/{module}/query",
    query_module,
    methods=["POST"],
    tags=["samples and queries"],
    generate_unique_id_function=lambda route: route.name,
    response_class=Response,
    responses={
        **responses(404, 409, 415),
        200: {
            "model": AnswerList,
            "description": "The answers, in the form of the request.",
            "content": {MEDIA_TYPE: {"schema": _BINARY}},
        },
    },
    openapi_extra=_bodies(QueryRequest),
)
"""Answered past the framework, by `handeye.server.shortcut`."""


@router.post(
    "/{module}/samples",
    status_code=201,
    response_model=SamplesAdded,
    responses=responses(404, 409, 415),
    openapi_extra=_bodies(SamplesRequest),
)
async def add_samples(
    module: ModuleName, request: Request, coordinator: CoordinatorDep, once: OnceDep, metrics: MetricsDep
) -> Response:
    """Teaches a module samples: all of them or none. When this answers they are durable, and the next query knows them.

    As JSON, or as a .npz file with the arrays `inputs` (n, N), `outputs` (n, M) and perhaps `demonstrations` (n,), ""
    for none. At most 10 000 at a time.
    """
    body = await _body(request, await request.body(), SamplesRequest, SAMPLES)

    def work() -> Response:
        inputs, outputs, shown = _samples(body)

        def write() -> tuple[SamplesAdded, None]:
            first = coordinator.modules.add(module, inputs, outputs, shown)
            metrics.samples.labels(module).inc(len(shown))
            total = coordinator.modules.live(module).samples + len(shown)  # it follows once this is committed
            return SamplesAdded(first=first, count=len(shown), samples=total), None

        return once.reply(write)

    return await to_thread.run_sync(work)


@router.get("/{module}/samples", responses=responses(404))
def list_samples(
    module: ModuleName, coordinator: CoordinatorDep, limit: Limit = 100, cursor: Cursor = None
) -> SamplePage:
    """A module's samples, by number."""
    begin = place(cursor, int)
    pieces = coordinator.modules.samples(module, begin[0] if begin else -1, limit + 1)
    found = [
        SampleInfo(number=number, input=tuple(given), output=tuple(wanted), demonstration=shown)
        for piece in pieces
        for number, given, wanted, shown in zip(
            piece.numbers.tolist(), piece.inputs.tolist(), piece.outputs.tolist(), piece.demonstrations, strict=True
        )
    ]
    following = cursor_at([found[limit - 1].number]) if len(found) > limit else None
    return SamplePage(samples=tuple(found[:limit]), next=following)


@router.delete("/{module}/samples", responses=responses(404))
def remove_samples(
    module: ModuleName,
    coordinator: CoordinatorDep,
    number: Annotated[list[SampleNumber], Query(max_length=1000)] = [],  # noqa: B006 # FastAPI copies it
    demonstration: Annotated[DemonstrationName | None, Query()] = None,
) -> SamplesRemoved:
    """Takes samples out, by number or all of one demonstration; the next query does not know them."""
    if bool(number) == (demonstration is not None):
        raise Invalid("Say which samples to take out: give numbers (?number=1&number=2) or one demonstration.")
    if demonstration is not None:
        return SamplesRemoved(removed=coordinator.modules.untrain(module, demonstration))
    return SamplesRemoved(removed=coordinator.modules.remove(module, number))


def _samples(body: SamplesRequest | Arrays) -> tuple[Floats, Floats, list[str | None]]:
    if isinstance(body, SamplesRequest):
        inputs = answering.matrix(tuple(sample.input for sample in body.samples), "inputs")
        outputs = answering.matrix(tuple(sample.output for sample in body.samples), "outputs")
        return inputs, outputs, [sample.demonstration for sample in body.samples]
    inputs, outputs = floats(body, "inputs"), floats(body, "outputs")
    _check_count(inputs)
    return inputs, outputs, names(body, len(inputs))


def _queries(body: QueryRequest | Arrays) -> tuple[Floats, int]:
    if isinstance(body, QueryRequest):
        return answering.matrix(body.inputs, "queries"), body.neighbours
    inputs = floats(body, "inputs")
    _check_count(inputs)
    most = floats(body, "neighbours") if "neighbours" in body else np.array(_NEIGHBOURS)
    if most.shape != () or not 0 <= most <= _MOST_NEIGHBOURS or most % 1:
        raise Invalid(f"Array 'neighbours' must be one whole number from 0 to {_MOST_NEIGHBOURS}.")
    return inputs, int(most)


def _check_count(inputs: Floats) -> None:
    if inputs.ndim != 2 or not 1 <= len(inputs) <= MOST_AT_ONCE:
        raise Invalid(
            f"Array 'inputs' must be (n, components) with n from 1 to {MOST_AT_ONCE}, not of shape {inputs.shape}; "
            "send more in several requests."
        )

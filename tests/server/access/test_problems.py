"""Whatever is wrong with a request, the answer is a problem with a sentence that helps. Never a 500."""

from __future__ import annotations

import json

import pytest
from fastapi import Request
from fastapi.exceptions import RequestValidationError
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from sqlalchemy.exc import DatabaseError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from starlette.testclient import TestClient

from handeye.rpc.errors import Busy
from handeye.server.problem import NotReady, error_code, error_sentence
from handeye.server.problem_responses import responses
from tests.server.access.conftest import Site, Thing, raw_request, sentence

JSON = {"Content-Type": "application/json"}


@pytest.mark.parametrize(
    ("body", "status", "code", "told"),
    [
        (b'{"name": "cup", ', 400, "malformed", "The body is not JSON: "),
        (b"", 422, "invalid_argument", "body: Field required"),
        (b"null", 422, "invalid_argument", "body: "),
        (b'"cup"', 422, "invalid_argument", "body: "),
        (b'{"name": "cup"} {}', 400, "malformed", "Extra data at character 16"),
        (b'{"name": "\xff"}', 400, "malformed", "UTF-8"),
        (b"\xff\xfe", 400, "malformed", "The body is not JSON"),
        (b'{"name": "cup", "value": NaN}', 422, "invalid_argument", "body.value: Input should be a finite number"),
        (
            b'{"name": "cup", "value": -Infinity}',
            422,
            "invalid_argument",
            "body.value: Input should be a finite number",
        ),
        (b'{"name": "cup", "value": 1e999}', 422, "invalid_argument", "body.value"),
        (b'{"name": "cup", "value": 1' + b"0" * 400 + b"}", 422, "invalid_argument", "body.value"),
        (b'{"name": "cup", "count": 1' + b"0" * 5000 + b"}", 400, "malformed", "4300 digits"),
        (b'{"name": "cup", "count": 1.5}', 422, "invalid_argument", "body.count"),
        (b'{"name": "a\\u0000b"}', 422, "invalid_argument", "body.name"),
        (b'{"name": "\\ud800"}', 422, "invalid_argument", "body.name"),
        (b'{"name": "cup", "\\ud800": 1}', 422, "invalid_argument", "body: Input should be a valid string"),
        (b'{"name": "cup", "colour": "blue"}', 422, "invalid_argument", "body.colour: Extra inputs"),
        (b"[" * 100_000, 400, "malformed", "nested too deeply"),
        (b'{"a":' * 100_000, 400, "malformed", "nested too deeply"),
    ],
)
def test_wrong_bodies(http: TestClient, body: bytes, status: int, code: str, told: str) -> None:
    assert told in sentence(http.post("/v1/things", content=body, headers=JSON), status, code)


@pytest.mark.parametrize(
    "kind", ["text/plain", "application/x-www-form-urlencoded", "nonsense", "application/xml", None]
)
def test_a_body_of_another_type(http: TestClient, kind: str | None) -> None:
    headers = {"Content-Type": kind} if kind else {}
    told = sentence(http.post("/v1/things", content=b'{"name": "cup"}', headers=headers), 415, "unsupported_media_type")
    assert "Content-Type: application/json" in told
    assert (kind or "none") in told


@pytest.mark.parametrize("kind", ["application/json; charset=utf-8", "application/vnd.cup+json"])
def test_json_by_its_other_names(http: TestClient, kind: str) -> None:
    response = http.post("/v1/things", content=b'{"name": "cup"}', headers={"Content-Type": kind})
    assert response.status_code == 201


def test_json_that_a_route_reads_itself(site: Site) -> None:
    @site.app.post("/v1/read")
    async def read(request: Request) -> None:
        try:
            Thing.model_validate_json(await request.body())
        except ValidationError as error:
            raise RequestValidationError(
                [{**each, "loc": ("body", *each["loc"])} for each in error.errors()]
            ) from error

    http = site.client()
    told = sentence(http.post("/v1/read", content=b'{"name": '), 400, "malformed")
    assert told == "The body is not JSON: EOF while parsing a value at line 1 column 9."
    assert "body.value" in sentence(http.post("/v1/read", content=b'{"value": NaN}'), 422, "invalid_argument")


@pytest.mark.parametrize("path", ["/v1/things/a%00b", "/v1/things/cup?x=a%00b"])
def test_nul_characters(http: TestClient, path: str) -> None:
    assert "%00" in sentence(http.get(path), 400, "malformed")


def test_paths_that_are_not_utf_8(site: Site) -> None:
    answer = raw_request(site, "GET", "/v1/things/\N{REPLACEMENT CHARACTER}", raw_path=b"/v1/things/%ff")
    assert answer["status"] == 400
    assert "UTF-8" in answer["body"]["detail"]


@pytest.mark.parametrize(
    ("method", "path", "possible"),
    [
        ("HEAD", "/v1/things/cup", "GET"),
        ("TRACE", "/v1/things/cup", "GET"),
        ("DELETE", "/v1/robot/stop", "POST"),
        ("BREW", "/v1/restore", "POST"),
        ("OPTIONS", "/v1/things", "POST"),
    ],
)
def test_methods_that_a_path_does_not_have(http: TestClient, method: str, path: str, possible: str) -> None:
    response = http.request(method, path)
    assert response.status_code == 405
    assert response.headers["allow"] == possible
    if response.content:  # not HEAD's
        told = sentence(response, 405, "method_not_allowed")
        assert told == f"{method} {path} is not possible; {possible} is."


def test_allow_names_the_methods_of_all_routes_at_a_path(site: Site) -> None:
    @site.app.get("/v1/things")
    def list_things() -> list[str]:
        return []

    assert site.client().put("/v1/things").headers["allow"] == "GET, POST"


def test_nothing_there(http: TestClient) -> None:
    told = sentence(http.get("/v1/nothing"), 404, "not_found")
    assert told == "There is nothing at GET /v1/nothing; GET /v1/openapi.json lists what there is."
    assert len(sentence(http.get(f"/v1/{'x' * 10_000}"), 404, "not_found")) < 400


def test_of_thousands_of_wrong_fields_the_first_are_named(site: Site) -> None:
    @site.app.post("/v1/numbers")
    def numbers(values: list[float]) -> int:
        return len(values)

    response = site.client().post("/v1/numbers", json=["a"] * 5000)
    told = sentence(response, 422, "invalid_argument")
    assert "body.0: " in told
    assert told.endswith("; and 4980 more.")
    assert len(response.json()["fields"]) == 20


def test_an_exception_is_a_500_that_the_log_explains(http: TestClient, capsys: pytest.CaptureFixture[str]) -> None:
    response = http.get("/v1/broken", headers={"X-Request-Id": "find-me"})
    told = sentence(response, 500, "internal")
    assert "zero" not in told
    assert response.headers["x-request-id"] == "find-me"
    log = capsys.readouterr().out
    assert "ZeroDivisionError" in log
    assert "find-me" in log
    assert "request failed" in log


@pytest.mark.parametrize(
    "error",
    [
        OperationalError("INSERT secret-statement", {}, Exception("the database says why")),
        DatabaseError("INSERT secret-statement", {}, Exception("the database says why")),
        PoolTimeout("the database says why"),
    ],
)
def test_a_store_that_fails_is_a_503(site: Site, error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    @site.app.get("/v1/full")
    def full() -> None:
        raise error

    told = sentence(site.client().get("/v1/full"), 503, "store_failed")
    assert "disk" in told
    assert "INSERT" not in told
    assert "the database says why" in capsys.readouterr().out


def test_not_ready_says_when_to_come_again(site: Site) -> None:
    @site.app.get("/v1/soon")
    def soon() -> None:
        raise NotReady("The modules are being built.")

    response = site.client().get("/v1/soon")
    assert sentence(response, 503, "not_ready") == "The modules are being built."
    assert response.headers["retry-after"] == "1"


def test_jobs_have_the_same_codes() -> None:
    assert error_code(Busy("held by 'alice'")) == "busy"
    assert error_sentence(Busy("held by 'alice'")) == "held by 'alice'"
    assert error_code(KeyError("x")) == "internal"
    assert "x" not in error_sentence(KeyError("x")).split()


def test_every_route_declares_what_each_can_give() -> None:
    assert {400, 401, 403, 409, 413, 415, 422, 429, 431, 500, 503} == set(responses(409))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=200)
@given(
    body=st.binary(max_size=60)
    | st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda inner: (
            st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5) | st.just("name"), inner, max_size=3)
        ),
        max_leaves=8,
    ).map(lambda value: json.dumps(value).encode())
)
def test_no_body_makes_a_500(http: TestClient, body: bytes) -> None:
    response = http.post("/v1/things", content=body, headers=JSON)
    assert response.status_code in (201, 400, 422)
    if response.status_code != 201:
        sentence(response, response.status_code, response.json()["code"])

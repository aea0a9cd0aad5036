"""Bounds: size, rate, guesses. Each refusal says what the bound is."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient

from handeye.server.access import LimitSettings, Role
from handeye.server.access.limits import Bucket, WrongTokens, size
from handeye.server.store import Store
from tests.server.access.conftest import ADMIN, Site, sentence
from tests.server.conftest import TOKEN

if TYPE_CHECKING:
    from tests.server.conftest import Lab

LIMIT = 2048


@pytest.fixture
def small(store: Store) -> Site:
    return Site(store, LimitSettings(body_bytes=LIMIT, archive_bytes=2 * LIMIT))


def pieces(total: int, each: int = 100) -> Iterator[bytes]:
    """A body without Content-Length."""
    for start in range(0, total, each):
        yield b"x" * min(each, total - start)


# Size


@pytest.mark.parametrize("declared", [True, False])
def test_a_body_of_just_the_limit_is_taken_and_no_more(small: Site, declared: bool) -> None:
    http = small.client()

    def upload(path: str, total: int) -> object:
        return http.post(path, content=b"x" * total if declared else pieces(total))

    assert upload("/v1/upload", LIMIT).json() == {"bytes": LIMIT}  # type: ignore[attr-defined]
    told = sentence(upload("/v1/upload", LIMIT + 1), 413, "too_large")
    assert "2 KiB (2048 bytes)" in told
    assert "HANDEYE_SERVER_LIMITS__BODY_BYTES" in told


@pytest.mark.parametrize("path", ["/v1/things", "/v1/careless"])
def test_whatever_the_route_makes_of_it_the_answer_is_413(small: Site, path: str) -> None:
    response = small.client().post(path, content=pieces(LIMIT + 1), headers={"Content-Type": "application/json"})
    sentence(response, 413, "too_large")


def test_whole_stores_have_a_bound_of_their_own(small: Site) -> None:
    http = small.client()
    assert http.post("/v1/restore", content=b"x" * (LIMIT + 1)).json() == {"bytes": LIMIT + 1}
    told = sentence(http.post("/v1/restore", content=pieces(2 * LIMIT + 1)), 413, "too_large")
    assert "HANDEYE_SERVER_LIMITS__ARCHIVE_BYTES" in told


def test_only_samples_queries_and_archives_may_be_large_unless_told_otherwise(lab: Lab) -> None:
    content = b'{"' + b"x" * 2**20 + b'": 1}'
    headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"}
    with TestClient(lab.app(), headers=headers) as http:
        for path in ("/v1/robot/stop", "/v1/demonstrations", "/v1/modules"):
            assert "1 MiB" in sentence(http.post(path, content=content), 413, "too_large")
        assert http.post("/v1/modules/none/query", content=content).status_code == 404
        for path in ("/v1/modules/none/samples", "/v1/modules/import"):
            assert http.post(path, content=content).status_code in (404, 415, 422)


@pytest.mark.parametrize("length", ["99999999999999999999999999", "9" * 5000])
def test_lengths_that_no_number_holds(small: Site, length: str) -> None:
    response = small.client().post("/v1/upload", headers={"Content-Length": length})
    sentence(response, 413, "too_large")


def test_who_may_not_is_told_so_before_the_body_is_read(small: Site) -> None:
    viewer = small.client(small.secret(Role.VIEWER))
    sentence(viewer.post("/v1/upload", content=b"x" * (LIMIT + 1)), 403, "forbidden")


def test_sizes_for_people() -> None:
    assert [size(n) for n in (12, 1536, 32 * 2**20, 4 * 2**30)] == ["12 bytes", "1.5 KiB", "32 MiB", "4 GiB"]


def test_a_head_that_is_too_large(site: Site) -> None:
    http = site.client()
    told = sentence(http.get("/v1/things/cup", headers={"X-Long": "x" * 70_000}), 431, "head_too_large")
    assert "64 KiB is the most" in told
    long, more = "x" * 60_000, {"X-Long": "x" * 6_000}
    sentence(http.get(f"/v1/things/{long}", headers=more), 431, "head_too_large")
    sentence(http.get(f"/v1/things/cup?x={long}", headers=more), 431, "head_too_large")
    sentence(site.client(None).get("/healthz", headers={"X-Long": "x" * 70_000}), 431, "head_too_large")


# Rate


def test_one_token_s_rate_does_not_hold_up_another(store: Store) -> None:
    site = Site(store, LimitSettings(requests_per_second=3.0))
    busy, other = site.client(), site.client(site.secret(Role.VIEWER))
    answers = [busy.get("/v1/things/cup") for _ in range(5)]
    assert [answer.status_code for answer in answers[:3]] == [200] * 3
    refused = next(answer for answer in answers if answer.status_code != 200)
    told = sentence(refused, 429, "too_many_requests")
    assert "'configured' may make 3 requests per second; try again in 1 s" in told
    assert refused.headers["retry-after"] == "1"
    assert other.get("/v1/things/cup").status_code == 200
    assert busy.get("/healthz").status_code == 200


def test_a_stop_is_never_too_much(store: Store) -> None:
    site = Site(store, LimitSettings(requests_per_second=0.001))
    http = site.client()
    http.get("/v1/things/cup")
    assert http.get("/v1/things/cup").headers["retry-after"] == "1000"
    assert [http.post("/v1/robot/stop").status_code for _ in range(5)] == [200] * 5


@given(
    rate=st.floats(0.1, 1e4),
    gaps=st.lists(st.floats(0.0, 3.0), max_size=100),
)
def test_a_bucket_gives_no_more_than_its_rate_and_one_second_s_burst(rate: float, gaps: list[float]) -> None:
    now, taken = 0.0, 0
    bucket = Bucket(rate, now)
    for gap in gaps:
        now += gap
        wait = bucket.take(now)
        if wait == 0.0:
            taken += 1
        else:
            now += wait * 1.001
            assert bucket.take(now) == 0.0  # what it says is true
            taken += 1
    assert taken <= max(rate, 1.0) + rate * now + 1e-6


# Guesses


def test_guessing_is_slow(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    site = Site(store, LimitSettings(wrong_tokens=3))
    now = [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    guesser = site.client(None)

    def guess(secret: str) -> object:
        return guesser.get("/v1/things/cup", headers={"Authorization": f"Bearer {secret}"})

    for number in range(3):
        sentence(guess(f"guess {number}"), 401, "token_wrong")
    refused = guess("one more")
    told = sentence(refused, 429, "too_many_requests")
    assert told == "3 wrong tokens came from 192.0.2.7 within 10 s; it may try again in 10 s."
    assert refused.headers["retry-after"] == "10"  # type: ignore[attr-defined]
    # The right one would not tell itself by another answer.
    sentence(guess(ADMIN), 429, "too_many_requests")
    # Others are not held up, nor is health.
    assert site.client(address="192.0.2.8").get("/v1/things/cup").status_code == 200
    assert guesser.get("/healthz").status_code == 200
    now[0] += 10.0
    assert guess(ADMIN).status_code == 200  # type: ignore[attr-defined]


def test_a_guesser_does_not_lock_out_who_was_there_before(store: Store) -> None:
    site = Site(store, LimitSettings(wrong_tokens=1))
    known = site.client()
    assert known.get("/v1/things/cup").status_code == 200
    site.client("wrong").get("/v1/things/cup")
    sentence(site.client("wrong").get("/v1/things/cup"), 429, "too_many_requests")
    assert known.post("/v1/robot/stop").status_code == 200


def test_missing_and_expired_tokens_are_no_guesses(store: Store) -> None:
    site = Site(store, LimitSettings(wrong_tokens=1))
    expired = site.client(site.secret(Role.VIEWER, days=1e-9))
    for _ in range(3):
        sentence(site.client(None).get("/v1/things/cup"), 401, "token_missing")
        sentence(expired.get("/v1/things/cup"), 401, "token_expired")


def test_one_ipv6_machine_is_one_guesser() -> None:
    wrong = WrongTokens(2)
    wrong.note("2001:db8::1", 0.0)
    wrong.note("2001:db8::2", 0.0)
    assert wrong.wait("2001:db8::ffff%eth0", 1.0) == 9
    assert wrong.wait("2001:db8:0:1::1", 1.0) == 0
    assert wrong.wait("not:an:address", 1.0) == 0


def test_addresses_are_forgotten_in_time() -> None:
    wrong = WrongTokens(1)
    for number in range(10_000):
        wrong.note(f"address {number}", 0.0)
    assert wrong.wait("address 9999", 1.0) == 9
    assert wrong.wait("address 1", 1.0) == 0


@pytest.mark.parametrize(
    "wrong",
    [{"body_bytes": 0}, {"requests_per_second": 0.0}, {"requests_per_second": float("inf")}, {"speed": 1}],
)
def test_limits_that_make_no_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        LimitSettings(**wrong)  # type: ignore[arg-type]

"""Samples and queries over REST, as JSON and as arrays."""

from __future__ import annotations

import io
import struct
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from handeye.server.arrays import SAMPLES, floats, names, read_arrays
from handeye.server.problem import RequestError
from tests.server.rest import NPZ, declaration, done, packed, problem, samples, taught, unpacked

if TYPE_CHECKING:
    from starlette.testclient import TestClient

    from tests.server.conftest import Lab


@pytest.fixture
def module(http: TestClient) -> str:
    """Where a module without samples is."""
    return str(http.post("/v1/modules", json=declaration()).headers["location"])


# --- teaching -------------------------------------------------------------------------------------------------------


def test_samples_are_numbered_and_the_next_query_knows_them(http: TestClient, module: str) -> None:
    problem(http.post(f"{module}/query", json={"inputs": [[0.1, 0.2]]}), 409, "not_taught")
    assert done(http.post(f"{module}/samples", json=samples(5)), 201) == {"first": 0, "count": 5, "samples": 5}
    assert done(http.post(f"{module}/samples", json=samples(3, seed=1)), 201) == {"first": 5, "count": 3, "samples": 8}
    inputs, outputs = taught(3, seed=1)
    (answer,) = done(http.post(f"{module}/query", json={"inputs": [inputs[1].tolist()], "neighbours": 2}))["answers"]
    assert answer["neighbours"][0]["sample"] == 6
    assert answer["neighbours"][0]["distance"] == 0.0
    assert len(answer["neighbours"]) == 2
    assert len(answer["output"]) == len(outputs[1])


def test_samples_as_arrays_are_the_same_samples(http: TestClient, module: str) -> None:
    inputs, outputs = taught(4)
    body = packed(inputs=inputs, outputs=outputs, demonstrations=["a-1", "", "a-1", "größe 2"])
    assert done(http.post(f"{module}/samples", content=body, headers=NPZ), 201)["count"] == 4
    listed = done(http.get(f"{module}/samples"))["samples"]
    assert [each["demonstration"] for each in listed] == ["a-1", None, "a-1", "größe 2"]
    assert [each["input"] for each in listed] == inputs.tolist()
    assert [each["output"] for each in listed] == outputs.tolist()


def test_ten_thousand_samples_and_queries_at_once(http: TestClient, module: str) -> None:
    inputs, _outputs = taught(10_000)
    assert done(http.post(f"{module}/samples", json=samples(10_000)), 201)["samples"] == 10_000
    asked = done(http.post(f"{module}/query", json={"inputs": inputs.tolist(), "neighbours": 1}))["answers"]
    assert [answer["neighbours"][0]["sample"] for answer in asked] == list(range(10_000))
    body = packed(inputs=inputs, neighbours=1)
    told = unpacked(http.post(f"{module}/query", content=body, headers=NPZ).content)
    assert told["samples"][:, 0].tolist() == list(range(10_000))
    assert told["outputs"].tolist() == [answer["output"] for answer in asked]
    too_many = np.zeros((10_001, 2))
    wrong = http.post(f"{module}/samples", content=packed(inputs=too_many, outputs=too_many), headers=NPZ)
    assert "several requests" in problem(wrong, 422, "invalid_argument")
    problem(http.post(f"{module}/samples", json=samples(10_001)), 422, "invalid_argument")
    problem(http.post(f"{module}/query", json={"inputs": too_many.tolist()}), 422, "invalid_argument")


@pytest.mark.parametrize(
    ("sample", "wrong"),
    [
        ({"input": [0.0], "output": [0.0, 0.0]}, "2 components"),
        ({"input": [0.0, 0.0, 0.0], "output": [0.0, 0.0]}, "2 components"),
        ({"input": [0.0, 0.0], "output": [0.0]}, "2 components"),
        ({"input": [], "output": []}, "at least 1 item"),
        ({"input": [0.0, 0.0]}, "output"),
        ({"input": [0.0, 0.0], "output": [0.0, 0.0], "colour": "blue"}, "colour"),
        ({"input": [0.0, 0.0], "output": [0.0, 0.0], "demonstration": "a/b"}, "demonstration"),
        ({"input": [0.0, 0.0], "output": [0.0, 0.0], "demonstration": ""}, "demonstration"),
        ({"input": [0.0, "much"], "output": [0.0, 0.0]}, "input.1"),
        ({"input": [0.0, None], "output": [0.0, 0.0]}, "input.1"),
        ({"input": [0.0, 1e200], "output": [0.0, 0.0]}, "magnitude"),
        ({"input": "01", "output": [0.0, 0.0]}, "input"),
    ],
)
def test_wrong_samples_are_refused_and_none_is_learned(
    http: TestClient, module: str, sample: dict[str, object], wrong: str
) -> None:
    body = {"samples": [sample]}
    assert wrong in problem(http.post(f"{module}/samples", json=body), 422, "invalid_argument")
    assert done(http.get(module))["samples"] == 0


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_what_is_not_finite_is_refused(http: TestClient, module: str, number: str) -> None:
    body = f'{{"samples": [{{"input": [0.0, {number}], "output": [0.0, 0.0]}}]}}'
    wrong = http.post(f"{module}/samples", content=body, headers={"Content-Type": "application/json"})
    assert "finite" in problem(wrong, 422, "invalid_argument")
    asked = f'{{"inputs": [[{number}, 0.0]]}}'
    wrong = http.post(f"{module}/query", content=asked, headers={"Content-Type": "application/json"})
    assert "finite" in problem(wrong, 422, "invalid_argument")
    arrays = packed(inputs=[[0.0, float(number)]], outputs=[[0.0, 0.0]])
    assert "finite" in problem(http.post(f"{module}/samples", content=arrays, headers=NPZ), 422, "invalid_argument")
    asked_arrays = packed(inputs=[[0.0, float(number)]])
    http.post(f"{module}/samples", json=samples(3))
    wrong = http.post(f"{module}/query", content=asked_arrays, headers=NPZ)
    assert "finite" in problem(wrong, 422, "invalid_argument")


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        (b"", 400, "malformed"),
        (b"{", 400, "malformed"),
        (b'{"samples": [', 400, "malformed"),
        (b"\xff\xfe", 400, "malformed"),
        (b'{"samples": "\\ud800"}', 400, "malformed"),
        (b'{"inputs":' + b"[" * 100_000, 400, "malformed"),
        (b"[]", 422, "invalid_argument"),
        (b"null", 422, "invalid_argument"),
        (b'{"samples": []}', 422, "invalid_argument"),
        (b'{"samples": [], "inputs": []}', 422, "invalid_argument"),
        (b'{"samples": [1]}', 422, "invalid_argument"),
        (b"1" * 5000, 400, "malformed"),
    ],
)
def test_bodies_that_are_no_json_or_no_samples(
    http: TestClient, module: str, body: bytes, status: int, code: str
) -> None:
    for path in ("samples", "query"):
        wrong = http.post(f"{module}/{path}", content=body, headers={"Content-Type": "application/json"})
        sentence = problem(wrong, status, code)
        assert "character body" not in sentence
        assert len(sentence) < 500


def test_a_flood_of_wrong_values_is_refused_at_the_first(http: TestClient, module: str) -> None:
    flood = b'""' + b',""' * 200_000
    for path, body in (
        ("query", b'{"inputs":[[' + flood + b"]]}"),
        ("query", b'{"inputs":[' + flood + b"]}"),
        ("samples", b'{"samples":[{"input":[' + flood + b'],"output":[0]}]}'),
        ("samples", b'{"samples":[' + b"{}" + b",{}" * 9_999 + b"]}"),
    ):
        wrong = http.post(f"{module}/{path}", content=body, headers={"Content-Type": "application/json"})
        problem(wrong, 422, "invalid_argument")
        assert len(wrong.json()["fields"]) <= 3, path


def test_other_types_of_bodies_are_refused(http: TestClient, module: str) -> None:
    for kind in ("text/csv", "application/x-npy", "x" * 1000):
        wrong = http.post(f"{module}/samples", content=b"1,2", headers={"Content-Type": kind})
        assert len(problem(wrong, 415, "unsupported_media_type")) < 400


def test_an_unknown_module_is_named(http: TestClient) -> None:
    for response in (
        http.post("/v1/modules/nobody/samples", json=samples(1)),
        http.post("/v1/modules/nobody/query", json={"inputs": [[0.0, 0.0]]}),
        http.get("/v1/modules/nobody/samples"),
        http.delete("/v1/modules/nobody/samples", params={"number": 1}),
    ):
        assert "'nobody'" in problem(response, 404, "not_found")


# --- arrays that are none -------------------------------------------------------------------------------------------


def header(text: str, content: bytes = b"", version: tuple[int, int] = (1, 0)) -> bytes:
    """A .npy file with a header of one's own."""
    text = text + " " * (64 - (len(text) + 11) % 64) + "\n"
    length = struct.pack("<H" if version == (1, 0) else "<I", len(text))
    return b"\x93NUMPY" + bytes(version) + length + text.encode("latin-1") + content


def archive(compression: int = zipfile.ZIP_STORED, **entries: bytes) -> bytes:
    """A .zip file with entries of one's own."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as zipped:
        for name, content in entries.items():
            zipped.writestr(f"{name}.npy", content)
    return file.getvalue()


def npy(array: np.ndarray[Any, Any]) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


GOOD = npy(np.zeros((1, 2)))
BAD_ARRAYS = {
    "nothing": b"",
    "no zip": b"PK\x03\x04 and so on",
    "cut off": packed(inputs=np.zeros((9, 2)))[:-30],
    "text": archive(inputs=b"hello"),
    "objects": archive(
        inputs=header("{'descr': '|O', 'fortran_order': False, 'shape': (1, 2), }", b"\x80\x04]\x94(K\x01K\x02e.")
    ),
    "larger than it is": archive(
        inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 2), }", b"12345678")
    ),
    "negative": archive(inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 2), }", bytes(16))),
    "huge shape": archive(inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (1" + "0" * 400 + ",), }")),
    "minus minus": archive(
        inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (" + "-" * 5000 + "1,), }")
    ),
    "deep": archive(inputs=header("(" * 3000)),
    "no type": archive(inputs=header("{'descr': 'nothing', 'fortran_order': False, 'shape': (1, 2), }", bytes(16))),
    "odd type": archive(inputs=header("{'descr': [('a',)], 'fortran_order': False, 'shape': (1, 2), }", bytes(16))),
    "no size": archive(inputs=header("{'descr': '<U0', 'fortran_order': False, 'shape': (1000000000, 2), }")),
    "old version": archive(inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 2), }", b"", (9, 9))),
    "latin": archive(inputs=header("{'descr': '<f8', '\xe9': 1}")),
    "short": archive(inputs=GOOD[:-1]),
    "long": archive(inputs=GOOD + b"x"),
    "lzma": archive(zipfile.ZIP_LZMA, inputs=GOOD),
}


def test_files_that_are_no_arrays_are_malformed(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(3))
    for name, body in BAD_ARRAYS.items():
        for path in (f"{module}/samples", f"{module}/query", "/v1/modules/import"):
            sentence = problem(http.post(path, content=body, headers=NPZ), 400, "malformed")
            assert "npz" in sentence, name
            assert len(sentence) < 500, name


@pytest.mark.parametrize(
    ("arrays", "wrong"),
    [
        ({"outputs": np.zeros((1, 2))}, "no array 'inputs'"),
        ({"inputs": np.zeros((1, 2))}, "no array 'outputs'"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "weights": np.zeros(1)}, "weights"),
        ({"inputs": np.array([["a", "b"]]), "outputs": np.zeros((1, 2))}, "real numbers"),
        ({"inputs": np.zeros((1, 2), complex), "outputs": np.zeros((1, 2))}, "real numbers"),
        ({"inputs": np.zeros((1, 2), "M8[s]"), "outputs": np.zeros((1, 2))}, "real numbers"),
        ({"inputs": np.zeros(1, [("x", "f8"), ("y", "f8")]), "outputs": np.zeros((1, 2))}, "real numbers"),
        ({"inputs": np.zeros(()), "outputs": np.zeros((1, 2))}, "(n, components)"),
        ({"inputs": np.zeros(2), "outputs": np.zeros((1, 2))}, "(n, components)"),
        ({"inputs": np.zeros((1, 1, 2)), "outputs": np.zeros((1, 2))}, "(n, components)"),
        ({"inputs": np.zeros((0, 2)), "outputs": np.zeros((0, 2))}, "(n, components)"),
        ({"inputs": np.zeros((1, 0)), "outputs": np.zeros((1, 2))}, "2 components"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((2, 2))}, "1 inputs, 2 outputs"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros(())}, "2 components"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.full((1, 2), "1e4000", "f16")}, "finite"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": np.zeros(1)}, "strings"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a", "b"]}, "strings"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": np.array("a")}, "strings"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a/b"]}, "called"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a" * 9999]}, "called"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a\nb"]}, "called"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a\n"]}, "called"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["\ud800"]}, "called"),
    ],
)
def test_arrays_that_do_not_fit_are_told_apart(
    http: TestClient, module: str, arrays: dict[str, Any], wrong: str
) -> None:
    response = http.post(f"{module}/samples", content=packed(**arrays), headers=NPZ)
    assert wrong in problem(response, 422, "invalid_argument")
    assert len(response.json()["detail"]) < 500
    assert done(http.get(module))["samples"] == 0


def test_code_points_that_do_not_exist_are_refused(http: TestClient, module: str) -> None:
    text = "{'descr': '<U1', 'fortran_order': False, 'shape': (1,), }"
    for point in (0x110000, 0xFFFFFFFF):
        body = archive(inputs=GOOD, outputs=GOOD, demonstrations=header(text, struct.pack("<I", point)))
        problem(http.post(f"{module}/samples", content=body, headers=NPZ), 422, "invalid_argument")


def test_bombs_do_not_unpack(http: TestClient, module: str) -> None:
    bomb = archive(zipfile.ZIP_DEFLATED, inputs=npy(np.zeros((20_000_000, 2))))  # 320 MB
    assert len(bomb) < 1_000_000
    assert "bytes" in problem(http.post(f"{module}/query", content=bomb, headers=NPZ), 400, "malformed")


def test_compressed_arrays_are_read_and_broken_ones_refused(http: TestClient, module: str) -> None:
    inputs, outputs = taught(50)
    file = io.BytesIO()
    np.savez_compressed(file, inputs=inputs, outputs=outputs)
    assert done(http.post(f"{module}/samples", content=file.getvalue(), headers=NPZ), 201)["count"] == 50
    broken = bytearray(file.getvalue())
    start = broken.index(b"inputs.npy") + 60
    broken[start : start + 40] = bytes(40)
    problem(http.post(f"{module}/samples", content=bytes(broken), headers=NPZ), 400, "malformed")


def test_damaged_files_are_refused_wherever_they_are_damaged() -> None:
    random = np.random.default_rng(3)
    inputs, outputs = taught(3)
    file = io.BytesIO()
    np.savez_compressed(file, inputs=inputs, outputs=outputs, demonstrations=["a", "b", "c"])
    for sound in (file.getvalue(), packed(inputs=inputs, outputs=outputs, demonstrations=["a", "b", "c"])):
        for turn in range(1500):
            damaged = bytearray(sound)
            for place in random.integers(0, len(damaged), random.integers(1, 5)):
                damaged[place] = random.integers(0, 256)
            try:
                arrays = read_arrays(
                    bytes(damaged[: random.integers(1, len(damaged) + 1) if turn % 5 == 0 else None]), SAMPLES
                )
                floats(arrays, "inputs")
                names(arrays, 3)
            except RequestError:
                pass


# --- asking ---------------------------------------------------------------------------------------------------------


def test_json_and_arrays_tell_the_same(http: TestClient, module: str) -> None:
    inputs, outputs = taught(40)
    shown = ["" if i % 3 == 0 else f"d-{i % 3}" for i in range(40)]
    done(
        http.post(
            f"{module}/samples", content=packed(inputs=inputs, outputs=outputs, demonstrations=shown), headers=NPZ
        ),
        201,
    )
    queries = taught(50, seed=5)[0]
    told = done(http.post(f"{module}/query", json={"inputs": queries.tolist(), "neighbours": 4}))["answers"]
    response = http.post(f"{module}/query", content=packed(inputs=queries, neighbours=4), headers=NPZ)
    assert response.headers["content-type"] == "application/x-npz"
    arrays = unpacked(response.content)
    assert set(arrays) == {
        "outputs", "support", "expected_error", "samples", "demonstrations", "distances", "weights", "names"
    }  # fmt: skip
    assert arrays["samples"].shape == arrays["weights"].shape == (50, 4)
    names = [*arrays["names"].tolist(), None]
    for row, answer in enumerate(told):
        assert answer["output"] == arrays["outputs"][row].tolist()
        assert answer["support"] == arrays["support"][row]
        assert answer["expected_error"] == arrays["expected_error"][row].tolist()
        assert answer["neighbours"] == [
            {"sample": sample, "demonstration": names[shown], "distance": distance, "weight": weight}
            for sample, shown, distance, weight in zip(
                arrays["samples"][row].tolist(),
                arrays["demonstrations"][row].tolist(),
                arrays["distances"][row].tolist(),
                arrays["weights"][row].tolist(),
                strict=True,
            )
        ]
    default = unpacked(http.post(f"{module}/query", content=packed(inputs=queries), headers=NPZ).content)
    assert default["samples"].shape == (50, 10)


@pytest.mark.parametrize("neighbours", [-1, 1001, 10**30, "many", None, 1.5])
def test_how_many_neighbours_are_told_has_bounds(http: TestClient, module: str, neighbours: Any) -> None:
    http.post(f"{module}/samples", json=samples(3))
    asked = {"inputs": [[0.0, 0.0]], "neighbours": neighbours}
    assert "neighbours" in problem(http.post(f"{module}/query", json=asked), 422, "invalid_argument")


@pytest.mark.parametrize("neighbours", [-1, 1001, np.nan, np.inf, 1.5, [1, 2], "many", 1e300])
def test_the_same_for_arrays(http: TestClient, module: str, neighbours: Any) -> None:
    http.post(f"{module}/samples", json=samples(3))
    body = packed(inputs=np.zeros((1, 2)), neighbours=neighbours)
    wrong = http.post(f"{module}/query", content=body, headers=NPZ)
    assert "neighbours" in problem(wrong, 422, "invalid_argument")


def test_without_neighbours_there_is_just_the_answer(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(3))
    (answer,) = done(http.post(f"{module}/query", json={"inputs": [[0.0, 0.0]], "neighbours": 0}))["answers"]
    assert answer["neighbours"] == []


def test_vectors_of_different_lengths_are_told(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(3))
    asked = {"inputs": [[0.0, 0.0], [0.0]]}
    assert "differ in length" in problem(http.post(f"{module}/query", json=asked), 422, "invalid_argument")
    assert "2 components" in problem(http.post(f"{module}/query", json={"inputs": [[0.0]]}), 422, "invalid_argument")
    problem(http.post(f"{module}/query", json={"inputs": [[0.0, 0.0]], "more": 1}), 422, "invalid_argument")


def test_one_sample_has_no_expected_error_yet(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(1))
    (answer,) = done(http.post(f"{module}/query", json={"inputs": [[0.0, 0.0]]}))["answers"]
    assert answer["expected_error"] == [None, None]


def test_extreme_numbers_are_answered_or_refused(http: TestClient) -> None:
    tiny = declaration("tiny")
    tiny["inputs"][0]["scale"] = 1e-9
    at = http.post("/v1/modules", json=tiny).headers["location"]
    body = {"samples": [{"input": [1e149, 0.0], "output": [0.0, 0.0]}]}
    assert "scale" in problem(http.post(f"{at}/samples", json=body), 422, "invalid_argument")
    http.post(f"{at}/samples", json=samples(3))
    assert "scale" in problem(http.post(f"{at}/query", json={"inputs": [[1e149, 0.0]]}), 422, "invalid_argument")
    done(http.post(f"{at}/query", json={"inputs": [[1e-300, -0.0]]}))


# --- pages and removal ----------------------------------------------------------------------------------------------


def test_samples_come_in_pages(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(25))
    http.delete(f"{module}/samples", params={"number": [3, 4]})
    seen: list[int] = []
    more: dict[str, Any] = {"limit": 10}
    for _ in range(3):
        page = done(http.get(f"{module}/samples", params=more))
        seen += [sample["number"] for sample in page["samples"]]
        more["cursor"] = page["next"]
    assert page["next"] is None
    assert seen == [n for n in range(25) if n not in (3, 4)]
    exact = done(http.get(f"{module}/samples", params={"limit": 23}))
    assert (len(exact["samples"]), exact["next"]) == (23, None)


NO_CURSORS = (
    *("x", "", "\u00e9", "//", "W10=", "bnVsbA=="),  # the last two: [], null
    *("WzFd" * 90, "WzEuNV0=", "W3RydWVd", "Wy0xXQ=="),  # [1][1]..., [1.5], [true], [-1]
    "WzE4NDQ2NzQ0MDczNzA5NTUxNjE1XQ==",  # [18446744073709551615]
    "WyJcdTAwMDAiXQ==",  # ["\\u0000"]
)


def test_cursors_that_no_page_gave_are_malformed(http: TestClient, module: str) -> None:
    for path in ("/v1/modules", f"{module}/samples", "/v1/demonstrations", "/v1/jobs"):
        for cursor in NO_CURSORS:
            response = http.get(path, params={"cursor": cursor})
            assert "cursor" in problem(response, 400, "malformed"), (path, cursor)


def test_removal_counts_at_the_next_query(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(5))
    query = {"inputs": [taught(5)[0][2].tolist()], "neighbours": 10}

    def near() -> set[int]:
        (answer,) = done(http.post(f"{module}/query", json=query))["answers"]
        return {neighbour["sample"] for neighbour in answer["neighbours"]}

    assert near() == {0, 1, 2, 3, 4}
    assert done(http.delete(f"{module}/samples", params={"number": [2, 4, 2]})) == {"removed": 2}
    assert near() == {0, 1, 3}
    unknown = http.delete(f"{module}/samples", params={"number": [1, 2]})
    assert "no sample 2" in problem(unknown, 404, "not_found")
    assert near() == {0, 1, 3}
    done(http.delete(f"{module}/samples", params={"number": [0, 1, 3]}))
    problem(http.post(f"{module}/query", json=query), 409, "not_taught")
    assert done(http.post(f"{module}/samples", json=samples(1)), 201) == {"first": 5, "count": 1, "samples": 1}


def test_a_demonstrations_samples_leave_together(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(3, demonstration="tasse à thé"))
    http.post(f"{module}/samples", json=samples(2, seed=1))
    assert done(http.get(module))["demonstrations"] == 1
    assert done(http.delete(f"{module}/samples", params={"demonstration": "tasse à thé"})) == {"removed": 3}
    again = http.delete(f"{module}/samples", params={"demonstration": "tasse à thé"})
    assert "'tasse à thé'" in problem(again, 404, "not_found")
    assert done(http.get(module))["samples"] == 2


def test_what_to_remove_has_to_be_said(http: TestClient, module: str) -> None:
    for query in (
        *("", "?number=1&demonstration=a", "?number=-1", "?number=9223372036854775808", "?number=1e3"),
        *("?demonstration=", f"?number={'9' * 5000}", "?" + "&".join(f"number={n}" for n in range(1001))),
    ):
        problem(http.delete(f"{module}/samples{query}"), 422, "invalid_argument")


def test_the_largest_number_is_just_unknown(http: TestClient, module: str) -> None:
    problem(http.delete(f"{module}/samples?number={2**63 - 1}"), 404, "not_found")


def test_names_in_all_scripts(http: TestClient, module: str) -> None:
    names = ["blauer Becher", "तश्तरी 2", "青い茶碗", "чашка-1", "e\u0301tude"]
    inputs, outputs = taught(len(names))
    arrays = packed(inputs=inputs, outputs=outputs, demonstrations=names)
    done(http.post(f"{module}/samples", content=arrays, headers=NPZ), 201)
    for name in names:
        done(http.post(f"{module}/samples", json=samples(1, demonstration=name)), 201)
        assert done(http.delete(f"{module}/samples", params={"demonstration": name})) == {"removed": 2}
        other = http.post("/v1/modules", json=declaration(name))
        assert done(http.get(other.headers["location"]))["name"] == name


def test_a_sample_survives_a_failing_memory(
    lab: Lab, http: TestClient, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    http.post(f"{module}/samples", json=samples(3))
    live = lab.coordinator.modules.live("map")
    monkeypatch.setattr(live, "learn", lambda *_: 1 / 0)
    assert done(http.post(f"{module}/samples", json=samples(2, seed=1)), 201)["samples"] == 5
    assert lab.coordinator.modules.live("map").samples == 5
    monkeypatch.setattr(lab.coordinator.modules.live("map"), "forget", lambda *_: 1 / 0)
    assert done(http.delete(f"{module}/samples", params={"number": 0})) == {"removed": 1}
    assert lab.coordinator.modules.live("map").samples == 4

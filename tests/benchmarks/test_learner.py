"""The learner's benchmark runs, at sizes at which its figures mean nothing."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.learner import cold, run, threads
from benchmarks.learner.data import GENERATED, LAB, gaussian, lab, manifold
from benchmarks.learner.growth import fit, growth
from benchmarks.learner.insertion import LAB as RECORDED
from benchmarks.learner.insertion import insertion
from benchmarks.learner.measure import K, measure
from benchmarks.learner.memory import weigh
from benchmarks.learner.pictures import COLOURS
from benchmarks.learner.reading import reading
from benchmarks.learner.report import markdown, show, write
from benchmarks.learner.rivals import Brute, Rival, Tuned, recall_of
from benchmarks.learner.systems import ANSWER, BEAM, EXACT, FASTEST_OF, GRAPH, SYSTEMS
from benchmarks.learner.targets import Findings, targets
from benchmarks.learner.timing import Timed, in_turns, ratio

LIBRARY = {"pykdtree": "pykdtree", "hnswlib": "hnswlib", "faiss flat": "faiss", "faiss HNSW": "faiss"}
"""What only requirements-bench.txt installs, by the system that needs it."""


def needs_rivals() -> None:
    """Skips where not everything is installed."""
    for library in dict.fromkeys(LIBRARY.values()):
        _needs(library)


def _needs(library: str) -> None:
    pytest.importorskip(library, reason=f"{library} is not installed: `make bench` does that (requirements-bench.txt)")


@pytest.fixture(params=SYSTEMS)
def system(request: pytest.FixtureRequest) -> Rival:
    if request.param in LIBRARY:
        _needs(LIBRARY[request.param])
    return SYSTEMS[request.param]()


def test_every_system_finds_the_neighbours(system: Rival) -> None:
    problem = gaussian(60, 3, seed=7, queries=20)
    judge = Brute()
    judge.build(problem.points)
    truth, _ = judge.many(problem.queries, K)
    system.build(problem.points)
    if isinstance(system, Tuned):
        assert K <= system.tune(problem.tuning, judge.many(problem.tuning, K)[0], 1.0) <= 60
    found = system.ids_of(system.many(system.batch(problem.queries), K))
    assert found.shape == (20, K)
    assert recall_of(found, truth) >= (0.9 if isinstance(system, Tuned) else 1.0)
    system.one(system.singles(problem.queries)[0], K)


def test_every_system_has_a_colour() -> None:
    assert set(COLOURS) == set(SYSTEMS)
    assert {ANSWER, EXACT, BEAM, GRAPH, *FASTEST_OF} <= set(SYSTEMS)


def test_data_is_drawn_from_the_seed() -> None:
    for make in GENERATED.values():
        first, again, other = make(50, 1), make(50, 1), make(50, 2)
        np.testing.assert_array_equal(first.points, again.points)
        assert not np.array_equal(first.points, other.points)
        assert not np.array_equal(first.queries, first.tuning)
    assert np.linalg.matrix_rank(manifold(50, 11, seed=1).points) == 11


@pytest.mark.skipif(not LAB.exists(), reason="the recorded set is not there")
def test_recorded_queries_are_not_among_the_points() -> None:
    problem = lab()
    assert problem.points.shape[1] == 9
    assert not {*map(bytes, problem.points)} & {*map(bytes, problem.queries)}


def test_systems_get_the_same_queries_in_turns() -> None:
    asked: dict[str, list[int]] = {"a": [], "b": []}

    def recorder(name: str) -> Callable[[int, int], None]:
        return lambda argument, _k: asked[name].append(argument)

    times = in_turns({name: Timed(recorder(name), range(7)) for name in asked}, K, rounds=3, calls=8)
    assert asked["a"] == asked["b"]
    assert all(len(spent) == 3 for spent in times.values())
    assert ratio(np.array([2.0, 4.0, 60.0]), np.array([1.0, 2.0, 3.0])) == 2.0


def test_the_line_over_log_n() -> None:
    n = [2**10, 2**12, 2**14]
    line = fit(n, [10.0, 14.0, 18.0])
    assert line.slope == pytest.approx(2.0)
    assert line.r2 == pytest.approx(1.0)
    assert fit(n, [1.0, 2.0, 4.0]).exponent == pytest.approx(0.5)


def test_cost_grows_with_n() -> None:
    small, large = growth("3-D Gaussian", 7, sizes=(64, 2048))
    assert small.looked < large.looked
    assert min(small.beam, small.exact, small.base) > 0


@pytest.mark.parametrize("model", [False, True])
@pytest.mark.parametrize("name", ["3-D Gaussian", RECORDED])
def test_inserted_samples_are_seen(name: str, model: bool) -> None:
    found = insertion(name, 100, 7, model=model)
    assert 0 < found.median <= found.longest
    assert found.more >= 100


@pytest.mark.parametrize("what", [threads.EXACT, threads.ANSWERS])
def test_two_at_once(what: str) -> None:
    found = threads.two("3-D Gaussian", 200, 7, what, rounds=2, batch=0.01)
    assert found.threads > 0
    assert found.processes > 0


def test_a_fresh_process_answers() -> None:
    assert cold.cold(uncached=False).cached > 0


def test_an_answer_is_read() -> None:
    found = reading(7, rounds=3)
    assert 0 < found.answer < found.everything


def test_an_index_is_weighed() -> None:
    weight = weigh(EXACT, gaussian(20_000, 3, seed=7).points)
    assert weight.peak >= 20_000 * 3 * 8


def test_everything_is_measured_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    needs_rivals()
    monkeypatch.setattr("benchmarks.learner.measure.ROUNDS", 2)
    monkeypatch.setattr("benchmarks.learner.measure.BATCH_ROUNDS", 2)
    found = Findings()
    for n in (50, 300):
        found.results += measure("3-D Gaussian", gaussian(n, 3, seed=7, queries=30), slow=n < 100)
    assert {each.system for each in found.results if each.n == 50} == set(SYSTEMS)
    assert {each.system for each in found.results if each.n == 300} == {
        name for name, make in SYSTEMS.items() if not make().slow_to_build
    }
    exact = {each.system: each.recall for each in found.results}
    assert exact[EXACT] == 1.0
    found.growth += growth("3-D Gaussian", 7, sizes=(64, 256, 1024))
    found.insertions.append(insertion("3-D Gaussian", 100, 7, model=False))
    write(found, tmp_path, 7)
    assert len(json.loads((tmp_path / "results.json").read_text())["results"]) == len(found.results)
    text = (tmp_path / "results.md").read_text()
    assert all(f"| {line.verdict} |" in text for line in targets(found))
    assert "](results.png)" in text
    assert (tmp_path / "results.png").stat().st_size > 0
    assert (tmp_path / "batches.png").stat().st_size > 0
    show(found)
    assert "Targets" in capsys.readouterr().out


def test_a_missed_target_is_called_missed() -> None:
    found = Findings(two=[threads.Two("a", 10, "Tree.exact", 1.69, 1.9), threads.Two("b", 10, "Tree.exact", 1.8, 1.9)])
    (line,) = targets(found)
    assert not line.met
    assert line.worst == "Tree.exact, a, 10"
    assert "1 of 2 met" in line.measured
    assert "| missed |" in markdown(found, 7)
    found.two = found.two[1:]
    assert targets(found)[0].verdict == "met"


def test_steps_of_a_run_are_all_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """What `run` would do, without doing it."""
    done: list[str] = []

    def recorder(name: str) -> Callable[..., list[object]]:
        def record(*_: object, **__: object) -> list[object]:
            done.append(name)
            return []

        return record

    for module, name in ((run, "measure"), (run, "growth"), (run, "insertion"), (threads, "two")):
        monkeypatch.setattr(module, name, recorder(name))
    monkeypatch.setattr(run, "reading", lambda _seed: None)
    monkeypatch.setattr(run, "cold", lambda: None)
    run.run([*GENERATED, run.RECORDED], [800, 20_000], 7, largest_slow=100)
    assert {each: done.count(each) for each in dict.fromkeys(done)} == {
        "measure": 9, "growth": 4, "insertion": 18, "two": 4,
    }  # fmt: skip

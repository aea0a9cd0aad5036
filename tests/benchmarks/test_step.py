"""The benchmark of a step runs, at sizes at which its figures mean nothing."""

from __future__ import annotations

import time

import pytest

from benchmarks.step.run import PARTS, REST, measure, summary, table
from benchmarks.step.stopwatch import SUM, Stopwatch


class Worker:
    """Works for as long as it is told, in s."""

    def look(self, duration: float) -> None:
        time.sleep(duration)

    def think(self, duration: float) -> None:
        time.sleep(duration)


def test_a_step_lasts_from_look_to_look_and_knows_its_parts() -> None:
    watch, worker = Stopwatch(), Worker()
    with watch.watching(Worker, "look", "pictures", begins=True), watch.watching(Worker, "think", "answer"):
        for _ in range(3):
            worker.look(0.01)
            worker.think(0.02)
            worker.think(0.02)
        watch.leave()
        worker.look(0.0)
    assert len(watch.steps) == 2
    for step in watch.steps:
        assert step["pictures"].wall >= 0.01
        assert step["answer"].wall >= 0.04
        assert step[SUM].wall >= step["pictures"].wall + step["answer"].wall
    found = summary(watch)
    assert found["count"] == 2
    assert found["parts"][REST]["wall"][0] < found["parts"]["answer"]["wall"][0]
    assert found["met"] == (found["parts"][SUM]["wall"][1] < 0.05)


@pytest.mark.timeout(180)
def test_every_part_of_a_step_is_measured() -> None:
    found = measure(7, scenes=3, runs=1)
    assert set(found) == {"task", "reach"}
    for each in found.values():
        assert each["count"] > 0
        assert all(each["parts"][part]["wall"][0] > 0.0 for part in PARTS)
        shares = sum(each["parts"][part]["wall"][0] for part in (*PARTS, REST))
        assert shares == pytest.approx(each["parts"][SUM]["wall"][0], rel=0.5)
    assert "one step" in table(found, 1.0)

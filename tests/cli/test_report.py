"""The report's numbers, its JSON contract and its page, from made-up trials."""

from __future__ import annotations

import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from rich.console import Console

from handeye.simulation.places import Place
from handeye.simulation.report import Histogram, Picture, Report, Series, Trial


def trial(number: int, miss: float = 1.0, passed: bool = True, failure: str = "") -> Trial:
    return Trial(
        number=number,
        place=Place(0.5 + 0.01 * number, -0.1 + 0.02 * number, 0.3, 5),
        passed={"approach": True, "grasp": passed, "lift": passed},
        miss_mm=miss,
        pushed_mm=miss / 2,
        looks=9,
        world_seconds=12.5,
        failure=failure,
    )


def report(random: Series) -> Report:
    return Report(
        seed=7,
        taught=tuple(Place(0.5 + 0.02 * n, 0.01 * n, 0.0, n) for n in range(10)),
        object="blue <cup>",
        random=random,
        resubstitution=Series((trial(1), trial(2))),
        plain=Series((trial(1, miss=40.0, passed=False),)),
        samples=420,
        seconds=83.2,
        pictures=[Picture(b"\xff\xd8jpeg", "Left and right")],
    )


def test_json_has_the_keys_that_others_read() -> None:
    content = report(Series((trial(1, 2.0), trial(2, 4.0, passed=False, failure="the cup is not seen")))).as_json()
    assert json.loads(json.dumps(content)) == content
    assert content["seed"] == 7
    assert content["taught"] == 10
    assert content["subtasks"] == {
        "approach": {"passed": 2, "trials": 2},
        "grasp": {"passed": 1, "trials": 2},
        "lift": {"passed": 1, "trials": 2},
    }
    assert content["resubstitution"] == {name: {"passed": 2, "trials": 2} for name in ("approach", "grasp", "lift")}
    assert content["misses_mm"] == [2.0, 4.0]
    assert content["pushed_mm"] == [1.0, 2.0]
    assert content["seconds"] == pytest.approx(83.2)
    assert content["trials"]["random"][1]["failure"] == "the cup is not seen"


@pytest.mark.parametrize(("failures", "passed"), [(0, True), (1, True), (2, False)])
def test_nine_of_ten_are_enough(failures: int, passed: bool) -> None:
    trials = tuple(trial(number, passed=number >= failures) for number in range(10))
    assert report(Series(trials)).passed is passed


def test_the_table_stands_beside_the_thesis() -> None:
    console = Console(width=120, file=io.StringIO(), record=True)
    console.print(report(Series((trial(1, 2.0),))).table())
    text = console.export_text()
    assert re.search(r"approach\W+10/10\W+10/10\W+2/2\W+1/1\W+1/1", text)
    assert re.search(r"lift\W+2/2\W+1/1\W+0/1", text)
    assert re.search(r"median miss.*1\.0 mm.*2\.0 mm.*40\.0 mm", text)


class Page(HTMLParser):
    """Collects what the page would load from elsewhere, and whether all tags close."""

    VOID = ("meta", "img", "rect", "circle", "line", "br")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag


def test_the_page_is_complete_in_itself(tmp_path: Path) -> None:
    numbers, page = report(Series((trial(1), trial(2, passed=False, failure="<b>not seen</b>")))).write(
        tmp_path / "new"
    )
    assert json.loads(numbers.read_text())["seed"] == 7
    text = page.read_text()
    parser = Page()
    parser.feed(text)
    assert parser.open == []
    assert parser.sources
    assert all(source.startswith("data:image/jpeg;base64,") for source in parser.sources)
    assert "&lt;b&gt;not seen" in text
    assert "blue &lt;cup&gt;" in text
    assert "http" not in text


def test_a_report_without_trials_can_still_be_written(tmp_path: Path) -> None:
    empty = report(Series(()))
    empty.write(tmp_path)
    assert empty.as_json()["misses_mm"] == []


def test_histogram_keeps_outliers_in_the_last_class() -> None:
    histogram = Histogram.of([0.1, 0.3, 0.6, 1.1, 1.2, 1.3, 1.4, 2.0, 2.1, 250.0])
    assert sum(histogram.counts) == 10
    assert histogram.counts[-1] == 1
    assert histogram.open_ended
    assert histogram.counts[0] >= 1
    assert max(height for *_, height in histogram.bars(100, 50)) == pytest.approx(50)
    assert sum(Histogram.of([]).counts) == 0

"""What an evaluation found: figures with 95 % intervals, every trial, pictures; as JSON and as a page."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from numpy.typing import ArrayLike
from rich.table import Table

from handeye.simulation.report import Histogram, Picture

_RESAMPLES = 2000
_Z = 1.959964  # two-sided 95 %


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured figure; `low` and `high` bound it with 95 % confidence, `met` is None where there is no target."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    count: int
    target: str = ""
    met: bool | None = None
    thesis: str = ""

    @property
    def spoken(self) -> str:
        """The value with its interval."""
        return f"{self.value:.3g} {self.unit} ({self.low:.3g} – {self.high:.3g})"


def share(
    name: str, passed: Sequence[bool], least: float | None = None, thesis: str = "", *, most: float | None = None
) -> Figure:
    """How many of the trials passed, in %, with Wilson's interval (1927); the target is `least` %, or `most` %."""
    n, k = len(passed), sum(passed)
    p = k / n
    middle, half = (p + _Z**2 / (2 * n)), _Z * math.sqrt(p * (1 - p) / n + _Z**2 / (4 * n**2))
    low, high = (min(max((middle + sign * half) / (1 + _Z**2 / n), 0.0), 1.0) for sign in (-1, 1))
    target, met = "", None
    if least is not None:
        target, met = f"≥ {least:g} %", 100 * p >= least
    elif most is not None:
        target, met = f"≤ {most:g} %", 100 * p <= most
    return Figure(name, 100 * p, 100 * low, 100 * high, "%", n, target, met, thesis)


def count(name: str, value: int, trials: int, most: int | None = None) -> Figure:
    """How often something happened in so many trials; the target is at `most` so often."""
    if most is None:
        return Figure(name, value, value, value, "", trials)
    return Figure(name, value, value, value, "", trials, f"≤ {most}" if most else "none", value <= most)


def median(name: str, values: ArrayLike, unit: str, most: float | None = None, thesis: str = "") -> Figure:
    """The median, with a bootstrapped interval; the target is at most `most`."""
    return _bootstrapped(name, values, unit, most, thesis, np.median)


def average(
    name: str,
    values: ArrayLike,
    unit: str,
    most: float | None = None,
    thesis: str = "",
    *,
    least: float | None = None,
) -> Figure:
    """The mean, with a bootstrapped interval; the target is at most `most`, or at least `least`."""
    figure = _bootstrapped(name, values, unit, most, thesis, np.mean)
    return figure if least is None else replace(figure, target=f"≥ {least:g} {unit}", met=figure.value >= least)


def _bootstrapped(
    name: str, values: ArrayLike, unit: str, most: float | None, thesis: str, statistic: Callable[..., Any]
) -> Figure:
    found = np.asarray(values, np.float64)
    picks = np.random.default_rng(0).integers(len(found), size=(_RESAMPLES, len(found)))
    low, high = np.quantile(statistic(found[picks], axis=1), (0.025, 0.975))
    value = float(statistic(found))
    target = "" if most is None else f"≤ {most:g} {unit}"
    met = None if most is None else value <= most
    return Figure(name, value, float(low), float(high), unit, len(found), target, met, thesis)


def quantile(name: str, values: ArrayLike, share_below: float, unit: str) -> Figure:
    """What this share of the values stays below, with a bootstrapped interval."""
    found = np.asarray(values, np.float64)
    picks = np.random.default_rng(0).integers(len(found), size=(_RESAMPLES, len(found)))
    low, high = np.quantile(np.quantile(found[picks], share_below, axis=1), (0.025, 0.975))
    return Figure(name, float(np.quantile(found, share_below)), float(low), float(high), unit, len(found))


def _rounded(value: Any) -> Any:
    """Numbers to a millionth of their unit: more than that says nothing, and takes room."""
    if isinstance(value, float):
        return round(value, 6)
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list) else value


@dataclass(frozen=True, slots=True)
class Earlier:
    """Trials of before, of other seeds, and how long they took, in s."""

    trials: tuple[dict[str, Any], ...] = ()
    seconds: float = 0.0

    @classmethod
    def read(cls, directory: Path, name: str, seeds: Sequence[int]) -> Earlier:
        """What evaluation `name` has written into `directory`, without the trials of `seeds`; nothing if it has not."""
        try:
            told = json.loads((directory / f"{name}.json").read_text())
        except FileNotFoundError:
            return cls()
        return cls(tuple(trial for trial in told["trials"] if trial["seed"] not in seeds), told["seconds"])


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one evaluation found."""

    name: str
    title: str
    seeds: tuple[int, ...]
    figures: tuple[Figure, ...]
    trials: tuple[dict[str, Any], ...]
    histograms: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """Values of single trials, by a caption that names their unit."""
    pictures: tuple[Picture, ...] = ()
    seconds: float = 0.0

    def table(self) -> Table:
        """The figures for the terminal."""
        table = Table(title=self.title, title_justify="left")
        for heading in ("", "measured (95 %)", "of", "target", "", "thesis"):
            table.add_column(heading)
        for each in self.figures:
            met = {None: "", True: "[green]met[/]", False: "[red]missed[/]"}[each.met]
            table.add_row(each.name, each.spoken, str(each.count), each.target, met, each.thesis)
        return table

    def write(self, directory: Path) -> None:
        """Writes <name>.json and <name>.html into `directory`, which is made if need be."""
        directory.mkdir(parents=True, exist_ok=True)
        numbers = {
            "name": self.name,
            "seeds": self.seeds,
            "figures": [asdict(figure) for figure in self.figures],
            "trials": [_rounded(trial) for trial in self.trials],
            "seconds": round(self.seconds, 1),
        }
        (directory / f"{self.name}.json").write_text(json.dumps(numbers, indent=1) + "\n")
        environment = jinja2.Environment(
            autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
        )
        template = environment.from_string((files(__package__) / "page.html.j2").read_text())
        histograms = {caption: Histogram.of(values) for caption, values in self.histograms.items()}
        (directory / f"{self.name}.html").write_text(template.render(outcome=self, histograms=histograms))

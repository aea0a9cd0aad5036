"""What the demonstration found: as numbers (`report.json`), as a page (`report.html`), as a table in the terminal."""

from __future__ import annotations

import base64
import json
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
from rich.table import Table

from handeye.simulation.places import Place
from handeye.simulation.scene import WORKSPACE_CENTRE, WORKSPACE_SIZE
from handeye.simulation.scoring import SUBTASKS

THESIS_TABLE_4_1 = {"approach": "10/10", "grasp": "10/10", "lift": "–"}
"""Table 4.1 of the thesis, both of re-substitution and of random trials; it has no lift."""

ENOUGH = 0.9
"""The demonstration has passed when each subtask passes at least this often, re-substituted and at random places."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A JPEG with its caption."""

    jpeg: bytes
    caption: str

    @property
    def url(self) -> str:
        """The picture as a data URL, so that the page needs no other file."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode("ascii")


@dataclass(frozen=True, slots=True)
class Trial:
    """One judged trial. `failure` is the job's message when it failed, else empty; `looks` counts its looks."""

    number: int
    place: Place
    passed: dict[str, bool]
    miss_mm: float
    pushed_mm: float
    looks: int
    world_seconds: float
    failure: str = ""

    @property
    def well(self) -> bool:
        """All subtasks passed."""
        return all(self.passed.values())

    def as_json(self) -> dict[str, Any]:
        """For `report.json`."""
        return {
            "number": self.number,
            "place": {"x": self.place.x, "y": self.place.y, "yaw": self.place.yaw},
            "passed": self.passed,
            "miss_mm": round(self.miss_mm, 3),
            "pushed_mm": round(self.pushed_mm, 3),
            "looks": self.looks,
            "world_seconds": round(self.world_seconds, 3),
            "failure": self.failure,
        }


@dataclass(frozen=True, slots=True)
class Series:
    """The trials of one kind."""

    trials: tuple[Trial, ...]

    def tally(self) -> dict[str, dict[str, int]]:
        """Subtask → how many trials passed it, of how many."""
        return {
            name: {"passed": sum(trial.passed[name] for trial in self.trials), "trials": len(self.trials)}
            for name in SUBTASKS
        }

    @property
    def misses_mm(self) -> list[float]:
        """Distance between gripper and cup's centre at closing, per trial."""
        return [round(trial.miss_mm, 3) for trial in self.trials]

    @property
    def pushed_mm(self) -> list[float]:
        """How far the cup was pushed until the gripper was closed, per trial."""
        return [round(trial.pushed_mm, 3) for trial in self.trials]

    @property
    def median_miss_mm(self) -> float:
        """Median of `misses_mm`; nan without trials."""
        return _median(self.misses_mm)

    @property
    def median_pushed_mm(self) -> float:
        """Median of `pushed_mm`; nan without trials."""
        return _median(self.pushed_mm)

    def as_json(self) -> dict[str, Any]:
        """Tally and distances under the names of the report."""
        return {"subtasks": self.tally(), "misses_mm": self.misses_mm, "pushed_mm": self.pushed_mm}


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that the demonstration found."""

    seed: int
    taught: tuple[Place, ...]
    object: str
    random: Series
    resubstitution: Series
    plain: Series
    samples: int
    seconds: float
    pictures: Sequence[Picture] = field(default_factory=tuple)

    @property
    def passed(self) -> bool:
        """Each subtask passed in at least 90 % of the trials, re-substituted and at random places."""
        tallies = [*self.random.tally().values(), *self.resubstitution.tally().values()]
        return all(each["passed"] >= ENOUGH * each["trials"] for each in tallies)

    def as_json(self) -> dict[str, Any]:
        """The content of `report.json`."""
        return {
            "seed": self.seed,
            "taught": len(self.taught),
            **self.random.as_json(),
            "resubstitution": self.resubstitution.tally(),
            "seconds": round(self.seconds, 1),
            "plain": self.plain.as_json(),
            "trials": {
                "random": [trial.as_json() for trial in self.random.trials],
                "resubstitution": [trial.as_json() for trial in self.resubstitution.trials],
                "plain": [trial.as_json() for trial in self.plain.trials],
            },
        }

    def rows(self) -> list[tuple[str, ...]]:
        """The table: what, the thesis's two columns, ours of re-substitution and random, the plain variant's."""
        ours = (self.resubstitution, self.random, self.plain)
        tallies = [series.tally() for series in ours]
        rows = [
            (
                name,
                THESIS_TABLE_4_1[name],
                THESIS_TABLE_4_1[name],
                *(f"{tally[name]['passed']}/{tally[name]['trials']}" for tally in tallies),
            )
            for name in SUBTASKS
        ]
        rows.append(("median miss", "–", "–", *(_millimetres(series.median_miss_mm) for series in ours)))
        rows.append(("median push", "–", "–", *(_millimetres(series.median_pushed_mm) for series in ours)))
        return rows

    def table(self) -> Table:
        """The table for the terminal."""
        table = Table(title="Grasping a cup by hand-eye coordination", title_justify="left")
        table.add_column("")
        for heading in HEADINGS:
            table.add_column(heading, justify="right")
        for row in self.rows():
            table.add_row(*row)
        return table

    def write(self, directory: Path) -> tuple[Path, Path]:
        """Writes `report.json` and `report.html` into `directory`, which is made if need be; returns both paths."""
        directory.mkdir(parents=True, exist_ok=True)
        numbers, page = directory / "report.json", directory / "report.html"
        numbers.write_text(json.dumps(self.as_json(), indent=2) + "\n")
        page.write_text(self.html())
        return numbers, page

    def html(self) -> str:
        """The page, complete in itself."""
        environment = jinja2.Environment(
            autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
        )
        template = environment.from_string((files(__package__) / "report.html.j2").read_text())
        return template.render(
            report=self,
            headings=HEADINGS,
            enough=ENOUGH,
            histogram=Histogram.of([trial.miss_mm for trial in self.random.trials]),
            subtasks=SUBTASKS,
            low=(WORKSPACE_CENTRE - WORKSPACE_SIZE / 2).tolist(),
            size=WORKSPACE_SIZE,
        )


HEADINGS = ("thesis, re-subst.", "thesis, random", "re-subst.", "random", "plain, random")


@dataclass(frozen=True, slots=True)
class Histogram:
    """Misses in classes of `width` mm; the last class also holds everything beyond it."""

    width: float
    counts: tuple[int, ...]
    open_ended: bool

    @classmethod
    def of(cls, values: Sequence[float], classes: int = 12) -> Histogram:
        """Classes that hold nine tenths of `values` (in mm) comfortably; outliers go into the last one."""
        if not values:
            return cls(1.0, (0,) * classes, open_ended=False)
        bulk = sorted(values)[int(0.9 * (len(values) - 1))]
        width = next(
            (each for each in (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 25.0, 50.0) if each * classes > 1.2 * bulk), 100.0
        )
        counts = [0] * classes
        for value in values:
            counts[min(int(value / width), classes - 1)] += 1
        return cls(width, tuple(counts), open_ended=max(values) >= width * classes)

    def bars(self, span: float, height: float) -> list[tuple[float, float, float, float]]:
        """(x, y, width, height) of each class's bar in a drawing of `span` × `height`, y downwards."""
        step, tallest = span / len(self.counts), max(1, *self.counts)
        return [
            (index * step + 1, height * (1 - count / tallest), step - 2, height * count / tallest)
            for index, count in enumerate(self.counts)
        ]


def _median(values: Sequence[float]) -> float:
    return statistics.median(values) if values else math.nan


def _millimetres(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.1f} mm"

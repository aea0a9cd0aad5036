"""The doctor finds what is missing and names a remedy."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from handeye.cli import doctor
from handeye.cli.app import build_app
from handeye.cli.doctor import Package


def test_a_package_that_is_not_there_names_its_extra() -> None:
    finding = doctor.check_package("camera", Package("package_that_is_not_there"))
    assert not finding.well
    assert "package_that_is_not_there" in finding.found
    assert finding.remedy == "pip install 'handeye[camera]'"


def test_a_package_that_is_there_but_of_no_use_is_missing() -> None:
    finding = doctor.check_package("robot", Package("sys", "raise SystemExit('built without numpy')"))
    assert (finding.well, finding.found) == (False, "built without numpy")


@pytest.mark.parametrize(
    ("version", "simulation", "well"),
    [((3, 10), False, False), ((3, 11), True, True), ((3, 13), False, True), ((3, 13), True, False)],
)
def test_python_versions(version: tuple[int, int], simulation: bool, well: bool) -> None:
    finding = doctor.check_python(version, simulation=simulation)
    assert finding.well is well
    assert bool(finding.remedy) is not well


def test_a_directory_that_can_not_be_written(tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("")
    assert doctor.check_writable("state directory", tmp_path / "new" / "deep", "mend").well
    assert list(tmp_path.iterdir()) == [blocker]
    finding = doctor.check_writable("state directory", blocker / "sub", "mend")
    assert not finding.well
    assert finding.remedy == "mend"


def test_the_verb_ends_with_1_and_the_remedy_when_something_is_missing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(doctor.PACKAGES, "client", (Package("package_that_is_not_there"),))
    arguments = ["doctor", "client", "--state-dir", str(tmp_path)]
    result = CliRunner().invoke(build_app([]), arguments)
    assert result.exit_code == 1
    assert "pip install 'handeye[client]'" in result.output
    monkeypatch.setitem(doctor.PACKAGES, "client", (Package("sys", "print('1.0')"),))
    result = CliRunner().invoke(build_app([]), arguments)
    assert result.exit_code == 0, result.output
    assert "All is well." in result.output


def test_an_unknown_extra_is_refused() -> None:
    assert CliRunner().invoke(build_app([]), ["doctor", "kitchen"]).exit_code == 2

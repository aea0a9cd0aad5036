from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from handeye.modules.declaration import ApproximatorSettings, ModuleDeclaration

DECLARED: dict[str, Any] = {
    "name": "CSS",
    "inputs": [{"name": "row", "unit": "px", "scale": 30.0}, {"name": "head", "unit": "", "categorical": True}],
    "outputs": [{"name": "x", "unit": "m"}],
    "approximator": {"method": "kndb", "neighbours": 5},
}


def test_a_declaration_is_plain_data_and_comes_back_the_same() -> None:
    declaration = ModuleDeclaration.model_validate(DECLARED)
    assert declaration.inputs[0].scale == 30.0
    assert declaration.inputs[1].categorical
    assert declaration.approximator.alpha == 3.0
    assert ModuleDeclaration.model_validate_json(declaration.model_dump_json()) == declaration


@pytest.mark.parametrize(
    "changes",
    [
        {"colour": "blue"},
        {"inputs": [{"name": "row", "unit": "px", "scael": 3}]},
        {"approximator": {"methode": "kndb"}},
        {"outputs": [{"name": "x", "unit": "m", "scale": 2}]},
    ],
)
def test_an_unknown_key_is_an_error(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="Extra inputs are not permitted"):
        ModuleDeclaration.model_validate(DECLARED | changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outputs": []}, "at least 1"),
        ({"inputs": []}, "at least 1 item"),
        ({"inputs": [{"name": "subtask", "unit": "", "categorical": True}]}, "not a category"),
        ({"inputs": [{"name": "row", "unit": "px"}, {"name": "row", "unit": "px"}]}, "share a name: row"),
        ({"outputs": [{"name": "x", "unit": "m"}, {"name": "x", "unit": "m"}]}, "share a name: x"),
        ({"inputs": [{"name": "row", "unit": "px", "scale": 0}]}, "greater than or equal"),
        ({"inputs": [{"name": "row", "unit": "px", "scale": float("inf")}]}, "less than or equal"),
        ({"inputs": [{"name": "", "unit": "px"}]}, "at least 1 character"),
    ],
)
def test_a_senseless_declaration_is_an_error(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ModuleDeclaration.model_validate(DECLARED | changes)


@pytest.mark.parametrize(
    "settings",
    [{"method": "magic"}, {"neighbours": 0}, {"alpha": 0.5}, {"ridge": 0}, {"smoothing": 0}, {"search": "none"}],
)
def test_settings_out_of_range_are_errors(settings: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        ApproximatorSettings.model_validate(settings)

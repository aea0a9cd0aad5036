"""What a module is, declared: its input and output components and how it answers. No module needs code of its own.

Core processes (`handeye.rpt`) know only how many numbers go in and out; a declaration says what they mean (3.1.3).
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictBool, model_validator

from handeye.rpt import Settings

MOST_COMPONENTS = 256
"""Inputs or outputs of a module: its samples' slopes are inputs times outputs, and an answer has them all."""

# An answer takes time with the square of the neighbours, with the cube of a local fit's terms; and KNDB2 makes a fit
# for each sample that comes near another.
MOST_NEIGHBOURS = 1000
_MOST_GRADIENT_NEIGHBOURS = 100
_MOST_QUADRATIC_INPUTS = 20

Name = Annotated[str, Field(min_length=1, max_length=100)]
Unit = Annotated[str, Field(max_length=40)]


class Declared(BaseModel):
    """Base of the declarations: immutable, and an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Component(Declared):
    """One input component."""

    name: Name
    unit: Unit
    """For people: "px", "rad", "m", or "" for a category."""
    scale: float = Field(default=1.0, ge=1e-100, le=1e100, strict=True)
    """Differences of this size, in the unit, count alike across components: inputs are divided by it before any
    distance is taken. Without meaning for a category."""
    categorical: StrictBool = False
    """A category: samples with another value are never neighbours."""


class Output(Declared):
    """One output component."""

    name: Name
    unit: Unit


class ApproximatorSettings(Declared):
    """How an answer is made from the samples near the query (`handeye.rpt.approximate`)."""

    method: Literal["local_quadratic", "local_linear", "kndb", "kndb2", "nearest"] = "local_linear"
    neighbours: int | None = Field(default=30, ge=1, le=MOST_NEIGHBOURS, strict=True)
    """How many samples are retrieved; None: all of the query's category, but 1000 at most (KNDB2: 100)."""
    alpha: float = Field(default=3.0, ge=1, le=100, strict=True)
    """How fast the weights of KNDB and KNDB2 fall (3.3)."""
    smoothing: float = Field(default=0.1, ge=1e-9, le=1e6, strict=True)
    """Of the distance weights of the local fits, as a share of the farthest neighbour's distance."""
    ridge: float = Field(default=1e-4, ge=1e-12, le=1e9, strict=True)
    """How strongly slopes are held small, as a share of the inputs' variance; for the local fits and KNDB2's
    gradients."""
    curvature_ridge: float = Field(default=1e-2, ge=1e-12, le=1e9, strict=True)
    """The same for the second-order terms of `local_quadratic`."""
    search: Literal["exact", "beam"] = "exact"
    """`beam` is the thesis's search; it may miss the nearest samples (Fig 3.36)."""
    keep_covered: StrictBool = True
    """Whether samples that became no node of the tree stay in their leaf."""

    @property
    def most_neighbours(self) -> int:
        """How many samples are retrieved if there are as many."""
        return self.neighbours or (_MOST_GRADIENT_NEIGHBOURS if self.method == "kndb2" else MOST_NEIGHBOURS)

    @model_validator(mode="after")
    def _check_neighbours(self) -> ApproximatorSettings:
        if self.method == "kndb2" and self.most_neighbours > _MOST_GRADIENT_NEIGHBOURS:
            raise ValueError(f"method kndb2 takes up to {_MOST_GRADIENT_NEIGHBOURS} neighbours, not {self.neighbours}")
        return self

    def for_model(self) -> Settings:
        """The same in the learner's terms. A beam over all samples is the exact search."""
        return Settings(
            method=self.method,
            neighbours=self.most_neighbours,
            alpha=self.alpha,
            smoothing=self.smoothing,
            ridge=self.ridge,
            curvature_ridge=self.curvature_ridge,
            gradient_neighbours=self.neighbours,
            beam_width=self.neighbours if self.search == "beam" else None,
            keep_covered=self.keep_covered,
        )


class ModuleDeclaration(Declared):
    """A module: R^N to R^M, learned from examples."""

    name: Name
    inputs: tuple[Component, ...] = Field(min_length=1, max_length=MOST_COMPONENTS)
    outputs: tuple[Output, ...] = Field(min_length=1, max_length=MOST_COMPONENTS)
    approximator: ApproximatorSettings = ApproximatorSettings()

    @model_validator(mode="after")
    def _check_components(self) -> ModuleDeclaration:
        if all(component.categorical for component in self.inputs):
            raise ValueError(f"module '{self.name}' needs an input component that is not a category")
        for kind, components in (("input", self.inputs), ("output", self.outputs)):
            names = [component.name for component in components]
            if doubled := sorted({name for name in names if names.count(name) > 1}):
                raise ValueError(f"{kind} components of module '{self.name}' share a name: {', '.join(doubled)}")
        return self

    @model_validator(mode="after")
    def _check_method(self) -> ModuleDeclaration:
        continuous = sum(not component.categorical for component in self.inputs)
        if self.approximator.method == "local_quadratic" and continuous > _MOST_QUADRATIC_INPUTS:
            raise ValueError(
                f"method local_quadratic takes up to {_MOST_QUADRATIC_INPUTS} inputs that are no categories, module "
                f"'{self.name}' has {continuous}; method local_linear takes more"
            )
        return self

    def answering_by(self, approximator: ApproximatorSettings | None) -> ModuleDeclaration:
        """The same module with other settings, if they are given. `ValueError` when they do not suit it."""
        if approximator is None:
            return self
        return ModuleDeclaration.model_validate({**dict(self), "approximator": approximator})

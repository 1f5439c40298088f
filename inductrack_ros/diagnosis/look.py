"""What is left at a fit, to first order: every candidate by what it promises, and whether it is more than noise."""

from __future__ import annotations

from dataclasses import dataclass

from ..estimation.fit import Fit
from ..estimation.problem import Problem
from .candidates import Screened, effect_columns, screen
from .gate import Gate, Projector, check
from .signatures import RunResponse, responses


@dataclass(frozen=True)
class Look:
    """A problem (perhaps only the beginning of its runs) at a fit: candidates, best promise first, and the gate's answer."""

    problem: Problem
    fit: Fit
    project: Projector
    screened: list[Screened]
    gate: Gate

    @classmethod
    def at(cls, problem: Problem, fit: Fit) -> Look:
        """Take the look."""
        runs, project = responses(problem, fit), Projector(problem, fit)
        screened = screen(problem, fit, runs, project)
        return cls(problem, fit, project, screened, check(problem, fit, runs, project, effect_columns(screened)))

    @property
    def responses(self) -> list[RunResponse]:
        """The runs' responses to small forces, made anew: they are large."""
        return responses(self.problem, self.fit)

# SPDX-License-Identifier: Apache-2.0
"""A sweep as a NetCDF file, through xarray: every number with its name, unit and meaning, and what it was made of."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.plain_json import attribute_text
from .planned import Placed
from .quantities import QUANTITIES
from .sweep import HIGH, LOW, Sweep

if TYPE_CHECKING:
    import xarray


def dataset(sweep: Sweep, placed: Sequence[Placed] = ()) -> xarray.Dataset:
    """The maps over their axes; of draws ``…_mean``, ``…_std`` and two percentiles; the runs of a campaign under
    ``planned_run``."""
    import xarray

    plan = sweep.plan
    axes = tuple(a.name for a in plan.axes)
    values: dict[str, Any] = {}
    for q in QUANTITIES:
        told = {"units": q.unit or "1", "long_name": q.title, "comment": q.meaning}
        values[q.name] = (axes, sweep.values[q.name], told)
        if sweep.spread is not None:
            for ending, tables, words in _statistics(sweep):
                values[f"{q.name}_{ending}"] = (
                    axes,
                    tables[q.name],
                    told | {"long_name": f"{q.title}, {words} of the draws that have it"},
                )
        if placed:
            values[f"planned_{q.name}"] = ("planned_run", np.array([p.values[q.name] for p in placed]), told)
    if sweep.spread is not None:
        values["touching_part"] = (
            axes,
            sweep.spread.touching,
            {"units": "1", "long_name": "part of the draws that touch the track"},
        )
        values["stable_part"] = (
            axes,
            sweep.spread.stable,
            {"units": "1", "long_name": "part of the draws that are stable"},
        )
        values["drawn"] = (("draw", "parameter"), plan.draws.values, {"long_name": "the parameters as drawn, SI"})
    coordinates: dict[str, Any] = {
        a.name: (a.name, a.values, {"units": a.unit or "1", "long_name": a.meaning}) for a in plan.axes
    }
    if sweep.spread is not None:
        coordinates["parameter"] = ("parameter", list(plan.draws.names))
    if placed:
        coordinates["planned_run"] = ("planned_run", [p.run.name for p in placed])
        for axis in plan.axes:
            values[f"planned_at_{axis.name}"] = (
                "planned_run",
                np.array([p.at[axis.name] for p in placed]),
                {"units": axis.unit or "1"},
            )
    return xarray.Dataset(values, coordinates, _about(sweep))


def write(sweep: Sweep, placed: Sequence[Placed], path: Path) -> None:
    """Write it as NetCDF 3, which SciPy writes and every reader reads."""
    dataset(sweep, placed).to_netcdf(path, format="NETCDF3_64BIT", engine="scipy")


def _statistics(sweep: Sweep) -> tuple[tuple[str, Any, str], ...]:
    s = sweep.spread
    return (
        ("mean", s.mean, "mean"),
        ("std", s.std, "standard deviation"),
        (f"p{LOW:02.0f}", s.low, f"{LOW:g}th percentile"),
        (f"p{HIGH:02.0f}", s.high, f"{HIGH:g}th percentile"),
    )


def _about(sweep: Sweep) -> dict[str, Any]:
    plan = sweep.plan
    return {
        "title": "Sweep over " + " and ".join(a.name for a in plan.axes),
        "source": f"inductrack_ros {version('inductrack_ros')}",
        "model": attribute_text(plan.model.to_mapping()),
        "initial_state": attribute_text(dict(plan.initial)),
        "duration": plan.duration,
        "rate": plan.rate,
        "samples": plan.samples,
    }

# SPDX-License-Identifier: Apache-2.0
"""Each run by itself: what is wrong with some runs of a campaign only, which all of them together hide."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from ..data import Campaign
from .finding import IMPOSSIBLE, Finding, impossible, shared

#: What a finding is alike by in several runs: severity, kind, channel, and about how large a factor is.
Alike = tuple[str, str, str | None, int]


def of_some(
    campaign: Campaign,
    together: list[Finding],
    alone: Callable[[Campaign], list[Finding]],
    telling: Callable[[Finding], bool] = lambda f: f.severity == IMPOSSIBLE,
) -> list[Finding]:
    """Findings of all runs ``together``, with those in the place of theirs that only some runs give ``alone``.

    ``telling`` says which findings of a run alone count: it sees less than all, and a warning of it may be chance."""
    if len(campaign.runs) == 1:
        return together
    apart = {run.name: alone(replace(campaign, runs=(run,))) for run in campaign.runs}
    kinds: dict[Alike, dict[str, Finding]] = {}
    for name, found in apart.items():
        for finding in filter(telling, found):
            kinds.setdefault(_alike(finding), {})[name] = finding
    odd = {name for mine in kinds.values() for name in mine}
    if len(odd) == len(apart) and impossible(together):
        return together
    surely = {c for f in impossible(together) for c in _about(f)}

    def is_told(mine: dict[str, Finding]) -> bool:
        """Whether what may mislead in some runs is what cannot be so in all."""
        first = next(iter(mine.values()))
        return first.severity != IMPOSSIBLE and first.channel in campaign.channels and first.channel in surely

    some = {
        key: mine
        for key, mine in kinds.items()
        if not is_told(mine) and _others_are_right(campaign, mine, apart, alone)
    }
    if not some:
        return together
    where = f" alone of {len(campaign.runs)} runs" if len(odd) < len(apart) else ""
    rest = [f for f in together if _alike(f) not in some]
    # What most runs give, and all together too, hides nothing from these: whatever else they give there is so.
    given = [key for key in map(_alike, together) if key in some and 2 * len(some[key]) > len(apart)]
    hidden = [mine for key, mine in some.items() if key not in given]
    named = {c for mine in hidden for f in mine.values() for c in (*_about(f), *f.size.get("explains", ()))}
    return [_in_runs(mine, where) for mine in some.values()] + [f for f in rest if not named & set(_about(f))]


def _others_are_right(
    campaign: Campaign,
    mine: dict[str, Finding],
    apart: dict[str, list[Finding]],
    alone: Callable[[Campaign], list[Finding]],
) -> bool:
    """Whether the runs that do not give a finding by themselves are right in it; ``apart`` is what each run gives.

    They do not give it together either, for each may be short. Nor do they move as no reading explains, together or
    most of them by themselves, for what all lack is no one run's."""
    first = next(iter(mine.values()))
    everywhere = first.channel not in campaign.channels  # the clock, the drive
    others = tuple(r for r in campaign.runs if r.name not in mine and (everywhere or first.channel in r.channels))
    if not others:
        return False
    about, size = set(_about(first)), first.size.get("factor")

    def unexplained(finding: Finding) -> bool:
        return finding.kind == "unlike" and finding.severity != IMPOSSIBLE and bool(about & set(_about(finding)))

    if 2 * sum(any(map(unexplained, apart[r.name])) for r in others) > len(others):
        return False

    def the_same(finding: Finding) -> bool:
        other = finding.size.get("factor")
        apart = size and other and _alike(finding)[-1] != _alike(first)[-1]
        alike = finding.severity == first.severity or finding.kind == "unlike"
        return bool(about & set(_about(finding))) and alike and not apart

    return not any(map(the_same, alone(replace(campaign, runs=others))))


def _alike(finding: Finding) -> Alike:
    factor = abs(finding.size.get("factor", 1.0)) or 1.0
    return finding.severity, finding.kind, finding.channel, round(4.0 * np.log(factor))


def _about(finding: Finding) -> Iterable[str]:
    """What a finding speaks of: its channels, or its kind where it is about the clock."""
    return [
        finding.channel or finding.kind,
        *filter(None, (finding.size.get("of"), *finding.size.get("candidates", ()), *finding.size.get("channels", ()))),
    ]


def _in_runs(mine: dict[str, Finding], where: str) -> Finding:
    """The finding of some runs, with their names."""
    name, first = next(iter(mine.items()))
    text = f"in {shared(mine)}{where} {first.text}"
    return replace(first, text=text, run=name, size={**first.size, "runs": list(mine)})

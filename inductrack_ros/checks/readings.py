# SPDX-License-Identifier: Apache-2.0
"""Data that do not belong to the model's motion as they are written: which unit, sign or clock would make them
belong?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..core.model import Model
from ..core.state import GAPS
from ..data import Campaign
from . import levels
from .apart import of_some
from .balance import Held, bad, hold, needed_factor, stops, total
from .changes import Change, changes, exchanges, factor_between
from .clock_rate import at_its_rate, clock
from .current import against_others, drive, judged
from .finding import IMPOSSIBLE, WARNING, Finding, impossible, number, shared
from .gravity import with_gravity
from .noise_found import Channel, channels_of
from .ranges import by_range, or_counts
from .room import mean_speeds
from .saying import counted, finding_of
from .windows import HALVES, WINDOWS, Reading, Windows, windows_of
from .zeros import negative_gap, zeros_apart

#: One thing wrong after the other is looked for, so many at most.
MOST = 4
#: A reading is better where it takes off this part of what does not belong.
BETTER = 0.4
#: Two readings are equally good where what they leave differs by less.
TWINS = 0.1
#: Where a drive current is to be corrected: as it is stated, as it was measured.
_IN_YAML, _AS_MEASURED = "in campaign.yaml", "where it is measured"
#: Windows of a run that is looked at alone.
FEWEST_APART = 24


def readings(campaign: Campaign, channels: Mapping[str, Channel], model: Model) -> list[Finding]:
    """Findings about units, signs and clocks that the model's own motion gives away: of all runs, or of some where the
    others are read rightly."""
    most = max(FEWEST_APART, WINDOWS // len(campaign.runs))

    windows = windows_of(campaign, channels)
    together = _at_any_length(campaign, channels, windows, model, of_all=True)
    # One factor on the travel of all runs explains what currents, a wrong one in each run, would explain as well.
    surge = any(f.kind == "unit" and f.channel == "surge" for f in impossible(together))

    def alone(one: Campaign) -> list[Finding]:
        own = channels_of(one)  # noise is in the unit of its run
        found = _at_any_length(one, own, windows_of(one, own, most), model, of_all=False)
        return [f for f in found if not (surge and f.channel in ("surge", "drive_current"))]

    found = of_some(campaign, together, alone, telling=_counts)
    found = against_others(campaign, channels, model, most, found)
    if any("drive_current" in run.inputs for run in campaign.runs):
        found = [replace(f, remedy=f.remedy.replace(_IN_YAML, _AS_MEASURED)) for f in found]
    if impossible(found) or windows is None:
        return found
    zeros = zeros_apart(campaign, hold(windows, model, Reading()))
    return zeros + [f for f in found if not zeros or f.channel != "heave"]


def _counts(finding: Finding) -> bool:
    """Whether a finding of one run alone counts."""
    return finding.severity == IMPOSSIBLE or finding.kind == "unlike"


def _at_any_length(
    campaign: Campaign, channels: Mapping[str, Channel], windows: Windows | None, model: Model, of_all: bool
) -> list[Finding]:
    """Findings about readings; where several channels move as nothing explains, also by shorter windows: how long these
    are the channels themselves say, and of two that changed places the slow one made them long."""
    found = _read(campaign, windows, model, of_all)
    if windows is None or not any(f.kind == "unlike" and len(f.size.get("channels", ())) > 1 for f in found):
        return found
    among = windows.values.keys()
    for half in HALVES:
        shorter = windows_of(campaign, channels, len(windows.times), half)
        if shorter is None:
            continue
        before = hold(shorter, model, Reading()).misfits
        tried = [(c, hold(shorter, model, c.reading).misfits) for c in exchanges(Reading(), shorter, [])]
        tried = [t for t in tried if explains(before, t[1], t[0].about)]
        if before and tried:
            best, after = min(tried, key=lambda t: total(t[1], among))
            return [finding_of(campaign, [best], 1.0, {"off": before, "then": after})]
    return found


def _read(campaign: Campaign, windows: Windows | None, model: Model, of_all: bool) -> list[Finding]:
    """Findings about readings that runs share. An encoder counts alike in all runs, so that of some it is not asked."""
    now, found = by_range(campaign, model, windows)
    found = [or_counts(f, campaign, windows, model, now) for f in found]
    found += with_gravity(campaign, model)
    unread = any(f.kind == "turned" or f.kind == "zero" and windows and f.channel in windows.values for f in found)
    if windows is None or unread:
        return found or _backwards(campaign, model)
    held = hold(windows, model, now)
    for _ in range(MOST):
        best = _best(held, of_all)
        if best is None:
            break
        alike, then, wanted = best
        factor = factor_between(held.reading, then.reading)
        finding = finding_of(campaign, alike, factor, {"off": held.misfits, "then": then.misfits})
        if alike[0].kind == "counted":
            finding = counted(finding, factor, windows, drive(campaign, windows, model, held.misfits))
        chance = finding.size.get("factor") == 0.0 and (wanted is None or abs(wanted) > levels.EXACTLY - 1.0)
        found.append(judged(finding, windows, model) if chance else finding)
        held = then
    if not found and not bad(held.misfits):
        return _backwards(campaign, model)
    return found if found else drive(campaign, windows, model, held.misfits) or _unlike(held.misfits)


def _best(held: Held, of_all: bool) -> tuple[list[Change], Held, float | None] | None:
    """The change that makes most of the data belong, with those that do as well, best first; the data so read; the
    factor that the drive current lacks as it is read. None where nothing is to be read otherwise.

    Where the data say nothing as they are read, for the cradle would be in the track, channels may have changed
    places."""
    left, now, wanted = held.misfits, held.reading, None
    if now.time == 1.0 and (then := at_its_rate(held)) is not None:
        return [clock(held, then)], then, None
    if (gap := negative_gap(held)) is not None:
        return [gap], hold(held.windows, held.model, gap.reading), None
    off = bad(left)
    if off:
        wanted = needed_factor(held.windows, held.model) if off == ["surge"] and now == Reading() else None
        others = [c for c in changes(now, held.windows, left, wanted, held.model) if of_all or c.kind != "counted"]
    elif not left and stops(held.model):
        others = exchanges(now, held.windows, [])
    else:
        return None
    tried = [(change, hold(held.windows, held.model, change.reading)) for change in others]
    tried = [t for t in tried if explains(left, t[1].misfits, t[0].about)]
    if not tried:
        return None
    among = left.keys() | {c for t in tried for c in t[1].misfits}
    tried.sort(key=lambda t: total(t[1].misfits, among))
    least = total(tried[0][1].misfits, among)
    alike = [t for t in tried if total(t[1].misfits, among) < least + TWINS]
    if alike[0][0].kind == "unit":  # an exchange needs no number to be right
        alike.sort(key=lambda t: t[0].kind != "swapped")
    best, then = alike[0]
    if (first := best.first_of(now)) is not best:
        return [first], hold(held.windows, held.model, first.reading), wanted
    return [t[0] for t in alike], then, wanted


def _unlike(left: Mapping[str, float]) -> list[Finding]:
    """What has nothing in common with the model's motion, however it is read."""
    names = bad(left)
    if not names:
        return []
    text = (
        f"{shared(names)} {'moves' if len(names) == 1 else 'move'} by other forces than this model's, and no unit, sign"
        " or exchange of channels explains it"
    )
    remedy = "look at the channels, the model's parameters and drive_current: no small effect makes such a difference"
    if set(names) <= set(GAPS):  # which hang on no force
        which = "is not the gap" if len(names) == 1 else "are not the gaps"
        text = f"{shared(names)} {which} at the places measured, and no unit, sign or exchange of channels explains it"
        remedy = "are they stamped late, or measured elsewhere than at the arrays? Look at the model's geometry, too"
    return [Finding("unlike", WARNING, text, remedy, names[0], size={"channels": names, "off": dict(left)})]


def _backwards(campaign: Campaign, model: Model) -> list[Finding]:
    """All runs going backwards, where nothing lifts or drives."""
    speeds = mean_speeds(campaign)
    if not stops(model) or not speeds or max(speeds) > -levels.MOVING:
        return []
    text = (
        f"surge runs backwards in all runs, at up to {number(-min(speeds))} m/s, where nothing lifts or drives the"
        " cradle"
    )
    remedy = "change the sign of surge; it grows along the travel"
    return [Finding("axis_flipped", IMPOSSIBLE, text, remedy, "surge", size={"candidates": ["surge"]})]


def explains(before: Mapping[str, float], after: Mapping[str, float], about: Sequence[str]) -> bool:
    """Whether a reading brings something that was off to where it belongs, and nothing out of where it belonged; all,
    where nothing was known ``before``.

    What it is ``about`` has to belong then, also where nothing told of it before."""
    mended = [c for c in bad(before) if after.get(c, 2.0) < levels.GOOD]
    spoiled = [c for c in bad(after) if c in about or (c in before and c not in bad(before))]
    if not before:
        return {"sway", "heave", "roll"} <= after.keys() and max(after.values()) < levels.GOOD
    return bool(mended) and not spoiled and total(after, before) < (1 - BETTER) * total(before, before)

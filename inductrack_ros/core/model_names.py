# SPDX-License-Identifier: Apache-2.0
"""A model as flat names and values, as they stand in a ROS 2 parameter file: read, checked and written.

`model.Model` uses this file; it does not know `Model` itself.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from .effects import Effect, load_effects, split_name
from .errors import InputError, announce, did_you_mean
from .options import COIL_OPTIONS, MODEL_OPTIONS, SIM, is_of_the_node
from .output_folder import write_whole
from .parameters import PARAMETERS
from .state import CHANNELS
from .uncertainty import Uncertainty

if TYPE_CHECKING:
    from .model import Model

#: How the names of conditions begin in a parameter file.
CONDITIONS = "conditions."


def arguments_of(
    values: Mapping[str, Any],
    where: str,
    extra_files: Iterable[str | Path],
    folder: Path | None,
    shared: Collection[str],
) -> dict[str, Any]:
    """What `Model.create` is called with for flat ``values``; see `Model.from_mapping`. Raises `InputError`."""
    place = f"{where}: " if where else ""
    values = dict(values)
    _check_of_the_node(values, place)
    dof, drive = values.pop("dof", 4), values.pop("drive", "averaged")
    track, coil_options = _track(values, place)
    names = text_list(values.pop("effects", []), "effects", place)
    files = [
        beside(folder, f) if folder else f for f in text_list(values.pop("effect_files", []), "effect_files", place)
    ] + [str(f) for f in extra_files]
    known = load_effects(files)
    foreign = [n for n in values if n in shared and not is_of_the_node(n) and not _of_a_model(n, known)]
    if foreign:
        announce(f"warning: {place}not of the model, passed over: {', '.join(foreign)}")
    values = {n: v for n, v in values.items() if n not in foreign and not is_of_the_node(n)}
    conditions = {n.removeprefix(CONDITIONS): values.pop(n) for n in list(values) if n.startswith(CONDITIONS)}
    base = {key: values.pop(key) for key in list(values) if "." not in key}
    effects = _effects(values, names, known, where)
    for key in base:
        if key not in PARAMETERS:
            raise InputError(f"{place}unknown parameter '{key}'{did_you_mean(key, [*PARAMETERS, *MODEL_OPTIONS])}")
    return {
        "parameters": base,
        "effects": effects,
        "dof": dof,
        "drive": drive,
        "effect_files": files,
        "where": where,
        "conditions": conditions,
        "track": track,
        "coil_options": coil_options,
    }


def _check_of_the_node(values: Mapping[str, Any], place: str) -> None:
    """Raise `InputError` for a value that the `sim` node would refuse too, and for names below one that has none."""
    for name, value in values.items():
        option, dot, _ = name.partition(".")
        if dot and (option in SIM or option in MODEL_OPTIONS):
            below = [f"{n.removeprefix(option + dot)}={v}" for n, v in values.items() if n.startswith(option + dot)]
            text = f"'{','.join(below)}'" if option == "initial_state" else "its value"
            raise InputError(f"{place}{name}: {option} has no names below it; write {option}: {text}")
        if name in SIM:
            SIM[name].check(name, value, place.removesuffix(": "))


def _track(values: dict[str, Any], place: str) -> tuple[Any, dict[str, Any]]:
    """The kind of track and the options of its coils, taken out of ``values``."""
    track = values.pop("track", "averaged")
    options = {n: values.pop(n) for n in ("track_length", *COIL_OPTIONS) if n in values}
    defaults = {n: (one.default, [one.default]) for n, one in COIL_OPTIONS.items()}  # a node has some as lists of one
    unused = [n for n in options if n in COIL_OPTIONS and options[n] not in defaults[n]]
    if unused and track == "averaged":
        announce(f"warning: {place}without track: coils these say nothing: {', '.join(unused)}")
    return track, options


def _effects(
    values: Mapping[str, Any], names: Iterable[str], known: Mapping[str, Effect], where: str
) -> dict[str, dict[str, Any]]:
    """The parameters of each effect in ``names``, from ``<effect>.<parameter>``; those of others are passed over, and
    said. Raises `InputError` for a parameter that no effect has."""
    place = f"{where}: " if where else ""
    effects: dict[str, dict[str, Any]] = {name: {} for name in names}
    off: list[str] = []
    for key, value in values.items():
        effect_name, _, parameter = key.rpartition(".")
        if effect_name in effects:
            effects[effect_name][parameter] = value
            continue
        item, _ = split_name(effect_name, known, CHANNELS, where)
        check_has(item, effect_name, parameter, place)
        off.append(key)
    if off:
        announce(f"warning: {place}not used, effects: does not list their effect: {', '.join(off)}")
    return effects


def check_has(item: Effect, name: str, parameter: str, place: str) -> None:
    """Raises `InputError` where the effect, called ``name``, has no such parameter."""
    if parameter not in item.parameters:
        raise InputError(
            f"{place}effect '{name}' has no parameter '{parameter}'{did_you_mean(parameter, item.parameters)}"
        )


def flat_names(model: Model) -> dict[str, object]:
    """The model's flat names and values, as `arguments_of` reads them."""
    dof = list(model.dof) if isinstance(model.dof, tuple) else model.dof
    flat: dict[str, object] = {"dof": dof, "drive": model.drive, **model.parameters, "effects": list(model.effects)}
    if model.track != "averaged":
        flat |= {"track": model.track, **model.coil_options}
    if model.effect_files:
        flat["effect_files"] = list(model.effect_files)
    flat |= {CONDITIONS + name: value for name, value in model.conditions.items()}
    return flat | {
        f"{e}.{p}": list(v) if isinstance(v, tuple) else v
        for e, values in model.effects.items()
        for p, v in values.items()
    }


def write_model(path: str | Path, flat: Mapping[str, Any], comment: str, uncertainty: Uncertainty | None) -> None:
    """Write flat names as a ROS 2 parameter file, whole or not at all."""
    nested: dict[str, Any] = {}
    for key, value in flat.items():
        effect_name, dot, parameter = key.rpartition(".")
        if dot:
            nested.setdefault(effect_name, {})[parameter] = value
        elif value != []:  # an empty list has no type in a ROS parameter file
            nested[key] = value
    text = "".join(f"# {line}\n" for line in comment.splitlines())
    blocks = {"/**": {"ros__parameters": nested}} | (uncertainty.block() if uncertainty else {})
    text += yaml.safe_dump(blocks, sort_keys=False, allow_unicode=True)
    write_whole(path, text)


def check_conditions(given: Mapping[str, Any], known: Mapping[str, Effect], place: str) -> dict[str, float]:
    """The conditions as numbers. Raises `InputError` for one that no effect asks for, and for what is no number."""
    asked = {c for item in known.values() for c in item.conditions if c not in PARAMETERS}
    for name, value in given.items():
        if name not in asked:
            own = (
                "it is a parameter of the model, set that"
                if name in PARAMETERS
                else "no effect asks for it" + did_you_mean(name, asked)
            )
            raise InputError(f"{place}{CONDITIONS}{name}: {own}")
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
            raise InputError(f"{place}{CONDITIONS}{name} = {value!r:.60} is not a finite number")
    return {name: float(value) for name, value in given.items()}


def _of_a_model(name: str, effects: Mapping[str, Effect]) -> bool:
    """Whether a parameter of this name is some model's; ``effects`` are those known."""
    effect, dot, _ = name.rpartition(".")
    if name.startswith(CONDITIONS):
        return any(name.removeprefix(CONDITIONS) in item.conditions for item in effects.values())
    return effect.partition(":")[0] in effects if dot else name in PARAMETERS or name in MODEL_OPTIONS


def beside(folder: Path, file: str) -> str:
    """A file that a YAML names, seen from the YAML's folder."""
    return os.path.join(folder, os.path.expanduser(file))


def text_list(value: object, name: str, place: str) -> list[str]:
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, (list, tuple)) or any(not isinstance(v, str) for v in value):
        raise InputError(f"{place}{name} must be a list of names, got {value!r:.60}")
    return [v for v in value if v]

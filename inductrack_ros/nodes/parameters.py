# SPDX-License-Identifier: Apache-2.0
"""ROS 2 parameters from their one declaration: the model's from the core, a node's own from a table like it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from ..core.errors import InputError, did_you_mean
from ..core.model import Model
from ..core.model_names import CONDITIONS
from ..core.options import MODEL_OPTIONS, OF_ROS, Option
from ..core.parameters import PARAMETERS, Parameter
from .overrides import EMPTY

__all__ = [
    "MODEL_OPTIONS",
    "Option",
    "declare",
    "effect_parameters",
    "in_words",
    "given",
    "model_options",
    "plain",
    "when_set",
    "with_values",
    "without_unknown",
]

#: A condition is a number of any kind; this is what its declaration says (ROS has no other way).
BOUND = 1e9

Declared = Mapping[str, Parameter | Option]


def plain(value: object) -> object:
    """A parameter's value as YAML would give it (rclpy hands out arrays, and an empty list has to be `EMPTY`)."""
    value = list(value) if hasattr(value, "typecode") or isinstance(value, tuple) else value
    return [] if value == EMPTY else value


def given(node: Node) -> dict[str, object]:
    """What the command line and parameter files gave the node (made with automatic declaration), as plain values."""
    found = {name: plain(parameter.value) for name, parameter in node.get_parameters_by_prefix("").items()}
    return {n: v for n, v in found.items() if not n.startswith(OF_ROS) and v is not None}


def without_unknown(
    values: Mapping[str, object], declared: Collection[str], node: Node, shared: Collection[str]
) -> dict[str, object]:
    """The values whose names are declared. Of others those in ``shared``, which were given to nodes of any name, are
    passed over, and that is said; for one that was given to this node it raises `InputError`."""
    unknown = [name for name in values if name not in declared]
    for name in unknown:
        if name not in shared:
            raise InputError(f"{node.get_name()}: unknown parameter '{name}'{did_you_mean(name, declared)}")
    if unknown:
        node.get_logger().warning(f"this node does not have, and passes over: {', '.join(unknown)}")
    return {name: value for name, value in values.items() if name in declared}


def declare(node: Node, declared: Declared, live: Collection[str] = ()) -> dict[str, object]:
    """Declare all with description, unit and range; those in `live` may be set later. Returns their values.

    Raises `InputError`, naming parameter and range, for a value given at the start that does not fit.
    """
    values = {}
    start = given(node)
    for name, one in declared.items():
        value = one.check(name, start.get(name, one.default), node.get_name())
        if name in start:
            node.undeclare_parameter(name)
        node.declare_parameter(
            name,
            list(value) if isinstance(value, tuple) else value,
            _descriptor(one, name in live),
            ignore_override=True,
        )
        values[name] = value
    return values


def when_set(
    node: Node, check: Callable[[dict[str, object]], object], take: Callable[[dict[str, object]], None]
) -> None:
    """What is set while the node runs, as names and plain values: ``check`` raises `InputError` for what cannot be,
    ``take`` is called once all have accepted it, other callbacks of the node too."""

    def values(changed: list[RosParameter]) -> dict[str, object]:
        return {parameter.name: plain(parameter.value) for parameter in changed}

    def asked(changed: list[RosParameter]) -> SetParametersResult:
        try:
            check(values(changed))
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(asked)
    node.add_post_set_parameters_callback(lambda changed: take(values(changed)))


def model_options(model: Model) -> dict[str, Option]:
    """`MODEL_OPTIONS`, in which ``dof`` is of the type that this model has, a number or a list of coordinates: a ROS
    parameter keeps its type."""
    if isinstance(model.dof, int):
        return MODEL_OPTIONS
    return MODEL_OPTIONS | {"dof": Option(list(model.dof), MODEL_OPTIONS["dof"].meaning)}


def in_words(model: Model) -> str:
    """What a node's first line says of its model: drive, effects, and what is not as usual."""
    parts = [f"drive: {model.drive}", f"effects: {', '.join(model.effects) or 'none'}"]
    if model.track != MODEL_OPTIONS["track"].default:
        parts.append(f"track: {model.track}")
    if model.dof != MODEL_OPTIONS["dof"].default:
        parts.append(f"dof: {model.dof if isinstance(model.dof, int) else ', '.join(model.dof)}")
    return ", ".join(parts)


def effect_parameters(model: Model) -> dict[str, Parameter]:
    """Parameters of the model's effects by their names on a node, ``EFFECT.PARAMETER``, and the conditions that these
    ask for."""
    items = {name: model.known_effects[name.partition(":")[0]] for name in model.effects}
    found = {
        f"{name}.{parameter}": declared
        for name, item in items.items()
        for parameter, declared in item.parameters.items()
    }
    return found | {
        CONDITIONS + condition: Parameter(default, "", -BOUND, BOUND, f"condition of the run that {name} asks for")
        for name, item in items.items()
        for condition, default in item.conditions.items()
        if condition not in PARAMETERS
    }


def with_values(model: Model, values: Mapping[str, object]) -> Model:
    """The model with some of its own parameters, those of its effects and its conditions changed. Raises
    `InputError`."""
    effects = {name: dict(parameters) for name, parameters in model.effects.items()}
    conditions = {n.removeprefix(CONDITIONS): v for n, v in values.items() if n.startswith(CONDITIONS)}
    for name, value in values.items():
        effect, dot, parameter = name.rpartition(".")
        if dot and not name.startswith(CONDITIONS):
            effects[effect][parameter] = value
    own = {n: v for n, v in values.items() if n in PARAMETERS}
    return model.with_changes(own, effects, conditions={**model.conditions, **conditions})


def _descriptor(one: Parameter | Option, live: bool) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=one.meaning, read_only=not live)
    if isinstance(one, Parameter):
        table = f"; up to {one.count} numbers in {one.range_text()}" if one.count > 1 else ""
        descriptor.description += f" ({one.unit or 'no unit'}){table}"
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(one.low), to_value=float(one.high))]
    elif type(one.default) is int:
        descriptor.integer_range = [IntegerRange(from_value=one.low, to_value=one.high)]
    elif one.choices:
        descriptor.additional_constraints = "one of " + ", ".join(one.choices)
    return descriptor

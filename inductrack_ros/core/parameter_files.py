"""ROS 2 parameter files, read without ROS: a file for the `sim` node is a model as well."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .errors import InputError
from .yaml_files import read_yaml

_EXPECTED = "expected parameter names with values"
_DEEPEST = 8  # far more than a node's name and an effect's parameter need


def read_parameter_file(path: str | Path, node: str = "sim") -> dict[str, object]:
    """Flat names and values that a parameter file gives the node, or those of a plain YAML mapping.

    Of several ``ros__parameters`` blocks those count whose name ends in ``node`` or is a wildcard; a single one
    counts whatever its name, for nodes may be renamed. Raises `InputError`.
    """
    loaded = read_yaml(path)
    if not isinstance(loaded, dict):
        raise InputError(f"{path}: {_EXPECTED}, got {type(loaded).__name__}")
    blocks = list(_blocks(loaded, ""))
    chosen = [block for name, block in blocks if name.rpartition("/")[2] in (node, "*", "**")]
    if len(blocks) == 1:
        chosen = [blocks[0][1]]
    elif blocks and not chosen:
        raise InputError(f"{path}: has no block for {node}; its blocks are {', '.join(name for name, _ in blocks)}")
    flat: dict[str, object] = {}
    for block in chosen or [loaded]:
        if not isinstance(block, dict):
            raise InputError(f"{path}: ros__parameters must hold parameter names with values")
        _flatten(block, "", flat, path)
    return flat


def _blocks(tree: dict, name: str) -> Iterator[tuple[str, object]]:
    """Name of a node, and what stands under its ``ros__parameters``."""
    for key, value in tree.items():
        if key == "ros__parameters":
            yield name, value
        elif isinstance(value, dict):
            yield from _blocks(value, f"{name}/{str(key).strip('/')}")


def _flatten(tree: dict, prefix: str, flat: dict[str, object], path: str | Path) -> None:
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if not isinstance(value, dict):
            flat[name] = value
        elif name.count(".") < _DEEPEST:
            _flatten(value, name + ".", flat, path)
        else:
            raise InputError(f"{path}: '{name[:60]}' is nested too deep; {_EXPECTED}")

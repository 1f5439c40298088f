# SPDX-License-Identifier: Apache-2.0
"""ROS 2 parameter files, read without ROS: a file for the `sim` node is a model as well.

Nodes and commands read them here and nowhere else, so the same file gives both the same.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from .errors import InputError
from .yaml_files import read_yaml

SIM_NODE = "/inductrack/sim"  # the node whose parameters are a model
_EXPECTED = "expected parameter names with values"
_BLOCK = "ros__parameters"
_NAME = re.compile(r"\w+|\*|\*\*", re.ASCII)
_DEEPEST = 8  # far more than a node's name and an effect's parameter need


@dataclass(frozen=True)
class Block:
    """What stands under one ``ros__parameters``: ``pattern`` says for which nodes, ``values`` are flat names and
    values.

    ``shared``: it is for nodes of any name, so that it may hold what one of them does not have.
    """

    pattern: str
    values: dict[str, object]
    shared: bool = False

    def is_for(self, node: str) -> bool:
        """Whether a node of this full name takes it: ``*`` is one name, ``**`` any number of them, as ROS 2 has it."""
        tokens = {"*": r"/\w+", "**": r"(/\w+)*"}
        parts = (tokens.get(part, "/" + re.escape(part)) for part in self.pattern.split("/")[1:])
        return re.fullmatch("".join(parts), node) is not None


def read_blocks(path: str | Path) -> list[Block]:
    """The file's blocks, in their order; a plain mapping is one for every node, and nothing in it is for others alone.

    Raises `InputError`.
    """
    loaded = read_yaml(path)
    if loaded is None:
        raise InputError(f"{path}: empty; {_EXPECTED}")
    if not isinstance(loaded, dict):
        raise InputError(f"{path}: {_EXPECTED}, got {type(loaded).__name__}")
    found: dict[str, dict[str, object]] = {}
    blocks = list(_blocks(loaded, "", path))
    if not blocks and (node := next((key for key in loaded if str(key).startswith(("/", "**"))), None)) is not None:
        raise InputError(f"{path}: no {_BLOCK} below '{node}'; what a node is given stands below that word")
    for pattern, block in blocks or [("/**", loaded)]:
        if not isinstance(block, dict):
            raise InputError(f"{path}: {_BLOCK} must hold parameter names with values")
        if wrong := [part for part in pattern.split("/")[1:] if not _NAME.fullmatch(part)]:
            raise InputError(
                f"{path}: '{pattern}' is no node's name; '{wrong[0]}' must be of letters, digits and _, or * or **"
                " alone"
            )
        values: dict[str, object] = {}
        _flatten(block, "", values, path)
        found.setdefault(pattern or "/**", {}).update(values)
    return [Block(pattern, values, bool(blocks) and pattern.endswith("*")) for pattern, values in found.items()]


def blocks_for(path: str | Path, node: str = SIM_NODE) -> list[Block]:
    """The file's blocks for the node of this full name. Raises `InputError`, also where there is none."""
    blocks = read_blocks(path)
    if unused := nothing_for(blocks, node):
        raise InputError(f"{path}: {unused}")
    return [block for block in blocks if block.is_for(node)]


def merged(blocks: Iterable[Block]) -> dict[str, object]:
    """Flat names and values; of two blocks the later counts."""
    return {name: value for block in blocks for name, value in block.values.items()}


def shared_names(blocks: Iterable[Block]) -> frozenset[str]:
    """Names that stand in shared blocks only: a node that does not have one passes over it."""
    blocks = list(blocks)
    return frozenset(merged(b for b in blocks if b.shared)) - frozenset(merged(b for b in blocks if not b.shared))


def overridden(blocks: Iterable[Block]) -> str:
    """What to say where a block for nodes of any name takes the place of what one for a node itself gave above it."""
    special: dict[str, tuple[str, object]] = {}
    said: list[str] = []
    for block in blocks:
        for name, value in block.values.items():
            if not block.shared:
                special[name] = block.pattern, value
            elif name in special and special[name][1] != value:
                pattern, before = special.pop(name)
                said.append(f"{name}: {value} of {block.pattern} counts, not {before} of {pattern} above it")
    return f"{'; '.join(said)}; put the general block first" if said else ""


def nothing_for(blocks: Iterable[Block], node: str) -> str:
    """What to say where the node takes none of the blocks, or passes over one with its own name in another
    namespace."""
    taken = [block.pattern for block in blocks if block.is_for(node)]
    others = [block.pattern for block in blocks if not block.is_for(node)]
    name = node.rpartition("/")[2]
    named = any(pattern.rpartition("/")[2] == name for pattern in taken)
    strange = [] if named else [pattern for pattern in others if pattern.rpartition("/")[2] == name]
    if taken and not strange:
        return ""
    what = f"nothing in it is for {node}" if not taken else f"not all in it is for {node}"
    return f"{what}; its blocks are for {', '.join(others if not taken else strange)}; name one {node} or /**"


def _blocks(tree: dict, name: str, path: str | Path) -> Iterator[tuple[str, object]]:
    """Name of a node, and what stands under its ``ros__parameters``. Raises `InputError` for what stands beside it."""
    blocks: list[tuple[str, object]] = []
    beside: list[str] = []
    for key, value in tree.items():
        if key == _BLOCK:
            blocks.append((name, value))
        elif isinstance(value, dict):
            blocks += _blocks(value, f"{name}/{str(key).strip('/')}", path)
        else:
            beside.append(str(key))
    if blocks and beside:
        raise InputError(f"{path}: '{beside[0]}' stands outside of {_BLOCK}; indent it below that word")
    yield from blocks


def _flatten(tree: dict, prefix: str, flat: dict[str, object], path: str | Path) -> None:
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if value is None:
            raise InputError(f"{path}: {name} has no value; give it one, or leave the name out")
        if not isinstance(value, dict):
            if name in flat:
                raise InputError(f"{path}: '{name}' is given twice, once with dots and once nested; keep one")
            flat[name] = value
        elif name.count(".") < _DEEPEST:
            _flatten(value, name + ".", flat, path)
        else:
            raise InputError(f"{path}: '{name[:60]}' is nested too deep; {_EXPECTED}")

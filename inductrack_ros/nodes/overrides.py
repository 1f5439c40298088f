# SPDX-License-Identifier: Apache-2.0
"""Parameters given on a node's command line, in a form that ROS 2 reads as the package's own reader does.

rcl's parser refuses four things that the reader takes: an empty list, whole and real numbers in one list, a general
block before a special one (ros2/rcl#1252), and a plain mapping. Its messages speak of its own source. So
`core.parameter_files` reads the files, as it does for commands, and rcl gets their content in a form that it takes. rcl
still decides which block is for which node, and which comes first.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from ..core.errors import InputError
from ..core.model_names import beside
from ..core.parameter_files import Block, nothing_for, overridden, read_blocks, shared_names

EMPTY = [""]  # a list in which there is nothing; an empty one has no type, and rcl none for it
_LARGEST = 2**63 - 1


@dataclass(frozen=True)
class Overrides:
    """What parameter files gave: each file and its blocks."""

    files: tuple[tuple[str, list[Block]], ...] = ()

    def shared(self, node: str) -> frozenset[str]:
        """Names that only blocks for nodes of any name gave to the node of this full name."""
        return shared_names(block for _, blocks in self.files for block in blocks if block.is_for(node))

    def remarks(self, node: str) -> list[str]:
        """What to say of files of which nothing is for the node, or a general block goes before the node's own."""
        found = [(path, nothing_for(blocks, node)) for path, blocks in self.files]
        found += [(path, overridden(block for block in blocks if block.is_for(node))) for path, blocks in self.files]
        return [f"{path}: {said}" for path, said in found if said]


@contextmanager
def readable(arguments: Sequence[str]) -> Iterator[tuple[list[str], Overrides]]:
    """The arguments as rcl takes them, good within the block, and what the parameter files in them give.

    Raises `InputError`.
    """
    with tempfile.TemporaryDirectory(prefix="inductrack_parameters_") as folder:
        rewriting = _Rewriting(Path(folder))
        yield rewriting.arguments(arguments), Overrides(tuple(rewriting.files))


@dataclass
class _Rewriting:
    folder: Path
    files: list[tuple[str, list[Block]]] = field(default_factory=list)

    def arguments(self, given: Sequence[str]) -> list[str]:
        """Every ``--params-file`` and ``-p`` between ``--ros-args`` and ``--`` rewritten."""
        made: list[str] = []
        inside = False
        for word in given:
            before = made[-1] if made and inside else ""
            inside = word != "--" and (inside or word == "--ros-args")
            if inside and before == "--params-file":
                word = self._file(word)
            elif inside and before in ("-p", "--param"):
                word = _rule(word)
            made.append(word)
        return made

    def _file(self, path: str) -> str:
        blocks = read_blocks(path)
        self.files.append((path, blocks))
        lines = []
        for block in blocks:
            lines.append(f"{json.dumps(block.pattern)}:\n  ros__parameters:" + ("" if block.values else " {}"))
            for name, value in block.values.items():
                if name in ("effects", "effect_files") and isinstance(value, str):
                    value = [value]  # as commands take it
                if name == "effect_files" and isinstance(value, list):
                    value = [beside(Path(path).absolute().parent, f) if f else f for f in value]
                lines.append(f"    {json.dumps(name)}: {_text(value, f'{path}: {name}')}")
        made = self.folder / f"{len(self.files)}.yaml"
        made.write_text("\n".join(lines) + "\n", encoding="ascii")
        return str(made)


def _rule(rule: str) -> str:
    """``NAME:=VALUE`` with a list that rcl takes; anything else as it is."""
    name, assigned, value = rule.partition(":=")
    if not (assigned and value.lstrip().startswith("[")):
        return rule
    try:
        return f"{name}:={_text(yaml.safe_load(value), name)}"
    except yaml.YAMLError:
        return rule  # rcl says what it makes of it


def _text(value: object, where: str) -> str:
    """A value as rcl reads it. Raises `InputError` for what is no ROS parameter."""
    if isinstance(value, list):
        entries = _of_one_kind(value, where)
        return "[" + ", ".join(_text(entry, where) for entry in entries) + "]"
    if value is None:
        raise InputError(f"{where} has no value; give it one, or leave the name out")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int) and abs(value) > _LARGEST:
        raise InputError(f"{where} is a whole number of more than 64 bits")
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    if isinstance(value, int | float):
        return repr(value)
    if "\0" in str(value):
        raise InputError(f"{where} holds a character that no parameter can hold")
    return json.dumps(str(value))  # dates and the like are words


def _of_one_kind(values: list, where: str) -> list:
    """The list with whole numbers made real where others are; rcl wants one type."""
    kinds = {type(value) for value in values}
    if kinds == {int, float}:
        return [float(value) for value in values]
    if len(kinds) > 1 or kinds & {list, dict, type(None)}:
        raise InputError(f"{where} = {values!r:.60}: all entries of a list must be of one kind, numbers or words")
    return values or EMPTY

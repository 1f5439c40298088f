# SPDX-License-Identifier: Apache-2.0
"""YAML that people write, read as data: no tags, no key twice, the line of every key, and one line for what is
wrong."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import yaml

from .errors import InputError
from .paths import missing


class Lines(dict):
    """A YAML mapping, and the line of each key in ``lines``."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: dict[object, int] = {}


class _Loader(yaml.SafeLoader):
    """1e-3 is a number, as ROS 2 has it; YAML 1.1, which PyYAML follows, asks for 1.0e-3. 9:30, 010 and 9_300 are none,
    where YAML 1.1 reads 570, 8 and 9300."""

    yaml_implicit_resolvers = {
        first: [(tag, form) for tag, form in resolvers if not tag.endswith((":int", ":float"))]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


class _NoAliases(_Loader):
    def compose_node(self, parent, index):
        if self.check_event(yaml.AliasEvent):
            raise yaml.MarkedYAMLError(
                problem="aliases (*name) cannot stand here", problem_mark=self.peek_event().start_mark
            )
        return super().compose_node(parent, index)


def _mapping(loader: yaml.SafeLoader, node: yaml.MappingNode) -> Iterator[Lines]:
    mapping = Lines()
    yield mapping  # first empty, then filled: so aliases may point back
    given: set[tuple[str, str]] = set()
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode):
            if (key.tag, key.value) in given:
                raise yaml.MarkedYAMLError(problem=f"'{key.value}' is given twice", problem_mark=key.start_mark)
            given.add((key.tag, key.value))
    loader.flatten_mapping(node)
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, (str, int, float, type(None))):
            raise yaml.MarkedYAMLError(problem="a key must be a word", problem_mark=key_node.start_mark)
        mapping.lines[key] = key_node.start_mark.line + 1
        mapping[key] = loader.construct_object(value_node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:map", _mapping)
_NUMBER = list("-+.0123456789")
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", re.compile(r"[-+]?(0|[1-9]\d*|0x[0-9a-fA-F]+)$"), _NUMBER)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?((\d+\.\d*|\.\d+)([eE][-+]?\d+)?|\d+[eE][-+]?\d+|\.(inf|Inf|INF))$|\.(nan|NaN|NAN)$"),
    _NUMBER,
)


def read_yaml(file: str | Path, aliases: bool = False) -> object:
    """What the file holds, its mappings as `Lines`; ``aliases``: whether ``*name`` may repeat an ``&name``.

    Raises `InputError` naming the file, the line and the remedy.
    """
    try:
        path = Path(file)
        if why := missing(path):
            raise InputError(f"{file}: {why}")
        if not path.is_file():  # reading a pipe or a device could wait for ever
            raise InputError(f"{file}: cannot be read: not a regular file")
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{file}: cannot be read: not UTF-8 text; save it with UTF-8 encoding") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        return yaml.load(text, _Loader if aliases else _NoAliases)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        problem = _one_line(error.problem or error.context)
        likely = likely_cause(text.splitlines(), mark.line if mark else 0, problem)
        raise InputError(f"{file}{line}: not valid YAML: {problem}{likely}") from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise InputError(f"{file}, line {line}: not valid YAML: a control character; save it as plain text") from None
    except RecursionError:
        raise InputError(f"{file}: not valid YAML: nested too deep") from None
    except Exception as error:  # PyYAML lets ValueError and others through for odd scalars
        raise InputError(f"{file}: not valid YAML: {_one_line(error)}") from None


#: Blanks that look like one and that YAML takes for letters.
_ODD_BLANKS = re.compile("[\u00a0\u2000-\u200b\u202f\u3000\ufeff]")


def likely_cause(lines: list[str], at: int, problem: str) -> str:
    """What is behind a ``problem`` that the parser noticed in line ``at`` (from 0), words to be put behind it; empty
    where that is not known. It notices some only some lines later."""
    if "'\\t'" in problem:
        return "; indent with spaces, not tabs"
    near = [(number + 1, lines[number]) for number in range(max(at - 2, 0), min(at + 1, len(lines)))]
    for number, line in reversed(near):
        if re.search(r"[:,\[{-]\s*\*", line):
            return f"; in line {number}, put what begins with * in quotes"
        if re.search(r"[\[{][^'\"]*\s#", line):
            return f"; in line {number}, a # behind a blank begins a comment: put the name in quotes"
    for number, line in enumerate(lines[: at + 1], 1):
        if odd := _ODD_BLANKS.search(line):
            return f"; line {number} holds a blank that is none for YAML (U+{ord(odd[0]):04X}): type it anew"
    if "<block" in problem and at and lines[at].strip() and _indent(lines[at]) != _indent(lines[at - 1]):
        return "; the keys of one entry must be indented alike: with - before the first, two more for the others"
    return ""


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _one_line(error: object) -> str:
    return " ".join(str(error).split())[:200]

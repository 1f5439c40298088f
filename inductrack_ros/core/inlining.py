# SPDX-License-Identifier: Apache-2.0
"""The text of an effect's function in the place of its call: a loop with calls in it does not become vector
instructions."""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any

#: What a text may call, by the name that it has there.
_CALLED = {math.exp: "exp", math.sin: "sin", math.cos: "cos", math.sqrt: "sqrt", abs: "abs", min: "min", max: "max"}


class _Refused(Exception):
    """The function holds what has no place in a loop over lanes."""


def inlined(function: Callable, arguments: Sequence[str], results: Sequence[str], prefix: str) -> list[str] | None:
    """Statements that assign what ``function`` returns for ``arguments`` to ``results``; its own names begin with
    ``prefix``.

    None where it is more than assignments, ``if …: return …`` and a ``return``, of numbers, arithmetic and what
    `_CALLED` lists. Both sides of a condition are computed: nothing there fails or changes anything."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        if not isinstance(tree, ast.FunctionDef) or len(tree.args.args) != len(arguments):
            return None
        writer = _Writer(function, prefix)
        lines = [f"{writer.own(a.arg)} = {given}" for a, given in zip(tree.args.args, arguments, strict=True)]
        found = writer.returned(tree.body, lines, len(results))
    except (_Refused, OSError, TypeError, SyntaxError):
        return None
    return lines + [f"{name} = {value}" for name, value in zip(results, found, strict=True)]


class _Writer:
    """Writes the statements of one function with names of its own."""

    def __init__(self, function: Callable, prefix: str) -> None:
        self._prefix, self._count = prefix, 0
        self._names = function.__globals__ | dict(inspect.getclosurevars(function).nonlocals)
        self._local: set[str] = set()

    def own(self, name: str) -> str:
        """The name of a variable of the function, from here on."""
        self._local.add(name)
        return f"{self._prefix}{name}"

    def returned(self, body: Sequence[ast.stmt], lines: list[str], count: int) -> list[str]:
        """Names of the ``count`` numbers that a body returns, after ``lines`` that are added."""
        for k, statement in enumerate(body):
            if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                continue  # a docstring
            if isinstance(statement, ast.Return):
                return self._kept(statement, lines, count)
            if isinstance(statement, ast.If):
                return self._either(statement, body[k + 1 :], lines, count)
            self._assign(statement, lines)
        raise _Refused

    def _kept(self, statement: ast.Return, lines: list[str], count: int) -> list[str]:
        value = statement.value
        parts = value.elts if isinstance(value, ast.Tuple) else [value]
        if len(parts) != count or value is None:
            raise _Refused
        return [self._stored(self._text(part), lines) for part in parts if part is not None]

    def _stored(self, text: str, lines: list[str]) -> str:
        self._count += 1
        lines.append(f"{self._prefix}_{self._count} = {text}")
        return f"{self._prefix}_{self._count}"

    def _either(self, statement: ast.If, rest: Sequence[ast.stmt], lines: list[str], count: int) -> list[str]:
        condition, then = self._stored(self._text(statement.test), lines), statement.body[0]
        if not isinstance(then, ast.Return) or len(statement.body) > 1:
            raise _Refused
        there = self._kept(then, lines, count)
        other = self.returned([*statement.orelse, *rest], lines, count)
        return [self._stored(f"{a} if {condition} else {b}", lines) for a, b in zip(there, other, strict=True)]

    def _assign(self, statement: ast.stmt, lines: list[str]) -> None:
        if not (isinstance(statement, ast.Assign) and len(statement.targets) == 1):
            raise _Refused
        target, value = statement.targets[0], statement.value
        if isinstance(target, ast.Name):
            names, values = [target], [value]
        elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and len(target.elts) == len(value.elts):
            names, values = target.elts, value.elts
        else:
            raise _Refused
        texts = [self._stored(self._text(v), lines) for v in values]
        for name, text in zip(names, texts, strict=True):
            if not isinstance(name, ast.Name):
                raise _Refused
            lines.append(f"{self.own(name.id)} = {text}")

    def _text(self, node: ast.expr) -> str:
        """An expression in the names of the loop."""
        match node:
            case ast.Constant(value=bool() | int() | float()):
                return repr(node.value)
            case ast.Name(id=name) if name in self._local:
                return f"{self._prefix}{name}"
            case ast.Name() | ast.Attribute():
                return _number(self._value(node))
            case ast.BinOp(left=a, op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() as op, right=b):
                return f"({self._text(a)} {_SIGN[type(op)]} {self._text(b)})"
            case ast.BinOp(left=a, op=ast.Pow(), right=ast.Constant(value=2)):
                return f"({self._text(a)} * {self._text(a)})"
            case ast.UnaryOp(op=ast.USub(), operand=a):
                return f"(-{self._text(a)})"
            case ast.Compare(left=a, ops=[op], comparators=[b]) if type(op) in _SIGN:
                return f"({self._text(a)} {_SIGN[type(op)]} {self._text(b)})"
            case ast.IfExp(test=test, body=a, orelse=b):
                return f"({self._text(a)} if {self._text(test)} else {self._text(b)})"
            case ast.Call(func=called, args=given, keywords=[]) if f := self._called(called):
                return f"{f}({', '.join(map(self._text, given))})"
        raise _Refused

    def _called(self, node: ast.expr) -> str:
        value = self._value(node)
        return next((name for known, name in _CALLED.items() if value is known), "")

    def _value(self, node: ast.expr) -> Any:
        """What a name means outside of the function."""
        if isinstance(node, ast.Attribute) and isinstance(module := self._value(node.value), ModuleType):
            return getattr(module, node.attr, None)
        if isinstance(node, ast.Name) and node.id not in self._local:
            return self._names.get(node.id, _BUILTINS.get(node.id))
        raise _Refused


_BUILTINS: Mapping[str, Any] = {"abs": abs, "min": min, "max": max}
_SIGN = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Lt: "<",
    ast.Gt: ">",
    ast.LtE: "<=",
    ast.GtE: ">=",
}


def _number(value: Any) -> str:
    """A number as text."""
    if isinstance(value, (bool, int, float)) and math.isfinite(value):
        return repr(value)
    raise _Refused

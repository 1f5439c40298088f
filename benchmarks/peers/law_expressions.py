# SPDX-License-Identifier: Apache-2.0
"""A general expression search on the table of an unknown force: Operon's genetic programming (`pyoperon`).

Two searches: one among sums, products, quotients, squares and absolute values, one with exp, sin and tanh too.
Levenberg-Marquardt polishes the constants of each expression. A corner is made of absolute values, for `fmax` gives the
smaller of two in version 0.6.2. The two aims are the part explained and the length. The points that a search is given
lie on the diagnosis's smooth curve, densest where the curve is known best, for it takes no weights.

What helps it: each expression of both fronts has its constants refitted to what the data say of the table, with full
covariance. BIC then chooses. Constants that do the same count as one. What hurts it: the smooth curve rounds
corners and jumps, and the search begins from that."""

from __future__ import annotations

import ast
from dataclasses import dataclass, replace

import numpy as np
from pyoperon.sklearn import SymbolicRegressor
from scipy import optimize

from inductrack_ros.diagnosis.laws.forms import Form, Shape, Term

from .laws import Formula, Statement

#: What expressions are made of: in one search all, in another what is algebraic, whose simple ones the first may lose.
SYMBOLS = (
    "add,sub,mul,div,square,abs,exp,sin,tanh,constant,variable", "add,sub,mul,div,square,abs,constant,variable"
)  # fmt: skip
#: Points that a search sees; longest expression; population and generations (both searches take some three seconds).
POINTS, LENGTH, POPULATION, GENERATIONS = 160, 24, 500, 60
#: Steps that polish an expression's constants, and evaluations of the refit to the table.
STEPS, REFIT = 5, 60
#: Constants whose columns are parallel within this do the same.
SAME = 1e-6
#: What functions are called in an effect.
_CALLED = {"exp": "math.exp", "sin": "math.sin", "tanh": "math.tanh", "abs": "abs"}


def propose(statement: Statement) -> Formula:
    """The expression of the front with the lowest BIC after a refit to the table."""
    far = statement.table.range.far
    density = np.cumsum(1.0 / np.maximum(statement.std, 1e-3 * statement.std.max()) ** 2)
    u = np.interp(np.linspace(density[0], density[-1], POINTS), density, statement.at)
    force = np.interp(u, statement.at, statement.force)
    size = float(np.std(force)) or 1.0
    texts: set[str] = set()
    for symbols in SYMBOLS:
        search = SymbolicRegressor(
            allowed_symbols=symbols, objectives=["r2", "length"], optimizer_iterations=STEPS, max_length=LENGTH,
            population_size=POPULATION, generations=GENERATIONS, epsilon=1e-9, random_state=0, n_threads=1,
        )  # fmt: skip
        search.fit((u / far)[:, None], force / size)
        texts |= {search.get_model_string(one["tree"], precision=12) for one in search.pareto_front_}
    whole = [Expression.of(text, far, size) for text in sorted(texts)]
    found = [refitted(statement, one) for e in whole for one in (e, e.without_offset) if one is not None]
    return min(found, key=lambda f: f[0])[1]


@dataclass(frozen=True)
class Expression:
    """An expression in u whose ``constants`` are c0, c1, … in its ``text``."""

    text: str
    constants: tuple[float, ...]

    @classmethod
    def of(cls, text: str, far: float, size: float) -> Expression:
        """From Operon's text, whose variable is u over ``far`` and whose value is a force over ``size``."""
        numbers = _Numbers(far)
        tree = numbers.visit(ast.parse(text.replace("^", "**"), mode="eval"))
        return cls(f"size * ({ast.unparse(tree)})", (size, *numbers.found))

    @property
    def without_offset(self) -> Expression | None:
        """The same without the constants that it adds, which Operon adds to all; None where there is nothing else."""
        tree = ast.parse(self.text, mode="eval").body
        assert isinstance(tree, ast.BinOp)  # "size * (…)"
        kept = [(sign, t) for sign, t in _summands(tree.right) if "u" in _names(t)]
        text = " + ".join(f"{'-' if sign < 0 else ''}({ast.unparse(t)})" for sign, t in kept)
        return replace(self, text=f"size * ({text})") if kept else None

    @property
    def form(self) -> Form:
        """The expression as a form of one term whose shapes are the constants."""
        names = ("size", *(f"c{k}" for k in range(len(self.constants) - 1)))
        return Form("", "", "", (Term("one", 0, self.text, ""),), tuple(Shape(n, "", "") for n in names))

    def with_constants(self, constants: np.ndarray) -> Formula:
        """The formula with these constants, one term for each summand."""
        size, *others = (float(c) for c in constants)
        tree = _Filled(others).visit(ast.parse(self.text.removeprefix("size * "), mode="eval")).body
        return Formula(tuple((sign * size, ast.unparse(term)) for sign, term in _summands(tree)))


class _Numbers(ast.NodeTransformer):
    """Collects the numbers of an expression, exponents excepted, and names its variable and functions as effects do."""

    def __init__(self, far: float):
        self.found: list[float] = []
        self.far = far

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        self.found.append(float(node.value))  # type: ignore[arg-type]
        return ast.Name(f"c{len(self.found) - 1}")

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        right = node.right if isinstance(node.op, ast.Pow) else None
        left = self.visit(node.left)
        return ast.BinOp(left, node.op, right or self.visit(node.right))

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.BinOp(ast.Name("u"), ast.Div(), ast.Constant(self.far))

    def visit_Call(self, node: ast.Call) -> ast.AST:
        name = node.func.id  # type: ignore[attr-defined]
        return ast.Call(ast.parse(_CALLED[name], mode="eval").body, [self.visit(a) for a in node.args], [])


class _Filled(ast.NodeTransformer):
    """Puts numbers in the place of constants."""

    def __init__(self, constants: list[float]):
        self.constants = constants

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if not node.id.startswith("c"):
            return node
        return ast.Constant(float(f"{self.constants[int(node.id[1:])]:.12g}"))


def _names(tree: ast.expr) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def _summands(tree: ast.expr, sign: float = 1.0) -> list[tuple[float, ast.expr]]:
    """An expression's summands with their signs."""
    if isinstance(tree, ast.BinOp) and isinstance(tree.op, (ast.Add, ast.Sub)):
        after = sign if isinstance(tree.op, ast.Add) else -sign
        return [*_summands(tree.left, sign), *_summands(tree.right, after)]
    return [(sign, tree)]


def refitted(statement: Statement, expression: Expression) -> tuple[float, Formula]:
    """BIC and formula after a refit of all constants to the table."""
    table, form = statement.table, expression.form

    def left(scaled: np.ndarray) -> np.ndarray:
        return table.wanted - table.lay(np.column_stack(form.columns(table.u, scaled * scale)))[:, 0]

    start = np.array(expression.constants)
    scale = np.where(np.abs(start) > 1e-9, np.abs(start), 1.0)
    best = optimize.least_squares(left, start / scale, x_scale="jac", max_nfev=REFIT)
    length = np.linalg.norm(best.jac, axis=0)
    columns = best.jac[:, length > 0] / length[length > 0]
    count = int(np.linalg.matrix_rank(columns, tol=SAME)) if columns.size else 0
    return 2.0 * best.cost + count * float(np.log(statement.samples)), expression.with_constants(best.x * scale)

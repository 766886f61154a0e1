"""Arithmetic expressions and conditions in the coordinates x, y, z, as written in scene files.

The text is parsed with `ast` and interpreted node by node, never passed to `eval`, so a scene from
an untrusted source can compute numbers only.
"""

import ast
import sys
import warnings
from collections.abc import Callable
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import AfterValidator

from sparsemor.core import BoolArray, FloatArray, InputError

Kind: TypeAlias = Literal["number", "condition"]

COORDINATES = ("x", "y", "z")
ALLOWED = (
    "allowed are numbers, x, y, z, pi, + - * / **, comparisons, and, or, not, "
    "abs, sqrt, sin, cos, exp, min and max"
)
MAX_DEPTH, MAX_LENGTH = 60, 2000

_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide,
    ast.Pow: np.power,
}
_COMPARISON: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater, ast.GtE: np.greater_equal,
    ast.Eq: np.equal, ast.NotEq: np.not_equal,
}
_ONE_ARGUMENT: dict[str, Callable[[Any], Any]] = {
    "abs": np.abs, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos, "exp": np.exp,
}
_MANY_ARGUMENTS: dict[str, Callable[[Any, Any], Any]] = {"min": np.minimum, "max": np.maximum}


def parse(text: str, kind: Kind, key: str = "") -> ast.expr:
    """Checked syntax tree of `text`, which must be of the given kind: a number or a condition."""
    if len(text) > MAX_LENGTH:
        raise InputError(f"an expression of {len(text)} characters; at most {MAX_LENGTH}", key)
    if not text.isascii():  # Python reads a full-width x as x
        odd = next(c for c in text if not c.isascii())
        raise InputError(f"{odd!r} in '{text}' is not an ASCII character; {ALLOWED}", key)
    try:
        with warnings.catch_warnings():  # Python's advice on odd spellings such as `1if`
            warnings.simplefilter("ignore")
            tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else "it cannot be parsed"
        raise InputError(f"'{text}' is not an expression: {reason}; {ALLOWED}", key) from None
    found = _Checker(text, key).kind(tree, 0)
    if found != kind:
        wanted = "a condition such as 'y > 0.08'" if kind == "condition" else "a number, e.g. '2*x'"
        raise InputError(f"'{text}' is a {found}; give {wanted}", key)
    return tree


def evaluate_formula(text: str, points: FloatArray, key: str = "") -> FloatArray:
    """Values (N,) of a numeric expression at points (N, d), m."""
    values = _Evaluator(text, points, key).value(parse(text, "number", key))
    return np.array(np.broadcast_to(values, len(points)), dtype=np.float64)


def evaluate_condition(text: str, points: FloatArray, key: str = "") -> BoolArray:
    """Truth values (N,) of a condition at points (N, d), m.

    Both sides of `and` and `or` are computed everywhere: `x != 0 and 1/x > 2` is an error where x =
    0, because a comparison with a number that is not finite has no meaning.
    """
    values = _Evaluator(text, points, key).value(parse(text, "condition", key))
    return np.array(np.broadcast_to(values, len(points)), dtype=np.bool_)


def _check(kind: Kind) -> Callable[[str], str]:
    def check(text: str) -> str:
        parse(text, kind)
        return text

    return check


FormulaText: TypeAlias = Annotated[str, AfterValidator(_check("number"))]
"""Type of an option: text of a numeric expression in x, y, z, checked when the scene is read."""
ConditionText: TypeAlias = Annotated[str, AfterValidator(_check("condition"))]
"""Type of an option: text of a condition in x, y, z, checked when the scene is read."""


class _Checker:
    """Checks a syntax tree before it is evaluated, and rejects all operations that are not allowed.
    """

    def __init__(self, text: str, key: str) -> None:
        self.text, self.key = text, key

    def refuse(self, what: str) -> InputError:
        return InputError(f"{what} in '{self.text}'; {ALLOWED}", self.key)

    def need(self, kind: Kind, node: ast.expr, depth: int) -> None:
        if self.kind(node, depth) != kind:
            other = "condition" if kind == "number" else "number"
            raise self.refuse(f"'{self.written(node)}' is a {other} where a {kind} is needed")

    def kind(self, node: ast.expr, depth: int) -> Kind:
        if depth > MAX_DEPTH:
            raise self.refuse("too many nested operations")
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                if abs(value) > sys.float_info.max:
                    raise self.refuse("a number is too large")
                return "number"
            case ast.Name(id=name) if name in (*COORDINATES, "pi"):
                return "number"
            case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
                return self.all("number", [operand], depth)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self.all("condition", [operand], depth)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return self.all("number", [left, right], depth)
            case ast.BoolOp(values=values):
                return self.all("condition", values, depth)
            case ast.Compare(left=left, ops=ops, comparators=rest) if all(
                type(op) in _COMPARISON for op in ops
            ):
                self.all("number", [left, *rest], depth)
                return "condition"
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self.call(name, args, depth)
        raise self.refuse(f"'{self.written(node)}' is not allowed")

    def written(self, node: ast.expr) -> str:
        """Part of the text from which a node was parsed."""
        return ast.get_source_segment(self.text.strip(), node) or self.text

    def all(self, kind: Kind, nodes: list[ast.expr], depth: int) -> Kind:
        for node in nodes:
            self.need(kind, node, depth + 1)
        return kind

    def call(self, name: str, args: list[ast.expr], depth: int) -> Kind:
        if name in _ONE_ARGUMENT and len(args) != 1:
            raise self.refuse(f"{name} takes one argument, not {len(args)},")
        if name in _MANY_ARGUMENTS and len(args) < 2:
            raise self.refuse(f"{name} takes two or more arguments, not {len(args)},")
        if name not in _ONE_ARGUMENT and name not in _MANY_ARGUMENTS:
            raise self.refuse(f"there is no function '{name}'")
        return self.all("number", args, depth)


class _Evaluator:
    """Evaluation of a checked syntax tree at given points."""

    def __init__(self, text: str, points: FloatArray, key: str) -> None:
        self.text, self.points, self.key = text, points, key

    def value(self, node: ast.expr) -> Any:
        with np.errstate(all="ignore"):
            result = self.of(node)
        return self.finite(result)

    def finite(self, values: Any) -> Any:
        bad = np.flatnonzero(~np.isfinite(np.broadcast_to(values, len(self.points))))
        if bad.size:
            where = ", ".join(f"{c:.6g}" for c in self.points[bad[0]])
            raise InputError(
                f"'{self.text}' is not a finite number at {bad.size} of {len(self.points)} points, "
                f"first at ({where})", self.key,
            )
        return values

    def of(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=int() | float() as value):
                return np.float64(value)
            case ast.Name(id=name):
                return np.float64(np.pi) if name == "pi" else self.coordinate(name)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return np.logical_not(self.of(operand))
            case ast.UnaryOp(op=op, operand=operand):
                return -self.of(operand) if isinstance(op, ast.USub) else self.of(operand)
            case ast.BinOp(left=left, op=op, right=right):
                return _ARITHMETIC[type(op)](self.of(left), self.of(right))
            case ast.BoolOp(op=op, values=nodes):
                join = np.logical_and if isinstance(op, ast.And) else np.logical_or
                return _fold(join, [self.of(n) for n in nodes])
            case ast.Compare():
                return self.comparison(node)
            case ast.Call(func=ast.Name(id=name), args=args):
                values = [self.of(a) for a in args]
                if name in _ONE_ARGUMENT:
                    return _ONE_ARGUMENT[name](values[0])
                return _fold(_MANY_ARGUMENTS[name], values)
        raise AssertionError("parse() lets nothing else through")

    def coordinate(self, name: str) -> FloatArray:
        axis, d = COORDINATES.index(name), self.points.shape[1]
        if axis >= d:
            names = " and ".join(COORDINATES[:d])
            raise InputError(f"'{name}' in '{self.text}': a {d}-D mesh has {names} only", self.key)
        return np.asarray(self.points[:, axis])

    def comparison(self, node: ast.Compare) -> Any:
        sides = [self.finite(self.of(n)) for n in (node.left, *node.comparators)]
        pairs = zip(node.ops, sides[:-1], sides[1:], strict=True)
        return _fold(np.logical_and, [_COMPARISON[type(op)](a, b) for op, a, b in pairs])


def _fold(join: Callable[[Any, Any], Any], values: list[Any]) -> Any:
    result = values[0]
    for value in values[1:]:
        result = join(result, value)
    return result

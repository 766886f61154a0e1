"""Arithmetic expressions and conditions of named values, as written in scene files and papers.

The text is parsed with `ast` and interpreted node by node, never passed to `eval`, so a text from
an untrusted source can compute numbers only.
"""

import ast
import sys
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from sparsemor.core.errors import InputError

Kind: TypeAlias = Literal["number", "condition"]
MAX_DEPTH, MAX_LENGTH = 60, 2000
_ALLOWED = "+ - * / **, comparisons, and, or, not, abs, sqrt, sin, cos, exp, min and max"
_EXAMPLES: Mapping[Kind, str] = {
    "condition": "a condition such as 'y > 0.08'", "number": "a number, e.g. '2*x'"}

_ARITHMETIC: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide,
    ast.Pow: np.power,
}
_COMPARISON: Mapping[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater, ast.GtE: np.greater_equal,
    ast.Eq: np.equal, ast.NotEq: np.not_equal,
}
_ONE_ARGUMENT: Mapping[str, Callable[[Any], Any]] = {
    "abs": np.abs, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos, "exp": np.exp,
}
_MANY_ARGUMENTS: Mapping[str, Callable[[Any, Any], Any]] = {"min": np.minimum, "max": np.maximum}


@dataclass(frozen=True, slots=True)
class Expression:
    """Checked text of a number or condition.

    tree: its syntax tree; names: names of the values that it uses; key: of the option that contains
    it, for errors.
    """

    text: str
    tree: ast.expr
    names: tuple[str, ...]
    key: str = ""

    @classmethod
    def parse(
        cls, text: str, kind: Kind, names: Collection[str] | None = None, *, texts: bool = False,
        key: str = "",
    ) -> "Expression":
        """Expression of the given kind. names: allowed names (None: any); texts: True if texts in
        quotes may be compared. Raises InputError for everything else."""
        words = ", ".join(names) if names is not None else "names"
        allowed = f"allowed are numbers, {words}, {_ALLOWED}"
        if len(text) > MAX_LENGTH:
            raise InputError(f"an expression of {len(text)} characters; at most {MAX_LENGTH}", key)
        if not text.isascii():  # Python reads a full-width x as x
            odd = next(c for c in text if not c.isascii())
            raise InputError(f"{odd!r} in '{text}' is not an ASCII character; {allowed}", key)
        line = " ".join(text.split())
        try:
            with warnings.catch_warnings():  # Python's advice on odd spellings such as `1if`
                warnings.simplefilter("ignore")
                tree = ast.parse(line, mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            reason = error.msg if isinstance(error, SyntaxError) else "it cannot be parsed"
            raise InputError(f"'{text}' is not an expression: {reason}; {allowed}", key) from None
        checker = _Checker(line, names, texts, allowed, key)
        found = checker.kind(tree, 0)
        if found != kind:
            raise InputError(f"'{text}' is a {found}; give {_EXAMPLES[kind]}", key)
        return cls(text, tree, tuple(checker.used), key)

    def value(
        self, values: Mapping[str, Any], checked: Callable[[Any], Any] = lambda sides: sides
    ) -> Any:
        """Value for numbers, arrays or texts by name; a missing number is None or nan.

        A comparison with a number that is not finite, or of a number with a text, is false. Both
        sides of `and` and `or` are computed. checked: called with the numbers on both sides of
        comparisons and with the result, to refuse some.
        """
        with np.errstate(all="ignore"):
            return checked(_Evaluator(self, values, checked).of(self.tree))


class _Checker:
    """Checks a syntax tree before it is evaluated, and rejects all operations that are not allowed.
    """

    def __init__(
        self, text: str, names: Collection[str] | None, texts: bool, allowed: str, key: str
    ) -> None:
        self.text, self.names, self.texts = text, names, texts
        self.allowed, self.key, self.used = allowed, key, dict[str, None]()

    def refuse(self, what: str) -> InputError:
        return InputError(f"{what} in '{self.text}'; {self.allowed}", self.key)

    def need(self, kind: Kind, node: ast.expr, depth: int) -> None:
        if self.kind(node, depth) != kind:
            other = "condition" if kind == "number" else "number"
            raise self.refuse(f"'{self.written(node)}' is a {other} where a {kind} is needed")

    def kind(self, node: ast.expr, depth: int) -> Kind:
        """Kind of the value of a node; collects the names that it uses. Raises InputError for
        anything but arithmetic, comparisons and the permitted functions."""
        if depth > MAX_DEPTH:
            raise self.refuse("too many nested operations")
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                if abs(value) > sys.float_info.max:
                    raise self.refuse("a number is too large")
                return "number"
            case ast.Name(id=name) if self.names is None or name in self.names:
                self.used[name] = None
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
                self.all("number", [s for s in (left, *rest) if not self.is_text(s)], depth)
                return "condition"
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self.call(name, args, depth)
        raise self.refuse(f"'{self.written(node)}' is not allowed")

    def is_text(self, node: ast.expr) -> bool:
        return self.texts and isinstance(node, ast.Constant) and isinstance(node.value, str)

    def written(self, node: ast.expr) -> str:
        """Part of the text from which a node was parsed."""
        return ast.get_source_segment(self.text, node) or self.text

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
    """Evaluation of a checked syntax tree."""

    def __init__(
        self, expression: Expression, values: Mapping[str, Any], checked: Callable[[Any], Any]
    ) -> None:
        self.expression, self.values, self.checked = expression, values, checked

    def of(self, node: ast.expr) -> Any:
        """Value of a node."""
        match node:
            case ast.Constant(value=str() as text):
                return text
            case ast.Constant(value=int() | float() as value):
                return np.float64(value)
            case ast.Name(id=name):
                value = self.values[name]
                return value if isinstance(value, str) else np.asarray(value, dtype=np.float64)[()]
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return np.logical_not(self.of(operand))
            case ast.UnaryOp(op=op, operand=operand):
                number = self.number(operand)
                return -number if isinstance(op, ast.USub) else number
            case ast.BinOp(left=left, op=op, right=right):
                return _ARITHMETIC[type(op)](self.number(left), self.number(right))
            case ast.BoolOp(op=op, values=nodes):
                join = np.logical_and if isinstance(op, ast.And) else np.logical_or
                return _fold(join, [self.of(n) for n in nodes])
            case ast.Compare(left=left, ops=ops, comparators=rest):
                sides = [self.of(n) for n in (left, *rest)]
                pairs = zip(ops, sides[:-1], sides[1:], strict=True)
                return _fold(np.logical_and, [self.comparison(*pair) for pair in pairs])
            case ast.Call(func=ast.Name(id=name), args=args):
                values = [self.number(a) for a in args]
                if name in _ONE_ARGUMENT:
                    return _ONE_ARGUMENT[name](values[0])
                return _fold(_MANY_ARGUMENTS[name], values)
        raise AssertionError("parse() lets nothing else through")

    def number(self, node: ast.expr) -> Any:
        value = self.of(node)
        if isinstance(value, str):
            raise InputError(f"a text where '{self.expression.text}' computes with numbers (got "
                             f"{value!r})", self.expression.key)
        return value

    def comparison(self, op: ast.cmpop, a: Any, b: Any) -> Any:
        if isinstance(a, str) or isinstance(b, str):
            return isinstance(a, str) and isinstance(b, str) and bool(_COMPARISON[type(op)](a, b))
        a, b = self.checked(a), self.checked(b)
        return _COMPARISON[type(op)](a, b) & np.isfinite(a) & np.isfinite(b)


def _fold(join: Callable[[Any, Any], Any], values: list[Any]) -> Any:
    result = values[0]
    for value in values[1:]:
        result = join(result, value)
    return result

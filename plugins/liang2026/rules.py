"""Conditions on named values, such as `error <= 0.1 * paper_error and status == 'done'`."""

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any

Operand = float | str | bool | None
_COMPARE: Mapping[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Eq: operator.eq, ast.NotEq: operator.ne}
_COMPUTE: Mapping[type[ast.operator], Callable[[Any, Any], float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow}
_FUNCTIONS: Mapping[str, Callable[..., float]] = {"abs": abs, "min": min, "max": max}


def names_in(rule: str) -> set[str]:
    """Names of the values in a rule. Raises ValueError if the rule contains anything but numbers,
    texts, names, arithmetic, comparisons, `and`, `or`, `not`, `abs`, `min` and `max`."""
    tree = _parsed(rule)
    evaluate(rule, _Anything())
    called = {id(n.func) for n in ast.walk(tree) if isinstance(n, ast.Call)}
    return {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and id(n) not in called}


def evaluate(rule: str, values: Mapping[str, Operand]) -> Operand:
    """Value of a rule. A comparison with a missing value (None) is false, arithmetic with one is
    None."""
    return _value(_parsed(rule).body, values)


class _Anything(dict[str, Operand]):
    """Mapping in which every name has no value, to check the form of a rule."""

    def __missing__(self, name: str) -> Operand:
        return None


def _parsed(rule: str) -> ast.Expression:
    try:
        return ast.parse(" ".join(rule.split()), mode="eval")
    except SyntaxError as error:
        raise ValueError(f"not a rule: {rule!r} ({error.msg})") from None


def _value(node: ast.expr, values: Mapping[str, Operand]) -> Operand:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float | str):
        return node.value
    if isinstance(node, ast.Name):
        return values[node.id]
    if isinstance(node, ast.BoolOp):
        found = [bool(_value(v, values)) for v in node.values]
        return all(found) if isinstance(node.op, ast.And) else any(found)
    if isinstance(node, ast.UnaryOp):
        inner = _value(node.operand, values)
        if isinstance(node.op, ast.Not):
            return not inner
        if isinstance(node.op, ast.USub):
            return None if inner is None else -_number(inner)
    if isinstance(node, ast.BinOp) and type(node.op) in _COMPUTE:
        a, b = _value(node.left, values), _value(node.right, values)
        return _computed(_COMPUTE[type(node.op)], a, b)
    if isinstance(node, ast.Compare):
        return _compared(node, values)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        function = _FUNCTIONS.get(node.func.id)
        if function is not None:
            return _computed(function, *(_value(a, values) for a in node.args))
    raise ValueError(f"a rule has no {ast.unparse(node)!r}")


def _compared(node: ast.Compare, values: Mapping[str, Operand]) -> bool:
    sides = [_value(n, values) for n in (node.left, *node.comparators)]
    found = True
    for op, a, b in zip(node.ops, sides, sides[1:], strict=False):
        if type(op) not in _COMPARE:
            raise ValueError(f"a rule has no {ast.unparse(node)!r}")
        same_kind = isinstance(a, str) == isinstance(b, str)
        found = found and a is not None and b is not None and same_kind and (
            _COMPARE[type(op)](a, b))
    return found


def _computed(function: Callable[..., float], *operands: Operand) -> float | None:
    if any(o is None for o in operands):
        return None
    try:
        return float(function(*map(_number, operands)))
    except (ZeroDivisionError, OverflowError):
        return None


def _number(value: Operand) -> float:
    if isinstance(value, str) or value is None:
        raise ValueError(f"a rule computes with numbers (got {value!r})")
    return value

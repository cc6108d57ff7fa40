"""The functions of `plants.elementary` and `plants.logarithms` in C, translated from their text.

The text is plain enough for it: see the docstring of `plants.elementary`. Every name gets a prefix, as the names in a
model are its author's.
"""

import ast
import inspect
import math
from collections.abc import Iterator, Mapping
from functools import cache
from types import ModuleType

import numpy as np

from plants import elementary, logarithms

PREFIX = "elementary_"
FILE = "elementary.h"

_MODULES: tuple[ModuleType, ...] = (elementary, logarithms)
_TYPES = {"float": "double", "int": "int64_t", "bool": "bool"}
_OPERATORS: Mapping[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "/",  # of numbers that are not negative
    ast.BitAnd: "&",
    ast.BitOr: "|",
    ast.BitXor: "^",
    ast.RShift: ">>",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}
_PRIMITIVES = {
    "abs": ("fabs", "double"),
    "sqrt": ("sqrt", "double"),
    "floor": ("floor", "double"),
    "copysign": ("copysign", "double"),
    "as_float": ("(double)", "double"),
    "to_bits": (f"{PREFIX}to_bits", "int64_t"),
    "from_bits": (f"{PREFIX}from_bits", "double"),
}
_BEGIN = f"""\
/* Elementary functions of IEEE arithmetic alone, whose results have the same bits on every machine. Translated from the
 * Python modules plants.elementary and plants.logarithms, which explain them. A compiler must round every operation by
 * itself: gcc and clang do with -ffp-contract=off and without -ffast-math. */
#ifndef ELEMENTARY_H
#define ELEMENTARY_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#if defined(__FAST_MATH__) || !defined(FLT_EVAL_METHOD) || FLT_EVAL_METHOD != 0
#error "arithmetic of doubles has to be that of IEEE 754, without shortcuts and without excess precision"
#endif
#ifdef __GNUC__
#define ELEMENTARY_APART static __attribute__((noinline, unused))
#else
#define ELEMENTARY_APART static inline
#endif

static inline int64_t {PREFIX}to_bits(double x)
{{
    int64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}}

static inline double {PREFIX}from_bits(int64_t bits)
{{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}}

/* The remainder that has the sign of the divisor, as in Python; fmod, which is exact, has the dividend's. */
static inline double {PREFIX}mod(double dividend, double divisor)
{{
    const double rest = fmod(dividend, divisor);
    if (rest == 0.0) return copysign(0.0, divisor);
    return (rest < 0.0) != (divisor < 0.0) ? rest + divisor : rest;
}}
"""


@cache
def header() -> str:
    """Return the functions as a header in C11."""
    primitives = {primitive.__name__ for primitive in elementary.PRIMITIVES}
    functions = [
        node
        for module in _MODULES
        for node in ast.parse(inspect.getsource(module)).body
        if isinstance(node, ast.FunctionDef) and node.name not in primitives
    ]
    results = {function.name: _types(function.returns) for function in functions}
    structs = dict.fromkeys(result for result in results.values() if len(result) > 1)
    parts = [_BEGIN, *_constants(), *map(_struct, structs)]
    parts += ["\n" + "\n".join(_Function(function, results).lines()) for function in functions]
    return "\n".join([*parts, "\n#endif\n"])


def result_type(name: str) -> str:
    """Return the C type of what a function returns; the items of several are ``item_0``, ``item_1`` and so on."""
    functions = [getattr(module, name) for module in _MODULES if hasattr(module, name)]
    return _result(_types(ast.parse(functions[0].__annotations__["return"], mode="eval").body))


def _constants() -> Iterator[str]:
    """Yield a definition for each constant of the modules: a macro, or an array."""
    names = dict.fromkeys(name for module in _MODULES for name in vars(module) if name.isupper())
    for name in names:
        value = next(vars(module)[name] for module in _MODULES if name in vars(module))
        if isinstance(value, int):
            yield f"#define {_constant(name)} INT64_C({value})"
        elif isinstance(value, float):
            yield f"#define {_constant(name)} ({_number(value)})"
        elif isinstance(value, np.ndarray):
            yield f"static const int64_t {_constant(name)}[] = {{{', '.join(map(str, value.tolist()))}}};"


def _constant(name: str) -> str:
    return f"{PREFIX.upper()}{name}"


def _number(value: float) -> str:
    return "INFINITY" if math.isinf(value) else "NAN" if math.isnan(value) else value.hex()


def _types(annotation: ast.expr | None) -> tuple[str, ...]:
    """Return the C types of an annotation, several for a tuple."""
    if isinstance(annotation, ast.Subscript) and isinstance(annotation.slice, ast.Tuple):
        return tuple(_TYPES[ast.unparse(entry)] for entry in annotation.slice.elts)
    assert annotation is not None, "every function is annotated"
    return (_TYPES[ast.unparse(annotation)],)


def _result(types: tuple[str, ...]) -> str:
    return types[0] if len(types) == 1 else PREFIX + "".join(kind[0] for kind in types)


def _struct(types: tuple[str, ...]) -> str:
    members = " ".join(f"{kind} item_{i};" for i, kind in enumerate(types))
    return f"typedef struct {{ {members} }} {_result(types)};"


class _Function:
    """One function on its way to C; the type of every name follows from what it is assigned."""

    def __init__(self, function: ast.FunctionDef, results: Mapping[str, tuple[str, ...]]) -> None:
        self._function = function
        self._results = results
        self._types = {argument.arg: _types(argument.annotation)[0] for argument in function.args.args}

    def lines(self) -> Iterator[str]:
        """Yield the lines of the function."""
        name = self._function.name
        arguments = ", ".join(f"const {kind} {argument}" for argument, kind in self._types.items())
        storage = "ELEMENTARY_APART" if name.startswith("far_") else "static inline"
        yield f"{storage} {_result(self._results[name])} {PREFIX}{name}({arguments})"
        yield "{"
        for statement in self._function.body[1:]:  # the first is its docstring
            yield from (f"    {line}" for line in self._statement(statement))
        yield "}"

    def _statement(self, statement: ast.stmt) -> Iterator[str]:
        match statement:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                kind = self._types[name] = self._type(value)
                yield f"const {kind} {name} = {self._bare(value)};"
            case ast.AnnAssign(target=ast.Name(id=name), annotation=annotation, value=ast.expr() as value):
                kind = self._types[name] = _types(annotation)[0]
                yield f"const {kind} {name} = {self._bare(value)};"
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Call(func=ast.Name(id=called)) as value):
                types = self._results[called]
                both = f"{called}_of_line_{statement.lineno - self._function.lineno}"
                yield f"const {_result(types)} {both} = {self._text(value)};"
                for i, (name, kind) in enumerate(zip(map(ast.unparse, names), types, strict=True)):
                    if name != "_":
                        self._types[name] = kind
                        yield f"const {kind} {name} = {both}.item_{i};"
            case ast.If(test=test, body=[ast.Return() as result], orelse=[]):
                yield f"if ({self._bare(test)}) {next(self._statement(result))}"
            case ast.Return(value=ast.Tuple(elts=entries)):
                kind = _result(self._results[self._function.name])
                yield f"return ({kind}){{{', '.join(map(self._bare, entries))}}};"
            case ast.Return(value=ast.expr() as value):
                yield f"return {self._bare(value)};"
            case _:
                raise ValueError(f"no C is known for: {ast.unparse(statement)}")

    def _bare(self, node: ast.expr) -> str:
        """Return an expression that nothing can tear apart: without the parentheses of an operation."""
        text = self._text(node)
        return text[1:-1] if isinstance(node, ast.BinOp | ast.Compare) and not text.startswith("((int64_t)(") else text

    def _text(self, node: ast.expr) -> str:
        match node:
            case ast.BinOp(left=left, op=ast.LShift(), right=right):  # as C defines it for unsigned numbers
                return f"((int64_t)((uint64_t){self._text(left)} << {self._text(right)}))"
            case (
                ast.BinOp(left=left, op=operator, right=right)
                | ast.Compare(left=left, ops=[operator], comparators=[right])
            ):
                return f"({self._text(left)} {_OPERATORS[type(operator)]} {self._text(right)})"
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return f"(-{self._text(operand)})"
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return f"!{self._text(operand)}"
            case ast.Constant(value=int() as value):
                return f"INT64_C({value})"
            case ast.Constant(value=float() as value):
                return _number(value)
            case ast.Name(id=name):
                return _constant(name) if name.isupper() else name
            case ast.Subscript(value=ast.Call() as value, slice=ast.Constant(value=int() as index)):
                return f"{self._text(value)}.item_{index}"
            case ast.Subscript(value=value, slice=index):
                return f"{self._text(value)}[{self._bare(index)}]"
            case ast.Call(func=ast.Name(id="select"), args=[condition, a, b]):
                return f"({self._text(condition)} ? {self._text(a)} : {self._text(b)})"
            case ast.Call(func=ast.Name(id=name), args=arguments) if name in {*_PRIMITIVES, *self._results}:
                function = _PRIMITIVES[name][0] if name in _PRIMITIVES else f"{PREFIX}{name}"
                return f"{function}({', '.join(map(self._bare, arguments))})"
        raise ValueError(f"no C is known for: {ast.unparse(node)}")

    def _type(self, node: ast.expr) -> str:
        match node:
            case ast.Compare() | ast.UnaryOp(op=ast.Not()):
                return "bool"
            case ast.BinOp(left=left):  # both sides are of one type
                return self._type(left)
            case ast.UnaryOp(operand=operand):
                return self._type(operand)
            case ast.Constant(value=int() | float() as value):
                return _TYPES[type(value).__name__]
            case ast.Call(func=ast.Name(id="select"), args=[_, a, _]):
                return self._type(a)
            case ast.Call(func=ast.Name(id=name)):
                return _PRIMITIVES[name][1] if name in _PRIMITIVES else self._results[name][0]
            case ast.Subscript(value=ast.Name(id=name)):
                return "int64_t" if name.isupper() else self._types[name]
            case ast.Name(id=name):
                if not name.isupper():
                    return self._types[name]
                value = next(vars(module)[name] for module in _MODULES if name in vars(module))
                return _TYPES[type(value).__name__]
        raise ValueError(f"no type is known for: {ast.unparse(node)}")

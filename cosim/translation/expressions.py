"""Expressions of a function on their way to C."""

from __future__ import annotations

import ast
import builtins
import inspect
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import FunctionType, ModuleType
from typing import Any, Final, NoReturn

import numpy as np

from cosim.translation import meanings, values
from cosim.translation.constants import Definition, definition
from cosim.translation.kinds import BOOL, FLOAT, INT, Array, Kind, Record, Records, Scalar, Several, Struct
from cosim.translation.layout import Block, Line
from cosim.translation.names import Names, identifier
from cosim.translation.python_function import INEXACT, PythonFunction, is_inexact, plain
from cosim.translation.refusal import Untranslatable
from cosim.translation.shared import Shared
from cosim.translation.translated import Translated
from cosim.translation.values import (
    NOTHING,
    ArrayValue,
    Axis,
    Number,
    Reads,
    RecordsValue,
    RecordValue,
    Root,
    SeveralValue,
    StructValue,
    TupleValue,
    Value,
    as_float,
    full,
    is_narrow,
    overlap,
    real,
    whole,
    wide,
)

_UNKNOWN: Final = object()


class Expressions:
    """The expressions of one function; `cosim.translation.function.Function` adds the statements.

    Attributes
    ----------
    shared : Shared
        What all functions share.
    source : PythonFunction
        The function.
    env : dict
        The values of the names that are declared here.
    assigned : set
        The names that have a value here for certain.
    fixed : set
        The names whose values do not change while they are declared.
    written : set
        The memory that the function writes to.
    rows : set
        The memory of which rows are passed on or named: their constness matters.
    block : Block
        Where statements go.
    """

    def __init__(self, shared: Shared, source: PythonFunction) -> None:
        self.shared = shared
        self.source = source
        self.env: dict[str, Value] = {}
        self.assigned: set[str] = set()
        self.fixed: set[str] = set()
        self.written: set[Root] = set()
        self.rows: set[Root] = set()
        self.block = Block()
        self.views: list[tuple[Line, Root, str]] = []
        self._c_names: dict[str, str] = {}
        self._c_taken = Names()
        self._lazy = 0
        self._writes_now = False
        self._statement_call: ast.expr | None = None
        closure = inspect.getclosurevars(source.function) if source.function.__closure__ else None
        self._outer = dict(closure.nonlocals) if closure else {}

    def refuse(self, node: ast.AST, message: str) -> NoReturn:
        """Refuse a node."""
        self.source.refuse(node, message)

    def c_name(self, name: str) -> str:
        """Return the name in C of a name of the function."""
        if name not in self._c_names:
            self._c_names[name] = self.fresh(name)
        return self._c_names[name]

    def fresh(self, wanted: str) -> str:
        """Return a name in C that the function does not have yet."""
        return self._c_taken.new(self.shared.local(identifier(wanted)))

    @contextmanager
    def lazily(self) -> Iterator[None]:
        """Translate what is evaluated only sometimes."""
        self._lazy += 1
        try:
            yield
        finally:
            self._lazy -= 1

    # Names -------------------------------------------------------------------------------------------------

    def static(self, node: ast.expr) -> Any:
        """Return the Python object of a global name or of an attribute of a module; `_UNKNOWN` if it is none."""
        if isinstance(node, ast.Name):
            if node.id in self.env or node.id in self.local_names:
                return _UNKNOWN
            for names in (self._outer, self.source.function.__globals__, vars(builtins)):
                if node.id in names:
                    return names[node.id]
            return _UNKNOWN
        if isinstance(node, ast.Attribute):
            owner = self.static(node.value)
            if isinstance(owner, ModuleType) and hasattr(owner, node.attr):
                return getattr(owner, node.attr)
        return _UNKNOWN

    @property
    def local_names(self) -> set[str]:
        """Names that are the function's own."""
        raise NotImplementedError

    def _name(self, node: ast.Name) -> Value:
        if node.id in self.env:
            if node.id not in self.assigned:
                self.refuse(node, f"{node.id} may have no value here: give it one before")
            return self.env[node.id]
        if node.id in self.local_names:
            self.refuse(node, f"{node.id} may have no value here: give it one before")
        value = self.static(node)
        if value is _UNKNOWN:
            self.refuse(node, f"{node.id} is not known here")
        return self._constant(node, node.id, value)

    def _constant(self, node: ast.expr, name: str, value: Any) -> Value:
        """Return the value of a constant of a module."""
        if value is math.pi or value is np.pi:
            return real(math.pi)
        if isinstance(value, int):
            self.of_64_bits(node, value)
        if isinstance(value, bool | float | int | np.int64 | np.bool_):
            found = self._definition(node, name)
            is_known = found.module.partition(".")[0] in ("math", "numpy")
            return real(float(value)) if is_known else self.shared.constant(found, value)
        if isinstance(value, np.ndarray) and value.dtype in (np.float64, np.int64) and value.ndim and value.size:
            return self.shared.constant_array(self._definition(node, name), value)
        self.refuse(node, f"{name} is no number and no array of numbers, of 64 bits each")

    def _definition(self, node: ast.expr, name: str) -> Definition:
        """Return where a constant is defined."""
        if isinstance(node, ast.Attribute):
            owner = self.static(node.value)
            return definition(owner.__name__, getattr(owner, "__file__", ""), name)
        return definition(self.source.function.__module__, self.source.file, name)

    # Expressions -------------------------------------------------------------------------------------------

    def number(self, node: ast.expr) -> Number:
        """Return an expression that has to be a number."""
        value = self.value(node)
        if not isinstance(value, Number):
            self.refuse(node, f"{ast.unparse(node)} is not a number")
        return value

    def scalar(self, node: ast.expr) -> Number:
        """Return an expression that has to be a number and no truth value."""
        number = self.number(node)
        if number.kind is BOOL:
            self.refuse(node, f"{ast.unparse(node)} is a truth value: write 1.0 if {ast.unparse(node)} else 0.0")
        return number

    def integer(self, node: ast.expr) -> Number:
        """Return an expression that has to be a whole number."""
        number = self.number(node)
        if number.kind is not INT:
            self.refuse(node, f"{ast.unparse(node)} is {number.kind.words}, not a whole number")
        return number

    def of_64_bits(self, node: ast.expr, value: int) -> int:
        """Return a whole number that is known, if C has it."""
        if not -(2**63) <= value < 2**63:
            self.refuse(node, f"{ast.unparse(node)} has more than 64 bits")
        return value

    def truth(self, node: ast.expr) -> Number:
        """Return an expression that has to be a truth value."""
        number = self.number(node)
        if number.kind is not BOOL:
            self.refuse(
                node, f"{ast.unparse(node)} is {number.kind.words}, not a truth value: compare it, as in x != 0"
            )
        return number

    def value(self, node: ast.expr) -> Value:
        """Return an expression."""
        match node:
            case ast.Constant(value=bool() as value):
                return Number(BOOL, "true" if value else "false", constant=value)
            case ast.Constant(value=int() as value):
                return whole(self.of_64_bits(node, value))
            case ast.Constant(value=float() as value):
                return real(value)
            case ast.Name():
                return self._name(node)
            case ast.Attribute():
                return self._attribute(node)
            case ast.Subscript():
                return self._subscript(node)
            case ast.BinOp():
                return self._operation(node)
            case ast.UnaryOp():
                return self._unary(node)
            case ast.Compare():
                return self._comparison(node)
            case ast.BoolOp():
                return self._logic(node)
            case ast.IfExp(test=test, body=a, orelse=b):
                return self._choice(node, self.truth(test), a, b)
            case ast.Call():
                return self._call(node)
            case ast.Tuple(elts=entries):
                return TupleValue(tuple(self.value(entry) for entry in entries))
        self.refuse(node, f"{_in_words(node)} has no translation to C")

    def _unary(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            truth = self.truth(node.operand)
            return Number(BOOL, f"!{truth.within(values.UNARY)}", values.UNARY, truth.reads)
        if isinstance(node.op, ast.Invert):
            operand = self.integer(node.operand)
            if operand.constant is not None:
                return whole(~int(operand.constant))
            operand = wide(operand) if operand.is_narrow else operand
            return Number(INT, f"~{operand.within(values.UNARY)}", values.UNARY, operand.reads)
        operand = self.scalar(node.operand)
        if isinstance(node.op, ast.UAdd):
            return operand
        if operand.kind is INT and operand.constant is not None:
            return whole(self.of_64_bits(node, -int(operand.constant)))
        operand = wide(operand) if operand.is_narrow else operand
        text = operand.within(values.UNARY)
        text = f"({text})" if text.startswith("-") else text
        constant = None if operand.constant is None else -operand.constant
        return Number(operand.kind, f"-{text}", values.UNARY, operand.reads, constant)

    def _operation(self, node: ast.BinOp) -> Value:
        left, right = self.number(node.left), self.number(node.right)
        reads = left.reads | right.reads
        if left.kind is BOOL and right.kind is BOOL and isinstance(node.op, ast.BitAnd | ast.BitOr | ast.BitXor):
            return _of_truths(node.op, left, right)
        left, right = self.scalar(node.left), self.scalar(node.right)
        if isinstance(node.op, ast.Pow):
            self.refuse(node, "a power is rounded differently on different machines: write a product")
        if left.kind is INT and right.kind is INT and not isinstance(node.op, ast.Div):
            return self._of_integers(node, left, right)
        if type(node.op) not in meanings.ARITHMETIC:
            self.refuse(node, f"{ast.unparse(node)} needs whole numbers")
        sign, level = meanings.ARITHMETIC[type(node.op)]
        a, b = as_float(left), as_float(right)
        return Number(FLOAT, f"{a.within(level)} {sign} {b.within(level + 1)}", level, reads)

    def _of_integers(self, node: ast.BinOp, left: Number, right: Number) -> Number:
        reads, natural = left.reads | right.reads, left.is_natural and right.is_natural
        if right.constant is not None:
            if isinstance(node.op, ast.LShift | ast.RShift) and not 0 <= right.constant < 64:
                self.refuse(node, "a shift is by 0 to 63 bits")
            if isinstance(node.op, ast.FloorDiv | ast.Mod) and right.constant == 0:
                self.refuse(node, "this divides by zero")
        if left.constant is not None and right.constant is not None:
            folded = self._folded(node, int(left.constant), int(right.constant))
            if not isinstance(node.op, ast.Add | ast.Sub | ast.Mult) or "INT64" in (w := whole(folded)).text:
                return whole(folded)
            sign, level = meanings.ARITHMETIC[type(node.op)]
            text = f"{left.within(level)} {sign} {right.within(level + 1)}"
            if all(letter.isdigit() or letter in " +-*()" for letter in text):
                return w
            return Number(INT, text, level, reads, folded, folded >= 0)
        if is_narrow(left) and (is_narrow(right) or isinstance(node.op, ast.RShift)):
            left = wide(left)
        match node.op:
            case ast.Add() | ast.Sub() | ast.Mult():
                sign, level = meanings.ARITHMETIC[type(node.op)]
                text = f"{left.within(level)} {sign} {right.within(level + 1)}"
                return Number(INT, text, level, reads, None, natural and not isinstance(node.op, ast.Sub))
            case ast.FloorDiv() | ast.Mod():
                is_divided = isinstance(node.op, ast.FloorDiv)
                if natural and right.constant:
                    text = f"{left.within(values.MULTIPLY)} {'/' if is_divided else '%'} {right.within(values.UNARY)}"
                    return Number(INT, text, values.MULTIPLY, reads, None, True)
                helper = self.shared.helper("quotient" if is_divided else "modulo")
                is_natural = natural if is_divided else right.is_natural
                return Number(INT, f"{helper}({left.text}, {right.text})", values.ATOM, reads, None, is_natural)
            case ast.LShift():
                text = f"(int64_t)((uint64_t){left.within(values.UNARY)} << {right.within(values.UNARY)})"
                return Number(INT, text, values.UNARY, reads)
            case ast.BitAnd() | ast.BitOr() | ast.BitXor() | ast.RShift():
                sign, level = meanings.BITWISE[type(node.op)]
                text = f"{left.within(values.UNARY)} {sign} {right.within(values.UNARY)}"
                either = isinstance(node.op, ast.BitAnd) and (left.is_natural or right.is_natural)
                return Number(INT, text, level, reads, None, natural or either)
        self.refuse(node, f"{ast.unparse(node)} has no translation to C")

    def _folded(self, node: ast.BinOp, left: int, right: int) -> int:
        operations: dict[type[ast.operator], Callable[[int, int], int]] = {
            ast.Add: lambda a, b: a + b,
            ast.Sub: lambda a, b: a - b,
            ast.Mult: lambda a, b: a * b,
            ast.FloorDiv: lambda a, b: a // b,
            ast.Mod: lambda a, b: a % b,
            ast.LShift: lambda a, b: a << b,
            ast.RShift: lambda a, b: a >> b,
            ast.BitAnd: lambda a, b: a & b,
            ast.BitOr: lambda a, b: a | b,
            ast.BitXor: lambda a, b: a ^ b,
        }
        if type(node.op) not in operations:
            self.refuse(node, f"{ast.unparse(node)} has no translation to C")
        return self.of_64_bits(node, operations[type(node.op)](left, right))

    def _comparison(self, node: ast.Compare) -> Value:
        if len(node.ops) > 1:
            terms = [node.left, *node.comparators]
            links = [ast.Compare(a, [op], [b]) for a, op, b in zip(terms, node.ops, terms[1:], strict=False)]
            self.refuse(node, f"a chained comparison: write {' and '.join(map(ast.unparse, links))}")
        if type(node.ops[0]) not in meanings.COMPARISONS:
            self.refuse(node, "only numbers are compared, by <, <=, >, >=, == and !=")
        sign, level = meanings.COMPARISONS[type(node.ops[0])]
        left, right = self.number(node.left), self.number(node.comparators[0])
        if BOOL in (left.kind, right.kind):
            if left.kind is not right.kind or level != values.EQUAL:
                self.refuse(node, "a truth value is compared with a truth value only, by == or !=")
        elif FLOAT in (left.kind, right.kind):
            left, right = as_float(left), as_float(right)
        text = f"{left.within(values.ADD)} {sign} {right.within(values.ADD)}"
        return Number(BOOL, text, level, left.reads | right.reads)

    def _logic(self, node: ast.BoolOp) -> Value:
        sign, level = ("&&", values.AND) if isinstance(node.op, ast.And) else ("||", values.OR)
        parts = [self.truth(node.values[0])]
        with self.lazily():
            parts += [self.truth(part) for part in node.values[1:]]
        text = f" {sign} ".join(part.within(values.BIT_OR) for part in parts)
        return Number(BOOL, text, level, _all_reads(parts))

    def _choice(self, node: ast.expr, test: Number, a: ast.expr, b: ast.expr) -> Number:
        with self.lazily():
            first, second = self.number(a), self.number(b)
        if first.kind is not second.kind:
            if BOOL in (first.kind, second.kind):
                self.refuse(node, "a choice between a truth value and a number")
            first, second = as_float(first), as_float(second)
        text = f"{test.within(values.OR)} ? {first.within(values.OR)} : {second.within(values.CHOICE)}"
        natural = first.is_natural and second.is_natural
        narrow = first.kind is INT and is_narrow(first) and is_narrow(second)
        reads = _all_reads((test, first, second))
        return Number(first.kind, text, values.CHOICE, reads, None, natural, is_narrow=narrow)

    # Attributes and subscripts -----------------------------------------------------------------------------

    def _attribute(self, node: ast.Attribute) -> Value:
        found = self.static(node)
        if found is not _UNKNOWN:
            return self._constant(node, node.attr, found)
        if isinstance(node.value, ast.Name) and self.static(node.value) is not _UNKNOWN:
            self.refuse(node, f"{ast.unparse(node)} is not known here")
        owner = self.value(node.value)
        if isinstance(owner, StructValue):
            field = owner.struct.field(node.attr)
            if field is None:
                self.refuse(node, f"{owner.struct.python.__name__} has no field {node.attr}")
            return self.member(owner, *field)
        if isinstance(owner, ArrayValue):
            if node.attr == "shape":
                return TupleValue(owner.sizes)
            if node.attr == "size":
                return self._size(owner)
        self.refuse(node, f"{ast.unparse(node)} has no translation to C")

    def member(self, owner: StructValue, c_name: str, kind: Kind) -> Value:
        """Return a member of a struct."""
        return self.placed(kind, owner.member(c_name), (*owner.root, c_name), owner.reads)

    def placed(self, kind: Kind, text: str, root: Root, reads: Reads = NOTHING) -> Value:
        """Return what stands at some place as a value."""
        match kind:
            case Scalar():
                return Number(kind, text, values.ATOM, reads | {root}, root=root)
            case Array(item, shape):
                return ArrayValue(item, text, root, tuple(full(n or 0) for n in shape), False, self.is_const(root))
            case Records(layout, size):
                return RecordsValue(layout, text, size, root)
            case Struct():
                return StructValue(kind, text, False, root, reads | {root})
        raise AssertionError(kind)

    def is_const(self, root: Root) -> bool:
        """Tell whether the memory at a path is declared const."""
        raise NotImplementedError

    def _size(self, array: ArrayValue) -> Number:
        sizes = array.sizes
        if all(size.constant is not None for size in sizes):
            return whole(math.prod(int(size.constant or 0) for size in sizes))
        text = " * ".join(size.within(values.UNARY) for size in sizes)
        return Number(INT, text, values.MULTIPLY if len(sizes) > 1 else sizes[0].level, _all_reads(sizes), None, True)

    def _subscript(self, node: ast.Subscript) -> Value:
        owner = self.value(node.value)
        match owner:
            case RecordValue():
                if not (isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, str)):
                    self.refuse(node, "a record is indexed by the name of a field")
                field = owner.layout.field(node.slice.value)
                if field is None:
                    known = ", ".join(name for name, _, _ in owner.layout.fields)
                    self.refuse(node, f"there is no field {node.slice.value!r}, only {known}")
                return self.placed(field[1], owner.member(field[0]), (*owner.root, field[0]), owner.reads)
            case RecordsValue():
                if isinstance(node.slice, ast.Slice | ast.Tuple | ast.Constant) and not (
                    isinstance(node.slice, ast.Constant) and type(node.slice.value) is int
                ):
                    self.refuse(node, "an array of records is indexed by one whole number, then by a field")
                try:
                    place = self._place(node.slice, whole(owner.size))
                except _Beyond as beyond:
                    self.refuse(node, f"there are only {beyond.size} records")
                return RecordValue(owner.layout, f"{owner.text}[{place.text}]", False, owner.root, place.reads)
            case ArrayValue():
                try:
                    return self._indexed(node, owner)
                except _Beyond as beyond:
                    if not self._lazy or len(owner.free) > 1 or isinstance(node.ctx, ast.Store):
                        self.refuse(node, f"there are only {beyond.size} entries")
                    # Python raises an exception where this is worked out, so what it is does not matter
                    nothing = "(double)NAN" if owner.item is FLOAT else "0"
                    return Number(owner.item, f"{nothing} /* there is no {ast.unparse(node)} */", values.UNARY)
            case TupleValue(items):
                return items[self._static_index(node, len(items))]
            case SeveralValue():
                index = self._static_index(node, len(owner.kind.items))
                return self.placed(owner.kind.items[index], f"{owner.text}.item_{index}", ("",), owner.reads)
            case StructValue():
                fields = owner.struct.fields
                return self.member(owner, *fields[self._static_index(node, len(fields))][1:])
        self.refuse(node, f"{ast.unparse(node.value)} has no entries")

    def _static_index(self, node: ast.Subscript, size: int) -> int:
        index = self.integer(node.slice)
        if index.constant is None or not -size <= index.constant < size:
            self.refuse(node, f"a tuple of {size} is indexed by a constant")
        return int(index.constant) % size

    def _place(self, node: ast.expr, size: Number) -> Number:
        """Return an index with negative ones made positive."""
        index = self.integer(node)
        if index.constant is not None and size.constant is not None:
            if not -size.constant <= index.constant < size.constant:
                raise _Beyond(int(size.constant))
            return index if index.constant >= 0 else whole(int(index.constant + size.constant))
        if index.is_natural:
            return index
        helper = self.shared.helper("place")
        return Number(INT, f"{helper}({index.text}, {size.text})", values.ATOM, index.reads | size.reads, None, True)

    def _indexed(self, node: ast.Subscript, array: ArrayValue) -> Value:
        entries = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        free = array.free
        if len(entries) > len(free):
            self.refuse(node, f"{ast.unparse(node.value)} has {len(free)} dimensions")
        axes = list(array.axes)
        for entry, place in zip(entries, free, strict=False):
            axis = axes[place]
            if isinstance(entry, ast.Slice):
                axes[place] = self._sliced(entry, axis)
            else:
                axes[place] = replace(axis, index=along(axis, self._place(entry, axis.size)))
        whole_array = replace(array, axes=tuple(axes))
        return self.element(whole_array) if not whole_array.free else whole_array

    def element(self, array: ArrayValue) -> Number:
        """Return the number of an array all of whose dimensions are at an index."""
        indices = [axis.index for axis in array.axes if axis.index is not None]
        if array.is_flat:
            text = f"{array.base}[{_sum(indices).text}]"
        else:
            text = array.base + "".join(f"[{index.text}]" for index in indices)
        return Number(array.item, text, values.ATOM, array.reads | {array.root}, root=array.root)

    def _sliced(self, entry: ast.Slice, axis: Axis) -> Axis:
        start = whole(0) if entry.lower is None else self.integer(entry.lower)
        step = whole(1) if entry.step is None else self.integer(entry.step)
        if entry.lower is None and entry.upper is None and entry.step is None:
            return axis
        if not start.is_natural:
            self.refuse(entry, "a slice begins at a place that is not negative for certain")
        if step.constant is not None and step.constant < 1:
            self.refuse(entry, "a slice has a positive step")
        if all(part.constant is not None for part in (start, step, axis.size)) and (
            entry.upper is None or self.integer(entry.upper).constant is not None
        ):
            upper = None if entry.upper is None else int(self.integer(entry.upper).constant or 0)
            places = range(
                *slice(int(start.constant or 0), upper, int(step.constant or 1)).indices(int(axis.size.constant or 0))
            )
            size = whole(len(places))
        else:
            stop = axis.size if entry.upper is None else self.integer(entry.upper)
            parts = (start, stop, step, axis.size)
            text = f"{self.shared.helper('slice_size')}({', '.join(part.text for part in parts)})"
            size = Number(INT, text, values.ATOM, _all_reads(parts), None, True)
        return Axis(None, along(axis, start), _product(axis.step, step), size, axis.native)

    # Calls -------------------------------------------------------------------------------------------------

    def _call(self, node: ast.Call) -> Value:
        if isinstance(node.func, ast.Attribute) and self.static(node.func) is _UNKNOWN:
            return self._method(node, node.func)
        function = self.static(node.func)
        if function is _UNKNOWN:
            self.refuse(node, f"{ast.unparse(node.func)} is not known here")
        if any(isinstance(argument, ast.Starred) for argument in node.args) or any(
            k.arg is None for k in node.keywords
        ):
            self.refuse(node, "arguments are written out, without a star")
        own = plain(function)
        if is_inexact(function):
            self.refuse(node, INEXACT)
        if own in self.shared.primitives:
            return self._primitive(node, self.shared.primitives[own])
        if meanings.is_known(own):
            return self._known(node, own)
        if isinstance(own, type) and issubclass(own, tuple) and hasattr(own, "_fields"):
            return self._named_tuple(node, own)
        if isinstance(own, FunctionType):
            return self._own_call(node, own)
        hint = self.shared.instead_of(getattr(own, "__name__", ""))
        self.refuse(node, f"{ast.unparse(node.func)} has no translation to C with the same bits everywhere{hint}")

    def _method(self, node: ast.Call, method: ast.Attribute) -> Value:
        owner = self.value(method.value)
        if isinstance(owner, ArrayValue) and not node.keywords:
            if method.attr == "reshape":
                given = [self.value(argument) for argument in node.args]
                if len(given) == 1 and isinstance(given[0], TupleValue):
                    given = list(given[0].items)
                return self._reshaped(node, owner, given)
            if method.attr == "ravel" and not node.args:
                return self._reshaped(node, owner, [self._size(owner)])
        self.refuse(node, f"{ast.unparse(method)} has no translation to C")

    def _reshaped(self, node: ast.Call, array: ArrayValue, sizes: Sequence[Value]) -> ArrayValue:
        if (
            array.is_flat
            or not is_gapless(array)
            or not all(isinstance(n, Number) and n.constant is not None for n in sizes)
        ):
            self.refuse(node, "only an array without gaps gets another shape, of sizes that are known")
        shape = [int(n.constant or 0) for n in sizes if isinstance(n, Number)]
        total = self._size(array)
        if total.constant != math.prod(shape):
            self.refuse(node, f"{total.text} numbers do not make the shape {tuple(shape)}")
        const = "const " if array.is_const else ""
        inner = "".join(f"[{n}]" for n in shape[1:])
        pointer = f"({const}{array.item.value} {f'(*){inner}' if inner else '*'})"
        base = f"({pointer}{self.pointer(array)})"
        return ArrayValue(array.item, base, array.root, tuple(full(n) for n in shape), False, array.is_const)

    def _arguments(self, node: ast.Call, count: int) -> list[ast.expr]:
        if node.keywords or len(node.args) != count:
            self.refuse(node, f"{ast.unparse(node.func)} takes {count} arguments here, by their places")
        return node.args

    def _primitive(self, node: ast.Call, name: str) -> Value:
        if name == "select":
            test, a, b = self._arguments(node, 3)
            return self._choice(node, self.truth(test), a, b)
        c, kinds, result = meanings.PRIMITIVES[name]
        given = [self.scalar(argument) for argument in self._arguments(node, len(kinds))]
        for argument, number, kind in zip(node.args, given, kinds, strict=True):
            if kind is INT and number.kind is not INT:
                self.refuse(argument, f"{ast.unparse(argument)} is {number.kind.words}, not a whole number")
        texts = [as_float(number) if kind is FLOAT else number for number, kind in zip(given, kinds, strict=True)]
        if c.startswith("("):
            return Number(result, f"{c}{texts[0].within(values.UNARY)}", values.UNARY, _all_reads(given))
        if c in meanings.HELPERS:
            self.shared.helper(c)
        return Number(result, f"{c}({', '.join(number.text for number in texts)})", values.ATOM, _all_reads(given))

    def _known(self, node: ast.Call, function: Any) -> Value:
        if function is len:
            (argument,) = self._arguments(node, 1)
            owner = self.value(argument)
            match owner:
                case ArrayValue():
                    return owner.sizes[0]
                case RecordsValue():
                    return whole(owner.size)
                case TupleValue(items):
                    return whole(len(items))
            self.refuse(node, f"{ast.unparse(argument)} has no length")
        if function in (np.empty, np.zeros):
            self.refuse(node, "an array is made by an assignment to a new name, with its sizes as constants")
        if function in (min, max):
            if node.keywords or len(node.args) < 2:
                self.refuse(node, f"{function.__name__} takes two numbers or more")
            given = [self.scalar(argument) for argument in node.args]
            if len({number.kind for number in given}) > 1:
                self.refuse(node, "a whole number and a float side by side: write 1.0 for 1, float(i) for i")
            helper = self.shared.helper(meanings.EXTREMES[function, given[0].kind])
            result = given[0]
            for number in given[1:]:
                naturals = (result.is_natural, number.is_natural)
                natural = all(naturals) if function is min else any(naturals)
                text = f"{helper}({result.text}, {number.text})"
                result = Number(result.kind, text, values.ATOM, result.reads | number.reads, None, natural)
            return result
        if function is abs:
            number = self.scalar(self._arguments(node, 1)[0])
            name = "fabs" if number.kind is FLOAT else self.shared.helper("magnitude")
            return Number(number.kind, f"{name}({number.text})", values.ATOM, number.reads, None, number.kind is INT)
        if function is float:
            return as_float(self.scalar(self._arguments(node, 1)[0]))
        if function is int:
            number = self.scalar(self._arguments(node, 1)[0])
            if number.kind is INT:
                return number
            return Number(INT, f"(int64_t){number.within(values.UNARY)}", values.UNARY, number.reads)
        if function in meanings.INTEGER_FUNCTIONS:
            number = self.scalar(self._arguments(node, 1)[0])
            if number.kind is INT:
                return number
            name = meanings.INTEGER_FUNCTIONS[function]
            return Number(INT, f"(int64_t){name}({number.text})", values.UNARY, number.reads)
        if function in meanings.FLOAT_TESTS:
            number = as_float(self.scalar(self._arguments(node, 1)[0]))
            text = f"{meanings.FLOAT_TESTS[function]}({number.text})"
            return Number(BOOL, f"{text} != 0", values.EQUAL, number.reads)
        name, count = meanings.FLOAT_FUNCTIONS[function]
        given = [as_float(self.scalar(argument)) for argument in self._arguments(node, count)]
        return Number(FLOAT, f"{name}({', '.join(n.text for n in given)})", values.ATOM, _all_reads(given))

    def bound(self, node: ast.Call, function: Any, names: Sequence[str]) -> list[ast.expr]:
        """Return the arguments of a call in the order of the parameters; defaults are constants."""
        try:
            signature = inspect.signature(function)
            given = signature.bind(
                *node.args, **{keyword.arg: keyword.value for keyword in node.keywords if keyword.arg}
            )
        except TypeError as error:
            self.refuse(node, f"{ast.unparse(node.func)}: {error}")
        result = []
        for name in names:
            argument = given.arguments.get(name, signature.parameters[name].default)
            if not isinstance(argument, ast.AST):
                if type(argument) not in (bool, int, float):
                    self.refuse(node, f"the default of {name} is no number")
                argument = ast.copy_location(ast.Constant(argument), node)
            result.append(argument)
        return result

    def _named_tuple(self, node: ast.Call, python: Any) -> Value:
        if python.__bases__ != (tuple,):
            self.refuse(node, f"{python.__name__} is no plain named tuple")
        given = [self.value(argument) for argument in self.bound(node, python, python._fields)]
        for argument, value in zip(node.args, given, strict=False):
            if not isinstance(value, Number | StructValue) or (
                isinstance(value, StructValue) and value.struct.has_memory
            ):
                self.refuse(argument, f"a {python.__name__} that is made here holds numbers and named tuples of them")
        struct = self.shared.struct(python, tuple(kind_of(value) for value in given))
        parts = []
        for (_, c_name, _), value in zip(struct.fields, given, strict=True):
            assert isinstance(value, Number | StructValue)
            parts.append(f".{c_name} = {value.text if isinstance(value, Number) else by_value(value)}")
        reads = _all_reads(value for value in given if isinstance(value, Number | StructValue))
        return StructValue(struct, f"({struct.name}){{{', '.join(parts)}}}", False, ("",), reads)

    def _own_call(self, node: ast.Call, function: FunctionType) -> Value:
        called = self.shared.source_of(function, self.source, node)
        own = called.tree.args
        names = [argument.arg for argument in (*own.posonlyargs, *own.args, *own.kwonlyargs)]
        given = [self.value(argument) for argument in self.bound(node, function, names)]
        view = self.inlined(called, dict(zip(names, given, strict=True)))
        if view is not None:
            return view
        for value, argument in zip(given, node.args, strict=False):
            if isinstance(value, TupleValue | SeveralValue):
                self.refuse(argument, "a tuple is passed on entry by entry, or as a named tuple")
        naturals = frozenset(
            place for place, value in enumerate(given) if isinstance(value, Number) and value.is_natural
        )
        translated = self.shared.function(called, tuple(self._kind_to_pass(value) for value in given), naturals)
        self._note_writes(node, translated, given)
        if translated.result is None and node is not self._statement_call:
            self.refuse(node, f"{ast.unparse(node.func)} returns nothing")
        if translated.writes and node is not self._statement_call:
            self.refuse(node, f"{ast.unparse(node.func)} writes into an array: call it in a statement of its own")
        self._writes_now = self._writes_now or bool(translated.writes)
        text = f"{translated.name}({', '.join(self._passed(translated, given))})"
        reads = _all_reads(value for value in given if not isinstance(value, TupleValue | RecordsValue))
        reads |= {
            value.root for value in given if isinstance(value, ArrayValue | RecordValue | RecordsValue | StructValue)
        }
        return self.result_of(translated, text, reads)

    def result_of(self, translated: Translated, text: str, reads: Reads) -> Value:
        """Return what a call gives back."""
        match translated.result:
            case Scalar() as kind:
                return Number(kind, text, values.ATOM, reads, None, translated.is_natural)
            case Struct() as struct:
                return StructValue(struct, text, False, ("",), reads)
            case Several() as several:
                return SeveralValue(several, text, reads)
        return Number(BOOL, text, values.ATOM, reads)  # nothing: a statement of its own

    def inlined(self, called: PythonFunction, given: dict[str, Value]) -> Value | None:
        """Return the view of an array that a function of nothing but names and one ``return`` gives."""
        *before, last = called.body or [ast.Pass()]
        if not isinstance(last, ast.Return) or last.value is None:
            return None
        if not isinstance(last.value, ast.Subscript | ast.Name | ast.Attribute | ast.Call):
            return None
        inner = Inlined(self.shared, called, given, self)
        try:
            for statement in before:
                match statement:
                    case (
                        ast.Assign(targets=[ast.Name(id=name)], value=value)
                        | ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value)
                    ):
                        inner.env[name] = inner.value(value)
                        inner.assigned.add(name)
                        if not isinstance(inner.env[name], ArrayValue | RecordValue | RecordsValue):
                            return None
                    case _:
                        return None
            if isinstance(last.value, ast.Call) and not isinstance(last.value.func, ast.Attribute):
                return None
            found = inner.value(last.value)
        except Untranslatable:
            return None
        return found if isinstance(found, ArrayValue | RecordValue | RecordsValue) else None

    def _kind_to_pass(self, value: Value) -> Kind:
        if isinstance(value, ArrayValue) and len(value.free) > 1:
            self.rows.add(value.root)
        return kind_of(value)

    def _note_writes(self, node: ast.Call, translated: Translated, given: Sequence[Value]) -> None:
        """Note what a called function writes into, and refuse that two of its arguments are the same memory."""
        for place, roots in translated.writes.items():
            value = given[place]
            assert isinstance(value, ArrayValue | RecordValue | RecordsValue | StructValue)
            for root in roots:
                path = (*value.root, *root)
                self.write(node, path, isinstance(value, ArrayValue) and value.is_const)
                for other, beside in enumerate(given):
                    if other == place or not isinstance(beside, ArrayValue | RecordValue | RecordsValue | StructValue):
                        continue
                    if isinstance(beside, StructValue) and not beside.struct.has_memory:
                        continue
                    if overlap(path, beside.root) and not _are_apart(value, beside):
                        self.refuse(
                            node, f"two arguments may be parts of one array, {'.'.join(path)}, which is written"
                        )

    def write(self, node: ast.AST, root: Root, is_const: bool = False) -> None:
        """Note that memory is written."""
        if is_const or root[0] == "const":
            self.refuse(node, f"{'.'.join(root[1:] or root)} is a constant: it cannot be written")
        self.written.add(root)

    def _passed(self, translated: Translated, given: Sequence[Value]) -> list[str]:
        texts = []
        for place, (value, kind) in enumerate(zip(given, translated.kinds, strict=True)):
            match value:
                case Number():
                    texts.append(as_float(value).text if kind is FLOAT else value.text)
                case ArrayValue():
                    texts.append(self.pointer(value))
                    for axis, needed in zip(value.free, translated.more.get(place, ()), strict=False):
                        step, size = needed
                        if step:
                            texts.append(self._flat_step(value, axis).text)
                        if size:
                            texts.append(value.axes[axis].size.text)
                case RecordValue():
                    texts.append(value.address)
                case RecordsValue():
                    texts.append(value.text)
                case StructValue() if value.struct.has_memory:
                    texts.append(value.text if value.is_pointer else f"&{value.text}")
                case StructValue():
                    texts.append(by_value(value))
        return texts

    def _flat_step(self, array: ArrayValue, axis: int) -> Number:
        """Return how many numbers apart two entries of a dimension are."""
        if array.is_flat:
            return array.axes[axis].step
        inner = whole(1)
        for other in array.axes[axis + 1 :]:
            inner = _product(inner, whole(other.native))
        return _product(array.axes[axis].step, inner)

    def pointer(self, array: ArrayValue) -> str:
        """Return an expression for the address of the first entry of an array, as its rows where it has rows."""
        if is_gapless(array) and (len(array.free) == 1 or all(size.constant is not None for size in array.sizes)):
            return array.base + "".join(f"[{axis.index.text}]" for axis in array.axes if axis.index is not None)
        starts = [axis.start if axis.index is None else axis.index for axis in array.axes]
        if array.is_flat:
            start = _sum(starts)
            return array.base if start.constant == 0 else f"{array.base} + {start.within(values.ADD + 1)}"
        return f"&{array.base}" + "".join(f"[{start.text}]" for start in starts)


class _Beyond(Exception):
    """A constant index is beyond the entries."""

    def __init__(self, size: int) -> None:
        self.size = size
        super().__init__()


class Inlined(Expressions):
    """The expressions of a function that only names views of arrays: its text is put in the place of the call."""

    def __init__(self, shared: Shared, source: PythonFunction, given: dict[str, Value], outer: Expressions) -> None:
        super().__init__(shared, source)
        self.env, self.assigned = dict(given), set(given)
        self._around = outer
        self._locals = set(given)

    @property
    def local_names(self) -> set[str]:
        """Names that are the function's own."""
        return self._locals

    def is_const(self, root: Root) -> bool:
        """Tell whether the memory at a path is declared const."""
        return self._around.is_const(root)


def kind_of(value: Value) -> Kind:
    """Return the kind of a value that is passed on."""
    match value:
        case Number(kind):
            return kind
        case ArrayValue():
            return _array_kind(value)
        case RecordsValue(layout, _, size):
            return Records(layout, size)
        case RecordValue(layout):
            return Record(layout)
        case StructValue(struct):
            return struct
        case SeveralValue(kind):
            return kind
    raise AssertionError(value)


def _array_kind(value: ArrayValue) -> Array:
    shape = tuple(None if size.constant is None else int(size.constant) for size in value.sizes)
    const = value.is_const and len(shape) > 1
    if is_gapless(value) and None not in shape:
        return Array(value.item, shape, None, const)
    steps = []
    for place in value.free:
        step = value.axes[place].step
        if not value.is_flat:
            for other in value.axes[place + 1 :]:
                step = _product(step, whole(other.native))
        steps.append(None if step.constant is None else int(step.constant))
    return Array(value.item, shape, tuple(steps), const)


def is_gapless(array: ArrayValue) -> bool:
    """Tell whether an array is a whole array of C, or one of its rows."""
    if array.is_flat:
        return len(array.axes) == 1 and array.axes[0].start.constant == 0 and array.axes[0].step.constant == 1
    free = array.free
    return (
        free == tuple(range(len(array.axes) - len(free), len(array.axes)))
        and all(array.axes[place].start.constant == 0 and array.axes[place].step.constant == 1 for place in free)
        and all(array.axes[place].size.constant == array.axes[place].native for place in free[1:])
    )


def _are_apart(a: Value, b: Value) -> bool:
    """Tell whether two parts of one array have no entry in common: at different constant indices."""
    if not (isinstance(a, ArrayValue) and isinstance(b, ArrayValue) and a.base == b.base and not a.is_flat):
        return False
    return any(
        one.index is not None
        and other.index is not None
        and one.index.constant is not None
        and other.index.constant is not None
        and one.index.constant != other.index.constant
        for one, other in zip(a.axes, b.axes, strict=False)
    )


def by_value(value: StructValue) -> str:
    """Return a struct of numbers as an expression."""
    return f"*{value.text}" if value.is_pointer else value.text


def along(axis: Axis, index: Number) -> Number:
    """Return the index in C of an entry of a dimension."""
    if axis.start.constant == 0 and axis.step.constant == 1:
        return index
    return _sum([axis.start, _product(index, axis.step)])


def _product(a: Number, b: Number) -> Number:
    for one, other in ((a, b), (b, a)):
        if one.constant == 1:
            return other
        if one.constant == 0:
            return whole(0)
    if a.constant is not None and b.constant is not None:
        return whole(int(a.constant * b.constant))
    text = f"{a.within(values.MULTIPLY)} * {b.within(values.UNARY)}"
    return Number(INT, text, values.MULTIPLY, a.reads | b.reads, None, a.is_natural and b.is_natural)


def _sum(numbers: Sequence[Number]) -> Number:
    parts = [number for number in numbers if number.constant != 0]
    if not parts:
        return whole(0)
    if len(parts) == 1:
        return parts[0]
    text = " + ".join(part.within(values.ADD if place == 0 else values.MULTIPLY) for place, part in enumerate(parts))
    return Number(INT, text, values.ADD, _all_reads(parts), None, all(part.is_natural for part in parts))


def _of_truths(operator: ast.operator, left: Number, right: Number) -> Number:
    reads = left.reads | right.reads
    if isinstance(operator, ast.BitXor):
        return Number(BOOL, f"{left.within(values.ADD)} != {right.within(values.ADD)}", values.EQUAL, reads)
    sign, level = ("&&", values.AND) if isinstance(operator, ast.BitAnd) else ("||", values.OR)
    return Number(BOOL, f"{left.within(values.BIT_OR)} {sign} {right.within(values.BIT_OR)}", level, reads)


def _all_reads(parts: Iterable[Number | ArrayValue | RecordValue | StructValue | SeveralValue]) -> Reads:
    return frozenset().union(*(part.reads for part in parts))


def _in_words(node: ast.AST) -> str:
    words = {
        ast.List: "a list",
        ast.Dict: "a dictionary",
        ast.Set: "a set",
        ast.ListComp: "a comprehension",
        ast.GeneratorExp: "a generator",
        ast.Lambda: "a lambda",
        ast.JoinedStr: "a string",
        ast.NamedExpr: "an assignment within an expression",
        ast.Slice: "a slice",
        ast.Starred: "a star",
        ast.Await: "await",
        ast.Yield: "yield",
    }
    if isinstance(node, ast.Constant):
        return repr(node.value)
    return words.get(type(node), ast.unparse(node))

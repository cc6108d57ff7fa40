"""A function on its way to C: its statements."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import FunctionType

import numpy as np

from cosim.translation import meanings, values
from cosim.translation.expressions import Expressions, along, by_value, is_gapless, kind_of
from cosim.translation.kinds import BOOL, FLOAT, INT, Array, Kind, Record, Records, Scalar, Several, Struct
from cosim.translation.layout import Block, Compound, Line, comment, is_read, wrapped
from cosim.translation.liveness import ends, loaded, needed, needed_in_loop, returns, stored, times_stored
from cosim.translation.python_function import PythonFunction, plain
from cosim.translation.shared import Shared
from cosim.translation.translated import Translated
from cosim.translation.values import (
    NOTHING,
    ArrayValue,
    Axis,
    Number,
    RecordsValue,
    RecordValue,
    Root,
    SeveralValue,
    StructValue,
    TupleValue,
    Value,
    as_float,
    full,
    overlap,
    whole,
)


@dataclass(frozen=True)
class Hoisted:
    """A name that is declared before the block in which it gets its value; its kind is not known before that."""

    line: Line


class Function(Expressions):
    """One function for arguments of just these kinds."""

    def __init__(
        self,
        shared: Shared,
        source: PythonFunction,
        kinds: Sequence[Kind],
        naturals: frozenset[int],
        name: str,
        const: frozenset[str] = frozenset(),
        result: Scalar | Several | None = None,
        is_entry: bool = False,
    ) -> None:
        super().__init__(shared, source)
        self._name_in_c = name
        self._const = const
        self._kinds = tuple(kinds)
        self._is_entry = is_entry
        self._result: Scalar | Struct | Several | None = result
        self._naturals: list[bool] = []
        self._hoisted: dict[str, Hoisted] = {}
        self._statements: list[ast.stmt] = source.body
        self._seen_line = 0
        self._returns_value = any(
            isinstance(node, ast.Return) and not _is_nothing(node.value) for node in ast.walk(source.tree)
        )
        arguments = source.tree.args
        if arguments.vararg or arguments.kwarg:
            self.refuse(source.tree, "a function has a fixed number of parameters")
        self._names = [a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
        self._locals = stored([source.tree]) | set(self._names)
        for own in (*self._names, *sorted(self._locals)):  # before any name that is made up
            self.c_name(own)
        self._parameters: dict[str, Value] = {}
        for own, kind in zip(self._names, self._kinds, strict=True):
            value = self._parameter(own, kind)
            if not times_stored(self._statements, own) and not isinstance(value, ArrayValue):
                self.fixed.add(self.c_name(own))
                if isinstance(value, Number) and len(self._parameters) in naturals:
                    value = replace(value, is_natural=True)
            self._parameters[own] = self.env[own] = value
            self.assigned.add(own)

    @property
    def local_names(self) -> set[str]:
        """Names that are the function's own."""
        return self._locals

    def is_const(self, root: Root) -> bool:
        """Tell whether the memory at a path is declared const."""
        return root[0] in self._const or root[0] == "const"

    def _parameter(self, name: str, kind: Kind) -> Value:
        c = self.c_name(name)
        match kind:
            case Scalar():
                return Number(kind, c, values.ATOM, frozenset({(c,)}))
            case Array(item, shape, None, const):
                return ArrayValue(item, c, (c,), tuple(full(n or 0) for n in shape), False, const or c in self._const)
            case Array(item, shape, steps):
                axes = []
                for place, (size, step) in enumerate(zip(shape, steps or (), strict=True)):
                    tail = f"_{place + 1}" if len(shape) > 1 else ""
                    step_c = whole(step) if step is not None else self._extra(f"{c}_step{tail}", False)
                    size_c = whole(size) if size is not None else self._extra(f"{c}_size{tail}", True)
                    axes.append(Axis(None, whole(0), step_c, size_c, 0))
                return ArrayValue(item, c, (c,), tuple(axes), True, kind.const)
            case Record(layout):
                return RecordValue(layout, c, True, (c,))
            case Records(layout, size):
                return RecordsValue(layout, c, size, (c,))
            case Struct():
                return StructValue(kind, c, kind.has_memory, (c,), frozenset({(c,)}))
        raise AssertionError(kind)

    def _extra(self, wanted: str, is_natural: bool) -> Number:
        name = self.fresh(wanted)
        self.fixed.add(name)
        return Number(INT, name, values.ATOM, frozenset({(name,)}), None, is_natural)

    # The whole ---------------------------------------------------------------------------------------------

    def translated(self) -> Translated:
        """Translate the function."""
        if not returns(self._statements) and self._returns_value:
            self.refuse(self.source.tree, "a function that returns a value ends with a return on every way")
        first = self._statements[0].lineno if self._statements else 1
        self._seen_line = first - 1
        self._sequence(self._statements, set())
        self._finish_views()
        body = self.block.without_unused()
        used = set(re.findall(r"\w+", re.sub(r"/\*.*?\*/", "", " ".join(body.lines(1)))))
        more = self._more(used)
        parameters = list(self._declared(more))
        unused = [c for c in (self.c_name(name) for name in self._names) if not is_read(c, body.items)]
        body.items[:0] = [Line(f"(void){name};") for name in unused]
        result = (
            self._result.name
            if isinstance(self._result, Struct | Several)
            else ("void" if self._result is None else self._result.value)
        )
        head = f"{result} {self._name_in_c}({', '.join(parameters) or 'void'})"
        docs = comment(self.source.docstring, 0) + "\n" if self.source.docstring else ""
        shown = "\n".join(wrapped(head if self._is_entry else f"static {head}", 0))
        lines = "\n".join(body.lines(1))
        writes: dict[int, frozenset[Root]] = {}
        for place, name in enumerate(self._names):
            roots = frozenset(root[1:] for root in self.written if root[0] == self.c_name(name))
            if roots and not isinstance(self._kinds[place], Scalar):
                writes[place] = roots
        return Translated(
            self._name_in_c,
            self._kinds,
            self._result,
            bool(self._naturals) and all(self._naturals),
            writes,
            more,
            head,
            f"{docs}{shown}\n{{\n{lines}\n}}\n" if lines else f"{docs}{shown}\n{{\n}}\n",
        )

    @property
    def unwritten(self) -> frozenset[str]:
        """The parameters with memory that is not written, but for arrays: C's own callers could not pass theirs on."""
        return frozenset(
            c
            for name, kind in zip(self._names, self._kinds, strict=True)
            if not isinstance(kind, Scalar | Array)
            for c in (self.c_name(name),)
            if not any(root[0] == c for root in self.written)
        )

    @property
    def has_rows_of_unwritten(self) -> bool:
        """Whether rows of such memory are named or passed on: the constness of these has to be known."""
        return any(root[0] in self.unwritten for root in self.rows)

    def _more(self, used: set[str]) -> dict[int, tuple[tuple[bool, bool], ...]]:
        found = {}
        for place, name in enumerate(self._names):
            value = self._parameters[name]
            if isinstance(value, ArrayValue) and value.is_flat:
                found[place] = tuple(
                    (
                        axis.step.constant is None and axis.step.text in used,
                        axis.size.constant is None and axis.size.text in used,
                    )
                    for axis in value.axes
                )
        return found

    def _declared(self, more: Mapping[int, tuple[tuple[bool, bool], ...]]) -> Iterable[str]:
        for place, (name, kind) in enumerate(zip(self._names, self._kinds, strict=True)):
            c = self.c_name(name)
            is_written = any(root[0] == c for root in self.written)
            const = "" if is_written else "const "
            match kind:
                case Scalar():
                    yield f"{kind.value} {c}"
                case Array(item, shape, None) if len(shape) > 1 and 0 not in shape:
                    const = "const " if c in self._const or kind.const else ""
                    yield f"{const}{item.value} {c}" + "".join(f"[{n}]" for n in shape)
                case Array(item, shape, None) if 0 not in shape:
                    yield f"{const}{item.value} {c}[{shape[0]}]"
                case Array(item):
                    yield f"{const}{item.value} *{c}"
                    value = self._parameters[name]
                    assert isinstance(value, ArrayValue)
                    for axis, (step, size) in zip(value.axes, more.get(place, ()), strict=False):
                        yield from [f"int64_t {axis.step.text}"] * step
                        yield from [f"int64_t {axis.size.text}"] * size
                case Record(layout):
                    yield f"{const}{layout.name} *{c}"
                case Records(layout, size):
                    yield f"{const}{layout.name} {c}[{size}]"
                case Struct() if kind.has_memory:
                    yield f"{const}{kind.name} *{c}"
                case Struct():
                    yield f"{kind.name} {c}"

    def _finish_views(self) -> None:
        """Decide which pointers are to const, once all writes are known."""
        for line, root, pattern in self.views:
            is_const = not any(overlap(root, other) for other in self.written)
            line.text = pattern.replace("@", "const " if is_const else "")

    # Statements --------------------------------------------------------------------------------------------

    def _sequence(self, statements: Sequence[ast.stmt], behind: set[str], around: set[str] = frozenset()) -> None:  # type: ignore[assignment]
        """Translate the statements of a block; names behind it are needed behind it."""
        self._open, outer_statements = statements, getattr(self, "_open", statements)
        for place, statement in enumerate(statements):
            rest = statements[place + 1 :]
            self._comments_before(statement)
            live = needed(rest, behind, around)
            if isinstance(statement, ast.If | ast.For | ast.While):
                self._hoist(statement, live)
            self._statement(statement, live, around)
            self._seen_line = max(self._seen_line, statement.end_lineno or 0)
            if ends([statement]) and rest:
                self.refuse(rest[0], "nothing leads here")
        self._open = outer_statements

    def _comments_before(self, statement: ast.stmt) -> None:
        for line in range(self._seen_line + 1, statement.lineno):
            if line in self.source.comments:
                self.block.add(f"/* {self.source.comments[line][0]} */")
            elif not self.source.lines[line - 1].strip():
                self.block.add("")
        self._seen_line = max(self._seen_line, statement.lineno - 1)

    def _trailing(self, node: ast.AST) -> None:
        """Put the comments at the end of a statement's lines before it."""
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1):  # type: ignore[attr-defined]
            if line in self.source.comments:
                self.block.add(f"/* {self.source.comments[line][0]} */")

    def _hoist(self, statement: ast.If | ast.For | ast.While, live: set[str]) -> None:
        """Declare names before a statement in whose blocks they get their values, if they are needed behind."""
        if isinstance(statement, ast.If):
            inside = stored(statement.body) | stored(statement.orelse)
        else:
            inside = stored(statement.body)
            live = needed_in_loop(statement, live)
        for name in sorted(inside & live):
            if name not in self.env and name not in self._hoisted:
                c = self.c_name(name)
                self._hoisted[name] = Hoisted(self.block.add("", c))

    def _statement(self, statement: ast.stmt, live: set[str], around: set[str]) -> None:
        self._writes_now = False
        match statement:
            case ast.If():
                self._if(statement, live, around)
            case ast.For():
                self._for(statement, live)
            case ast.While():
                self._while(statement, live)
            case ast.Assign(targets=[target], value=value):
                self._trailing(statement)
                self._assign(statement, target, value)
            case ast.Assign():
                self.refuse(statement, "several assignments at once: write them one after the other")
            case ast.AnnAssign(target=ast.Name() as target, value=ast.expr() as value):
                self._trailing(statement)
                self._assign(statement, target, value)
            case ast.AugAssign():
                self._trailing(statement)
                self._change(statement)
            case ast.Return():
                self._trailing(statement)
                self._return(statement)
            case ast.Expr(value=ast.Constant()) | ast.Pass() | ast.AnnAssign(value=None):
                pass
            case ast.Expr(value=ast.Call() as call):
                self._trailing(statement)
                self._call_alone(call)
            case ast.Break():
                self.block.add("break;")
            case ast.Continue():
                self.block.add("continue;")
            case _:
                names = {
                    ast.With: "with",
                    ast.Try: "try",
                    ast.FunctionDef: "a function within a function",
                    ast.Assert: "assert",
                    ast.Raise: "raise",
                    ast.Delete: "del",
                    ast.Import: "import",
                    ast.Global: "global",
                    ast.Nonlocal: "nonlocal",
                    ast.Match: "match",
                    ast.ClassDef: "a class",
                }
                self.refuse(statement, f"{names.get(type(statement), 'this statement')} has no translation to C")

    def _inner(self, statements: Sequence[ast.stmt], behind: set[str], around: set[str]) -> tuple[Block, set[str]]:
        """Translate a block of its own; return it, and the names that have a value at its end."""
        outer, env, assigned, fixed = self.block, dict(self.env), set(self.assigned), set(self.fixed)
        hoisted = dict(self._hoisted)
        self.block = Block()
        with self.lazily():
            self._sequence(statements, behind, around)
        inner, at_end = self.block, self.assigned
        self._hoisted = hoisted
        self.block, self.env, self.assigned = outer, {**env, **self._declared_hoisted(env)}, assigned
        self.fixed = fixed
        return inner, at_end

    def _declared_hoisted(self, env: Mapping[str, Value]) -> dict[str, Value]:
        """Return the hoisted names that have got their kinds meanwhile."""
        return {name: self.env[name] for name in self._hoisted if name in self.env and name not in env}

    def _if(self, statement: ast.If, live: set[str], around: set[str]) -> None:
        parts: list[tuple[str, Block]] = []
        ways: list[set[str]] = []
        head, node = "", statement
        while True:
            test = self.truth(node.test) if not parts else self._lazy_truth(node.test)
            block, at_end = self._inner(node.body, live, around)
            parts.append((f"{head}if ({test.text})", block))
            if not ends(node.body):
                ways.append(at_end)
            if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If) and self._is_elif(node.orelse[0]):
                head, node = "else ", node.orelse[0]
                self._seen_line = max(self._seen_line, node.lineno - 1)
                continue
            break
        if node.orelse:
            block, at_end = self._inner(node.orelse, live, around)
            parts.append(("else", block))
            if not ends(node.orelse):
                ways.append(at_end)
        else:
            ways.append(set(self.assigned))
        self.block.items.append(Compound(parts))
        if ways:
            self.assigned = set.intersection(*ways) & set(self.env)

    def _lazy_truth(self, node: ast.expr) -> Number:
        with self.lazily():
            return self.truth(node)

    def _is_elif(self, node: ast.If) -> bool:
        return self.source.lines[node.lineno - 1].strip().startswith("elif")

    def _for(self, loop: ast.For, live: set[str]) -> None:
        if loop.orelse:
            self.refuse(loop, "else of a loop has no translation to C")
        call = loop.iter
        if not (
            isinstance(call, ast.Call)
            and self.static(call.func) is range
            and 1 <= len(call.args) <= 3
            and not call.keywords
            and isinstance(loop.target, ast.Name)
        ):
            self.refuse(loop, "a loop runs over range(...) with one name")
        name = loop.target.id
        if name in self.env or name in self._hoisted:
            self.refuse(
                loop, f"{name} has a value before the loop or is needed behind it: take another name for the loop"
            )
        if times_stored(loop.body, name):
            self.refuse(loop, f"the loop's {name} is assigned within the loop: take another name there")
        if name in live:
            self.refuse(loop, f"{name} is needed behind its loop: keep it under another name")
        bounds = [self.integer(argument) for argument in call.args]
        start = whole(0) if len(bounds) == 1 else bounds[0]
        stop = bounds[0] if len(bounds) == 1 else bounds[1]
        step = bounds[2] if len(bounds) == 3 else whole(1)
        if step.constant is None or step.constant == 0:
            self.refuse(call, "the step of a loop is a constant other than zero")
        c = self.c_name(name)
        stop = self._kept(stop, f"{c}_stop", loop.body)
        sign = "<" if step.constant > 0 else ">"
        change = {1: f"{c}++", -1: f"{c}--"}.get(int(step.constant))
        down = whole(self.of_64_bits(call, -int(step.constant)))
        change = change or (f"{c} += {step.text}" if step.constant > 0 else f"{c} -= {down.text}")
        head = f"for (int64_t {c} = {start.text}; {c} {sign} {stop.within(values.ADD)}; {change})"
        env, fixed, assigned = self.env, self.fixed, self.assigned
        natural = start.is_natural and step.constant > 0
        self.env = {**env, name: Number(INT, c, values.ATOM, frozenset({(c,)}), None, natural)}
        self.fixed, self.assigned = fixed | {c}, assigned | {name}
        self._loops = [*self._loops, name]
        head_live = needed_in_loop(loop, live)
        block, _ = self._inner(loop.body, head_live, head_live)
        hoisted = self._declared_hoisted(env)
        self._loops = self._loops[:-1]
        self.env, self.fixed, self.assigned = {**env, **hoisted}, fixed, assigned
        self.block.items.append(Compound([(head, block)]))

    _loops: list[str] = []  # noqa: RUF012

    def _while(self, loop: ast.While, live: set[str]) -> None:
        if loop.orelse:
            self.refuse(loop, "else of a loop has no translation to C")
        head_live = needed_in_loop(loop, live)
        test = self._lazy_truth(loop.test)
        assigned = set(self.assigned)
        block, _ = self._inner(loop.body, head_live, head_live)
        self.assigned = assigned
        self.block.items.append(Compound([(f"while ({test.text})", block)]))

    def _kept(self, number: Number, name: str, body: Sequence[ast.stmt]) -> Number:
        """Return a number as it is now: in a name of its own if the statements of a body may change it."""
        changed = {self.c_name(own) for own in stored(body)}
        if all(len(root) == 1 and root[0] not in changed and self._is_number(root[0]) for root in number.reads):
            return number
        c = self.fresh(name)
        self.block.add(f"const int64_t {c} = {number.text};", c)
        self.fixed.add(c)
        return Number(INT, c, values.ATOM, frozenset({(c,)}), None, number.is_natural)

    def _is_number(self, c: str) -> bool:
        return any(isinstance(value, Number) and value.text == c for value in self.env.values()) or c in self.fixed

    def _return(self, statement: ast.Return) -> None:
        if statement.value is None or _is_nothing(statement.value):
            if self._returns_value:
                self.refuse(statement, "nothing is returned here, and a value elsewhere")
            self.block.add("return;")
            return
        value = self.value(statement.value)
        match value:
            case Number(kind):
                self._result_is(statement, kind)
                self._naturals.append(value.is_natural)
                text = as_float(value).text if self._result is FLOAT else value.text
                self.block.add(f"return {text};")
            case StructValue(struct):
                if struct.has_memory:
                    self.refuse(statement, "a function returns numbers and named tuples of numbers")
                self._result_is(statement, struct)
                self.block.add(f"return {by_value(value)};")
            case TupleValue(items):
                kinds = []
                for entry, item in zip(
                    getattr(statement.value, "elts", [statement.value] * len(items)), items, strict=True
                ):
                    if not isinstance(item, Number | StructValue) or (
                        isinstance(item, StructValue) and item.struct.has_memory
                    ):
                        self.refuse(entry, "a function returns numbers and named tuples of numbers")
                    kinds.append(kind_of(item))
                if not kinds:
                    self.refuse(statement, "an empty tuple")
                self._result_is(statement, self.shared.several(tuple(kinds)))
                assert isinstance(self._result, Several)
                texts = [
                    (as_float(item).text if kind is FLOAT else item.text)
                    if isinstance(item, Number)
                    else by_value(item)
                    for item, kind in zip(items, self._result.items, strict=True)
                    if isinstance(item, Number | StructValue)
                ]
                self.block.add(f"return ({self._result.name}){{{', '.join(texts)}}};")
            case SeveralValue(kind):
                self._result_is(statement, kind)
                self.block.add(f"return {value.text};")
            case _:
                self.refuse(statement, "a function returns numbers; an array is passed in to be filled")

    def _result_is(self, node: ast.AST, kind: Scalar | Struct | Several) -> None:
        """Note the kind of the result; kinds that differ are joined, and the function begun anew with that."""
        if self._result is None:
            self._result = kind
        elif self._result != kind:
            joined = self._joined(self._result, kind)
            if joined is None:
                self.refuse(node, "this is another kind of result than that of another return")
            if joined != self._result:
                raise _OtherResult(joined)

    def _joined(self, a: Kind, b: Kind) -> Scalar | Several | None:
        if {a, b} == {FLOAT, INT}:
            return FLOAT
        if isinstance(a, Several) and isinstance(b, Several) and len(a.items) == len(b.items):
            items = [x if x == y else self._joined(x, y) for x, y in zip(a.items, b.items, strict=True)]
            return None if None in items else self.shared.several(tuple(item for item in items if item is not None))
        return None

    def _call_alone(self, call: ast.Call) -> None:
        function = self.static(call.func)
        own = plain(function) if callable(function) else None
        if isinstance(own, FunctionType) and not call.args and not call.keywords and self.shared.does_nothing(own):
            return
        self._statement_call = call
        value = self.value(call)
        self._statement_call = None
        if isinstance(value, TupleValue | ArrayValue | RecordValue | RecordsValue):
            return
        self.block.add(f"{value.text};")

    # Assignments -------------------------------------------------------------------------------------------

    def _assign(self, statement: ast.stmt, target: ast.expr, node: ast.expr) -> None:
        if isinstance(target, ast.Tuple):
            self._assign_several(statement, target.elts, node)
            return
        if isinstance(target, ast.Name) and self._is_array_made(node):
            self._make_array(target, node)
            return
        if isinstance(node, ast.Call):
            self._statement_call = node
        value = self.value(node)
        self._statement_call = None
        if isinstance(target, ast.Name):
            self._store_name(target, value)
        else:
            if self._writes_now and isinstance(value, Number):  # C may look for the place before the call
                value = self._kept_value(node, value)
            self._store(target, value)

    def _is_array_made(self, node: ast.expr) -> bool:
        return isinstance(node, ast.Call) and self.static(node.func) in (np.empty, np.zeros)

    def _make_array(self, target: ast.Name, node: ast.expr) -> None:
        assert isinstance(node, ast.Call)
        if len(node.args) != 1 or node.keywords:
            self.refuse(node, "an array is made of its sizes alone; its numbers are floats")
        given = self.value(node.args[0])
        sizes = given.items if isinstance(given, TupleValue) else (given,)
        shape = [int(n.constant) for n in sizes if isinstance(n, Number) and n.kind is INT and n.constant is not None]
        if len(shape) != len(sizes) or any(n < 1 for n in shape):
            self.refuse(node, "the sizes of an array are positive constants")
        if target.id in self.env or target.id in self._hoisted:
            self.refuse(target, f"{target.id} is another array before or behind: give it another name")
        c = self.c_name(target.id)
        start = " = {0}" if self.static(node.func) is np.zeros else ""
        self.block.add(f"double {c}{''.join(f'[{n}]' for n in shape)}{start};", c)
        self.written.add((c,))
        self.env[target.id] = ArrayValue(FLOAT, c, (c,), tuple(full(n) for n in shape))
        self.assigned.add(target.id)

    def _assign_several(self, statement: ast.stmt, targets: Sequence[ast.expr], node: ast.expr) -> None:
        if any(isinstance(target, ast.Tuple | ast.List | ast.Starred) for target in targets):
            self.refuse(statement, "targets within targets, or with a star")
        if isinstance(node, ast.Call):
            self._statement_call = node
        value = self.value(node)
        self._statement_call = None
        items = self._items(statement, value, node)
        if len(items) != len(targets):
            self.refuse(statement, f"{len(items)} values for {len(targets)} names")
        places = [None if isinstance(target, ast.Name) else self._target(target) for target in targets]
        # Python works out all values before it stores the first; where that makes a difference, they are kept
        changed: list[Root] = []
        for target, place in zip(targets, places, strict=True):
            root = (self.c_name(target.id),) if isinstance(target, ast.Name) else self._root_of(place)
            changed.append(root)
        for place_in, item in enumerate(items[1:], 1):
            if any(overlap(root, read) for root in changed[:place_in] for read in _depends(item)):
                items[place_in] = self._kept_value(targets[place_in], item)
        for target, place, own in zip(targets, places, range(len(items)), strict=True):
            later = [_target_reads(other) for other in places[own + 1 :] if other is not None]
            if any(overlap(changed[own], read) for reads in later for read in reads):
                self.refuse(target, "a place behind depends on this: write one assignment after the other")
            if isinstance(target, ast.Name):
                if target.id != "_" or target.id in loaded(self._statements):
                    self._store_name(target, items[own])
            else:
                self._store(target, items[own], place)

    def _items(self, statement: ast.stmt, value: Value, node: ast.expr) -> list[Value]:
        match value:
            case TupleValue(items):
                return list(items)
            case SeveralValue(kind):
                c = self._short_name(node, "result")
                self.block.add(f"const {kind.name} {c} = {value.text};", c, self._writes_now)
                return [self.placed(item, f"{c}.item_{place}", (c,)) for place, item in enumerate(kind.items)]
            case StructValue(struct):
                if value.root == ("",):
                    c = self._short_name(node, struct.python.__name__.lower())
                    self.block.add(f"const {struct.name} {c} = {value.text};", c, self._writes_now)
                    value = StructValue(struct, c, False, (c,), frozenset({(c,)}))
                return [self.member(value, c_name, kind) for _, c_name, kind in struct.fields]
            case ArrayValue() if value.free and value.sizes[0].constant is not None:
                size = int(value.sizes[0].constant or 0)
                place = value.free[0]
                return [self._at(value, place, k) for k in range(size)]
        self.refuse(statement, f"{ast.unparse(node)} is not a tuple")

    def _at(self, array: ArrayValue, place: int, k: int) -> Value:
        axis = array.axes[place]
        index = whole(k)
        axes = (*array.axes[:place], replace(axis, index=along(axis, index)), *array.axes[place + 1 :])
        part = replace(array, axes=axes)
        return part if part.free else self.element(part)

    def _short_name(self, node: ast.expr, otherwise: str) -> str:
        """Return a name that is free for what a call returns."""
        wanted = otherwise
        if isinstance(node, ast.Call):
            wanted = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", otherwise)
        wanted = wanted.lstrip("_")
        return self.fresh(f"{wanted}_of" if wanted in self._locals else wanted)

    def _kept_value(self, node: ast.expr, item: Value) -> Value:
        if not isinstance(item, Number):
            self.refuse(node, "the order of these assignments matters: write them one after the other")
        c = self._short_name(node, "value")
        self.block.add(f"const {item.kind.value} {c} = {item.text};", c, self._writes_now)
        return Number(item.kind, c, values.ATOM, frozenset({(c,)}), None, item.is_natural)

    def _target(self, target: ast.expr) -> Value:
        if not isinstance(target, ast.Subscript):
            self.refuse(target, f"{ast.unparse(target)} cannot be assigned: only names, entries and fields are")
        return self.value(target)

    def _root_of(self, value: Value | None) -> Root:
        match value:
            case ArrayValue(root=root):
                return root
            case Number(root=root) if root is not None:
                return root
        raise AssertionError(value)

    def _store(self, target: ast.expr, value: Value, place: Value | None = None) -> None:
        """Store into an entry or a field."""
        assert isinstance(target, ast.Subscript) or place is not None
        place = self._target(target) if place is None else place
        if isinstance(place, ArrayValue):
            self._store_array(target, place, value)
            return
        if not isinstance(place, Number):
            self.refuse(target, f"{ast.unparse(target)} cannot be assigned as a whole")
        if not isinstance(value, Number):
            self.refuse(target, "only a number is stored in an entry or a field")
        root = self._memory_of(target)
        self.write(target, root[0], root[1])
        if place.kind is FLOAT:
            text = as_float(value).text
        elif place.kind is value.kind:
            text = value.text
        else:
            self.refuse(target, f"{value.kind.words} in the place of {place.kind.words}")
        self.block.add(f"{place.text} = {text};")

    def _memory_of(self, target: ast.expr) -> tuple[Root, bool]:
        """Return the path to the memory that a target is in, and whether that is const."""
        assert isinstance(target, ast.Subscript)
        owner = self.value(target.value)
        match owner:
            case ArrayValue():
                return owner.root, owner.is_const and len(owner.free) > 1
            case RecordValue():
                field = owner.layout.field(target.slice.value) if isinstance(target.slice, ast.Constant) else None  # type: ignore[arg-type]
                return (*owner.root, field[0] if field else ""), False
        self.refuse(target, f"{ast.unparse(target)} cannot be assigned")

    def _store_array(self, target: ast.expr, place: ArrayValue, value: Value) -> None:
        """Store into all entries of an array."""
        if isinstance(value, ArrayValue):
            if overlap(place.root, value.root):
                self.refuse(target, "an array is copied onto a part of itself")
            if [n.text for n in value.sizes] != [n.text for n in place.sizes]:
                self.refuse(target, "only an array of the same shape is copied")
        elif not isinstance(value, Number) or value.kind is BOOL:
            self.refuse(target, "only a number or an array is stored in an array")
        elif any(overlap(place.root, read) for read in value.reads):
            value = self._kept_value(target, value)
            assert isinstance(value, Number)
        # What is written may change no index, as Python takes them before the first entry is written.
        root = place.root
        place = self._placed_now(target, place, root)
        value = self._placed_now(target, value, root) if isinstance(value, ArrayValue) else value
        if (value.item if isinstance(value, ArrayValue) else value.kind) is FLOAT and place.item is INT:
            self.refuse(target, "floats in the place of whole numbers")
        self.write(target, place.root, place.is_const)
        outer = block = self.block
        indices = []
        for depth, size in enumerate(place.sizes):
            wanted = "ijkl"[depth : depth + 1]
            c = wanted if wanted and wanted not in self._c_names.values() else self.fresh(f"index_{depth + 1}")
            block = Block()
            head = f"for (int64_t {c} = 0; {c} < {size.text}; {c}++)"
            self.block.items.append(Compound([(head, block)]))
            self.block = block
            indices.append(Number(INT, c, values.ATOM, frozenset({(c,)}), None, True))
        into = self._entry(place, indices)
        given = self._entry(value, indices) if isinstance(value, ArrayValue) else value
        given = as_float(given) if into.kind is FLOAT else given
        block.add(f"{into.text} = {given.text};")
        self.block = outer

    def _placed_now(self, node: ast.expr, array: ArrayValue, written: Root) -> ArrayValue:
        """Return an array whose place no longer depends on what is written: such numbers get names of their own."""

        def now(number: Number) -> Number:
            if not any(overlap(written, read) for read in number.reads):
                return number
            kept = self._kept_value(node, number)
            assert isinstance(kept, Number)
            return kept

        axes = (
            replace(axis, index=now(axis.index))
            if axis.index is not None
            else replace(axis, start=now(axis.start), step=now(axis.step), size=now(axis.size))
            for axis in array.axes
        )
        return replace(array, axes=tuple(axes))

    def _entry(self, array: ArrayValue, indices: Sequence[Number]) -> Number:
        axes = list(array.axes)
        for place, index in zip(array.free, indices, strict=True):
            axes[place] = replace(axes[place], index=along(axes[place], index))
        return self.element(replace(array, axes=tuple(axes)))

    def _store_name(self, target: ast.Name, value: Value) -> None:
        name, c = target.id, self.c_name(target.id)
        if name in self._loops:
            self.refuse(target, f"{name} is the name of a loop: take another")
        match value:
            case Number():
                self._store_number(target, name, c, value)
            case StructValue(struct) if not struct.has_memory:
                self._store_struct(target, name, c, value)
            case SeveralValue():
                self.refuse(target, "a tuple is taken apart where it is returned: write a, b = f(...)")
            case TupleValue():
                self.refuse(target, "a tuple is taken apart where it is made: write a, b = x, y")
            case _:
                self._name_view(target, name, c, value)
        self.assigned.add(name)

    def _declare(self, name: str, c: str, kind: str, text: str) -> bool:
        """Declare a new name with its value; return whether it never changes from then on."""
        if name in self._hoisted:
            self._hoisted[name].line.text = f"{kind} {c};"
            self.block.add(f"{c} = {text};")
            return False
        is_fixed = times_stored(self._open, name) == 1
        self.block.add(f"{'const ' if is_fixed else ''}{kind} {c} = {text};", c, self._writes_now)
        if is_fixed:
            self.fixed.add(c)
        return is_fixed

    def _store_number(self, target: ast.Name, name: str, c: str, value: Number) -> None:
        if name in self.env:
            own = self.env[name]
            if not isinstance(own, Number):
                self.refuse(target, f"{name} is no number before: give this another name")
            if own.kind is not value.kind and not (own.kind is FLOAT and value.kind is INT):
                self.refuse(
                    target, f"{name} is {own.kind.words} before, and {value.kind.words} here: write 0.0 for 0 before"
                )
            self.block.add(f"{c} = {as_float(value).text if own.kind is FLOAT else value.text};")
            return
        is_fixed = self._declare(name, c, value.kind.value, value.text)
        natural = is_fixed and value.is_natural
        constant = value.constant if is_fixed and value.kind is INT else None
        self.env[name] = Number(value.kind, c, values.ATOM, frozenset({(c,)}), constant, natural)

    def _store_struct(self, target: ast.Name, name: str, c: str, value: StructValue) -> None:
        if name in self.env:
            own = self.env[name]
            if not isinstance(own, StructValue) or own.struct != value.struct:
                self.refuse(target, f"{name} is something else before: give this another name")
            self.block.add(f"{c} = {by_value(value)};")
            return
        self._declare(name, c, value.struct.name, by_value(value))
        self.env[name] = StructValue(value.struct, c, False, (c,), frozenset({(c,)}))

    def _name_view(self, target: ast.Name, name: str, c: str, value: Value) -> None:
        """Give a name to an array or a record: a pointer, or just another name for the same."""
        if name in self.env or name in self._hoisted or times_stored(self._open, name) > 1:
            self.refuse(target, f"{name} names several arrays or records: give each its own name")
        match value:
            case RecordValue(layout):
                line = self.block.add("", c)
                self.views.append((line, value.root, f"@{layout.name} *{c} = {value.address};"))
                self.env[name] = replace(value, text=c, is_pointer=True, reads=NOTHING)
            case RecordsValue(layout):
                line = self.block.add("", c)
                self.views.append((line, value.root, f"@{layout.name} *{c} = {value.text};"))
                self.env[name] = replace(value, text=c)
            case ArrayValue():
                self.env[name] = self._named_array(target, c, value)
            case StructValue():
                self.env[name] = value

    def _named_array(self, target: ast.Name, c: str, value: ArrayValue) -> ArrayValue:
        item, free = value.item.value, value.free
        gapless = is_gapless(value) and all(size.constant is not None for size in value.sizes)
        if gapless and len(free) == 1:
            line = self.block.add("", c)
            place = _bare(self.pointer(value))
            self.views.append((line, value.root, f"@{item} *{c} = {place};"))
            return replace(value, base=c, axes=(full(int(value.sizes[0].constant or 0)),))
        if gapless and not value.is_flat:
            self.rows.add(value.root)
            shape = [int(size.constant or 0) for size in value.sizes]
            const = "const " if value.is_const else ""
            inner = "".join(f"[{n}]" for n in shape[1:])
            self.block.add(f"{const}{item} (*{c}){inner} = {self.pointer(value)};", c)
            return replace(value, base=c, axes=tuple(full(n) for n in shape))
        if not all(len(root) == 1 and root[0] in self.fixed for root in value.reads):
            self.refuse(target, "the place of this view may change: give its index a name that is assigned once")
        if len(value.axes) == 1:
            axis = value.axes[0]
            start = axis.start
            base = _bare(value.base)
            place = base if start.constant == 0 else f"{base} + {start.within(values.ADD)}"
            line = self.block.add("", c)
            self.views.append((line, value.root, f"@{item} *{c} = {place};"))
            size = axis.size
            if size.constant is None:
                size_c = self.fresh(f"{target.id}_size")
                self.block.add(f"const int64_t {size_c} = {size.text};", size_c)
                self.fixed.add(size_c)
                size = Number(INT, size_c, values.ATOM, frozenset({(size_c,)}), None, True)
            return replace(value, base=c, axes=(Axis(None, whole(0), axis.step, size, 0),), is_flat=True)
        return value

    def _change(self, statement: ast.AugAssign) -> None:
        """Translate ``+=`` and its like."""
        value = self.scalar(statement.value)
        target = statement.target
        if isinstance(target, ast.Name):
            own = self.value(ast.copy_location(ast.Name(target.id, ast.Load()), target))
            if target.id in self._loops:
                self.refuse(target, f"{target.id} is the name of a loop: take another")
        else:
            own = self._target(target)
        if not isinstance(own, Number):
            self.refuse(statement, "only a number is changed")
        if not isinstance(target, ast.Name):
            self.write(target, *self._memory_of(target))
        if own.kind is INT and value.kind is FLOAT:
            self.refuse(statement, f"{ast.unparse(target)} is a whole number, and a float is added: write 0.0 before")
        if own.kind is BOOL:
            self.refuse(statement, f"{ast.unparse(target)} is a truth value")
        if own.kind is INT and type(statement.op) not in (ast.Add, ast.Sub, ast.Mult):
            self.refuse(statement, "write the operation out, as in a = a // b")
        if type(statement.op) not in meanings.ARITHMETIC:
            self.refuse(statement, f"{ast.unparse(statement)} has no translation to C")
        sign, _ = meanings.ARITHMETIC[type(statement.op)]
        value = as_float(value) if own.kind is FLOAT else value
        self.block.add(f"{own.text} {sign}= {value.text};")


def _is_nothing(node: ast.expr | None) -> bool:
    """Tell whether a function returns nothing by this."""
    return node is None or (isinstance(node, ast.Constant) and node.value is None)


def _bare(pointer: str) -> str:
    """Return a pointer without the parentheses about the whole of a conversion."""
    return pointer[1:-1] if re.fullmatch(r"\(\([^()]*\*\)[^()]*\)", pointer) else pointer


class _OtherResult(Exception):
    """The returns of a function have kinds that are joined to another one."""

    def __init__(self, kind: Scalar | Several) -> None:
        self.kind = kind
        super().__init__()


def _depends(value: Value) -> Iterable[Root]:
    match value:
        case Number() | StructValue() | SeveralValue():
            return value.reads
        case ArrayValue():
            return {value.root, *value.reads}
    return ()


def _target_reads(value: Value) -> Iterable[Root]:
    """Return what the place of a target depends on, besides the memory that it is in."""
    match value:
        case Number(reads=reads):
            return reads - {value.root} if value.root is not None else reads
        case ArrayValue():
            return value.reads
    return ()


def translated(
    shared: Shared,
    source: PythonFunction,
    kinds: tuple[Kind, ...],
    naturals: frozenset[int],
    name: str,
    is_entry: bool,
) -> Translated:
    """Translate a function for arguments of some kinds, of which some are known not to be negative.

    Two things are known only at its end, for which it is begun anew: the kind that all returns have in common, and what
    memory it does not write, where rows of that are passed on.
    """
    const: frozenset[str] = frozenset()
    result: Scalar | Several | None = None
    state = shared.state()
    while True:
        function = Function(shared, source, kinds, naturals, name, const, result, is_entry)
        try:
            found = function.translated()
        except _OtherResult as other:
            result = other.kind
        else:
            if const or not function.has_rows_of_unwritten:
                return found
            const = function.unwritten
        shared.restore(state)

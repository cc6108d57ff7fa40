"""What the functions of a file share: names, structs, constants, and the functions themselves."""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Callable, Iterable
from types import FunctionType
from typing import Any

import numpy as np

from cosim.errors import Location
from cosim.translation import meanings
from cosim.translation.constants import Constant, Definition
from cosim.translation.kinds import BOOL, FLOAT, INT, Array, Kind, Layout, Records, Scalar, Several, Struct
from cosim.translation.names import RESERVED, Names, identifier, type_name
from cosim.translation.python_function import INEXACT, PythonFunction, is_inexact, plain, python_function
from cosim.translation.refusal import Untranslatable
from cosim.translation.translated import Translated
from cosim.translation.values import ArrayValue, Number, Value, full, real, whole


class Shared:
    """What the functions of a file share.

    Parameters
    ----------
    name
        The file.
    primitives
        Functions with a meaning of their own.
    reserved
        Names that no function may take for its own.
    translated
        Translates a function.
    """

    def __init__(
        self,
        name: str,
        primitives: Iterable[Callable[..., Any]],
        reserved: frozenset[str],
        translated: Callable[[Shared, PythonFunction, tuple[Kind, ...], frozenset[int], str, bool], Translated],
    ) -> None:
        self._translator = translated
        self.name = identifier(name)
        self.primitives = {plain(function): function.__name__ for function in primitives}
        for function, own in self.primitives.items():
            if own != "select" and own not in meanings.PRIMITIVES:
                known = ", ".join([*meanings.PRIMITIVES, "select"])
                raise Untranslatable(f"{own} of {function.__module__} is no primitive: known are {known}")
        self._reserved = reserved
        self._names = Names(RESERVED)
        self.local_names: set[str] = set()
        self._structs: dict[tuple[Any, tuple[Kind, ...]], Struct] = {}
        self._several: dict[tuple[Kind, ...], Several] = {}
        self._layouts: dict[tuple[str, Any], Layout] = {}
        self._constants: dict[tuple[Any, ...], Constant] = {}
        self._helpers: dict[str, str] = {}
        self._functions: dict[tuple[FunctionType, tuple[Kind, ...], frozenset[int] | str], Translated] = {}
        self._in_progress: list[FunctionType] = []
        self.public: list[Struct | Several | Layout] = []
        self.dtypes: dict[str, np.dtype[Any]] = {}

    @property
    def global_names(self) -> set[str]:
        """The names in C of functions, constants and types."""
        texts = {
            constant.value.base if isinstance(constant.value, ArrayValue) else constant.value.text
            for constant in self._constants.values()
            if isinstance(constant.value, Number | ArrayValue)
        }
        structs: list[Struct | Several | Layout] = [*self._structs.values(), *self._several.values()]
        types = {own.name for own in (*structs, *self._layouts.values())}
        return {function.name for function in self._functions.values()} | texts | set(self._helpers.values()) | types

    def local(self, name: str) -> str:
        """Return a name of a function's own."""
        while name in self._reserved and not name.endswith("_"):
            name = f"{name}_"
        self.local_names.add(name)
        return name

    # Entries -----------------------------------------------------------------------------------------------

    def entry(self, entry_name: str, entry: Callable[..., Any], arguments: tuple[Any, ...]) -> Translated:
        """Translate a function that others call, for examples of its arguments."""
        function = plain(entry)
        if not isinstance(function, FunctionType):
            raise Untranslatable(f"{entry!r} is no function that is written with def")
        source = python_function(function)
        if is_inexact(entry):
            source.refuse(source.tree, INEXACT)
        names = list(inspect.signature(function).parameters)
        if len(names) != len(arguments):
            raise Untranslatable(
                f"{function.__qualname__} takes {len(names)} arguments, {len(arguments)} are given as examples",
                source.where(source.tree),
            )
        where = source.where(source.tree)
        kinds = tuple(self._kind_of(argument, name, where) for name, argument in zip(names, arguments, strict=True))
        name = self._names.new(f"{self.name}_{identifier(entry_name)}")
        translated = self._translated(source, kinds, frozenset(), name, True)
        self._functions[function, kinds, name] = translated  # others, also of the same function, have other names
        self._publish(translated.result)
        return translated

    def _publish(self, kind: Kind | None) -> None:
        """Let the header state the struct that an entry returns, and those in it."""
        if isinstance(kind, Struct):
            for _, _, own in kind.fields:
                self._publish(own)
        elif isinstance(kind, Several):
            for own in kind.items:
                self._publish(own)
        if isinstance(kind, Struct | Several) and kind not in self.public:
            self.public.append(kind)

    def _kind_of(self, value: Any, name: str, where: Location) -> Kind:
        """Return the kind of an example."""
        if isinstance(value, bool | np.bool_):
            return BOOL
        if isinstance(value, int | np.int64):
            return INT
        if isinstance(value, float):
            return FLOAT
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            kinds = [self._kind_of(item, field, where) for field, item in zip(value._fields, value, strict=True)]
            return self.struct(type(value), tuple(kinds), is_public=True)
        if isinstance(value, np.ndarray) and value.dtype.names is not None and value.ndim == 1:
            return Records(self._layout(name, value.dtype, where), len(value))
        if isinstance(value, np.ndarray) and value.dtype in (np.float64, np.int64) and value.ndim:
            if value.size and not value.flags.c_contiguous:
                raise Untranslatable(f"the example of {name} is an array with gaps: give one without", where)
            return Array(FLOAT if value.dtype == np.float64 else INT, value.shape)
        raise Untranslatable(
            f"the example of {name} is {type(value).__name__}: expected a number, an array of float64 or int64, a "
            "structured array or a named tuple of these",
            where,
        )

    def _layout(self, name: str, dtype: np.dtype[Any], where: Location) -> Layout:
        key = name, dtype
        if key in self._layouts:
            return self._layouts[key]
        fields: list[tuple[str, str, Scalar | Array]] = []
        size, names = 0, Names()
        for field in dtype.names or ():
            own, offset = dtype.fields[field][:2]  # type: ignore[index]
            if own.base not in (np.float64, np.int64) or offset != size:
                raise Untranslatable(
                    f"field {field!r} of {name} is {own}: expected numbers of 64 bits, without gaps", where
                )
            item = FLOAT if own.base == np.float64 else INT
            fields.append((field, names.new(identifier(field)), Array(item, own.shape) if own.shape else item))
            size += own.itemsize
        layout = Layout(self._names.new(type_name(self.name, name)), tuple(fields), dtype.itemsize)
        self._layouts[key] = layout
        if size:
            self.public.append(layout)
            self.dtypes[layout.name] = dtype
        return layout

    # Types -------------------------------------------------------------------------------------------------

    def struct(self, python: Any, kinds: tuple[Kind, ...], is_public: bool = False) -> Struct:
        """Return the struct of a named tuple."""
        key = python, kinds
        if key not in self._structs:
            names = Names()
            fields = tuple(
                (field, names.new(identifier(field)), kind) for field, kind in zip(python._fields, kinds, strict=True)
            )
            own = type_name(python.__name__)
            is_told = not is_public or own.startswith(type_name(self.name))  # TeamRecords of team, not TeamTeamRecords
            name = own if is_told else type_name(self.name, python.__name__)
            struct = Struct(self._names.new(name), python, fields)
            self._structs[key] = struct
            if is_public:
                self.public.append(struct)
                self.dtypes[struct.name] = self._dtype(struct)
        return self._structs[key]

    def _dtype(self, struct: Struct) -> np.dtype[Any]:
        """Return a struct as a data type of NumPy."""
        rows: list[Any] = []
        for field, _, kind in struct.fields:
            match kind:
                case Scalar():
                    rows.append((field, {FLOAT: np.float64, INT: np.int64, BOOL: np.bool_}[kind]))
                case Array(item, shape) if 0 not in shape:
                    rows.append((field, np.float64 if item is FLOAT else np.int64, shape))
                case Records(layout, size) if size and layout.size:
                    rows.append((field, self.dtypes[layout.name], (size,)))
                case Struct():
                    rows.append((field, self.dtypes[kind.name]))
        return np.dtype(rows, align=True)

    def several(self, kinds: tuple[Kind, ...]) -> Several:
        """Return the struct of a tuple."""
        if kinds not in self._several:
            wanted = f"Doubles{len(kinds)}" if set(kinds) == {FLOAT} else "Several"
            self._several[kinds] = Several(self._names.new(wanted), kinds)
        return self._several[kinds]

    # Functions ---------------------------------------------------------------------------------------------

    def source_of(self, function: FunctionType, caller: PythonFunction, node: ast.AST) -> PythonFunction:
        """Return the text of a called function."""
        if function in self._in_progress:
            caller.refuse(node, f"{function.__qualname__} calls itself, by way of others or directly")
        return python_function(function)

    def does_nothing(self, function: FunctionType) -> bool:
        """Tell whether a function has no statements."""
        try:
            body = python_function(function).body
        except Untranslatable:
            return False
        return all(isinstance(statement, ast.Pass) for statement in body)

    def function(self, source: PythonFunction, kinds: tuple[Kind, ...], naturals: frozenset[int]) -> Translated:
        """Return a function for arguments of some kinds, of which some are known not to be negative."""
        key = source.function, kinds, naturals
        if key not in self._functions:
            name = self._names.new(identifier(source.name))
            self._functions[key] = self._translated(source, kinds, naturals, name, False)
        return self._functions[key]

    def _translated(
        self, source: PythonFunction, kinds: tuple[Kind, ...], naturals: frozenset[int], name: str, is_entry: bool
    ) -> Translated:
        self._in_progress.append(source.function)
        translated = self._translator(self, source, kinds, naturals, name, is_entry)
        self._in_progress.pop()
        return translated

    def state(self) -> tuple[Any, ...]:
        """Return what `restore` goes back to."""
        return dict(self._functions), self._names.copy()

    def restore(self, state: tuple[Any, ...]) -> None:
        """Forget the functions that were translated since."""
        functions, names = state
        self._functions, self._names = dict(functions), names.copy()

    @property
    def functions(self) -> list[Translated]:
        """The functions, callees first."""
        return list(self._functions.values())

    def helper(self, name: str) -> str:
        """Return the name in C of a helper."""
        if name not in self._helpers:
            self._helpers[name] = name
        return name

    @property
    def helpers(self) -> list[str]:
        """The helpers that are used, in the order of their definitions."""
        return [name for name in meanings.HELPERS if name in self._helpers]

    def instead_of(self, name: str) -> str:
        """Return a hint at an elementary function of this name beside the primitives."""
        for primitive in self.primitives:
            own = getattr(primitive, "__globals__", {}).get(name)
            if isinstance(own, FunctionType):
                return f"; {own.__module__}.{name} has one"
        return ""

    # Constants ---------------------------------------------------------------------------------------------

    def constant(self, definition: Definition, value: Any) -> Value:
        """Return a number that a module names."""
        if isinstance(value, bool | np.bool_):
            return Number(BOOL, "true" if value else "false", constant=bool(value))
        if not math.isfinite(value):
            return real(float(value))
        key = definition.short, repr(value)
        if key not in self._constants:
            c = self._names.new(identifier(definition.short))
            if isinstance(value, int | np.int64):
                own = whole(int(value))
                text = (
                    f"static const int64_t {c} = {own.text};"
                    if "INT64" in own.text
                    else f"enum {{ {c} = {own.text} }};"
                )
                number = Number(INT, c, constant=int(value), is_natural=int(value) >= 0)
            else:
                text = f"static const double {c} = {real(float(value)).text};"
                number = Number(FLOAT, c, constant=float(value))
            self._constants[key] = Constant(number, text, definition)
        return self._constants[key].value

    def constant_array(self, definition: Definition, value: np.ndarray[Any, Any]) -> Value:
        """Return an array of numbers that a module names."""
        key = definition.short, value.shape, value.dtype, value.tobytes()
        if key not in self._constants:
            c = self._names.new(identifier(definition.short))
            item = FLOAT if value.dtype.kind == "f" else INT
            sizes = "".join(f"[{n}]" for n in value.shape)
            text = f"static const {item.value} {c}{sizes} = {_braces(value)};"
            array = ArrayValue(item, c, ("const", definition.name), tuple(full(n) for n in value.shape), False, True)
            self._constants[key] = Constant(array, text, definition)
        return self._constants[key].value

    @property
    def constants(self) -> list[Constant]:
        """The constants that functions use."""
        return [*self._constants.values()]

    @property
    def private(self) -> list[Struct | Several]:
        """The structs that only the source file knows."""
        own: list[Struct | Several] = [*self._structs.values(), *self._several.values()]
        return [struct for struct in own if struct not in self.public]


def _braces(value: np.ndarray[Any, Any]) -> str:
    """Return an array as an initialiser."""
    if value.ndim:
        return f"{{{', '.join(map(_braces, value))}}}"
    return real(float(value)).text if value.dtype.kind == "f" else whole(int(value)).text

"""Compilation that takes long is told, once."""

import ast
import importlib
import math
import pkgutil
import sys
from pathlib import Path
from typing import Any

import formation_controllers
import pytest
from formation_controllers.dependencies import of_function

import cosim
from cosim import compiling
from cosim.compiled import COMPILED, _own
from cosim.master import loop, moves

pytestmark = pytest.mark.skipif(not COMPILED, reason="nothing is compiled")


def compile_two() -> None:
    import numba

    for number in range(2):
        numba.njit(lambda x, number=number: x + number)(1.0)


@pytest.mark.parametrize(("long", "times"), [(0.0, 1), (math.inf, 0)])
def test_long_compilation_is_told_once(monkeypatch: pytest.MonkeyPatch, long: float, times: int) -> None:
    compiling.watch_numba()
    monkeypatch.setattr(compiling, "LONG", long)
    said: list[str] = []
    with compiling.told(lambda: said.append("compiling")):
        compile_two()
    assert said == ["compiling"] * times


def test_nothing_is_told_after_the_block(monkeypatch: pytest.MonkeyPatch) -> None:
    compiling.watch_numba()
    said: list[str] = []
    with compiling.told(lambda: said.append("compiling")):
        pass
    monkeypatch.setattr(compiling, "LONG", 0.0)
    compile_two()
    assert not said


@pytest.mark.parametrize("package", [cosim, formation_controllers])
def test_compiled_functions_refer_to_sources_that_count(package: Any) -> None:
    """Kept code is found by a checksum of these sources: a name from elsewhere could have another meaning since."""
    from numba.core.dispatcher import Dispatcher

    modules = [
        importlib.import_module(one.name) for one in pkgutil.walk_packages(package.__path__, package.__name__ + ".")
    ]
    found = 0
    for module in modules:
        imported = {}
        for node in ast.walk(ast.parse(Path(module.__file__).read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                imported |= {alias.asname or alias.name: node.module for alias in node.names}
        for function in vars(module).values():
            if not isinstance(function, Dispatcher) or function.__module__ != module.__name__:
                continue
            found += 1
            own = function._cache._cache_file._own.files
            assert module.__file__ in own
            for name in set(function.py_func.__code__.co_names) & imported.keys():
                if imported[name].partition(".")[0] not in sys.stdlib_module_names | {"numba", "numpy"}:
                    origin = sys.modules.get(f"{imported[name]}.{name}") or sys.modules[imported[name]]
                    assert origin.__file__ in own, f"{function.py_func} takes {name} from {origin}"
    assert found > 40


def test_every_function_of_the_harness_is_kept_for_what_it_refers_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that cannot be described would be compiled at each start."""
    from numba.core.dispatcher import Dispatcher

    described = 0
    for room in ("compiled", "frames", "control", "master", "plant", "signals"):
        top = importlib.import_module(f"cosim.{room}")
        names = [found.name for found in pkgutil.walk_packages(getattr(top, "__path__", []), f"cosim.{room}.")]
        for module in (top, *map(importlib.import_module, names)):
            for function in vars(module).values():
                if isinstance(function, Dispatcher):
                    assert of_function(function, _own().files)
                    described += 1
    assert described > 30
    before = of_function(loop.advance, _own().files)
    monkeypatch.setattr(moves, "_OF_ROW", moves._OF_ROW + 1)
    assert of_function(loop.advance, _own().files) != before

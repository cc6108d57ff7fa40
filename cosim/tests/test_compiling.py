"""Compilation that takes long is told, once."""

import math

import pytest

from cosim import compiling
from cosim.compiled import COMPILED

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

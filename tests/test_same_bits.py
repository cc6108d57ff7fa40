"""The results of all scenarios have the bits that they had, and would have them on another processor."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import formation_controllers
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import interpolate, signal

import cosim
import plants
from cosim.signals.spline import through
from cosim.signals.waves.random import _low_pass

from . import same_bits

SCENARIOS = sorted((same_bits.ROOT / "scenarios").glob("*.xml"))
ROOMS = ("control", "master", "plant", "results", "signals", "vehicle", "compare")
LIBRARY = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "arcsin", "arccos", "arctan", "arctan2", "hypot"),
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "pow", "power", "sinh", "cosh", "tanh", "cbrt"),
    *("einsum", "dot", "matmul", "inner"),
}
DRAWN = {"figure.py", "figure_paths.py", "drawable_part.py", "sight.py"}
"""What only draws."""
AS_NUMPY = {"normal.py"}
"""What gives the numbers of NumPy, which asks the C library in one draw of thousands: see docs/same_bits.md."""


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.stem)
def test_a_scenario_gives_the_bits_that_are_kept(scenario: Path) -> None:
    different = same_bits.differences(same_bits.digests(scenario), same_bits.kept(full=False))
    assert not different, (
        "other bits than before; if that is meant, say so in the changelog, then run same_bits.py --renew"
    )


def test_every_scenario_is_kept() -> None:
    for full in (False, True):
        lines = same_bits.kept(full).read_text().splitlines()
        assert sorted({line.split()[0] for line in lines}) == [path.stem for path in SCENARIOS]


def test_another_processor_and_no_compiler_give_the_same_bits() -> None:
    """What a processor without fused multiply-adds and wide registers does, as far as libraries can be told to."""
    names = ("clmr_line_as_printed", "differential_drive", "side_wind", "figure_eight")
    paths, horizon = [path for path in SCENARIOS if path.stem in names], 0.1
    other = {
        "NUMBA_DISABLE_JIT": "1",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-AVX2_Usable,-FMA4",
        "OPENBLAS_CORETYPE": "Prescott",
    }
    command = [sys.executable, same_bits.__file__, "--list", "--horizon", str(horizon), *map(str, paths)]
    told = subprocess.run(
        command, env=os.environ | other, capture_output=True, text=True, check=True, timeout=300
    ).stdout
    here = [line for path in paths for line in same_bits.digests(path, horizon)]
    assert told.splitlines() == [" ".join(line) for line in here]


def test_both_distributions_hold_the_same_functions() -> None:
    texts = {
        Path(package.__file__ or "").with_name("elementary.py").read_bytes()
        for package in (plants, formation_controllers)
    }
    assert len(texts) == 1, "copy plants/elementary.py to controllers/formation_controllers, or the reverse"


def test_the_harness_calls_no_function_whose_bits_depend_on_the_machine() -> None:
    root = Path(cosim.__file__).parent
    for file in (
        file for room in ROOMS for file in sorted((root / room).rglob("*.py")) if file.name not in DRAWN | AS_NUMPY
    ):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            assert not isinstance(node, ast.MatMult), f"{file} multiplies matrices with @, which BLAS does"
            if isinstance(node, ast.Attribute):
                module, _, function = ast.unparse(node).partition(".")
                assert not (module in ("math", "np") and function in LIBRARY), f"{file} calls {module}.{function}"
                assert not function.startswith("linalg"), f"{file} calls {module}.{function}"


@pytest.mark.parametrize("count", [6, 7, 12, 200])
def test_the_spline_is_that_of_scipy(count: int) -> None:
    random = np.random.default_rng(count)
    times = np.cumsum(random.uniform(0.2, 1.0, count))
    points = np.cumsum(random.normal(size=(count, 2)), axis=0)
    own, theirs = through(times, points), interpolate.make_interp_spline(times, points, k=5)
    at = np.concatenate([times, np.linspace(times[0], times[-1], 501)])
    for order in range(5):
        expected: NDArray[np.float64] = theirs(at, order)
        np.testing.assert_allclose(own(at, order), expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
    with pytest.raises(ValueError, match="do not increase"):
        through(np.concatenate([times[:-1], times[-2:-1]]), points)


@pytest.mark.parametrize("cutoff", [1e-5, 0.01, 0.2, 0.49])
def test_the_low_pass_is_that_of_scipy(cutoff: float) -> None:
    own, sos = _low_pass(cutoff), signal.butter(2, 2 * cutoff, output="sos")
    np.testing.assert_allclose([*own.b, 1.0, *own.a], sos[0], rtol=1e-9)
    values = np.random.default_rng(1).normal(size=300)
    course, _ = signal.sosfilt(sos, values, zi=np.zeros((1, 2)))
    first, state = own.filtered((0.0, 0.0), values[:100].tolist())
    second, _ = own.filtered(state, values[100:].tolist())
    found = np.concatenate([first, second])
    np.testing.assert_allclose(found, course, rtol=1e-6, atol=1e-9 * np.abs(course).max())

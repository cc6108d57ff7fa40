"""LaTeX of matrices and equations: complete, balanced, and rendered by Matplotlib where that knows the environment."""

import re

import pytest
import sympy
from matplotlib.mathtext import MathTextParser

import plants
from plants import latex

from .test_models import pendulum_on_wheels, spring
from .test_vehicles import VEHICLES

NAMES = ("A", "S", "M1", "C1", "D1", "B1", "M2", "C2", "D2", "B2", "F2")


def render(text: str) -> float:
    """Set a formula with Matplotlib, which raises for what it cannot read; return its width."""
    return float(MathTextParser("path").parse(f"${text}$")[0])


def check(text: str) -> None:
    assert text.count("{") == text.count("}")
    assert text.count(r"\left") == text.count(r"\right")
    assert re.findall(r"\\begin\{(\w+)\}", text) == re.findall(r"\\end\{(\w+)\}", text)[::-1]
    # Matplotlib has neither cases nor matrices: there the parts are set.
    for part in re.split(r"\\begin\{\w+\}|\\end\{\w+\}|&|\\\\|\\left\[|\\right\]", text):
        part = re.sub(r"\\text\{(.*?)\}", r"\\mathrm{\1}", part)
        if part.strip() and part.count("{") == part.count("}") and part.count(r"\left") == part.count(r"\right"):
            assert render(part) > 0


@pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)
def test_every_matrix_is_complete(vehicle) -> None:  # type: ignore[no-untyped-def]
    system = vehicle.SYSTEM
    written = latex.matrices(system)
    assert tuple(written) == NAMES
    for name, text in written.items():
        check(text)
        letters, digits = name.rstrip("12"), name.lstrip("ABCDFMS")
        assert text.startswith(f"{letters}_{{{digits}}} = " if digits else f"{letters} = ")
        rows, columns = getattr(system, name).shape
        # Outside the branches of the drive gain, which are set as cases.
        body = re.sub(r"\\begin\{cases\}.*?\\end\{cases\}", "", text)
        assert body.count(r"\\") == rows - 1
        assert body.count("&") == rows * (columns - 1)
        for entry in getattr(system, name):
            assert latex.expression(entry) in text


@pytest.mark.parametrize("model", [*map(plants.load, VEHICLES), spring()], ids=lambda model: model.name)
def test_equations_name_every_state_term_and_output(model) -> None:  # type: ignore[no-untyped-def]
    lines = latex.equations(model)
    functions = [t for t in model.terms if isinstance(t.expression, sympy.cos | sympy.sin | sympy.tan)]
    assert len(lines) == len(model.terms) - len(functions) + len(model.states) + len(model.outputs)
    for line in lines:
        check(line)
    for state in model.states:
        assert any(line.startswith(latex.symbol(state.name, dot=True) + " = ") for line in lines)


def test_a_system_without_stated_constraints() -> None:
    assert "A" not in latex.matrices(pendulum_on_wheels())


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("v", "v"),
        ("psi", r"\psi"),
        ("theta_1", r"\theta_{1}"),
        ("theta_01", r"\theta_{01}"),
        ("I_theta1", r"I_{\theta1}"),
        ("M2_11", "M_{2,11}"),
        ("d_m1", "d_{m1}"),
        ("tau_d_theta_0", r"\tau_{d,\theta,0}"),
        ("gamma_max", r"\gamma_{\mathrm{max}}"),
        ("e_dot_stop", r"\dot{e}_{\mathrm{stop}}"),
        ("hitch", r"\mathrm{hitch}"),
    ],
)
def test_symbols(name: str, expected: str) -> None:
    assert latex.symbol(name) == expected
    assert render(latex.symbol(name)) > 0

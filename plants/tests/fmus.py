"""FMUs for the tests: the built-in models and one that has all that a model can have."""

from dataclasses import dataclass
from pathlib import Path

import sympy

import plants
from plants.ode import TIME, Enumeration, Input, Limit, OdeModel, Output, Parameter, State, Term, Terminal

from .driver import Library

VERSIONS = ("2.0", "3.0")


def many_functions() -> OdeModel:
    """A model of all that C can compute and has a derivative: kinks, steps, the time, enumerations, limits."""
    x, y, u, w, k, energy, bend = sympy.symbols("x y u w k energy bend")
    law = Enumeration(sympy.Symbol("law"), {"smooth": "", "kinked": "", "periodic": ""}, "Law")
    smooth = sympy.exp(-(x**2)) + sympy.atan2(y, 3 + sympy.sqrt(1 + x**2)) + sympy.log(2 + sympy.sin(k * y) ** 2)
    kinked = sympy.Abs(x - k) + sympy.Max(x, y) + 0.1 * sympy.floor(2 * y) + sympy.sign(x) * sympy.Min(x**3, 1)
    return OdeModel(
        name="many_functions",
        description="Functions of all kinds",
        states=(State(x, "m", "x", start=0.3, nominal=2.0), State(y, "rad", "y", start=0.2, output=False)),
        derivatives=(
            law.select(smooth=smooth * u, kinked=kinked + u, periodic=sympy.cos(TIME) * sympy.tanh(x) + w),
            -y * u**4 / (1 + x**2) ** 2 + sympy.sinh(bend) - TIME**2 + k ** sympy.Rational(3, 2),
        ),
        inputs=(Input(u, "N", "u", start=0.5), Input(w, "m/s", "w", start=-0.2)),
        parameters=(Parameter(k, "1", "k", start=1.2, min=0.0), law),
        outputs=(Output(energy, x**2 / 2 + bend * u, "J", "energy", nominal=10.0),),
        terms=(Term(bend, sympy.cosh(x * y) - (2 + w) ** -2),),
        limits=(Limit(x * y, min=-2.0, max=2.0, reason="#1 of 100 % made up"), Limit(x, max=3.0, reason="far away")),
        terminals=(Terminal("both", (u, x, energy), "Some"),),
    )


MODELS = {name: plants.load(name) for name in plants.models()}
MODELS["many_functions"] = many_functions()


@dataclass(frozen=True)
class Fmu:
    """An unpacked FMU with its variables' value references by name."""

    path: Path
    folder: Path
    library: Library
    references: dict[str, int]

    def __getitem__(self, name: str) -> int:
        return self.references[name]

"""From a Lagrangian description with nonholonomic constraints to an explicit ordinary differential equation.

A model states the matrices of the constrained dynamics, equation (1) of the paper,

    M1 eta'' + C1 eta' + D1 eta' + tau_d1 = B1 tau - A' lambda,    A eta' = 0,

and the motion basis S, whose columns span the null space of A. The Coriolis matrix C1 follows from Lagrange's
equations, and with the pseudo-velocities v of (2), eta' = S v, the reduced dynamics (3),

    M2 v' + C2 v + D2 v + F2 + tau_d2 = B2 tau,

whose solution for v' together with (2) is the model. The multipliers lambda and all terms that cancel are gone.
F2 is not in the paper: it holds resistances to the pseudo-velocities themselves, such as friction.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import sympy
from sympy.functions.elementary.trigonometric import TrigonometricFunction

from plants import units
from plants.errors import ModelError
from plants.ode import TIME, Enumeration, Input, Limit, OdeModel, Output, Parameter, State, Term, Terminal
from plants.trigonometry import shorten


@dataclass(frozen=True)
class NonholonomicSystem:
    """A mechanical system with n coordinates, m pseudo-velocities and k actuators, in the symbols of equations (1)-(3).

    Parameters
    ----------
    name, description
        As in `OdeModel`.
    coordinates
        The n entries of eta.
    velocities
        The m entries of v; their units fix those of the reduced dynamics (N for m/s, N.m for rad/s).
    inputs
        The k entries of tau.
    disturbances
        The n entries of tau_d1. They stand on the left-hand side of (1): positive ones oppose motion.
    parameters
        All that M1, D1, B1 and S use. A parameter that cancels in the reduction does not reach the model.
    S, M1, D1, B1
        Motion basis (n, m), inertia (n, n), damping (n, n) and input map (n, k). S and M1 depend on coordinates,
        parameters and constant terms alone.
    A
        Constraint matrix (n - m, n). The reduction does not need it, but if it is stated, S must satisfy A S = 0.
    F2
        Resistances (m, 1): positive ones oppose motion, as damping does. None for no resistance.
    terms
        Named intermediate results that the matrices use, each those before it. In S and M1, which are differentiated,
        they must be constant.
    angles
        Names for differences of coordinates, such as theta_01 = theta_0 - theta_1. S and M1 are stated in the
        coordinates; the reduced matrices and all that is generated are written in these.
    outputs, limits
        Outputs to compute besides the states, and where the equations hold, as in `OdeModel`.

    Raises
    ------
    ModelError
        The shape of a matrix does not fit, M1 is not symmetric, A S is not zero, S or M1 depends on the time, an input,
        a pseudo-velocity or a term that is not constant, an angle is not a difference of coordinates, or a quantity has
        a unit with a factor to SI units, such as g: one that moves, or one that a matrix uses without a conversion.
    """

    name: str
    description: str
    coordinates: tuple[State, ...]
    velocities: tuple[State, ...]
    inputs: tuple[Input, ...]
    disturbances: tuple[Input, ...]
    parameters: tuple[Parameter | Enumeration, ...]
    S: sympy.Matrix
    M1: sympy.Matrix
    D1: sympy.Matrix
    B1: sympy.Matrix
    A: sympy.Matrix | None = None
    F2: sympy.Matrix | None = None
    terms: tuple[Term, ...] = ()
    angles: tuple[Term, ...] = ()
    outputs: tuple[Output, ...] = ()
    limits: tuple[Limit, ...] = ()

    def __post_init__(self) -> None:
        n, m, k = len(self.coordinates), len(self.velocities), len(self.inputs)
        if self.F2 is None:
            object.__setattr__(self, "F2", sympy.zeros(m, 1))
        shapes = {"S": (n, m), "M1": (n, n), "D1": (n, n), "B1": (n, k), "A": (n - m, n), "F2": (m, 1)}
        for letter, shape in shapes.items():
            stated = getattr(self, letter)
            if letter == "A" and stated is None:
                continue
            try:
                object.__setattr__(self, letter, sympy.Matrix(stated))
            except (TypeError, ValueError):
                raise ModelError(f"model {self.name!r}: {letter} is {stated!r}, it must be a matrix of SymPy") from None
            if getattr(self, letter).shape != shape:
                raise ModelError(f"model {self.name!r}: {letter} is {getattr(self, letter).shape}, it must be {shape}")
        if len(self.disturbances) != n:
            raise ModelError(
                f"model {self.name!r}: {len(self.disturbances)} disturbances, one for each of {n} coordinates needed"
            )
        if self.M1 != self.M1.T:
            raise ModelError(f"model {self.name!r}: M1 is not symmetric")
        for angle in self.angles:
            slopes = [angle.expression.diff(q) for q in self.eta]
            if not any(slopes) or not all(slope.is_number for slope in slopes):
                raise ModelError(f"model {self.name!r}: the angle {angle.symbol} is not a difference of coordinates")
        if self.A is not None and any(sympy.simplify(entry) != 0 for entry in self._short(self.A * self.S)):
            raise ModelError(f"model {self.name!r}: A S is not zero: the motion basis breaks the constraints")
        differentiated = self.S.free_symbols | self.M1.free_symbols
        moving = (*self.velocities, *self.inputs, *self.disturbances)
        for symbol in sorted(differentiated & {TIME, *(variable.symbol for variable in moving)}, key=str):
            raise ModelError(
                f"model {self.name!r}: S or M1 uses {symbol}: they may depend on coordinates, parameters and constant "
                "terms alone"
            )
        varying = {TIME, *(variable.symbol for variable in (*self.coordinates, *moving))}
        for term in (*self.angles, *self.terms):
            if term.expression.free_symbols & varying:
                varying.add(term.symbol)
                if term.symbol in differentiated:
                    raise ModelError(f"model {self.name!r}: S or M1 uses the term {term.symbol}, which is not constant")
        self._check_units()

    def _check_units(self) -> None:
        """Refuse units with a factor: of all that moves, and of what a matrix uses without a conversion."""
        moving: tuple[State | Input | Term, ...] = (*self.coordinates, *self.velocities, *self.inputs)
        for quantity in (*moving, *self.disturbances, *self.angles):
            unit = units.parse(quantity.unit)
            if unit.factor != 1.0:
                raise ModelError(
                    f"model {self.name!r}: {quantity.symbol} is in {quantity.unit}, but the derivation computes in SI "
                    f"units: state it in {unit}"
                )
        entries = [(letter, entry) for letter in ("S", "M1", "D1", "B1", "F2") for entry in getattr(self, letter)]
        used = set[sympy.Symbol]().union(*(entry.free_symbols for _, entry in entries))
        reals = (p for p in (*self.parameters, *self.terms) if isinstance(p, Parameter | Term))
        others = {p.symbol: p.unit for p in reals if p.symbol in used}
        factors = {symbol: units.parse(unit).factor for symbol, unit in others.items()}
        scaled = {symbol: factor for symbol, factor in factors.items() if factor != 1.0}
        if scaled:
            for letter, entry in entries:
                for symbol in sorted(_unconverted(entry, scaled), key=str):
                    raise ModelError(
                        f"model {self.name!r}: {symbol} is in {others[symbol]}, but {letter} uses it as it stands, and "
                        f"the derivation computes in SI units: state it in {units.parse(others[symbol])}, or convert it"
                    )

    @cached_property
    def eta(self) -> sympy.Matrix:
        """The coordinates, (n, 1)."""
        return sympy.Matrix([c.symbol for c in self.coordinates])

    @cached_property
    def v(self) -> sympy.Matrix:
        """The pseudo-velocities, (m, 1)."""
        return sympy.Matrix([v.symbol for v in self.velocities])

    @cached_property
    def eta_dot(self) -> sympy.Matrix:
        """The coordinates' rates by (2), eta' = S v, (n, 1)."""
        return self.S * self.v

    @cached_property
    def C1(self) -> sympy.Matrix:
        """The Coriolis matrix of (1), in Christoffel symbols of M1, (n, n)."""
        n, M1, eta = len(self.eta), self.M1, self.eta
        return sympy.Matrix(
            n,
            n,
            lambda i, j: sum(
                (M1[i, j].diff(eta[k]) + M1[i, k].diff(eta[j]) - M1[j, k].diff(eta[i])) / 2 * self.eta_dot[k]
                for k in range(n)
            ),
        )

    @cached_property
    def M2(self) -> sympy.Matrix:
        """The reduced inertia M2 = S' M1 S of (3), (m, m)."""
        return self._short(self.S.T * self.M1 * self.S)

    @cached_property
    def C2(self) -> sympy.Matrix:
        """The reduced Coriolis matrix C2 = S' M1 S_dot + S' C1 S of (3), (m, m)."""
        S_dot = sum((self.S.diff(q) * rate for q, rate in zip(self.eta, self.eta_dot, strict=True)), 0 * self.S)
        return self._short(self.S.T * self.M1 * S_dot + self.S.T * self.C1 * self.S)

    @cached_property
    def D2(self) -> sympy.Matrix:
        """The reduced damping D2 = S' D1 S of (3), (m, m)."""
        return self._short(self.S.T * self.D1 * self.S)

    @cached_property
    def B2(self) -> sympy.Matrix:
        """The reduced input map B2 = S' B1 of (3), (m, k)."""
        return self._short(self.S.T * self.B1)

    @cached_property
    def tau_d2(self) -> sympy.Matrix:
        """The reduced disturbance tau_d2 = S' tau_d1 of (3), (m, 1)."""
        return self._relative(self.S.T * sympy.Matrix([d.symbol for d in self.disturbances]))

    def _relative(self, matrix: sympy.Matrix) -> sympy.Matrix:
        """Write a matrix in the relative angles: theta_0 becomes theta_01 + theta_1, theta_0 - theta_1 so theta_01."""
        for angle in self.angles:
            last = [q for q in self.eta if q in angle.expression.free_symbols][-1]
            matrix = matrix.subs(last, sympy.solve(angle.expression - angle.symbol, last)[0])
        return matrix

    def _short(self, matrix: sympy.Matrix) -> sympy.Matrix:
        return self._relative(matrix).applyfunc(shorten)

    def ode(self) -> OdeModel:
        """Return the explicit model, der(eta) by (2) and der(v) by (3), the matrices' entries as named terms."""
        m = len(self.velocities)
        terms = _Terms(self.angles, self.terms)
        speed = [units.parse(v.unit) for v in self.velocities]
        # Power, a pseudo-force times its pseudo-velocity, is in watts; torques carry no radian in their unit.
        force = [units.parse("W") / _without_radians(unit) for unit in speed]
        second = units.parse("s")

        S = terms.matrix(
            "S",
            self._relative(self.S),
            [[units.parse(c.unit) / second / s for s in speed] for c in self.coordinates],
            "(2)",
        )
        M2 = terms.matrix("M2", self.M2, [[f * second / s for s in speed] for f in force], "(3)")
        D2 = terms.matrix("D2", self.D2, [[f / s for s in speed] for f in force], "(3)")
        B2 = terms.matrix("B2", self.B2, [[f / units.parse(u.unit) for u in self.inputs] for f in force], "(3)")
        C2_v = terms.vector("C2_v", self._short(self.C2 * self.v), force, "(3)")
        F2 = terms.vector("F2", self._relative(self.F2), force, "(3)")
        tau_d2 = terms.vector("tau_d2", self.tau_d2, force, "(3)")
        tau = sympy.Matrix([u.symbol for u in self.inputs])
        f = terms.vector("f", B2 * tau - C2_v - D2 * self.v - F2 - tau_d2, force, "(3): M2 v' = f")
        if M2.is_diagonal():
            v_dot = [force / M2[i, i] for i, force in enumerate(f)]
        else:
            unit = _product([f * second / s for f, s in zip(force, speed, strict=True)])
            v_dot = [*(M2.adjugate() * f / terms.add("det_M2", M2.det(), unit, "(3)"))]

        derivatives = [*(S * self.v), *v_dot]
        named, used = terms.needed_by(
            [*derivatives, *(o.expression for o in self.outputs), *(limit.expression for limit in self.limits)]
        )
        bundles = {
            "pose": self.coordinates,
            "velocity": self.velocities,
            "torque": self.inputs,
            "disturbance": self.disturbances,
        }
        return OdeModel(
            name=self.name,
            description=self.description,
            states=(*self.coordinates, *self.velocities),
            derivatives=tuple(derivatives),
            inputs=(*self.inputs, *self.disturbances),
            parameters=tuple(p for p in self.parameters if p.symbol in used),
            outputs=self.outputs,
            terms=named,
            equations=("(2)",) * len(self.coordinates) + ("(3)",) * m,
            limits=self.limits,
            terminals=tuple(Terminal(name, tuple(v.symbol for v in group)) for name, group in bundles.items()),
        )


def _unconverted(expression: sympy.Expr, scaled: Mapping[sympy.Symbol, float]) -> set[sympy.Symbol]:
    """Return symbols of units with these factors in a product that, by any measure, is in no SI unit.

    A number in a product may be the conversion. Factors may also cancel, as in a ratio of two masses in g.
    """
    if not expression.free_symbols & scaled.keys():
        return set()
    angles = [function.args[0] for function in expression.atoms(TrigonometricFunction)]
    for product in (term for part in (expression, *angles) for term in sympy.Add.make_args(sympy.expand(part))):
        powers = product.as_powers_dict()
        rest = [base**power for base, power in powers.items() if base not in scaled or not power.is_number]
        plain = all(abs(item) == 1 if item.is_number else not item.free_symbols & scaled.keys() for item in rest)
        found = powers.keys() & scaled.keys()
        if plain and found and not math.isclose(math.prod(scaled[s] ** float(powers[s]) for s in found), 1.0):
            return set(found)
    return set()


class _Terms:
    """Collects named terms; functions that several of them use, such as cos(psi), become terms of their own."""

    def __init__(self, angles: Sequence[Term], terms: Sequence[Term]) -> None:
        self._angles = angles
        self._terms = [*angles, *terms]

    def add(self, name: str, expression: sympy.Expr, unit: units.Unit, equation: str) -> sympy.Expr:
        """Name an expression; a plain number needs no name."""
        if expression.is_number:
            return expression
        symbol = sympy.Symbol(name, real=True)
        self._terms.append(Term(symbol, expression, str(_without_radians(unit)), equation))
        return symbol

    def matrix(
        self, name: str, matrix: sympy.Matrix, entry_units: Sequence[Sequence[units.Unit]], equation: str
    ) -> sympy.Matrix:
        """Name the entries of a matrix `name`_row column, counted from one; equal entries of a symmetric one once."""
        symmetric = matrix.is_square and matrix.is_symmetric()
        named = matrix.copy()
        for i in range(matrix.rows):
            for j in range(matrix.cols):
                if symmetric and j < i:
                    named[i, j] = named[j, i]
                    continue
                named[i, j] = self.add(f"{name}_{i + 1}{j + 1}", matrix[i, j], entry_units[i][j], equation)
        return named

    def vector(self, name: str, vector: sympy.Matrix, entry_units: Sequence[units.Unit], equation: str) -> sympy.Matrix:
        """Name the entries of a vector `name`_row, counted from one."""
        rows = zip(vector, entry_units, strict=True)
        return sympy.Matrix(
            [self.add(f"{name}_{i}", entry, unit, equation) for i, (entry, unit) in enumerate(rows, start=1)]
        )

    def needed_by(self, expressions: Iterable[sympy.Expr]) -> tuple[tuple[Term, ...], set[sympy.Symbol]]:
        """Return the terms that expressions need, those for shared functions first, and all symbols in use."""
        used = set[sympy.Symbol]().union(*(expression.free_symbols for expression in expressions))
        needed: list[Term] = []
        for term in reversed(self._terms):
            if term.symbol in used:
                needed.insert(0, term)
                used |= term.expression.free_symbols

        uses: dict[sympy.Expr, int] = {}
        for term in needed:
            # A branch is evaluated only if it is chosen: leave its functions there.
            outside = term.expression.replace(lambda e: isinstance(e, sympy.Piecewise), lambda _: sympy.Integer(0))
            for function in outside.atoms(sympy.Function):
                uses[function] = uses.get(function, 0) + 1
        angles = [term for term in needed if term in self._angles]
        others = [term for term in needed if term not in angles]
        late = {term.symbol for term in others}
        shared = sorted((f for f, count in uses.items() if count > 1 and not f.free_symbols & late), key=str)
        names = {f: sympy.Symbol(_name(f), real=True) for f in shared}
        functions = tuple(Term(symbol, f) for f, symbol in names.items())
        rest = (Term(t.symbol, t.expression.xreplace(names), t.unit, t.equation) for t in others)
        return (*angles, *functions, *rest), used


def disturbances(coordinates: Iterable[State]) -> tuple[Input, ...]:
    """Return the disturbances tau_d1 of (1): ``tau_d_q`` for a coordinate q, a force if it is a length, else a torque.

    Raises
    ------
    ModelError
        A coordinate is neither in m nor in rad.
    """
    return tuple(map(_disturbance, coordinates))


def _disturbance(coordinate: State) -> Input:
    name = coordinate.name
    kinds = {"m": ("N", f"force along {name.upper()}"), "rad": ("N.m", f"torque about {name}")}
    if coordinate.unit not in kinds:
        raise ModelError(
            f"disturbance on {name!r}: its unit is {coordinate.unit!r}, it must be one of {', '.join(kinds)}"
        )
    unit, what = kinds[coordinate.unit]
    text = f"Disturbing {what}, opposing motion: left-hand side of (1)"
    return Input(sympy.Symbol(f"tau_d_{name}", real=True), unit, text, nominal=10.0)


def _name(function: sympy.Expr) -> str:
    """Return a name such as cos_psi for cos(psi)."""
    text = str(function)
    for sign, word in {"+": "plus", "-": "minus", "*": "times", "/": "over"}.items():
        text = text.replace(sign, f" {word} ")
    return "_".join("".join(c if c.isalnum() else " " for c in text).split())


def _product(factors: Sequence[units.Unit]) -> units.Unit:
    product = units.Unit()
    for factor in factors:
        product *= factor
    return product


def _without_radians(unit: units.Unit) -> units.Unit:
    """Radians count as pure numbers in mechanics: a torque is N.m, not N.m/rad."""
    return units.Unit((*unit.exponents[:-1], 0), unit.factor)

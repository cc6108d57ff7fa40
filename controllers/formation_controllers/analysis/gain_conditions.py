"""The conditions of Theorem 1 on the gains, (39) to (42), and Remark 2.

With kappa = lambda_max(K_p)/lambda_min(K_p) and the free constant l, (39) and (40) divided by lambda_min(K_p) are::

    (39)  alpha > kappa (1 + beta)/(2 l)             <=>  l > kappa (1 + beta)/(2 alpha)
    (40)  beta > kappa/(2 l) + kappa beta l/2        <=>  kappa beta l^2 - 2 beta l + kappa < 0
                                                     <=>  beta > kappa^2 and |kappa l - 1| < sqrt(1 - kappa^2/beta)

So there is an l for both if and only if beta > kappa^2 and

    alpha > kappa^2 (1 + beta)/(2 (1 + sqrt(1 - kappa^2/beta))).

Which of the two roots is alpha is open. Neither order is always the better one: that with more room for l in (39) and
(40) may be the one that needs an l which (41) and (42) do not allow. Both are tried.

For kappa = 1 this needs Lambda_1 = alpha beta > 0.8817, whatever Lambda_0 = alpha + beta is: the least of
beta (1 + beta)/(2 (1 + sqrt(1 - 1/beta))) over beta > 1, at beta = 1.066. The printed Lambda_1 = 0.05 will not do.

(41) and (42) bound l from above. They contain matrices of (10); of these the smallest eigenvalues are asked for,
lambda_min(K_p + D) >= lambda_min(K_p) + lambda_d and lambda_min(k_d M - K_p) >= k_d lambda_m - lambda_max(K_p), so that
a condition may be told to fail by a little that holds for the matrices themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from formation_controllers.errors import ControllerError, GainError, unknown
from formation_controllers.observer_pid import ObserverPidGains
from formation_controllers.vehicles import is_finite, is_positive

G = TypeVar("G", bound=ObserverPidGains)


@dataclass(frozen=True)
class Bounds:
    """The assumptions of Theorem 1 about the formation model (10).

    Parameters
    ----------
    c_1, c_2, c_4, c_5
        Constants of (22) and (38); they depend on the gains too.
    c_3
        Constant of (27). It enters only the region of attraction, (52): no condition depends on it. By (16), (18) and
        (26), s_c_tilde + s_o_tilde = 2 (s_o - alpha q_tilde - beta xi_o), so that the least one is
        2 sqrt(1 + alpha^2 + beta^2).
    lambda_m, lambda_d
        Smallest eigenvalues of M and D, Properties 1 and 3.
    lambda_M
        Largest eigenvalue of M, Property 1, if it is known. It enters only the region of attraction.

    Raises
    ------
    ControllerError
        If one is no number, negative or not finite, lambda_m is zero, or lambda_M is less than lambda_m.
    """

    c_1: float
    c_2: float
    c_3: float
    c_4: float
    c_5: float
    lambda_m: float
    lambda_d: float
    lambda_M: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name == "lambda_M" and value is None:
                continue
            if not (is_finite(value) and value >= 0):
                raise ControllerError(f"the bound {name} is {value!r}: it must be a number, at least zero and finite")
        if self.lambda_m == 0:
            raise ControllerError("the bound lambda_m is 0: M is positive definite, Property 1")
        if self.lambda_M is not None and self.lambda_M < self.lambda_m:
            raise ControllerError(
                f"the bound lambda_M is {self.lambda_M}: it must be at least lambda_m, {self.lambda_m}"
            )
        for name, value in list(vars(self).items()):  # fractions and numbers of less precision
            object.__setattr__(self, name, None if value is None else float(value))


@dataclass(frozen=True)
class Condition:
    """One condition, ``left > right``.

    Attributes
    ----------
    name : str
        Its number.
    left, right : float
        Its sides, at the constant l.
    l_above, l_below : float
        The constants l with which it holds; an empty interval if it never does.
    """

    name: str
    left: float
    right: float
    l_above: float
    l_below: float

    @property
    def margin(self) -> float:
        """Left less right side: by how much the condition holds, or, negative, fails."""
        return self.left - self.right

    @property
    def satisfied(self) -> bool:
        """Whether it holds."""
        return self.left > self.right


@dataclass(frozen=True)
class GainReport:
    """The findings of `check_gains`.

    Attributes
    ----------
    alpha, beta : float
        Roots of s^2 - Lambda_0 s + Lambda_1, in the order with the larger smallest margin; NaN if there are none.
    l : float
        The free constant of the conditions: the one with the largest smallest margin.
    conditions : tuple of Condition
        (39) to (42), and Remark 2 if a formation is given.
    discriminant : float
        Lambda_0^2 - 4 Lambda_1, zero if it is by less than rounding; alpha and beta are real if it is not negative.
    """

    alpha: float
    beta: float
    l: float  # noqa: E741 (the paper's letter)
    conditions: tuple[Condition, ...]
    discriminant: float

    @property
    def satisfied(self) -> bool:
        """Whether all conditions hold with one constant l."""
        return all(condition.satisfied for condition in self.conditions)

    def __getitem__(self, name: str) -> Condition:
        """Return the condition of this name: "(39)" to "(42)", "Remark 2"; raises ControllerError if there is none."""
        conditions = {condition.name: condition for condition in self.conditions}
        if name not in conditions:
            raise ControllerError(unknown("condition", name, conditions))
        return conditions[name]

    def __iter__(self) -> Iterator[str]:
        """Return the names of the conditions, as a mapping does; so `in` asks for a name."""
        return (condition.name for condition in self.conditions)

    def __str__(self) -> str:
        """Return a table."""
        if self.discriminant < 0:
            lines = [f"no real alpha and beta exist: Lambda_0^2 - 4 Lambda_1 = {self.discriminant:.4g}"]
        else:
            lines = [f"alpha = {self.alpha:.4g}, beta = {self.beta:.4g}, l = {self.l:.4g}"]
        for c in self.conditions:
            if math.isnan(c.margin):
                lines.append(f"{c.name:8} FAILS: it needs real alpha and beta")
                continue
            holds = "holds" if c.satisfied else "FAILS"
            interval = f"for l in ({c.l_above:.4g}, {c.l_below:.4g})" if c.l_above < c.l_below else "for no l"
            lines.append(f"{c.name:8} {c.left:10.4g} > {c.right:10.4g}  {holds} by {abs(c.margin):.4g}; {interval}")
        return "\n".join(lines)


def check_gains(gains: ObserverPidGains, bounds: Bounds, desired_bearing: ArrayLike | None = None) -> GainReport:
    """Tell which conditions of Theorem 1 gains satisfy, and by how much.

    Parameters
    ----------
    gains
        Gains of the paper's law, or of the PID law that it contains.
    bounds
        Bounds of the formation model.
    desired_bearing
        Desired bearings [rad], of any shape; adds Remark 2.

    Raises
    ------
    GainError
        If the gains are another law's, or Lambda_0 or Lambda_1 differs between range and bearing: (39), (40) are for
        (alpha + beta) I and alpha beta I.
    ControllerError
        If the bounds are no `Bounds`, or desired bearings are given but there is none, or one is not a finite number.
    """
    require(gains, ObserverPidGains, bounds)
    largest = None if desired_bearing is None else _largest(desired_bearing)
    if len(set(gains.Lambda_0)) > 1 or len(set(gains.Lambda_1)) > 1:  # type: ignore[arg-type]
        raise GainError("gains 'Lambda_0' and 'Lambda_1' must be the same for range and bearing, as alpha and beta are")
    reports = [_report(alpha, beta, gains, bounds) for alpha, beta in orders_of_roots(gains)]
    report = max(reports, key=lambda report: min(condition.margin for condition in report.conditions))
    if largest is None:
        return report
    remark = Condition("Remark 2", math.pi / 2, largest, 0.0, math.inf if largest < math.pi / 2 else 0.0)
    return replace(report, conditions=(*report.conditions, remark))


def propose_gains(gains: G, bounds: Bounds, *, l: float = 0.5, margin: float = 0.1) -> G:  # noqa: E741
    """Return gains that satisfy (39) to (42) with a constant l, as small as a margin allows, others left alone.

    The constants c of `bounds` depend on the gains: check again with the proposed gains.

    Parameters
    ----------
    gains
        Gains whose Lambda_0, Lambda_1, K_p and k_d are to be changed. K_p becomes the same for range and bearing,
        and never smaller than it is; so does k_d.
    bounds
        Bounds of the formation model.
    l
        The free constant, in (0, 1): the smaller, the larger Lambda_0 and Lambda_1 and the smaller K_p and k_d.
    margin
        By which fraction each gain exceeds the least one.

    Raises
    ------
    GainError
        If the gains are another law's.
    ControllerError
        If the bounds are no `Bounds`, l is not in (0, 1) or the margin is not positive.
    """
    require(gains, ObserverPidGains, bounds)
    if not (is_finite(l) and 0 < l < 1):
        raise ControllerError(f"the constant l is {l}: with l outside (0, 1) no K_p satisfies (41) for all bounds")
    if not is_positive(margin):
        raise ControllerError(f"the margin is {margin}: it must be positive, the conditions are strict")
    more = 1 + margin
    beta = more / (l * (2 - l))
    alpha = more * (1 + beta) / (2 * l)
    K_p = max(*gains.K_p, more * (0.5 * l * (bounds.c_1 + bounds.c_2) - bounds.lambda_d) / (1 - l))  # type: ignore[misc]
    k_d = max(gains.k_d, more * (K_p * (1 + l) + 0.5 * l * (bounds.c_4 + bounds.c_5)) / bounds.lambda_m)
    return replace(gains, Lambda_0=alpha + beta, Lambda_1=alpha * beta, K_p=K_p, k_d=k_d)


def require(gains: object, gains_type: type[ObserverPidGains], bounds: object) -> None:
    """Refuse gains of another type, and anything but bounds."""
    if not isinstance(gains, gains_type):
        raise GainError(f"the gains are {type(gains).__name__}: the theorem is about {gains_type.__name__}")
    if not isinstance(bounds, Bounds):
        raise ControllerError(f"the bounds are {bounds!r}: expected Bounds")


def _largest(bearings: ArrayLike) -> float:
    """Return the largest magnitude of bearings."""
    try:
        values = list(np.asarray(bearings, dtype=object).flat)  # as they are: no number is made of a text or a bool
        values = [v.item() if isinstance(v, np.ndarray) and not np.ma.is_masked(v) else v for v in values]
    except ValueError:
        values = []
    if not values or np.ma.is_masked(bearings) or not all(map(is_finite, values)):
        raise ControllerError(f"the desired bearing is {bearings!r}: expected one or more finite numbers")
    return max(abs(float(value)) for value in values)


def orders_of_roots(gains: ObserverPidGains) -> list[tuple[float, float]]:
    """Return both orders of the roots alpha and beta; one pair of NaN if they are not real."""
    unit, total, discriminant = _scaled(gains)
    if discriminant < 0:
        return [(math.nan, math.nan)]
    larger = unit * ((total + math.sqrt(discriminant)) / 2)
    smaller = gains.Lambda_1[0] / larger  # type: ignore[index]
    return [(smaller, larger), (larger, smaller)]


def _scaled(gains: ObserverPidGains) -> tuple[float, float, float]:
    """Return a power of two, and by it Lambda_0, from 1 to 2, and by its square the discriminant: none overflows.

    A double root is often meant, as by 2.26 and 1.2769 = 1.13^2. Half a unit in the last place of each of the two
    numbers and of their products makes up to four times 2^-53 Lambda_0^2 of a discriminant that is zero.
    """
    unit = math.ldexp(1.0, math.frexp(gains.Lambda_0[0])[1] - 1)  # type: ignore[index]
    total = gains.Lambda_0[0] / unit  # type: ignore[index]
    square, product = total * total, 4 * (gains.Lambda_1[0] / unit / unit)  # type: ignore[index]
    discriminant = square - product
    return unit, total, 0.0 if abs(discriminant) <= 4 * 2.0**-53 * square else discriminant


def _report(alpha: float, beta: float, gains: ObserverPidGains, bounds: Bounds) -> GainReport:
    """Return the report on (39) to (42) for one order of alpha and beta."""
    sides, intervals = sides_of(alpha, beta, gains, bounds), _intervals(alpha, beta, gains, bounds)
    best = 1.0 if math.isnan(alpha) else argmax(partial(least_margin, sides))
    conditions = tuple(Condition(name, *side(best), *intervals[name]) for name, side in sides.items())
    unit, _, discriminant = _scaled(gains)
    return GainReport(alpha, beta, best, conditions, discriminant * unit * unit)


Sides = dict[str, Callable[[float], tuple[float, float]]]


def least_margin(sides: Sides, l: float) -> float:  # noqa: E741
    """Return the smallest difference of left and right side at a constant l."""
    return min(left - right for left, right in (side(l) for side in sides.values()))


def sides_of(alpha: float, beta: float, gains: ObserverPidGains, bounds: Bounds) -> Sides:
    """Return, for each condition, its left and right side as a function of l; every difference is concave in l."""
    low, high = min(gains.K_p), max(gains.K_p)  # type: ignore[arg-type]
    return {
        "(39)": lambda l: (alpha * low, 0.5 * high * (1 + beta) / l),  # noqa: E741
        "(40)": lambda l: (beta * low, 0.5 * high / l + 0.5 * beta * l * high),  # noqa: E741
        "(41)": lambda l: (low + bounds.lambda_d, l * (high + 0.5 * (bounds.c_1 + bounds.c_2))),  # noqa: E741
        "(42)": lambda l: (gains.k_d * bounds.lambda_m - high, l * (high + 0.5 * (bounds.c_4 + bounds.c_5))),  # noqa: E741
    }


def _intervals(alpha: float, beta: float, gains: ObserverPidGains, bounds: Bounds) -> dict[str, tuple[float, float]]:
    """Return, for each condition, the open interval of l in which it holds; see the module's text."""
    low, high = min(gains.K_p), max(gains.K_p)  # type: ignore[arg-type]
    kappa = high / low
    never = (1 / kappa, 1 / kappa)
    root = math.sqrt(1 - kappa**2 / beta) if beta > kappa**2 else math.nan
    ceiling = (gains.k_d * bounds.lambda_m - high) / (high + 0.5 * (bounds.c_4 + bounds.c_5))
    return {
        "(39)": (kappa * (1 + beta) / (2 * alpha), math.inf) if alpha > 0 else (math.inf, math.inf),
        "(40)": never if math.isnan(root) else ((1 - root) / kappa, (1 + root) / kappa),
        "(41)": (0.0, (low + bounds.lambda_d) / (high + 0.5 * (bounds.c_1 + bounds.c_2))),
        "(42)": (0.0, max(0.0, ceiling)),
    }


def argmax(function: Callable[[float], float]) -> float:
    """Return where a function that is concave in l > 0 is largest, by golden sections of log l."""
    ratio = (math.sqrt(5) - 1) / 2
    a, b = math.log(1e-9), math.log(1e9)
    x, y = b - ratio * (b - a), a + ratio * (b - a)
    f_x, f_y = function(math.exp(x)), function(math.exp(y))
    for _ in range(120):
        if f_x >= f_y:
            b, y, f_y = y, x, f_x
            x = b - ratio * (b - a)
            f_x = function(math.exp(x))
        else:
            a, x, f_x = x, y, f_y
            y = a + ratio * (b - a)
            f_y = function(math.exp(y))
    return math.exp((a + b) / 2)

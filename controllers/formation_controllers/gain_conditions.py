"""The conditions of Theorem 1 on the gains, (39) to (42), its region of attraction, (52), and Remark 2.

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
import numbers
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from formation_controllers.errors import ControllerError, GainError
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePidGains
from formation_controllers.observer_pid import ObserverPidGains

G = TypeVar("G", bound=ObserverPidGains)


@dataclass(frozen=True)
class Bounds:
    """What Theorem 1 takes for granted about the formation model (10).

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
            real = isinstance(value, numbers.Real) and not isinstance(value, bool)
            if not (real and math.isfinite(value) and value >= 0):
                raise ControllerError(f"the bound {name} is {value!r}: it must be a number, at least zero and finite")
        if self.lambda_m == 0:
            raise ControllerError("the bound lambda_m is 0: M is positive definite, Property 1")
        if self.lambda_M is not None and self.lambda_M < self.lambda_m:
            raise ControllerError(
                f"the bound lambda_M is {self.lambda_M}: it must be at least lambda_m, {self.lambda_m}"
            )


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
    """What `check_gains` finds.

    Attributes
    ----------
    alpha, beta : float
        Roots of s^2 - Lambda_0 s + Lambda_1, in the order with the larger smallest margin; NaN if there are none.
    l : float
        The free constant at which the conditions are told: that with the largest smallest margin.
    conditions : tuple of Condition
        (39) to (42), and Remark 2 if a formation is given.
    discriminant : float
        Lambda_0^2 - 4 Lambda_1; alpha and beta are real if it is not negative.
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
        """Return the condition of this name: "(39)" to "(42)", "Remark 2"."""
        return next(condition for condition in self.conditions if condition.name == name)

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
        What is known of the formation model.
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
    _require(gains, ObserverPidGains, bounds)
    largest = None if desired_bearing is None else _largest(desired_bearing)
    if len(set(gains.Lambda_0)) > 1 or len(set(gains.Lambda_1)) > 1:  # type: ignore[arg-type]
        raise GainError("gains 'Lambda_0' and 'Lambda_1' must be the same for range and bearing: alpha and beta are")
    reports = [_report(alpha, beta, gains, bounds) for alpha, beta in _orders(gains)]
    report = max(reports, key=lambda report: min(condition.margin for condition in report.conditions))
    if largest is None:
        return report
    remark = Condition("Remark 2", math.pi / 2, largest, 0.0, math.inf if largest < math.pi / 2 else 0.0)
    return replace(report, conditions=(*report.conditions, remark))


def propose_gains(gains: G, bounds: Bounds, *, l: float = 0.5, margin: float = 0.1) -> G:  # noqa: E741
    """Return gains that satisfy (39) to (42) with a constant l, as small as a margin allows, others left alone.

    The constants c of `bounds` depend on the gains: check again with those of the proposal.

    Parameters
    ----------
    gains
        Gains whose Lambda_0, Lambda_1, K_p and k_d are to be changed. K_p becomes the same for range and bearing,
        and never smaller than it is; so does k_d.
    bounds
        What is known of the formation model.
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
    _require(gains, ObserverPidGains, bounds)
    if not 0 < l < 1:
        raise ControllerError(f"the constant l is {l}: with l outside (0, 1) no K_p satisfies (41) for all bounds")
    if not (math.isfinite(margin) and margin > 0):
        raise ControllerError(f"the margin is {margin}: it must be positive, the conditions are strict")
    more = 1 + margin
    beta = more / (l * (2 - l))
    alpha = more * (1 + beta) / (2 * l)
    K_p = max(*gains.K_p, more * (0.5 * l * (bounds.c_1 + bounds.c_2) - bounds.lambda_d) / (1 - l))  # type: ignore[misc]
    k_d = max(gains.k_d, more * (K_p * (1 + l) + 0.5 * l * (bounds.c_4 + bounds.c_5)) / bounds.lambda_m)
    return replace(gains, Lambda_0=alpha + beta, Lambda_1=alpha * beta, K_p=K_p, k_d=k_d)


@dataclass(frozen=True)
class RegionOfAttraction:
    """What `region_of_attraction` finds.

    Attributes
    ----------
    radius : float
        Initial errors of a smaller norm are in the region, see `region_of_attraction` for the norm; infinite if
        c_2 = c_5 = 0.
    alpha, beta : float
        Roots of s^2 - Lambda_0 s + Lambda_1, in the order with the larger radius.
    l : float
        The free constant at which it is told.
    kappa_m, kappa_7, kappa_8 : float
        Constants of (51), at that l.
    lambda_x, lambda_vartheta : float
        Bounds of the Lyapunov function, (44).
    """

    radius: float
    alpha: float
    beta: float
    l: float  # noqa: E741 (the paper's letter)
    kappa_m: float
    kappa_7: float
    kappa_8: float
    lambda_x: float
    lambda_vartheta: float


def region_of_attraction(
    gains: NeuralAdaptivePidGains,
    bounds: Bounds,
    *,
    l: float | None = None,  # noqa: E741
) -> RegionOfAttraction:
    """Return the radius of initial errors of one follower for which Theorem 1 promises that they stay bounded.

    It is R_A of Theorem 1 for N = 1, with (44) and (52)::

        radius = sqrt(lambda_x (kappa_m - kappa_7)/(kappa_8 lambda_vartheta))

        lambda_x        = min(lambda_min(K_p), lambda_m)/2
        lambda_vartheta = max(lambda_max(K_p), lambda_M, 1/gamma_w, 1/gamma_theta)/2
        kappa_m         = smallest margin of (39) to (42)
        kappa_7         = ((c_1 + c_4)/l + 3 c_3)/2
        kappa_8         = (c_2 + c_5)/(2 l)

    The radius bounds the Euclidean norm, at time zero, of the errors (xi_c, xi_o, epsilon, q_tilde) in m and rad, of
    (s_c, s_o) in m/s and rad/s, and of those of the weights and of the robust gain (W_tilde, theta_tilde) in N and
    N.m, added as plain SI numbers, as the paper does. The errors of the weights count: with W_hat(0) = 0 they are as
    large as the ideal weights.

    Where the mathematics says otherwise than print:

    - For N followers, R_A is printed with the sums of kappa_m and kappa_7 over all of them and the least kappa_8. That
      does not follow from (51), in which each follower needs kappa_mi > kappa_7i + kappa_8i |x_i|^2 for itself: N equal
      followers would have sqrt(N) times the radius of one. As neither V_i nor a law depends on another follower, each
      has the region computed here for its own gains and bounds.
    - A radius needs kappa_m > kappa_7, which (39) to (42) do not say: they say kappa_m > 0. As c_3 is known, see
      `Bounds`, it needs at least kappa_m > 3 sqrt(1 + alpha^2 + beta^2).
    - (51) makes V decrease only outside a ball whose radius grows with gamma of (52), so that V(t) <= V(0) does not
      follow for all t. What is promised needs that the largest V there, errors of the weights and of the robust gain
      included, is less than lambda_x (kappa_m - kappa_7)/kappa_8. This contains the ideal weights and theta, which
      nobody knows, and is not checked here.
    - "Arbitrarily large" is not to be had by gains: with kappa_m <= (1 - l) lambda_min(K_p) + lambda_d by (41), l < 2
      by (40), lambda_x <= lambda_m/2 and lambda_vartheta >= max(lambda_max(K_p), lambda_M)/2, the squared radius is at
      most (lambda_m/2 + 4 lambda_d lambda_m/lambda_M)/(c_2 + c_5). No gain makes c_5 small: chi_2, (37), contains
      C(q_dot) (s_o - s_c).
    - Property 1 takes lambda_m and lambda_M over all errors e, where there are none: M = R^-T M2 R^-1 has an eigenvalue
      that tends to zero with the range and one that grows without bound as the bearing goes to 90 degrees. They can
      hold on a set only, and nothing in the theorem keeps the robot in it.

    Parameters
    ----------
    gains
        Gains of the paper's law.
    bounds
        What is known of the formation model, with lambda_M.
    l
        The free constant; the one with the largest radius if left out.

    Raises
    ------
    GainError
        If the gains are another law's, Lambda_0 or Lambda_1 differs between range and bearing, or gamma_w or
        gamma_theta is zero.
    ControllerError
        If the bounds are no `Bounds`, lambda_M is not known, c_3 is less than it can be, l is not positive and finite,
        or the theorem promises nothing: one of (39) to (42) fails, or kappa_m does not exceed kappa_7.
    """
    _require(gains, NeuralAdaptivePidGains, bounds)
    if bounds.lambda_M is None:
        raise ControllerError("the bound lambda_M is not given: the region of attraction depends on it, (44)")
    for name in ("gamma_w", "gamma_theta"):
        if getattr(gains, name) == 0:
            raise GainError(f"gain {name!r} is 0: Theorem 1 needs a positive one")
    if l is not None and not (math.isfinite(l) and l > 0):
        raise ControllerError(f"the constant l is {l}: it must be positive and finite")
    report = check_gains(gains, bounds)
    if math.isnan(report.alpha):
        raise ControllerError(f"Theorem 1 promises nothing: {str(report).splitlines()[0]}")
    least = 2 * math.hypot(1, report.alpha, report.beta)
    if bounds.c_3 < least * (1 - 1e-9):
        raise ControllerError(f"the bound c_3 is {bounds.c_3:g}: with these gains (27) needs at least {least:.6g}")

    def kappa_7(l: float) -> float:  # noqa: E741
        return 0.5 * ((bounds.c_1 + bounds.c_4) / l + 3 * bounds.c_3)

    def squared(sides: Sides, l: float) -> float:  # noqa: E741
        """Return the squared radius but for a constant factor; it is concave in l, as every l kappa is."""
        return l * (_least_margin(sides, l) - kappa_7(l))

    orders = []
    for pair in _orders(gains):
        sides = _sides(*pair, gains, bounds)
        orders.append((pair, sides, _argmax(partial(squared, sides)) if l is None else l))
    (alpha, beta), sides, best = max(orders, key=lambda order: squared(order[1], order[2]))
    kappa_m = _least_margin(sides, best)
    if not kappa_m > kappa_7(best):
        at, where, tried = best, "as given", sides
        if l is None:
            at, where, tried = report.l, "where all come nearest", _sides(report.alpha, report.beta, gains, bounds)
        failing = ", ".join(name for name, side in tried.items() if not side(at)[0] > side(at)[1])
        if failing:
            raise ControllerError(f"Theorem 1 promises nothing: not satisfied with l = {at:.4g}, {where}: {failing}")
        exceeds = "exceeds kappa_7, (52), for no l" if l is None else f"does not exceed kappa_7, (52), with l = {l:g}"
        raise ControllerError(f"Theorem 1 promises nothing: kappa_m {exceeds}")
    low, high = min(gains.K_p), max(gains.K_p)  # type: ignore[arg-type]
    lambda_x = 0.5 * min(low, bounds.lambda_m)
    lambda_vartheta = 0.5 * max(high, bounds.lambda_M, 1 / gains.gamma_w, 1 / gains.gamma_theta)
    kappa_8 = 0.5 * (bounds.c_2 + bounds.c_5) / best
    room = kappa_m - kappa_7(best)
    radius = math.sqrt(lambda_x * room / (kappa_8 * lambda_vartheta)) if kappa_8 else math.inf
    return RegionOfAttraction(radius, alpha, beta, best, kappa_m, kappa_7(best), kappa_8, lambda_x, lambda_vartheta)


def _require(gains: object, gains_type: type[ObserverPidGains], bounds: object) -> None:
    """Refuse what are no gains of this type or no bounds."""
    if not isinstance(gains, gains_type):
        raise GainError(f"the gains are {type(gains).__name__}: the theorem is about {gains_type.__name__}")
    if not isinstance(bounds, Bounds):
        raise ControllerError(f"the bounds are {bounds!r}: expected Bounds")


def _largest(bearings: ArrayLike) -> float:
    """Return the largest magnitude of bearings."""
    try:
        magnitudes = np.abs(np.asarray(bearings, dtype=float))
    except (TypeError, ValueError):
        magnitudes = np.array([math.nan])
    if not (magnitudes.size and np.isfinite(magnitudes).all()):
        raise ControllerError(f"the desired bearing is {bearings!r}: expected one or more finite numbers")
    return float(magnitudes.max())


def _orders(gains: ObserverPidGains) -> list[tuple[float, float]]:
    """Return both orders of the roots alpha and beta; one pair of NaN if they are not real."""
    total, product = gains.Lambda_0[0], gains.Lambda_1[0]  # type: ignore[index]
    discriminant = total * total - 4 * product
    if discriminant < 0:
        return [(math.nan, math.nan)]
    larger = (total + math.sqrt(discriminant)) / 2
    smaller = product / larger
    return [(smaller, larger), (larger, smaller)]


def _report(alpha: float, beta: float, gains: ObserverPidGains, bounds: Bounds) -> GainReport:
    """Return the report on (39) to (42) for one order of alpha and beta."""
    sides, intervals = _sides(alpha, beta, gains, bounds), _intervals(alpha, beta, gains, bounds)
    best = 1.0 if math.isnan(alpha) else _argmax(partial(_least_margin, sides))
    conditions = tuple(Condition(name, *side(best), *intervals[name]) for name, side in sides.items())
    total, product = gains.Lambda_0[0], gains.Lambda_1[0]  # type: ignore[index]
    return GainReport(alpha, beta, best, conditions, total * total - 4 * product)


Sides = dict[str, Callable[[float], tuple[float, float]]]


def _least_margin(sides: Sides, l: float) -> float:  # noqa: E741
    """Return the smallest difference of left and right side at a constant l."""
    return min(left - right for left, right in (side(l) for side in sides.values()))


def _sides(alpha: float, beta: float, gains: ObserverPidGains, bounds: Bounds) -> Sides:
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


def _argmax(function: Callable[[float], float]) -> float:
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

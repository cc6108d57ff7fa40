"""The region of attraction that Theorem 1 promises, (52)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from formation_controllers.analysis.gain_conditions import (
    Bounds,
    Sides,
    argmax,
    check_gains,
    least_margin,
    orders_of_roots,
    require,
    sides_of,
)
from formation_controllers.errors import ControllerError, GainError
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePidGains
from formation_controllers.vehicles import is_positive


@dataclass(frozen=True)
class RegionOfAttraction:
    """The findings of `region_of_attraction`.

    Attributes
    ----------
    radius : float
        Initial errors of a smaller norm are in the region, see `region_of_attraction` for the norm; infinite if
        c_2 = c_5 = 0.
    alpha, beta : float
        Roots of s^2 - Lambda_0 s + Lambda_1, in the order with the larger radius.
    l : float
        The free constant of this region.
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
        Bounds of the formation model, with lambda_M.
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
    require(gains, NeuralAdaptivePidGains, bounds)
    if bounds.lambda_M is None:
        raise ControllerError("the bound lambda_M is not given: the region of attraction depends on it, (44)")
    for name in ("gamma_w", "gamma_theta"):
        if getattr(gains, name) == 0:
            raise GainError(f"gain {name!r} is 0: Theorem 1 needs a positive one")
    if l is not None and not is_positive(l):
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
        return l * (least_margin(sides, l) - kappa_7(l))

    orders = []
    for pair in orders_of_roots(gains):
        sides = sides_of(*pair, gains, bounds)
        orders.append((pair, sides, argmax(partial(squared, sides)) if l is None else l))
    (alpha, beta), sides, best = max(orders, key=lambda order: squared(order[1], order[2]))
    kappa_m = least_margin(sides, best)
    if not kappa_m > kappa_7(best):
        at, where, tried = best, "as given", sides
        if l is None:
            at, where, tried = report.l, "where all come nearest", sides_of(report.alpha, report.beta, gains, bounds)
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

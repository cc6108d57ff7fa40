"""The velocity observer (32) to (34), for one component of q."""

from __future__ import annotations

from formation_controllers.compiled import part


@part
def rate_estimate(p: float, q_tilde: float, Lambda_0: float, k_d: float) -> float:
    """Estimated rate q_hat_dot = R v_hat + delta, (32) multiplied by R."""
    return p + (Lambda_0 + k_d) * q_tilde


@part
def p_dot(zeta: float, q_tilde: float, q_d_ddot: float, Lambda_0: float, Lambda_1: float, k_d: float) -> float:
    """Rate of the observer's state p, (33)."""
    return q_d_ddot + k_d * Lambda_0 * q_tilde + Lambda_1 * q_tilde + zeta


@part
def zeta_dot(q_tilde: float, Lambda_1: float, k_d: float) -> float:
    """Rate of the observer's integral zeta, (34)."""
    return k_d * Lambda_1 * q_tilde

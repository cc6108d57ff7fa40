"""Steps of constant length that a Co-Simulation FMU takes inside, and whether they fit a communication step."""

from __future__ import annotations

from cosim.clock import whole


def divides(part: float, step: float) -> bool:
    """Return whether a communication step is a whole number of steps of a length, both in seconds."""
    return part > 0 and bool(whole(step / part))


def remedy(fitting: float) -> str:
    """Return the advice that gives a scenario a fitting communication step."""
    return (
        f'state step="{fitting:.12g} s" or a multiple in <simulation>, or try it with '
        f"--set 'simulation/@step={fitting:.12g} s' of formation run, --step '{fitting:.12g} s' of compare-plants"
    )


def misfit(usual: float, step: float) -> str:
    """Return why an FMU may not complete its steps, with the FMU as the subject; empty if there is no reason.

    Parameters
    ----------
    usual
        The step [s] of its default experiment, if it takes steps of constant length only; else 0.
    step
        The communication step [s].
    """
    if not usual or divides(usual, step):
        return ""
    return (
        f"takes steps of constant length only, and of {usual:.12g} s in its default experiment, which do not divide "
        f"the communication step of {step:.12g} s: if it does not complete its steps, {remedy(usual)}"
    )

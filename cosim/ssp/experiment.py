"""Step and end of a run, as an SSP states them."""

from __future__ import annotations

import math

from cosim.clock import whole
from cosim.errors import InputError
from cosim.quantity import whole_steps
from cosim.scenario.reader.times import LONGEST, MAX_TICKS
from cosim.ssp.structure import Structure


def experiment(structure: Structure, step: float, horizon: float, *, rounds: bool = False) -> tuple[float, float]:
    """Return the communication step and the end of the run [s], which a scenario can have.

    Parameters
    ----------
    structure
        The system.
    step, horizon
        Where it states none.
    rounds
        Whether the end is put off to that of a step, as the SSP does not state both.

    Raises
    ------
    InputError
        A scenario cannot have them; with the place in the SSP.
    """
    step, horizon = structure.step or step, structure.stop or horizon
    for value, place in ((step, structure.step_where), (horizon, structure.stop_where)):
        if value > LONGEST:
            raise InputError(f"the experiment states {value:g} s, where at most {LONGEST:g} s are possible", place)
    where = structure.stop_where if structure.stop else structure.step_where
    steps = horizon / step
    if steps > MAX_TICKS:
        raise InputError(
            f"the experiment has {steps:g} communication steps of {step:g} s; at most {MAX_TICKS} are possible", where
        )
    count = whole(steps)
    if (count is None or count < 1) and not rounds:
        raise InputError(
            f"the experiment ends at {horizon:g} s, which is not a whole number of communication steps of {step:g} s, "
            f"such as {whole_steps(steps, step, 1)}",
            where,
        )
    return step, horizon if count else math.ceil(steps) * step

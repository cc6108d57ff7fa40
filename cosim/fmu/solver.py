"""Checks that an FMU fits the solver that a scenario states for it, and the communication step."""

from __future__ import annotations

import math

from cosim.errors import InputError
from cosim.fmu.interfaces import experiment_number, interfaces
from cosim.fmu.vehicle import Fmu
from cosim.plant.constant_step import divides, remedy
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE
from cosim.scenario.scenario import DEFAULT_SOLVER, PlantSource


def check_solver(fmu: Fmu, source: PlantSource) -> None:
    """Refuse settings of a solver that the FMU does not use."""
    asked = {"solver": source.solver or None, "solver_step": source.solver_steps}
    given = [name for name, value in asked.items() if value is not None]
    if fmu.interface == CO_SIMULATION and source.tolerance is not None:
        if source.model is not None:
            raise InputError(
                f'a built-in model takes its tolerance as <parameter name="tolerance" value="{source.tolerance:g}"/>',
                source.where,
            )
        if fmu.description.fmiVersion == "1.0":
            raise InputError(f"the FMU {fmu.path} is FMI 1.0 Co-Simulation, which takes no tolerance", source.where)
    if fmu.interface == CO_SIMULATION and given:
        other = (
            f'; or state interface="{MODEL_EXCHANGE}", whose solver takes it'
            if len(interfaces(fmu.description)) > 1
            else ""
        )
        raise InputError(
            f"the FMU {fmu.path} runs in Co-Simulation with a solver of its own: remove {' and '.join(given)}{other}",
            source.where,
        )
    solver = source.solver or DEFAULT_SOLVER
    if fmu.interface == MODEL_EXCHANGE and source.tolerance is not None and solver != "cvode":
        raise InputError(
            f'{solver} makes steps of constant length and has no tolerance: state a solver_step, or solver="cvode"',
            source.where,
        )


def check_step(fmu: Fmu, source: PlantSource, step: float) -> None:
    """Refuse an FMU whose fixed internal step does not divide the communication step."""
    said = fmu.about_interface.fixedInternalStepSize
    if said and not divides(internal := _number(said), step):
        raise InputError(
            f"the FMU {fmu.path} has a fixed internal step of {internal:g} s, which does not divide the "
            f"communication step of {step:g} s" + (f": {remedy(internal)}" if internal > 0 else ""),
            source.where,
        )


def usual_step(fmu: Fmu) -> float:
    """Return the step [s] of an FMU's default experiment if it takes steps of constant length only, else 0.

    FMI 1.0 and 2.0 cannot state a fixed internal step, but many FMUs have one: they take constant steps only,
    and the step of their default experiment fits.
    """
    usual = experiment_number(fmu.description, "stepSize")
    constant = not fmu.about_interface.canHandleVariableCommunicationStepSize
    return usual if fmu.interface == CO_SIMULATION and constant and usual is not None else 0.0


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan

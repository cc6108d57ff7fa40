"""Whether an FMU fits how it is to be stepped: the solver that is stated for it, and the communication step."""

from __future__ import annotations

import math

from cosim.errors import InputError
from cosim.fmu import Fmu, experiment_number, interfaces
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE
from cosim.scenario import DEFAULT_SOLVER, PlantSource


def check_solver(fmu: Fmu, source: PlantSource) -> None:
    """Refuse what is said of a solver that an FMU does not use."""
    asked = {"solver": source.solver or None, "solver_step": source.solver_steps}
    given = [name for name, value in asked.items() if value is not None]
    if fmu.interface == CO_SIMULATION and source.tolerance is not None:
        if source.model is not None:
            raise InputError(
                f'a built-in model has a parameter for it: <parameter name="tolerance" value="{source.tolerance:g}"/>',
                source.where,
            )
        if fmu.description.fmiVersion == "1.0":
            raise InputError(f"the FMU {fmu.path} is FMI 1.0 Co-Simulation, which is told no tolerance", source.where)
    if fmu.interface == CO_SIMULATION and given:
        other = (
            f"; with the interface {MODEL_EXCHANGE} the solver would be asked"
            if len(interfaces(fmu.description)) > 1
            else ""
        )
        raise InputError(
            f"the FMU {fmu.path} is used by Co-Simulation and brings its own solver, with which no "
            f"{' and no '.join(given)} goes{other}",
            source.where,
        )
    solver = source.solver or DEFAULT_SOLVER
    if fmu.interface == MODEL_EXCHANGE and source.tolerance is not None and solver != "cvode":
        raise InputError(
            f'{solver} makes the steps that it is told and has no tolerance: state a solver_step, or solver="cvode"',
            source.where,
        )


def check_step(fmu: Fmu, source: PlantSource, step: float) -> None:
    """Refuse an FMU whose fixed internal step does not divide the communication step."""
    said = getattr(fmu.about_interface, "fixedInternalStepSize", None)
    if said and not _divides(internal := _number(said), step):
        raise InputError(
            f"the FMU {fmu.path} has a fixed internal step of {internal:g} s, which does not divide the "
            f"communication step of {step:g} s",
            source.where,
        )


def step_doubt(fmu: Fmu, step: float) -> str:
    """Return why an FMU may not complete its steps, with the FMU as the subject; empty if nothing speaks against it.

    What FMI 1.0 and 2.0 cannot say, a fixed internal step, many FMUs have all the same: they take constant steps only,
    and the step of their default experiment is one that fits.
    """
    usual = experiment_number(fmu.description, "stepSize")
    constant = not getattr(fmu.about_interface, "canHandleVariableCommunicationStepSize", True)
    if fmu.interface != CO_SIMULATION or not constant or usual is None or _divides(usual, step):
        return ""
    return (
        f"takes steps of constant length only, and of {usual:g} s in its default experiment, which do not divide the "
        f'communication step of {step:g} s: if it does not complete its steps, state step="{usual:g} s" or a multiple '
        "in <simulation>"
    )


def _divides(part: float, step: float) -> bool:
    parts = step / part if part > 0 else 0.0
    return round(parts) >= 1 and abs(parts - round(parts)) <= 1e-9 * parts


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan

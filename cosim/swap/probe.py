"""A short drive of an FMU with open questions: which output moves under which input."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, SimulationError
from cosim.fmu.binding import start_of
from cosim.fmu.capabilities import obstacle
from cosim.fmu.interfaces import choose_interface, experiment_number, interfaces
from cosim.fmu.model_description import ModelDescription
from cosim.fmu.package import Package
from cosim.plant.failures import PlantError
from cosim.plant.process import PlantProcess, end
from cosim.plant.spec import CO_SIMULATION, Block, Exchanged, PlantSpec
from cosim.scenario.scenario import OPEN
from cosim.swap.candidates import Number, Numbers
from cosim.swap.proposal import Proposal, Suggestion
from cosim.undisturbed import undisturbed

DURATION = 1.0
"""Length of the drive [s]."""
_STEP = 0.02
_AMPLITUDES = (1.0, 10.0)
"""Amplitudes of an input, in the FMU's own unit; the second one if nothing moves under the first."""
_MOST_INPUTS, _MOST_OUTPUTS = 3, 24
_TIME_LIMIT = 5.0
"""Time limit [s] of the FMU for its start, and for a step."""
_PATIENCE = 20.0
"""Time limit [s] of the whole drive."""
_MOVED = 1e-9
"""Relative change that counts as a movement."""


@dataclass(frozen=True)
class Probe:
    """The movements in a short drive.

    Attributes
    ----------
    inputs : tuple of str
        The inputs that the drive has set: one after the other and, if there are two or more, all together.
    amplitude : float
        Amplitude of the inputs, in the FMU's own units.
    changes : dict
        By the output: its difference after `DURATION` to the run without any input, one number for each run.
    problem : str
        Reason why there are no movements; empty if there are.
    """

    inputs: tuple[str, ...] = ()
    amplitude: float = 0.0
    changes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    problem: str = ""


def probed(package: Package, proposal: Proposal) -> Probe:
    """Drive an FMU in processes of its own and return its movements, or the reason why there are none."""
    if sentence := obstacle(package):
        return Probe(problem=sentence)
    numbers = Numbers(package.description)
    played = {s.source.variable for s in proposal.suggestions if s.source is not None}
    commands = {role.name for role in proposal.kind.command}
    named = [name for s in proposal.suggestions if s.role.name in commands for name in _names(s)]
    inputs = [n for n in numbers.of("input") if n.name in named] or numbers.of("input")
    outputs = [n for causality in ("output", "local") for n in numbers.of(causality) if n.name in played]
    outputs += [n for n in numbers.of("output") if n not in outputs]
    try:
        return _driven(package, inputs[:_MOST_INPUTS], outputs[:_MOST_OUTPUTS])
    except (InputError, SimulationError, PlantError, ValueError, OSError) as error:
        return Probe(problem=str(error))


def with_doubts(proposal: Proposal, probe: Probe) -> Proposal:
    """Return a proposal with a doubt at each role that the drive contradicts."""
    return replace(
        proposal,
        suggestions=tuple(
            replace(s, doubts=(*s.doubts, *_contradictions(proposal, s.role.name, probe))) for s in proposal.suggestions
        ),
    )


# The drive --------------------------------------------------------------------------------------------------


def _driven(package: Package, inputs: Sequence[Number], outputs: Sequence[Number]) -> Probe:
    spec, given, shown = _spec(package, inputs, outputs)
    rest = np.array(spec.inputs.start)
    until = time.monotonic() + _PATIENCE
    for amplitude in _AMPLITUDES:
        runs = [rest.copy() for _ in range(len(given) + 1 + (len(given) > 1))]
        for run, place in zip(runs[1:], given, strict=False):
            run[place] += amplitude
        runs[-1][given] = rest[given] + amplitude
        ends = _run(spec, _step(package.description), runs, until)
        changes = np.array([(end - ends[0])[shown] for end in ends[1:]])
        moved = np.abs(changes) > _MOVED * (1.0 + np.abs(ends[0][shown]))
        if moved.any():
            break
    names = {number.name: tuple((changes[:, i] * moved[:, i]).tolist()) for i, number in enumerate(outputs)}
    return Probe(tuple(number.name for number in inputs), amplitude, names)


def _run(spec: PlantSpec, step: float, runs: Sequence[NDArray[np.float64]], until: float) -> list[NDArray[np.float64]]:
    """Return the outputs at the end of runs with constant inputs, side by side."""
    processes: list[PlantProcess] = []
    try:
        for _ in runs:
            with undisturbed():  # a process that is not in the list would be left
                processes.append(PlantProcess([spec]))
        for process in processes:
            process.wait_until_started()
        for tick in range(round(DURATION / step)):
            if time.monotonic() > until:
                raise PlantError(f"it takes more than {_PATIENCE:g} s")
            for process, inputs in zip(processes, runs, strict=True):
                process.board.inputs[:] = inputs
                process.begin(tick * step, step)
            for process in processes:
                process.finish()
                for said in process.failures().values():
                    raise PlantError(said)
        return [process.board.outputs.copy() for process in processes]
    finally:
        end(processes)


def _spec(
    package: Package, inputs: Sequence[Number], outputs: Sequence[Number]
) -> tuple[PlantSpec, list[int], list[int]]:
    """Return the FMU as a plant without a binding, and the places of the inputs and of the outputs."""
    description = package.description
    interface = choose_interface(package, "", None)
    about = interfaces(description)[interface]
    input_block, given = _block(inputs)
    output_block, shown = _block(outputs)
    fmi1 = description.fmiVersion == "1.0"
    spec = PlantSpec(
        robot="probe",
        file=package.path.name,
        directory=str(package.directory),
        fmi=description.fmiVersion,
        interface=interface,
        identifier=about.modelIdentifier,
        token=description.guid or "",
        values=(),
        inputs=input_block,
        outputs=output_block,
        stop_time=DURATION,
        states=description.numberOfContinuousStates,
        event_indicators=description.numberOfEventIndicators,
        completed_steps=fmi1 or bool(getattr(about, "needsCompletedIntegratorStep", False)),
        tolerance=experiment_number(description, "tolerance") if interface == CO_SIMULATION and not fmi1 else None,
        time_limit=_TIME_LIMIT,
    )
    return spec, given, shown


def _block(numbers: Iterable[Number]) -> tuple[Block, list[int]]:
    first: dict[tuple[str, int], int] = {}
    variables: list[Exchanged] = []
    start: list[float] = []
    places = []
    for number in numbers:
        variable = number.variable
        key = (variable.type, variable.valueReference)
        if key not in first:
            first[key] = len(start)
            start += start_of(variable)
            variables.append(Exchanged(variable.name, variable.type, len(start) - first[key]))
        places.append(first[key] + number.element)
    return Block(tuple(reference for _, reference in first), tuple(start), tuple(variables)), places


def _step(description: ModelDescription) -> float:
    """Return a communication step: a multiple of the default experiment's step, if that divides a second."""
    own = experiment_number(description, "stepSize") or _STEP
    step = own * max(1, round(_STEP / own))
    return step if step <= DURATION / 5 else _STEP


# Conclusions -----------------------------------------------------------------------------------------------


def _names(suggestion: Suggestion) -> tuple[str, ...]:
    source = suggestion.source
    return suggestion.candidates or ((source.variable,) if source is not None and source.variable != OPEN else ())


def _contradictions(proposal: Proposal, role: str, probe: Probe) -> Iterable[str]:
    player = {s.role.name: s.source.variable for s in proposal.suggestions if s.source is not None}
    name = player.get(role, "")
    if probe.problem or name not in probe.changes:
        return
    if not any(probe.changes[name]):
        if any(map(any, probe.changes.values())):
            yield f"in a short drive {name!r} moves under no input, while others do: check that it is the right one"
        return
    for response in proposal.kind.responses:
        command, sign = response.command, response.sign
        if response.role != role or player.get(command) not in probe.inputs:
            continue
        change = probe.changes[name][probe.inputs.index(player[command])] * sign
        if change <= 0:
            what = f"moves by {change * sign:.3g}" if change else "does not move"
            way = "up" if sign > 0 else "down"
            drive = f"{player[command]!r} = {probe.amplitude:g}"
            yield (
                f"in a short drive {name!r} {what} under {drive} alone, but {role} goes {way} with {command}: "
                "check names and signs"
            )

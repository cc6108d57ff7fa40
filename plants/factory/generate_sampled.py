"""The files of the FMU of a sampled model, `plants.sampled.Sampled`, around the C that it brings."""

import itertools
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from plants.factory.assemble import VERSIONS, rendered, runtime_of
from plants.factory.variables import Entry, Table, Unknown
from plants.sampled import Port, Sampled

RUNTIME = ("sampled/model.h", "sampled/simulation.c", "sampled/simulation_state.h")
_TEMPLATES = {
    "documentation/index.html": "sampled/documentation.html.jinja",
    "sources/config.h": "sampled/config.h.jinja",
    "sources/variables.c": "sampled/variables.c.jinja",
}
_STRUCTURED = re.compile(
    r"[A-Za-z_][A-Za-z0-9_]*(\[[1-9][0-9]*(,[1-9][0-9]*)*\])?(\.[A-Za-z_][A-Za-z0-9_]*(\[[1-9][0-9]*(,[1-9][0-9]*)*\])?)*"
)


def generate_sampled(model: Sampled, fmi: str) -> dict[str, bytes]:
    """Return the files of a sampled model's FMU, but the binaries, by their path in the FMU."""
    version, table = VERSIONS[fmi], _tabulate(model)
    files = runtime_of(version, RUNTIME) | {f"sources/{name}": text.encode() for name, text in model.sources.items()}
    files |= {f"resources/{name}": content for name, content in model.resources.items()}
    attributes = {"canHandleVariableCommunicationStepSize": "false"}
    attributes |= {"fixedInternalStepSize": repr(model.step)} if fmi == "3.0" else {}
    is_structured = all(_STRUCTURED.fullmatch(variable.name) for variable in table.variables)
    context = {
        "model": model,
        "table": table,
        "interfaces": {"CoSimulation": attributes},
        "naming": "structured" if is_structured else "flat",
        "stop": model.stop,
        "needs_tool": model.program,
    }
    templates = version.templates | _TEMPLATES
    # An icon is all that is left of terminals and icons, which the hand-written files bring.
    return rendered(files, templates, context)


def _tabulate(model: Sampled) -> Table:
    references = itertools.count()

    def entries(ports: Iterable[Port], causality: str, variability: str, initial: str | None) -> tuple[Entry, ...]:
        return tuple(
            Entry(
                reference=next(references),
                name=port.name,
                causality=causality,
                variability="tunable" if port.tunable else variability,
                initial=initial,
                description=port.description,
                unit=port.unit,
                start=None if causality == "output" else port.start,
                min=port.min,
                max=port.max,
                above=port.above,
                below=port.below,
            )
            for port in ports
        )

    inputs = entries(model.inputs, "input", "continuous", None)
    parameters = entries(model.parameters, "parameter", "fixed", "exact")
    outputs = entries(model.outputs, "output", "discrete", "calculated")
    numbers = entries(model.integers, "parameter", "fixed", "exact")
    integers = tuple(
        replace(entry, start=int(port.start), whole=True) for entry, port in zip(numbers, model.integers, strict=True)
    )
    time = Entry(next(references), "time", "independent", "continuous", None, "Time", unit="s")
    reference_of = {entry.name: entry.reference for entry in inputs}
    unknowns = tuple(
        _unknown(entry.reference, () if model.late else port.depends, reference_of)
        for entry, port in zip(outputs, model.outputs, strict=True)
    )
    return Table(
        (), (), inputs, parameters, outputs, integers, time, unknowns, (), unknowns, step=model.step, tolerance=None
    )


def _unknown(reference: int, depends: Iterable[str] | None, inputs: Mapping[str, int]) -> Unknown:
    found = tuple(sorted(inputs[name] for name in (inputs if depends is None else depends)))
    return Unknown(reference, found, ("dependent",) * len(found))

"""What ``formation inspect`` prints of an FMU."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import islice

from rich.console import Console

from cosim.cli.console import broken, out, safe, table, warn
from cosim.cli.fmi_rules import rules_kept
from cosim.errors import printable
from cosim.fmu.archive import size
from cosim.fmu.binaries import has_sources, machines, this_machine
from cosim.fmu.binding import match, shape_of
from cosim.fmu.capabilities import NAMES, obstacle
from cosim.fmu.interfaces import interfaces
from cosim.fmu.model_description import DefaultExperiment, Variable
from cosim.fmu.package import Package
from cosim.fmu.reference_experiments import carries_experiments
from cosim.fmu.units import unit_name
from cosim.plant.spec import CO_SIMULATION
from cosim.scenario.scenario import OPEN, RoleSource
from cosim.swap.proposal import Proposal, attributes, proposals

NARROW = 120
"""Columns of a terminal below which a variable's causality, variability and type share a column."""
ROWS = 60
"""Number of variables that are shown without ``--all``."""

_CAN = {
    "needsExecutionTool": "needs the tool that made it",
    "canBeInstantiatedOnlyOncePerProcess": "only once per process (each robot then has a process of its own)",
    "canHandleVariableCommunicationStepSize": "variable communication step",
    "hasEventMode": "event mode",
    "providesIntermediateUpdate": "intermediate update",
    "mightReturnEarlyFromDoStep": "may return early from a step",
    "canGetAndSetFMUstate": "saved states",
    "canGetAndSetFMUState": "saved states",
    "providesDirectionalDerivative": "directional derivatives",
    "providesDirectionalDerivatives": "directional derivatives",
    "providesAdjointDerivatives": "adjoint derivatives",
}
_ORDER = {
    causality: place
    for place, causality in enumerate(
        ("input", "output", "parameter", "structuralParameter", "calculatedParameter", "independent")
    )
}


def print_content(package: Package, *, strict: bool, every: bool) -> None:
    """Print the description of an FMU, its capabilities, and the kinds of vehicle that it could be.

    Parameters
    ----------
    strict
        Whether a breach of a rule of FMI is refused.
    every
        Whether all variables and warnings are printed, however many.

    Raises
    ------
    InputError
        It breaks a rule, and `strict` asks for the refusal.
    """
    console = out()
    _print_identity(console, package)
    _print_interfaces(console, package)
    _print_variables(console, package, None if every else ROWS)
    _print_contracts(console, package)
    if sentence := obstacle(package):
        warn(sentence)
    rules_kept(package, strict, every=every)


# Facts ----------------------------------------------------------------------------------------------------


def _print_identity(console: Console, package: Package) -> None:
    said = package.description
    bytes_ = size(package.path)
    rows = {
        "model": said.modelName,
        "description": said.description,
        "FMI version": said.fmiVersion,
        "made by": " on ".join(filter(None, (said.generationTool, said.generationDateAndTime))),
        "version": said.version,
        "author": said.author,
        "licence": said.license,
        "copyright": said.copyright,
        "token" if said.fmiVersion.startswith("3") else "GUID": said.guid,
        "SHA-256": package.sha256,
        "size": f"{bytes_ / 1e6:.2f} MB" if bytes_ >= 1e5 else f"{bytes_} bytes",
        "runs on": _platforms(package),
        "default experiment": ", ".join(_experiment(said.defaultExperiment)),
        "self-test": "--self-test replays its reference experiment" if carries_experiments(package) else "",
        "states": f"{said.numberOfContinuousStates}" if said.modelExchange is not None else "",
    }
    shown = table(console, safe(package.path.name))
    shown.show_header = False
    shown.add_column(no_wrap=True)
    shown.add_column(overflow="fold")
    for name, text in rows.items():
        if text:
            shown.add_row(name, safe(text))
    console.print(shown)


def _platforms(package: Package) -> str:
    here, names = this_machine(package.description), machines(package)
    sources = "; it brings its C sources" if has_sources(package) else ""
    whether = f"this machine, {here}, is {'' if here in names else 'not '}among them"
    return f"{', '.join(names) or 'no machine'}: {whether}{sources}"


def _experiment(experiment: DefaultExperiment | None) -> Iterator[str]:
    if experiment is not None:
        for name, text in (("start", "startTime"), ("stop", "stopTime"), ("step", "stepSize")):
            if (value := getattr(experiment, text)) is not None:
                yield f"{name} {value} s"
        if experiment.tolerance is not None:
            yield f"tolerance {experiment.tolerance}"


def _print_interfaces(console: Console, package: Package) -> None:
    usable = interfaces(package.description)
    shown = table(console, "Interfaces")
    for heading in ("interface", "here", "capabilities"):
        shown.add_column(heading, no_wrap=heading != "capabilities")
    for name, said in package.capabilities.items():
        shown.add_row(
            NAMES[name],
            "supported" if name in usable else "not supported",
            safe(", ".join(_capabilities(name, said))),
        )
    console.print(shown)


def _capabilities(interface: str, said: Mapping[str, str]) -> Iterator[str]:
    true = ("true", "1")
    if interface == CO_SIMULATION and said.get("canHandleVariableCommunicationStepSize") not in true:
        yield "constant communication step"
    if "fixedInternalStepSize" in said:
        yield f"fixed internal step of {said['fixedInternalStepSize']} s, which must divide the communication step"
    yield from (text for name, text in _CAN.items() if said.get(name) in true)


# Its variables ----------------------------------------------------------------------------------------------


def _print_variables(console: Console, package: Package, rows: int | None) -> None:
    every = package.description.modelVariables
    numbers = Counter([variable.causality for variable in every])
    ranks = {causality: _ORDER.get(causality, len(_ORDER)) for causality in numbers}
    variables = islice((v for rank in sorted(set(ranks.values())) for v in every if ranks[v.causality] == rank), rows)
    counted = ", ".join(f"{numbers[causality]} {causality}" for causality in sorted(numbers, key=ranks.__getitem__))
    shown = table(console, f"Variables: {counted}")
    narrow = console.width < NARROW
    headings = (
        ("name", "what", "unit", "start") if narrow else ("name", "causality", "variability", "type", "unit", "start")
    )
    for heading in (*headings, "description"):
        shown.add_column(heading, overflow="fold", no_wrap=heading != "description")
    for variable in variables:
        kind = (variable.causality, variable.variability, variable.type + _dimensions(variable))
        cells = (
            broken(printable(variable.name), console.width // 3),
            *(("\n".join(filter(None, kind)),) if narrow else kind),
            broken(printable(unit_name(variable)), 12),
            _start(variable) if not narrow else broken(_start(variable), 12),
            variable.description,
        )
        shown.add_row(*(safe(str(cell or "")) for cell in cells))
    console.print(shown)
    if rows is not None and len(every) > rows:
        console.print(f"and {len(every) - rows} more: --all shows them", style="dim")


def _dimensions(variable: Variable) -> str:
    if not variable.dimensions:
        return ""
    try:
        return f"[{', '.join(map(str, shape_of(variable)))}]"
    except ValueError:
        return "[?]"


def _start(variable: Variable) -> str:
    text = str(variable.start if variable.start is not None else "")
    if variable.type == "Enumeration" and variable.declaredType is not None:
        text = next((item.name for item in variable.declaredType.items if item.value == text), text)
    return text if len(text) <= 30 else text[:27] + "..."


# Which vehicle it could be ----------------------------------------------------------------------------------


def _print_contracts(console: Console, package: Package) -> None:
    best, *_ = found = proposals(package.description)
    for proposal in found:
        kind = proposal.kind
        title = f"As a {kind.name} vehicle"
        _, problems = match(kind, package.description)
        if not problems:
            _print_roles(console, f"{title}: it can be driven as it is", proposal)
        elif proposal.plausible and len(proposal.missing) == len(best.missing):
            complete = "" if not proposal.open else ", once it is complete"
            _print_roles(console, f"{title}: it can be driven with a binding{complete}", proposal)
            said = f'"formation swap SCENARIO.xml --plant ID={package.path}" writes the binding to a file'
            console.print(printable(said), markup=False, soft_wrap=True)
        else:
            missing = "; ".join(f"{role.name}, {role.meaning}" for role in proposal.missing)
            reason = proposal.refusal or f"no variable obviously plays {missing}"
            console.print(f"\n[bold]{title}[/]: no, {safe(reason)}", soft_wrap=True)


def _print_roles(console: Console, title: str, proposal: Proposal) -> None:
    shown = table(console, title)
    for heading in ("role", "unit", "meaning", "played by", "to fill in or to look at"):
        shown.add_column(heading, no_wrap=heading in ("role", "unit"), overflow="fold")
    for suggestion in proposal.suggestions:
        if suggestion.source is not None or suggestion.doubts:
            role, remarks = suggestion.role, "; ".join((*suggestion.open, *suggestion.doubts))
            player = broken(printable(_player(suggestion.source)), console.width // 4) if suggestion.source else ""
            shown.add_row(*map(safe, (role.name, role.unit, role.meaning, player, remarks)))
    console.print(shown)
    if absent := [s.role.name for s in proposal.suggestions if s.source is None and not s.doubts]:
        console.print(f"not offered, but not every controller needs them: {', '.join(absent)}", style="dim")


def _player(source: RoleSource) -> str:
    said = attributes(source)
    del said["name"]
    name = [said.pop("variable")] if source.variable not in ("", OPEN) else []
    return " ".join([*name, *(f'{key}="{value}"' for key, value in said.items())])

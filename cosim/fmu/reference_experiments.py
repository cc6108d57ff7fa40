"""The reference experiments that an FMU carries, by the draft layered standard FMI-LS-REF (1.0.0-alpha.1).

The manifest names related files, each with a role (sections 2.1, 2.2). One with the role ``experiment`` (2.5.2) holds
experiments in the format of MA-HS-Experiments, once appendix A of the draft: times, a parameter set (SSV of SSP),
stimuli and references in CSV. FMUs without such a file may have one with the role ``result`` alone, as the Reference
FMUs of the Modelica Association do: these are results of the default experiment of the model description.

The files are written by strangers: nothing outside the FMU is read, no entity is expanded, sizes are limited.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from cosim.errors import InputError
from cosim.fmu.inner_files import FmuFiles, finite, shortened, tag
from cosim.fmu.interfaces import experiment_number
from cosim.fmu.model_description import Variable
from cosim.fmu.package import Package
from cosim.fmu.reference_series import Series, SeriesReader, value_of
from cosim.fmu.units import unit_name

MANIFEST = Path("extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml")
NAME = "org.fmi-standard.fmi-ls-ref"
MAX_EXPERIMENTS = 100
MAX_VALUES = 20_000_000

_NAMESPACE = "{http://fmi-standard.org/fmi-ls-manifest}"
_EXPERIMENTS = ("application/x-ma-hs-experiments", "application/x-ma-ls-experiments")
"""The type of a file of experiments, now and in earlier drafts of the format."""
_REPLAYED = ("experiment", "experiment/smoke-test", "experiment/validation")
_PARAMETERS = "application/x-ssp-parameter-set"
_CSV = "text/csv"
_LONGEST_NAME = 100
_CHILDREN = ("TransientSimulation", "Parameters", "Stimuli", "References", "Annotations")


@dataclass(frozen=True)
class Experiment:
    """An experiment to replay, and its reference results.

    Attributes
    ----------
    name
        Its name.
    start, stop, step
        Start, end and communication step [s].
    tolerance
        The tolerance that it states; None if it states none.
    values
        Start values of the FMU's variables, as text; an enumeration's is its number.
    stimuli, references
        The FMU's inputs and results; None if there are none.
    """

    name: str
    start: float
    stop: float
    step: float
    tolerance: float | None
    values: Mapping[str, str]
    stimuli: Series | None
    references: Series | None


@dataclass(frozen=True)
class Experiments:
    """All experiments of an FMU, and notes that name the experiments left out, with reasons."""

    experiments: tuple[Experiment, ...]
    notes: tuple[str, ...]


def carries_experiments(package: Package) -> bool:
    """Return whether an FMU has a manifest of the layered standard."""
    return (package.directory / MANIFEST).is_file()


def read_experiments(package: Package) -> Experiments:
    """Return the reference experiments of an FMU.

    Raises
    ------
    InputError
        It carries none that can be replayed, or they are broken: file, line and fault.
    """
    if not carries_experiments(package):
        raise InputError(
            f"the FMU {package.path} carries no reference experiment: it has no {MANIFEST.as_posix()}, in which the "
            "layered standard FMI-LS-REF describes one"
        )
    reader = _Reader(package)
    experiments = tuple(reader.experiments())
    if not experiments:
        left_out = f": {'; '.join(reader.notes)}" if reader.notes else f": {MANIFEST.as_posix()} names none"
        raise InputError(
            shortened(f"the FMU {package.path} carries no reference experiment that can be replayed{left_out}")
        )
    return Experiments(experiments, tuple(map(shortened, reader.notes)))


class _Reader:
    def __init__(self, package: Package) -> None:
        self._package = package
        self._files = FmuFiles(package)
        self._tables = SeriesReader(package, self._files)
        self.notes = self._tables.notes

    def experiments(self) -> Iterator[Experiment]:
        """Return the experiments of all files that are experiments, or else the default experiment with its results."""
        root = self._files.xml(MANIFEST, "fmiReferences")
        if root.get(f"{_NAMESPACE}fmi-ls-name", NAME) != NAME:
            raise self._files.error(
                MANIFEST, root, f"is the manifest of {root.get(f'{_NAMESPACE}fmi-ls-name')!r}, not of {NAME}"
            )
        related = [element for element in root if tag(element) == "Related"]
        files = [element for element in related if element.get("role", "").split("/")[0] == "experiment"]
        count = 0
        for element in files:
            if (role := element.get("role", "")) not in _REPLAYED:
                self.notes.append(f"{element.get('source')} is left out: its role is {role}")
            elif (kind := element.get("type", "")) not in _EXPERIMENTS:
                self.notes.append(f"{element.get('source')} is left out: its type is {kind!r}, not {_EXPERIMENTS[0]}")
            else:
                for experiment in self._of_file(self._files.named(MANIFEST, element)):
                    count += 1
                    if count > MAX_EXPERIMENTS:
                        raise self._files.error(MANIFEST, element, f"there are more than {MAX_EXPERIMENTS} experiments")
                    yield experiment
        if not files:
            results = [element for element in related if element.get("role") == "result"]
            for element in results[:MAX_EXPERIMENTS]:
                if element.get("type") == _CSV:
                    yield self._default_experiment(self._files.named(MANIFEST, element))
                else:
                    self.notes.append(
                        f"{element.get('source')} is left out: its type is {element.get('type')!r}, not {_CSV}"
                    )

    def _of_file(self, file: Path) -> Iterator[Experiment]:
        for element in self._files.xml(file, "Experiments"):
            if tag(element) != "Experiment":
                continue
            name = (element.get("name") or "without a name")[:_LONGEST_NAME]
            children = {tag(child): child for child in element}
            analysis = next((child for child in children if child not in _CHILDREN), None)
            if analysis is not None:
                self.notes.append(f"the experiment {name!r} is left out: {analysis} is no transient simulation")
                continue
            # The times stand with the experiment, or in newer drafts with its transient simulation.
            times = children.get("TransientSimulation", element)
            yield self._experiment(
                file,
                times,
                name,
                self._files.number(file, element, "tolerance"),
                self._values(file, children["Parameters"]) if "Parameters" in children else {},
                self._series_of(file, children.get("Stimuli"), stimuli=True),
                self._series_of(file, children.get("References"), stimuli=False),
            )

    def _default_experiment(self, file: Path) -> Experiment:
        results = self._tables.read(file, stimuli=False)
        return self._experiment(file, etree.Element("none"), "default experiment", None, {}, None, results)

    def _experiment(
        self,
        file: Path,
        times: etree._Element,
        name: str,
        tolerance: float | None,
        values: Mapping[str, str],
        stimuli: Series | None,
        references: Series | None,
    ) -> Experiment:
        """Return an experiment; its times default to the default experiment, or to its results."""
        default = self._package.description.defaultExperiment
        listed = np.unique(references.time) if references is not None else np.zeros(0)
        start = self._files.number(file, times, "startTime")
        if start is None:
            start = finite(getattr(default, "startTime", None)) or 0.0
        stop = self._files.number(file, times, "stopTime")
        if stop is None:
            stop = finite(getattr(default, "stopTime", None))
        if stop is None:
            stop = float(listed[-1]) if listed.size else start + 1.0
        step = self._files.number(file, times, "stepSize") or experiment_number(self._package.description, "stepSize")
        if step is None:
            step = float(np.diff(listed).min()) if listed.size > 1 else (stop - start) / 100
        if not (start < stop and step > 0.0):
            raise self._files.error(
                file,
                times,
                f"the experiment {name!r} ends at {stop:g} s, begins at {start:g} s and has a step of {step:g} s",
            )
        columns = 1 if references is None else 1 + sum(column.shape[1] for column in references.columns.values())
        if (stop - start) / step * columns > MAX_VALUES:
            raise self._files.error(
                file, times, f"the experiment {name!r} has more than {MAX_VALUES} values with steps of {step:g} s"
            )
        if tolerance is not None and not tolerance > 0.0:
            raise self._files.error(
                file, times, f"the experiment {name!r} has the tolerance {tolerance:g}; it must be more than zero"
            )
        return Experiment(name, start, stop, step, tolerance, values, stimuli, references)

    # Parameter sets -------------------------------------------------------------------------------------------

    def _values(self, file: Path, element: etree._Element) -> dict[str, str]:
        if element.get("type", _PARAMETERS) != _PARAMETERS:
            raise self._files.error(
                file, element, f"the parameters are of the type {element.get('type')!r}; only {_PARAMETERS} can be read"
            )
        source = self._files.named(file, element)
        values: dict[str, str] = {}
        for parameter in self._files.xml(source, "ParameterSet").iter("{*}Parameter"):
            name = parameter.get("name", "")
            given = next((child for child in parameter if child.get("value") is not None), None)
            if given is None:
                raise self._files.error(source, parameter, f"the parameter {name!r} has no value")
            variable = self._tables.variable(source, parameter, name)
            unit, own = given.get("unit"), unit_name(variable)
            if unit is not None and unit != own:
                raise self._files.error(
                    source, parameter, f"the parameter {name!r} is in {unit!r}, but the FMU's variable in {own!r}"
                )
            values[name] = self._value(source, parameter, variable, given.get("value", ""))
        return values

    def _value(self, file: Path, element: etree._Element, variable: Variable, text: str) -> str:
        """Return the value of a parameter as FMPy takes it."""
        if variable.type == "Enumeration":
            items = [] if variable.declaredType is None else variable.declaredType.items
            text = next((str(item.value) for item in items if item.name == text), text)
        if variable.type in ("String", "Binary"):
            return text
        if variable.type == "Boolean" and text in ("0", "1"):
            text = "true" if text == "1" else "false"
        if any(value_of(variable, part) is None for part in text.split()) or not text.split():
            raise self._files.error(
                file, element, f"the parameter {variable.name!r} cannot be {text!r}: it is of the type {variable.type}"
            )
        return text

    def _series_of(self, file: Path, element: etree._Element | None, *, stimuli: bool) -> Series | None:
        if element is None:
            return None
        if (kind := element.get("type", _CSV)) != _CSV:
            if stimuli:
                raise self._files.error(file, element, f"the stimuli are of the type {kind!r}; only {_CSV} can be read")
            self.notes.append(f"{element.get('source')} is not compared: its type is {kind!r}, not {_CSV}")
            return None
        return self._tables.read(self._files.named(file, element), stimuli=stimuli)

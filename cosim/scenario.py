"""What a scenario file says, as plain data in SI units."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from lxml import etree

from cosim.changes import Change, set_value
from cosim.document import NAMESPACE, Document, local_name, read_document
from cosim.errors import InputError, Location, nearest, printable
from plants import UnitError, units

LEADER = "leader"
MAX_TICKS = 10_000_000

_NS = "{" + NAMESPACE + "}"
_QUANTITY = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?) ?(.*)")


@dataclass(frozen=True)
class Setting:
    """A named value as it is written, to be understood by whom it is for (a plant, a controller)."""

    name: str
    value: str
    where: Location


@dataclass(frozen=True)
class PlantSource:
    """A kind of vehicle: a built-in model or an FMU file, with parameters."""

    id: str
    model: str | None
    fmu: Path | None
    parameters: tuple[Setting, ...]
    where: Location


@dataclass(frozen=True)
class ControllerSource:
    """A control law by name, package and version range, with gains."""

    id: str
    name: str
    package: str
    version: str
    gains: tuple[Setting, ...]
    where: Location


@dataclass(frozen=True)
class Leader:
    """The virtual leader: its initial pose (x, y [m], psi, gamma [rad]) and the torques [N.m] that drive it."""

    plant: str
    pose: tuple[float, ...]
    torque: tuple[float, ...]


@dataclass(frozen=True)
class Follower:
    """A follower: its initial pose (x, y [m], psi, gamma [rad]) and desired range [m] and bearing [rad]."""

    id: str
    plant: str
    controller: str
    pose: tuple[float, ...]
    desired: tuple[float, float]
    where: Location


@dataclass(frozen=True)
class RmsExpectation:
    """The root mean square of a signal, for each follower, over a window of time [s], is below a bound in a unit."""

    signal: str
    below: float
    unit: str
    start: float
    stop: float
    where: Location


@dataclass(frozen=True)
class Scenario:
    """One experiment.

    Attributes
    ----------
    step : float
        Communication step [s].
    ticks : int
        Communication steps of the run; the horizon is ``ticks * step``.
    noise : tuple of float
        Standard deviation of each pose entry's noise [m, m, rad, rad].
    saturation : float
        Largest magnitude of a torque [N.m]; infinite where there is no limit.
    text : str
        The resolved document.
    """

    path: Path
    text: str
    name: str
    title: str
    step: float
    ticks: int
    seed: int
    plants: Mapping[str, PlantSource]
    controllers: Mapping[str, ControllerSource]
    noise: tuple[float, ...]
    saturation: float
    leader: Leader
    followers: tuple[Follower, ...]
    expectations: tuple[RmsExpectation, ...]

    @property
    def horizon(self) -> float:
        """The end of the run [s]."""
        return self.ticks * self.step


def read_scenario(path: str | Path, changes: Iterable[str | Change] = ()) -> Scenario:
    """Read a scenario file.

    Parameters
    ----------
    path
        The file.
    changes
        Made before the document is checked: ``XPATH=VALUE`` each, as for ``--set``, or one of `cosim.changes`.

    Raises
    ------
    InputError
        What the file says is not a scenario; with file, line and column.
    """
    made = [set_value(change) if isinstance(change, str) else change for change in changes]
    return _Reader(read_document(Path(path), made)).scenario()


_T = TypeVar("_T")


def _known(table: Mapping[str, _T], key: str, what: str, where: Location | None = None) -> _T:
    if key not in table:
        raise InputError(f"the scenario has no {what} {key!r}: {nearest(key, list(table))}", where)
    return table[key]


class _Reader:
    """Turns a document that satisfies the schema into a scenario, and checks what a schema cannot say."""

    def __init__(self, document: Document) -> None:
        self.document = document

    def scenario(self) -> Scenario:
        root = self.document.root
        simulation = self._child(root, "simulation")
        step = self._positive(simulation, "step", "s")
        ticks = self._ticks(simulation, step)
        plants = self._table(root, "plant", self._plant)
        controllers = self._table(root, "controller", self._controller)
        leader = self._child(root, "leader")
        _known(plants, leader.get("plant", ""), "plant", self.document.where(leader))
        followers = self._table(root, "follower", lambda e: self._follower(e, plants, controllers))
        if LEADER in followers:
            raise InputError(f"a follower cannot have the id {LEADER!r}", followers[LEADER].where)
        noise = root.find(f"{_NS}sensor/{_NS}noise")
        saturation = root.find(f"{_NS}actuator/{_NS}saturation")
        return Scenario(
            path=self.document.path,
            text=self.document.text,
            name=root.get("name", ""),
            title=printable(" ".join(root.findtext(_NS + "title", "").split())),
            step=step,
            ticks=ticks,
            seed=int(simulation.get("seed", "0")),
            plants=plants,
            controllers=controllers,
            noise=(0.0,) * 4 if noise is None else self._noise(noise),
            saturation=math.inf if saturation is None else self._positive(saturation, "limit", "N.m"),
            leader=Leader(
                plant=leader.get("plant", ""),
                pose=self._pose(leader),
                torque=tuple(
                    self._quantity(self._child(leader, "torque"), name, "N.m") for name in ("tau_drive", "tau_steer")
                ),
            ),
            followers=tuple(followers.values()),
            expectations=tuple(self._rms(element, ticks * step) for element in root.iterfind(f"{_NS}expect/{_NS}rms")),
        )

    # Elements

    def _plant(self, element: etree._Element) -> PlantSource:
        model, fmu = element.get("model"), element.get("fmu")
        if (model is None) == (fmu is None):
            raise self._error(element, "a <plant> needs either model=... (a built-in model) or fmu=... (a file)")
        return PlantSource(
            id=element.get("id", ""),
            model=model,
            fmu=None if fmu is None else (self.document.path.parent / fmu).absolute(),
            parameters=self._settings(element, "parameter"),
            where=self.document.where(element),
        )

    def _controller(self, element: etree._Element) -> ControllerSource:
        return ControllerSource(
            id=element.get("id", ""),
            name=element.get("name", ""),
            package=element.get("package", ""),
            version=element.get("version", ""),
            gains=self._settings(element, "gain"),
            where=self.document.where(element),
        )

    def _follower(
        self,
        element: etree._Element,
        plants: Mapping[str, PlantSource],
        controllers: Mapping[str, ControllerSource],
    ) -> Follower:
        where = self.document.where(element)
        _known(plants, element.get("plant", ""), "plant", where)
        _known(controllers, element.get("controller", ""), "controller", where)
        desired = self._child(element, "desired")
        return Follower(
            id=element.get("id", ""),
            plant=element.get("plant", ""),
            controller=element.get("controller", ""),
            pose=self._pose(element),
            desired=(self._positive(desired, "range", "m"), self._quantity(desired, "bearing", "rad")),
            where=where,
        )

    def _pose(self, element: etree._Element) -> tuple[float, ...]:
        pose = self._child(element, "pose")
        return tuple(
            self._quantity(pose, name, unit)
            for name, unit in (("x", "m"), ("y", "m"), ("psi", "rad"), ("gamma", "rad"))
        )

    def _noise(self, element: etree._Element) -> tuple[float, ...]:
        return tuple(
            self._not_negative(element, name, unit)
            for name, unit in (("x", "m"), ("y", "m"), ("psi", "rad"), ("gamma", "rad"))
        )

    def _rms(self, element: etree._Element, horizon: float) -> RmsExpectation:
        start = self._not_negative(element, "from", "s")
        stop = self._quantity(element, "to", "s") if "to" in element.attrib else horizon
        if not start < stop <= horizon:
            raise self._error(
                element, f"the window from {start:g} s to {stop:g} s is not within the run of {horizon:g} s"
            )
        match = _QUANTITY.fullmatch(element.get("below", ""))
        assert match is not None, "the schema demands a quantity"
        return RmsExpectation(
            signal=element.get("signal", ""),
            below=float(match[1]),
            unit=match[2] or "1",
            start=start,
            stop=stop,
            where=self.document.where(element),
        )

    def _ticks(self, simulation: etree._Element, step: float) -> int:
        horizon = self._positive(simulation, "horizon", "s")
        steps = horizon / step
        if steps > MAX_TICKS:
            raise self._error(
                simulation, f"the run has {steps:g} communication steps; at most {MAX_TICKS} are possible"
            )
        ticks = round(steps)
        if ticks < 1 or abs(steps - ticks) > 1e-9 * ticks:
            raise self._error(
                simulation, f"the horizon {horizon:g} s is not a whole number of communication steps of {step:g} s"
            )
        return ticks

    # Values

    def _settings(self, element: etree._Element, tag: str) -> tuple[Setting, ...]:
        settings = [
            Setting(child.get("name", ""), child.get("value", ""), self.document.where(child))
            for child in element.iterfind(_NS + tag)
        ]
        seen: dict[str, Setting] = {}
        for setting in settings:
            if setting.name in seen:
                first = seen[setting.name].where
                raise InputError(
                    f"the {tag} {setting.name!r} is given twice; first in line {first.line}", setting.where
                )
            seen[setting.name] = setting
        return tuple(settings)

    def _quantity(self, element: etree._Element, name: str, unit: str) -> float:
        text = element.get(name, "")
        try:
            return quantity(text, unit)
        except ValueError as error:
            raise self._error(element, f'{name}="{text}" of <{local_name(element)}>: {error}') from None

    def _positive(self, element: etree._Element, name: str, unit: str) -> float:
        value = self._quantity(element, name, unit)
        if value <= 0:
            raise self._error(
                element, f'{name}="{element.get(name)}" of <{local_name(element)}> must be greater than zero'
            )
        return value

    def _not_negative(self, element: etree._Element, name: str, unit: str) -> float:
        value = self._quantity(element, name, unit)
        if value < 0:
            raise self._error(element, f'{name}="{element.get(name)}" of <{local_name(element)}> must not be negative')
        return value

    # The tree

    def _table(self, root: etree._Element, tag: str, read: Callable[[etree._Element], _T]) -> dict[str, _T]:
        table: dict[str, _T] = {}
        first: dict[str, int] = {}
        for element in root.iterfind(_NS + tag):
            key = element.get("id", "")
            if key in table:
                raise self._error(element, f"the id {key!r} is given to a second <{tag}>; first in line {first[key]}")
            table[key] = read(element)
            first[key] = self.document.where(element).line
        return table

    def _child(self, element: etree._Element, tag: str) -> etree._Element:
        child = element.find(_NS + tag)
        assert child is not None, f"the schema demands <{tag}>"
        return child

    def _error(self, element: etree._Element, message: str) -> InputError:
        return InputError(message, self.document.where(element))


def quantity(text: str, unit: str | units.Unit) -> float:
    """Return the value of a text such as ``"45 deg"`` in the given unit.

    A bare number is taken only where the unit is a pure number.

    Raises
    ------
    ValueError
        The text is no quantity, its unit does not fit, or the number is not finite.
    """
    wanted = units.parse(unit) if isinstance(unit, str) else unit
    match = _QUANTITY.fullmatch(text.strip())
    if not match:
        raise ValueError(f"{text!r} is not a number with a unit, such as '1 {unit}'")
    number, name = match.groups()
    try:
        given = units.parse(name or "1")
    except UnitError as error:
        raise ValueError(str(error)) from None
    if given.exponents != wanted.exponents:
        problem = f"{given} does not fit" if name else "the unit is missing"
        raise ValueError(f"{text!r}: {problem}; expected is a quantity such as '{number} {unit}'")
    value = float(number) * given.factor / wanted.factor if given.factor != wanted.factor else float(number)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite number")
    return value

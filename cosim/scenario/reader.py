"""From a document that satisfies the schema to a scenario; checks what a schema cannot say."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from lxml import etree

from cosim.errors import InputError, Location, nearest, printable
from cosim.quantity import quantity, split, whole_steps
from cosim.scenario.document import Document, parse_document, read_binding_document, read_document
from cosim.scenario.edits import Change, in_words, set_value
from cosim.scenario.grammar import NAMESPACE, local_name
from cosim.scenario.scenario import (
    FIRST_STEP,
    LEADER,
    OPEN,
    BindingSource,
    ControllerSource,
    Effect,
    Entries,
    Event,
    Expectation,
    Follower,
    InputSource,
    Leader,
    PlaceChange,
    PlantSource,
    RoleSource,
    Scenario,
    Setting,
    Trajectory,
    Wave,
)

MAX_TICKS = 10_000_000

_NS = "{" + NAMESPACE + "}"
_T = TypeVar("_T")

_UNITS = {"x": "m", "y": "m", "psi": "rad", "gamma": "rad", "theta_1": "rad", "theta_0": "rad"}
_TORQUES = ("tau_drive", "tau_steer", "tau_right", "tau_left")
_NOT_NEGATIVE = ("noise", "quantisation")
_PARTS = {"dropout": "probability", "effectiveness": "factor"}
_LIMITS = {"saturation": "N.m", "rate": "N.m/s"}


def read_scenario(
    path: str | Path, changes: Iterable[str | Change] = (), untrusted: Iterable[str | Path] = ()
) -> Scenario:
    """Read a scenario file.

    Parameters
    ----------
    path
        The file.
    changes
        Made before the document is checked: ``XPATH=VALUE`` each, as for ``--set``, or one of `cosim.scenario.edits`.
    untrusted
        Folders: each robot whose FMU lies in one of them gets a process of its own, also in scenarios to compare with.

    Raises
    ------
    InputError
        What the file says is not a scenario; with file, line and column.
    """
    made = [set_value(change) if isinstance(change, str) else change for change in changes]
    document = read_document(Path(path), made)
    scenario = _Reader(document, tuple(Path(folder).resolve() for folder in untrusted)).scenario()
    return replace(scenario, changes=tuple(in_words(change) for change in made))


def read_expectations(text: str, path: str | Path) -> tuple[Expectation, ...]:
    """Read what is expected of a run from the text of its scenario; no other file is read.

    Parameters
    ----------
    text
        The resolved text, as a result keeps it.
    path
        The file that it is of, to which other files are relative.

    Raises
    ------
    InputError
        The text is not a scenario.
    """
    return _Reader(parse_document(text, Path(path)), ()).expectations()


def read_binding(path: str | Path) -> BindingSource:
    """Read a file with a binding.

    Raises
    ------
    InputError
        What the file says is not a binding; with file, line and column.
    """
    document = read_binding_document(Path(path))
    return _binding(document.root, document)


def _binding(element: etree._Element, document: Document) -> BindingSource:
    roles: dict[str, RoleSource] = {}
    for child in element.iterfind(_NS + "role"):
        where, name = document.where(child), child.get("name", "")
        if name in roles:
            raise InputError(f"the role {name!r} is given twice", where)
        for attribute, value in child.attrib.items():
            if value == OPEN:
                raise InputError(f'the role {name!r} has {attribute}="{OPEN}", which is to be filled in', where)
        if ("variable" in child.attrib) == ("value" in child.attrib):
            raise InputError("a <role> needs either a variable or a value", where)
        if "value" in child.attrib and len(child.attrib) > 2:
            raise InputError("a <role> with a value has nothing else but its name", where)
        roles[name] = RoleSource(**{**dict(child.attrib), "where": where})
    return BindingSource(element.get("vehicle", ""), tuple(roles.values()), document.where(element))


class _Reader:
    def __init__(self, document: Document, untrusted: tuple[Path, ...]) -> None:
        self.document = document
        self.untrusted = untrusted
        self.horizon = 0.0
        self.step = 0.0

    def scenario(self) -> Scenario:
        root = self.document.root
        simulation = self._child(root, "simulation")
        self.step = self._positive(simulation, "step", "s")
        ticks = self._ticks(simulation)
        self.horizon = ticks * self.step
        plants = self._table(root, "plant", self._plant)
        controllers = self._table(root, "controller", self._controller)
        leader = self._leader(self._child(root, "leader"), plants)
        sensor, actuator = self._effects(root, "sensor"), self._effects(root, "actuator")
        followers = self._table(root, "follower", lambda e: self._follower(e, plants, controllers, sensor, actuator))
        if LEADER in followers:
            raise InputError(f"a follower cannot have the id {LEADER!r}", followers[LEADER].where)
        events = [event for element in root.iterfind(_NS + "event") for event in self._event(element, list(followers))]
        return Scenario(
            path=self.document.path,
            text=self.document.text,
            name=root.get("name", ""),
            title=printable(" ".join(root.findtext(_NS + "title", "").split())),
            step=self.step,
            ticks=ticks,
            period=self._steps(simulation, "period") if "period" in simulation.attrib else 1,
            seed=int(simulation.get("seed", "0")),
            plants=plants,
            controllers=controllers,
            inputs=self._inputs(root),
            leader=leader,
            followers=tuple(followers.values()),
            events=tuple(sorted(events, key=lambda event: event.time)),
            expectations=self._expectations(list(followers)),
        )

    def expectations(self) -> tuple[Expectation, ...]:
        root = self.document.root
        simulation = self._child(root, "simulation")
        self.step = self._positive(simulation, "step", "s")
        self.horizon = self._ticks(simulation) * self.step
        return self._expectations([element.get("id", "") for element in root.iterfind(f"{_NS}follower")])

    def _expectations(self, followers: list[str]) -> tuple[Expectation, ...]:
        return tuple(self._expectation(element, followers) for element in self.document.root.iterfind(f"{_NS}expect/*"))

    # Plants, controllers, robots

    def _plant(self, element: etree._Element) -> PlantSource:
        model, fmu = element.get("model"), element.get("fmu")
        if (model is None) == (fmu is None):
            raise self._error(element, "a <plant> needs either model=... (a built-in model) or fmu=... (a file)")
        path = None if fmu is None else self._path(element, "fmu")
        return PlantSource(
            id=element.get("id", ""),
            model=model,
            fmu=path,
            binding=self._binding(element),
            interface=element.get("interface", ""),
            solver=element.get("solver", ""),
            solver_steps=self._solver_steps(element),
            tolerance=self._tolerance(element),
            late_outputs=element.get("start") == FIRST_STEP,
            isolated="isolate" in element.attrib or (path is not None and self._distrusts(path)),
            time_limit=self._positive(element, "time_limit", "s") if "time_limit" in element.attrib else None,
            logging="log" in element.attrib,
            parameters=self._settings(element, "parameter"),
            where=self.document.where(element),
        )

    def _distrusts(self, fmu: Path) -> bool:
        return any(fmu.resolve().is_relative_to(folder) for folder in self.untrusted)

    def _binding(self, plant: etree._Element) -> BindingSource | None:
        element = plant.find(_NS + "binding")
        if "binding" not in plant.attrib:
            return None if element is None else _binding(element, self.document)
        if element is not None:
            raise self._error(element, 'the <plant> has binding="..." already: it is either there or in a file')
        try:
            return read_binding(self._path(plant, "binding"))
        except InputError as error:
            if error.where == Location(str(self._path(plant, "binding"))):  # it cannot even be read
                message = f'binding="{plant.get("binding")}" of <plant>: {error.message}'
                raise self._error(plant, message) from None
            raise

    def _tolerance(self, element: etree._Element) -> float | None:
        if "tolerance" not in element.attrib:
            return None
        tolerance = float(element.get("tolerance", ""))
        if not tolerance > 0:
            raise self._error(element, f'tolerance="{element.get("tolerance")}" of <plant> must be greater than zero')
        return tolerance

    def _solver_steps(self, element: etree._Element) -> int | None:
        if "solver_step" not in element.attrib:
            return None
        if element.get("solver") == "cvode":
            raise self._error(element, "cvode chooses its steps itself: there is no solver_step of it")
        length = self._positive(element, "solver_step", "s")
        steps = round(self.step / length)
        if steps < 1 or abs(self.step / length - steps) > 1e-9 * steps:
            raise self._error(
                element, f"the solver_step {length:g} s does not divide the communication step of {self.step:g} s"
            )
        return steps

    def _controller(self, element: etree._Element) -> ControllerSource:
        return ControllerSource(
            id=element.get("id", ""),
            name=element.get("name", ""),
            package=element.get("package", ""),
            version=element.get("version", ""),
            gains=self._settings(element, "gain"),
            where=self.document.where(element),
        )

    def _leader(self, element: etree._Element, plants: Mapping[str, PlantSource]) -> Leader:
        where = self.document.where(element)
        self._known(element, "plant", plants)
        trajectory = element.find(_NS + "trajectory")
        for tag in ("pose", "torque", "parameter", "input"):
            found = element.find(_NS + tag)
            if trajectory is not None and found is not None and tag != "parameter":
                raise self._error(
                    found, f"a leader with a <trajectory> has no <{tag}>: its motion follows from the path"
                )
            if trajectory is None and found is None and tag == "pose":
                raise self._error(element, "the <leader> needs a <pose> to start from, or a <trajectory> to move along")
        return Leader(
            plant=element.get("plant", ""),
            pose=self._entries(element, "pose", _UNITS),
            torque=self._entries(element, "torque", dict.fromkeys(_TORQUES, "N.m")),
            trajectory=None if trajectory is None else self._trajectory(trajectory),
            parameters=self._settings(element, "parameter"),
            sensor=self._effects(element, "sensor"),
            inputs=self._inputs(element),
            where=where,
        )

    def _follower(
        self,
        element: etree._Element,
        plants: Mapping[str, PlantSource],
        controllers: Mapping[str, ControllerSource],
        sensor: tuple[Effect, ...],
        actuator: tuple[Effect, ...],
    ) -> Follower:
        self._known(element, "plant", plants)
        self._known(element, "controller", controllers)
        desired = self._child(element, "desired")
        place = (self._positive(desired, "range", "m"), self._quantity(desired, "bearing", "rad"))
        return Follower(
            id=element.get("id", ""),
            plant=element.get("plant", ""),
            controller=element.get("controller", ""),
            pose=self._entries(element, "pose", _UNITS),
            desired=place,
            changes=self._changes(desired, place),
            parameters=self._settings(element, "parameter"),
            gains=self._settings(element, "gain"),
            sensor=sensor if element.find(_NS + "sensor") is None else self._effects(element, "sensor"),
            actuator=actuator if element.find(_NS + "actuator") is None else self._effects(element, "actuator"),
            inputs=self._inputs(element),
            where=self.document.where(element),
        )

    def _entries(self, element: etree._Element, tag: str, units: Mapping[str, str]) -> Entries:
        child = element.find(_NS + tag)
        if child is None:
            return Entries({}, self.document.where(element))
        values = {name: self._quantity(child, name, units[name]) for name in child.attrib}
        return Entries(values, self.document.where(child))

    def _trajectory(self, element: etree._Element) -> Trajectory:
        waypoints = element.findall(_NS + "waypoint")
        if bool(waypoints) == ("file" in element.attrib):
            raise self._error(element, "a <trajectory> needs either waypoints or file=...")
        points: list[tuple[float, float, float]] = []
        for waypoint in waypoints:
            point = tuple(self._quantity(waypoint, name, unit) for name, unit in (("at", "s"), ("x", "m"), ("y", "m")))
            if points and point[0] <= points[-1][0]:
                raise self._error(waypoint, f"the waypoint at {point[0]:g} s is not later than the one before it")
            points.append((point[0], point[1], point[2]))
        return Trajectory(
            waypoints=tuple(points),
            file=self._path(element, "file") if "file" in element.attrib else None,
            smoothing=self._not_negative(element, "smoothing", "m") if "smoothing" in element.attrib else 0.0,
            where=self.document.where(element),
        )

    def _changes(self, desired: etree._Element, place: tuple[float, float]) -> tuple[PlaceChange, ...]:
        changes: list[PlaceChange] = []
        before = 0.0
        for element in desired.iterfind(_NS + "change"):
            start, stop = self._span(element)
            if start < before:
                raise self._error(
                    element, f"the change from {start:g} s begins before {before:g} s, when the one before it ends"
                )
            if not {"range", "bearing"} & set(element.attrib):
                raise self._error(element, "the <change> has neither a range nor a bearing: nothing changes")
            place = (
                self._positive(element, "range", "m") if "range" in element.attrib else place[0],
                self._quantity(element, "bearing", "rad") if "bearing" in element.attrib else place[1],
            )
            changes.append(PlaceChange(start, stop, *place, self.document.where(element)))
            before = stop
        return tuple(changes)

    # Sensors, actuators, signals, events

    def _effects(self, element: etree._Element, tag: str) -> tuple[Effect, ...]:
        effects = [effect for child in element.iterfind(f"{_NS}{tag}/*") for effect in self._effect(child)]
        self._check_delays([effect for effect in effects if effect.kind == "delay"])
        return tuple(effects)

    def _check_delays(self, delays: list[Effect]) -> None:
        """Check that the delays of a channel, which add up, are not longer than the run."""
        total = dict.fromkeys((*_UNITS, *_TORQUES), 0.0)
        for delay in delays:
            for channel in delay.channels or total:
                total[channel] = total.get(channel, 0.0) + delay.amount
            longest = max(total.values())
            if longest > self.horizon + 0.5 * self.step:
                raise InputError(
                    f"with this delay a channel is {longest:g} s late, longer than the run of {self.horizon:g} s",
                    delay.where,
                )

    def _effect(self, element: etree._Element) -> list[Effect]:
        kind, where = local_name(element), self.document.where(element)
        start, stop = self._window(element, math.inf)
        if kind in ("noise", "bias", "quantisation"):
            read = self._not_negative if kind in _NOT_NEGATIVE else self._quantity
            entries = [name for name in element.attrib if name in _UNITS]
            return [Effect(kind, read(element, name, _UNITS[name]), (name,), start, stop, where) for name in entries]
        channels = tuple(element.get("channels", "").split())
        if kind == "delay":
            return [Effect(kind, self._steps(element, "time") * self.step, channels, 0.0, math.inf, where)]
        if kind in _LIMITS:
            return [Effect(kind, self._positive(element, "limit", _LIMITS[kind]), channels, start, stop, where)]
        part = float(element.get(_PARTS[kind], "nan"))
        if not 0 <= part <= 1:
            raise self._error(element, f'{_PARTS[kind]}="{element.get(_PARTS[kind])}" of <{kind}> is not from 0 to 1')
        return [Effect(kind, part, channels, start, stop, where)]

    def _inputs(self, element: etree._Element) -> tuple[InputSource, ...]:
        inputs = []
        for child in element.iterfind(_NS + "input"):
            waves = tuple(self._wave(wave) for wave in child if isinstance(wave.tag, str))
            if bool(waves) == ("value" in child.attrib):
                raise self._error(child, "an <input> has either a value, which it keeps, or signals")
            waves = waves or (self._constant(child),)
            inputs.append(InputSource(child.get("name", ""), waves, self.document.where(child)))
        return tuple(inputs)

    def _constant(self, element: etree._Element) -> Wave:
        value, where = element.get("value", ""), self.document.where(element)
        return Wave("constant", value, 0.0, math.inf, 0.0, 0.0, 0.0, None, "", where)

    def _wave(self, element: etree._Element) -> Wave:
        kind = local_name(element)
        start, stop = self._span(element) if kind in ("ramp", "pulse") else self._window(element, math.inf)
        if kind == "step":
            start = self._beginning(element, "at")
        cutoff = self._positive(element, "cutoff", "Hz") if kind == "random" else 0.0
        if cutoff >= 0.5 / self.step:
            raise self._error(
                element, f"the cutoff {cutoff:g} Hz is not below half of the ticks' frequency, {0.5 / self.step:g} Hz"
            )
        return Wave(
            kind=kind,
            value=element.get("value", ""),
            start=start,
            stop=stop,
            period=self._positive(element, "period", "s") if kind == "sine" else 0.0,
            phase=self._quantity(element, "phase", "rad") if "phase" in element.attrib else 0.0,
            cutoff=cutoff,
            file=self._path(element, "file") if kind == "table" else None,
            column=element.get("column", ""),
            where=self.document.where(element),
        )

    def _event(self, element: etree._Element, followers: list[str]) -> list[Event]:
        where = self.document.where(element)
        time = self._beginning(element, "at")
        robots = self._robots(element, [LEADER, *followers])
        for tag in ("torque", "stop"):
            if len(found := element.findall(_NS + tag)) > 1:
                raise self._error(found[1], f"an event has one <{tag}>: this is a second one")
        for given in element.iterfind(_NS + "input"):
            if "value" not in given.attrib or len(given):
                raise self._error(given, "an <input> of an event has a value, which it keeps from then on")
        torque = element.find(_NS + "torque")
        stops = element.find(_NS + "stop") is not None
        if torque is not None and robots != (LEADER,):
            raise self._error(torque, 'only the torque of robots="leader" can be given: a follower has a controller')
        return [
            Event(
                time=time,
                robot=robot,
                parameters=self._settings(element, "parameter"),
                inputs=self._settings(element, "input"),
                torque=None if torque is None else self._entries(element, "torque", dict.fromkeys(_TORQUES, "N.m")),
                stops=stops,
                where=where,
            )
            for robot in robots
        ]

    # Expectations

    def _expectation(self, element: etree._Element, followers: list[str]) -> Expectation:
        kind = local_name(element)
        start, stop = self._window(element, self.horizon)
        if not start < stop <= self.horizon and kind != "final":
            raise self._error(
                element, f"the window from {start:g} s to {stop:g} s is not within the run of {self.horizon:g} s"
            )
        bound, unit = 0.0, "1"
        if kind == "settled":
            bound, unit = split(element.get("by", ""))
            if not 0 <= (by := self._quantity(element, "by", "s")) < self.horizon:
                raise self._error(element, f"{by:g} s is not within the run of {self.horizon:g} s")
        elif kind == "compare":
            bound = float(element.get("factor", "nan"))
            if bound <= 0:
                raise self._error(element, f'factor="{element.get("factor")}" of <compare> must be greater than zero')
        elif kind != "regular":
            bound, unit = split(element.get("above" if kind in ("least", "distance") else "below", ""))
        return Expectation(
            kind=kind,
            signal=element.get("signal", ""),
            component=element.get("component", ""),
            bound=bound,
            unit=unit,
            start=start,
            stop=stop,
            range_band=self._positive(element, "range", "m") if kind == "settled" else math.inf,
            bearing_band=self._positive(element, "bearing", "rad") if kind == "settled" else math.inf,
            measure=element.get("measure", ""),
            scenario=self._path(element, "scenario") if kind == "compare" else None,
            robots=self._robots(element, followers) if "robots" in element.attrib else (),
            fails=element.get("fails", ""),
            where=self.document.where(element),
            untrusted=self.untrusted,
        )

    # Times

    def _ticks(self, simulation: etree._Element) -> int:
        horizon = self._positive(simulation, "horizon", "s")
        steps = horizon / self.step
        if steps > MAX_TICKS:
            raise self._error(
                simulation, f"the run has {steps:g} communication steps; at most {MAX_TICKS} are possible"
            )
        return self._whole(simulation, f"horizon {horizon:g} s", steps, 1)

    def _steps(self, element: etree._Element, name: str) -> int:
        """Return how many communication steps a time is."""
        time = self._not_negative(element, name, "s")
        if time > self.horizon + 0.5 * self.step:
            raise self._error(
                element,
                f'{name}="{element.get(name)}" of <{local_name(element)}> is longer than the run of {self.horizon:g} s',
            )
        return self._whole(element, f"{name} {time:g} s", time / self.step, 1 if name == "period" else 0)

    def _whole(self, element: etree._Element, what: str, steps: float, least: int) -> int:
        whole = round(steps)
        if whole < least or abs(steps - whole) > 1e-9 * max(whole, 1):
            raise self._error(
                element,
                f"the {what} is not a whole number of communication steps of {self.step:g} s, such as "
                + whole_steps(steps, self.step, least),
            )
        return whole

    def _beginning(self, element: etree._Element, name: str) -> float:
        """Return when something begins, which is not after the end of the run."""
        time = self._not_negative(element, name, "s")
        if time > self.horizon:
            raise self._error(
                element,
                f"the <{local_name(element)}> at {time:g} s is after the end of the run at {self.horizon:g} s",
            )
        return time

    def _window(self, element: etree._Element, end: float) -> tuple[float, float]:
        start = self._beginning(element, "from") if "from" in element.attrib else 0.0
        stop = self._quantity(element, "to", "s") if "to" in element.attrib else end
        if start > stop:
            raise self._error(element, f"the window ends at {stop:g} s, before it begins at {start:g} s")
        return start, stop

    def _span(self, element: etree._Element) -> tuple[float, float]:
        start, stop = self._window(element, math.inf)
        if start == stop:
            raise self._error(element, f"it begins and ends at {start:g} s: it must last")
        return start, stop

    # Values

    def _settings(self, element: etree._Element, tag: str) -> tuple[Setting, ...]:
        settings = [
            Setting(child.get("name", ""), child.get("value", ""), self.document.where(child))
            for child in element.iterfind(_NS + tag)
        ]
        seen: dict[str, Setting] = {}
        for setting in settings:
            if setting.name in seen:
                first = _seen_from(setting.where, seen[setting.name].where)
                raise InputError(f"the {tag} {setting.name!r} is given twice; first {first}", setting.where)
            seen[setting.name] = setting
        return tuple(settings)

    def _path(self, element: etree._Element, name: str) -> Path:
        """Return a path that is written relative to the folder of the document."""
        return (self.document.path.parent / str(element.get(name))).absolute()

    def _robots(self, element: etree._Element, known: list[str]) -> tuple[str, ...]:
        robots = tuple(dict.fromkeys(element.get("robots", "").split()))
        for robot in robots:
            if robot not in known:
                raise self._error(element, f"the scenario has no robot {robot!r}: {nearest(robot, known)}")
        return robots

    def _known(self, element: etree._Element, what: str, table: Mapping[str, object]) -> None:
        key = element.get(what, "")
        if key not in table:
            raise self._error(element, f"the scenario has no {what} {key!r}: {nearest(key, list(table))}")

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
        first: dict[str, Location] = {}
        for element in root.iterfind(_NS + tag):
            key = element.get("id", "")
            if key in table:
                place = _seen_from(self.document.where(element), first[key])
                raise self._error(element, f"the id {key!r} is given to a second <{tag}>; first {place}")
            table[key] = read(element)
            first[key] = self.document.where(element)
        return table

    def _child(self, element: etree._Element, tag: str) -> etree._Element:
        child = element.find(_NS + tag)
        assert child is not None, f"the schema demands <{tag}>"
        return child

    def _error(self, element: etree._Element, message: str) -> InputError:
        return InputError(message, self.document.where(element))


def _seen_from(here: Location, there: Location) -> str:
    """Return where another place is: a line of the same file, or a place in another."""
    return f"in line {there.line}" if here.file == there.file else f"at {there}"

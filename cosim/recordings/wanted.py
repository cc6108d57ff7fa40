"""What is wanted of a recording: the numbers that expectations need, each with the place where it is looked for."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Mapping as Table
from dataclasses import dataclass, replace

from cosim.errors import InputError
from cosim.export.csv import heading
from cosim.export.ros2_names import signal_topic, tokens
from cosim.master.robot import RobotSetup
from cosim.master.setup import Setup
from cosim.recordings.mapping import YAW, Mapped, MappedRobot, Mapping, Place, X, Y
from cosim.results.expectations import needed
from cosim.results.expectations.recorded import DERIVED
from cosim.results.result_variable import ResultVariable
from cosim.scenario.scenario import LEADER, Scenario


@dataclass(frozen=True)
class Number:
    """A number that is wanted.

    Attributes
    ----------
    robot, row : str, int
        Whose it is, and the robot's row among the leader and the followers.
    signal, component, unit : str
        The signal's name in a result, the component's for this kind of vehicle, and the unit in a result.
    column : int
        The component's place in a result.
    mapped : Mapped
        Where it is looked for.
    """

    robot: str
    row: int
    signal: str
    component: str
    unit: str
    column: int
    mapped: Mapped

    @property
    def text(self) -> str:
        """Its name in messages."""
        signal = self.signal.removeprefix("leader_") if self.robot == LEADER else self.signal
        return " ".join(part for part in (signal, self.component, "of", self.robot) if part)


def wanted_numbers(scenario: Scenario, setup: Setup, mapping: Mapping, bag: bool) -> Iterator[Number]:
    """Yield the numbers that expectations need, poses and torques, each with its place in the recording.

    Parameters
    ----------
    scenario, setup
        The scenario, and its set-up.
    mapping
        Where the recording has what is not where an export has it.
    bag
        Whether the recording has topics, not columns.

    Raises
    ------
    InputError
        The mapping names a signal that the scenario does not have.
    """
    called = setup.columns.commands
    names = needed(scenario.expectations, setup.signals) | {"pose", "leader_pose", called}
    robots = [setup.leader, *setup.followers]
    own = tokens([robot.name for robot in robots])
    taken: set[tuple[str, str, str]] = set()
    for variable in setup.result_variables:
        if variable.name not in names:
            continue
        for row, robot in enumerate(robots):
            if ("robot" in variable.dims) == (robot is setup.leader):
                continue
            signal = _without_leader(variable.name) if robot is setup.leader else variable.name
            mapped = mapping.robots.get(robot.name)
            if mapped is not None and mapped.from_scenario:
                continue
            for column, component, unit in _components(setup, variable, robot):
                taken.add((robot.name, signal, component))
                place = _place(robot, own, signal, component, mapped, bag)
                yield Number(robot.name, row, variable.name, component, unit, column, place)
    for robot_id, one in mapping.robots.items():
        for (signal, component), given in one.signals.items():
            if (robot_id, signal, component) not in taken and given.where is not None:
                _refuse_unknown(setup, robot_id, signal, component, given)


def _without_leader(name: str) -> str:
    """Return the name of a signal of the leader as that of any robot."""
    return name.replace("leader_", "", 1)


def _components(setup: Setup, variable: ResultVariable, robot: RobotSetup) -> Iterator[tuple[int, str, str]]:
    """Yield the components that a robot has of a signal: column in the result, name and unit."""
    shared, roles = {
        "pose_component": (setup.columns.pose, robot.kind.pose),
        "velocity_component": (setup.columns.velocity, robot.kind.velocity),
        f"{setup.columns.commands}_component": (setup.columns.command, robot.kind.command),
    }.get(variable.dims[-1] if variable.dims else "", (None, ()))
    if shared is not None:
        for column, role in zip(shared.of[robot.kind.name], roles, strict=True):
            yield column, role.name, role.unit
    elif robot.name in setup.signals[variable.name].robots:
        by_component = setup.signals[variable.name].units
        yield from ((column, name, unit) for column, (name, unit) in enumerate(by_component.items()))


def _place(
    robot: RobotSetup,
    own: Table[str, str],
    signal: str,
    component: str,
    mapped: MappedRobot | None,
    bag: bool,
) -> Mapped:
    """Return where a number is: as mapped, in the robot's pose, or by its usual name."""
    if mapped is not None:
        fields = dict(zip([role.name for role in robot.kind.pose], (X, Y, YAW), strict=False))
        in_topic = mapped.pose is not None and signal == "pose" and component in fields
        if (own_signal := mapped.signals.get((signal, component))) is not None:
            if in_topic and mapped.is_moved:
                raise InputError(
                    f"ahead, left and frame_... of {robot.name} move x, y and heading of its topic together, so that "
                    f"{component} cannot be from elsewhere: leave out this <signal>, or those attributes",
                    own_signal.where,
                )
            return own_signal
        if in_topic and mapped.pose is not None:
            return Mapped(replace(mapped.pose, field=fields[component]), where=mapped.where)
    path = tuple(part for part in (signal, component) if part)
    if bag:
        return Mapped(Place(topic=signal_topic(own[robot.name], path), field="data"))
    return Mapped(Place(column=heading((robot.name, *path), "1")))


def _refuse_unknown(setup: Setup, robot: str, signal: str, component: str, given: Mapped) -> None:
    """Refuse a mapped signal that the scenario does not have; one that no expectation needs is left alone."""
    names = {_without_leader(one) if robot == LEADER else one: one for one in setup.signals}
    name = names.get(signal, "")
    if signal not in DERIVED and component in (setup.signals[name].units if name in setup.signals else ()):
        return
    known = sorted(names.keys() - DERIVED.keys())
    if signal not in DERIVED and name in setup.signals:
        known = [one for one in setup.signals[name].units if one]
        raise InputError(f"{signal!r} has no component {component!r}, but {', '.join(known) or 'none'}", given.where)
    computed = "; it is computed from poses" if signal in DERIVED else ""
    raise InputError(f"no signal {signal!r} can be mapped{computed}; those that can: {', '.join(known)}", given.where)

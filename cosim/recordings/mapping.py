"""Where a recording has what is judged: read from a mapping, or by the names that an export gives."""

from __future__ import annotations

from collections.abc import Mapping as Table
from dataclasses import dataclass, field
from pathlib import Path

from cosim.errors import Location
from cosim.moments import nanoseconds_of
from cosim.scenario.document import read_mapping_document
from cosim.scenario.reader.element import Element, known
from plants import UnitError, units

LONGEST_GAP = 0.5
"""Longest time [s] between samples across which values are interpolated, where nothing else is stated."""
X, Y, YAW = "pose x", "pose y", "yaw"
"""Fields that stand for parts of a pose, whatever the type of the message."""


@dataclass(frozen=True)
class Place:
    """Where a recording has a number.

    Attributes
    ----------
    column : str
        The column of a table; empty in a bag.
    topic, field, child_frame : str
        The topic of a bag, the field of its messages, and the frame whose transform is meant.
    """

    column: str = ""
    topic: str = ""
    field: str = ""
    child_frame: str = ""

    def __str__(self) -> str:
        """Return how a message names it."""
        return f"the column {self.column!r}" if self.column else f"the topic {self.topic!r}"


@dataclass(frozen=True)
class Mapped:
    """A number of a robot in a recording: the factor times what is there, plus the offset.

    Attributes
    ----------
    place : Place
        Where it is.
    unit : str
        The unit in which it is recorded; empty: that of the table, or the SI unit.
    factor, offset : float, str
        The offset is a quantity; empty: none.
    where : Location or None
        The place in the mapping; None if it is looked for by its usual name.
    """

    place: Place
    unit: str = ""
    factor: float = 1.0
    offset: str = ""
    where: Location | None = None


@dataclass(frozen=True)
class MappedRobot:
    """A robot in a recording.

    Attributes
    ----------
    pose : Place or None
        Where its pose in the plane is, of which `X`, `Y` and `YAW` are fields; None if no topic gives it.
    ahead, left : float
        How far its reference point lies ahead and to the left of the recorded one [m].
    frame : tuple of float
        Where the frame of its recorded poses lies in that of all robots: x, y [m] and how far it is turned [rad].
    from_scenario : bool
        Whether its motion is that of a run of the scenario.
    signals : dict
        Its numbers, by signal and component.
    """

    where: Location
    pose: Place | None = None
    ahead: float = 0.0
    left: float = 0.0
    frame: tuple[float, float, float] = (0.0, 0.0, 0.0)
    from_scenario: bool = False
    signals: Table[tuple[str, str], Mapped] = field(default_factory=dict)

    @property
    def is_moved(self) -> bool:
        """Whether what its topic gives is not the place of its reference point in the frame of all robots."""
        return any((self.ahead, self.left, *self.frame))


@dataclass(frozen=True)
class Mapping:
    """Where a recording has what is judged.

    Attributes
    ----------
    start : int or None
        The time in the recording at which the scenario begins [ns]; None for that of the first poses.
    longest_gap : float
        Longest time between samples across which values are interpolated [s].
    clock : str
        Whether the time of a message is that of its ``header``, if it has one, or of the ``log``; empty if not stated.
    time : str
        The column of a table that has the time; empty if not stated.
    robots : dict
        By id.
    where : Location or None
        Its place; None if there is no file.
    """

    start: int | None = None
    longest_gap: float = LONGEST_GAP
    clock: str = ""
    time: str = ""
    robots: Table[str, MappedRobot] = field(default_factory=dict)
    where: Location | None = None


def read_mapping(path: Path, robots: Table[str, object]) -> Mapping:
    """Read a mapping of recordings of some robots.

    Raises
    ------
    InputError
        It cannot be read, or something in it makes no sense; with file, line and column.
    """
    root = Element.root(read_mapping_document(path))
    found: dict[str, MappedRobot] = {}
    for element in root.children("robot"):
        robot = known(element, "id", robots)
        if robot in found:
            raise element.error(f"the robot {robot!r} is mapped twice")
        found[robot] = _robot(element)
    return Mapping(
        start=_start(root),
        longest_gap=root.positive("longest_gap", "s") if "longest_gap" in root else LONGEST_GAP,
        clock=root.get("clock"),
        time=root.get("time"),
        robots=found,
        where=root.where,
    )


def _start(root: Element) -> int | None:
    if "start" not in root:
        return None
    try:
        return nanoseconds_of(root.get("start"))
    except (ValueError, OverflowError):
        raise root.error(
            f'start="{root.get("start")}" of <mapping>: expected seconds such as "12.5 s", or a date with a time such '
            'as "2026-05-04T09:30:00Z"'
        ) from None


def _robot(element: Element) -> MappedRobot:
    signals: dict[tuple[str, str], Mapped] = {}
    for child in element.children("signal"):
        key = child.get("name"), child.get("component")
        if key in signals:
            raise child.error(f"{' '.join(key).strip()} is mapped twice")
        signals[key] = _signal(child)
    from_scenario = "from" in element
    if from_scenario and (element.get("id") != "leader" or "topic" in element or signals):
        raise element.error('from="scenario" is for a leader of whom nothing is recorded')
    lengths = {name: element.quantity(name, "m") for name in ("ahead", "left", "frame_x", "frame_y") if name in element}
    turn = element.quantity("frame_turn", "rad") if "frame_turn" in element else 0.0
    if "topic" not in element and (lengths or turn or "child_frame" in element):
        raise element.error(
            "child_frame, frame_x, frame_y, frame_turn, ahead, left belong to a topic, which is missing"
        )
    return MappedRobot(
        where=element.where,
        pose=Place(topic=element.get("topic"), child_frame=element.get("child_frame")) if "topic" in element else None,
        ahead=lengths.get("ahead", 0.0),
        left=lengths.get("left", 0.0),
        frame=(lengths.get("frame_x", 0.0), lengths.get("frame_y", 0.0), turn),
        from_scenario=from_scenario,
        signals=signals,
    )


def _signal(element: Element) -> Mapped:
    if ("column" in element) == ("topic" in element):
        raise element.error("a <signal> needs either a column of a table or a topic of a bag")
    if "column" in element and ("field" in element or "child_frame" in element):
        raise element.error("field and child_frame belong to a topic, and this <signal> has a column")
    if "unit" in element:
        try:
            units.parse(element.get("unit"))
        except UnitError as error:
            raise element.error(f'unit="{element.get("unit")}" of <signal>: {error}') from None
    factor = float(element.get("factor", "1"))
    if factor == 0.0:
        raise element.error("factor=0 of <signal> makes every value the same")
    place = Place(*(element.get(name) for name in ("column", "topic", "field", "child_frame")))
    return Mapped(place, element.get("unit"), factor, element.get("offset"), element.where)

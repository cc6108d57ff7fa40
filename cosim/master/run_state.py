"""The state of a run between two ticks, as plain data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.plant.message import Message, RobotMessage
from cosim.plant.saved import FleetState, PlantState
from cosim.signals.random import Streams

Floats: TypeAlias = NDArray[np.float64]
ChainState: TypeAlias = Mapping[str, tuple[Floats, Streams]]
Arrays: TypeAlias = Mapping[str, NDArray[Any]]

NUMBERS = ("state", "measured", "command", "torque")
"""The arrays of `cosim.master.team_arrays.TeamArrays` that are kept."""
_NUMBERS = ("inputs", "outputs", "given")
"""Numbers of a `PlantState`."""


@dataclass(frozen=True)
class RunState:
    """The state of a run before a tick.

    Attributes
    ----------
    tick : int
        The tick.
    numbers : dict
        The numbers of all robots, by the names of `NUMBERS`.
    sensors, actuators : dict
        What their effects remember, with the streams that they draw from; see `cosim.signals.chain.Chain.saved`.
    laws : tuple of bytes
        The state of each team's law; empty before the first tick.
    signals : tuple of ndarray
        The signals of each team's law at its last step.
    fleet : FleetState
        The plants.
    given : dict
        The first and the last tick at which the caller gave the commands of a robot, by its name.
    """

    tick: int
    numbers: Mapping[str, Floats]
    sensors: ChainState
    actuators: ChainState
    laws: tuple[bytes, ...]
    signals: tuple[Floats, ...]
    fleet: FleetState
    given: Mapping[str, tuple[int, int]]

    def to_parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the state as facts for JSON, and arrays by name."""
        fleet = self.fleet
        arrays: dict[str, NDArray[Any]] = {f"numbers/{name}": values for name, values in self.numbers.items()}
        facts: dict[str, Any] = {
            "tick": self.tick,
            "messages": fleet.messages,
            "logged": [asdict(entry) for entry in fleet.logged],
            "kept": fleet.kept,
            "given": self.given,
        }
        for name, chain in (("sensors", self.sensors), ("actuators", self.actuators)):
            facts[name] = {element: streams.names for element, (_, streams) in chain.items()}
            for element, (memory, streams) in chain.items():
                arrays[f"{name}/{element}"] = memory
                arrays[f"{name}/{element}/streams"] = streams.states
        arrays |= _joined("laws", [np.frombuffer(law, np.uint8) for law in self.laws])
        arrays |= _joined("signals", list(self.signals))
        arrays |= _joined("plants/fmu", [np.frombuffer(plant.fmu, np.uint8) for plant in fleet.plants])
        for name in _NUMBERS:
            arrays |= _joined(f"plants/{name}", [np.array(getattr(plant, name), np.float64) for plant in fleet.plants])
        events = [(plant.next_event, plant.changed) for plant in fleet.plants]
        arrays["plants/events"] = np.array(events, np.float64).reshape(-1, 2)
        return facts, arrays

    @classmethod
    def from_parts(cls, facts: Mapping[str, Any], arrays: Arrays) -> Self:
        """Return the state of which `to_parts` has made facts and arrays; KeyError, TypeError, ValueError if none."""
        return cls(
            tick=int(facts["tick"]),
            numbers={name: arrays[f"numbers/{name}"] for name in NUMBERS},
            sensors=_chain("sensors", facts, arrays),
            actuators=_chain("actuators", facts, arrays),
            laws=tuple(law.tobytes() for law in _split("laws", arrays)),
            signals=tuple(_split("signals", arrays)),
            fleet=FleetState(
                plants=tuple(_plants(arrays)),
                messages=tuple(map(str, facts["messages"])),
                logged=tuple(
                    RobotMessage(float(entry["time"]), str(entry["robot"]), Message(**entry["message"]))
                    for entry in facts["logged"]
                ),
                kept=tuple(map(int, facts["kept"])),
            ),
            given={str(robot): (int(first), int(last)) for robot, (first, last) in facts.get("given", {}).items()},
        )


def _chain(name: str, facts: Mapping[str, Any], arrays: Arrays) -> ChainState:
    def each() -> Iterator[tuple[str, tuple[Floats, Streams]]]:
        for element, names in facts[name].items():
            streams = Streams(tuple(map(str, names)), arrays[f"{name}/{element}/streams"])
            yield element, (arrays[f"{name}/{element}"], streams)

    return dict(each())


def _plants(arrays: Arrays) -> Iterator[PlantState]:
    fmus = _split("plants/fmu", arrays)
    each = zip(*(_split(f"plants/{name}", arrays) for name in _NUMBERS), strict=True)
    for fmu, numbers, (next_event, changed) in zip(fmus, each, arrays["plants/events"].tolist(), strict=True):
        inputs, outputs, given = (tuple(part.tolist()) for part in numbers)
        yield PlantState(fmu.tobytes(), inputs, outputs, given, next_event, bool(changed))


def _joined(name: str, parts: list[NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return arrays of one dimension as one, with their sizes."""
    sizes = np.array([len(part) for part in parts], dtype=np.int64)
    return {name: np.concatenate(parts) if parts else np.zeros(0), f"{name}/sizes": sizes}


def _split(name: str, arrays: Arrays) -> list[NDArray[Any]]:
    """Return the arrays that `_joined` has joined."""
    sizes = arrays[f"{name}/sizes"]
    if (sizes < 0).any() or sizes.sum() != len(arrays[name]):
        raise ValueError(name)
    return np.split(arrays[name], np.cumsum(sizes)[:-1]) if len(sizes) else []

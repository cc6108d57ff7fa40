"""Everything that starts a plant, as plain data: the same in this process and in a process of the plant's own."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

CO_SIMULATION = "co_simulation"
MODEL_EXCHANGE = "model_exchange"
SOLVERS = ("euler", "runge_kutta_4", "cvode")
"""Solvers of Model Exchange."""


@dataclass(frozen=True)
class Value:
    """A value of a variable of an FMU; an array has all of its elements, in row-major order."""

    name: str
    type: str
    reference: int
    values: tuple[float | int | bool | str, ...]


REAL_TYPES = ("Real", "Float64")
"""Types of doubles: of FMI 1.0 and 2.0, and of FMI 3.0."""
FLOAT_TYPES = (*REAL_TYPES, "Float32")
WHOLE = ("Integer", *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)))
"""Types of whole numbers, the one of FMI 1.0 and 2.0 first."""


@dataclass(frozen=True)
class Exchanged:
    """A variable that is exchanged: its name, its type, and how many elements it has."""

    name: str
    type: str
    size: int = 1


@dataclass(frozen=True)
class Block:
    """Variables that are exchanged together.

    Attributes
    ----------
    references : tuple of int
        Their value references.
    start : tuple of float
        A value of every element of every variable, in this order; of inputs, the values at the start of the run.
    variables : tuple of Exchanged
        The variables themselves.
    """

    references: tuple[int, ...]
    start: tuple[float, ...]
    variables: tuple[Exchanged, ...]

    def name_of(self, place: int) -> str:
        """Return the name of the variable that has an element at this place."""
        names = [variable.name for variable in self.variables for _ in range(variable.size)]
        return names[place]


@dataclass(frozen=True)
class PlantSpec:
    """One plant.

    Attributes
    ----------
    robot : str
        The robot's id, which is the FMU's instance name.
    file : str
        The FMU's name in messages.
    directory : str
        The folder of the unpacked FMU.
    fmi, interface, identifier, token : str
        Version of FMI (``1.0``, ``2.0``, ``3.0``), `CO_SIMULATION` or `MODEL_EXCHANGE`, model identifier, and GUID or
        instantiation token.
    values : tuple of Value
        Start values and parameters.
    inputs, outputs : Block
        Numbers that the FMU gets, and numbers that it returns, at every communication point.
    held : tuple of Value
        Other inputs, which keep their values until they are changed, at the start of the run.
    stop_time : float
        End of the run [s].
    states, event_indicators : int
        Their number in a Model Exchange FMU of FMI 2.0; an FMU of FMI 3.0 is asked.
    completed_steps : bool
        Whether a Model Exchange FMU needs a call after each completed step of the solver.
    solver : str
        Of a Model Exchange FMU: one of `SOLVERS`.
    solver_steps : int
        How many steps of the solver make a communication step.
    tolerance : float or None
        Relative tolerance of CVODE, or of a Co-Simulation FMU's own solver; None if there is none.
    late_outputs : bool
        Whether the outputs count only from the first step on; until then the start values of `outputs` stand for them.
    time_limit : float
        Time limit [s] of a process of its own, for the start, for each step and for the end.
    logging : bool
        Whether the FMU is asked to log everything.
    """

    robot: str
    file: str
    directory: str
    fmi: str
    interface: str
    identifier: str
    token: str
    values: tuple[Value, ...]
    inputs: Block
    outputs: Block
    stop_time: float
    states: int = 0
    event_indicators: int = 0
    completed_steps: bool = True
    solver: str = "runge_kutta_4"
    solver_steps: int = 1
    tolerance: float | None = None
    late_outputs: bool = False
    time_limit: float = 10.0
    logging: bool = False
    held: tuple[Value, ...] = ()

    @property
    def uses_cvode(self) -> bool:
        """Whether CVODE integrates the plant."""
        return self.interface == MODEL_EXCHANGE and self.solver == "cvode"

    @property
    def is_typed(self) -> bool:
        """Whether it exchanges other numbers than doubles."""
        return any(v.type not in REAL_TYPES for v in (*self.inputs.variables, *self.outputs.variables))

    def to_json(self) -> bytes:
        """Return a text from which `from_json` makes an equal specification, to the bit."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_json(cls, text: bytes) -> PlantSpec:
        """Return the specification that `to_json` has written."""
        data = json.loads(text)
        for values in ("values", "held"):
            data[values] = values_from(data[values])
        for block in ("inputs", "outputs"):
            variables = tuple(Exchanged(**variable) for variable in data[block].pop("variables"))
            data[block] = Block(**{name: tuple(v) for name, v in data[block].items()}, variables=variables)
        return cls(**data)


def values_from(data: list[dict[str, object]]) -> tuple[Value, ...]:
    """Return values from their form in JSON."""
    return tuple(Value(**{**value, "values": tuple(value["values"])}) for value in data)  # type: ignore[arg-type]

"""What a sampled model states: one that computes its outputs once a communication point, in C that it brings."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from plants.errors import ModelError

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True)
class Port:
    """A variable of a sampled model.

    Attributes
    ----------
    name, unit, description : str
        What it is; a whole number has no unit.
    start : float
        The value at the start, of inputs and parameters.
    min, max : float
        Bounds, of parameters.
    above, below : bool
        Whether a value must not equal its bound.
    tunable : bool
        Whether a parameter may change between two steps.
    depends : tuple of str or None
        The inputs on which an output depends within its tick; None for all.
    """

    name: str
    unit: str
    description: str
    start: float = 0.0
    min: float = -math.inf
    max: float = math.inf
    above: bool = False
    below: bool = False
    tunable: bool = False
    depends: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Sampled:
    """A sampled model: C that computes outputs of inputs, parameters and its memory, tick by tick.

    Attributes
    ----------
    name, description : str
        An identifier, and one line.
    step : float
        Time from one tick to the next [s].
    sources : mapping
        C files by name, ``memory.h`` among them. They define what template/sampled/model.h declares: the type `Memory`,
        and the functions `model_start` and `model_tick`. config.h gives them the place of each variable in its array.
    last : int or None
        The last tick that the model can compute, as its courses over time end there; None if they do not.
    late : bool
        Whether the outputs of a tick come with the step that leads on from it, so that they are one step late under
        every master; they are zero before, and the first tick takes the inputs as they are after initialisation.
    stop : float
        How long a run of it lasts as a rule [s].
    inputs, parameters, outputs : sequence of Port
        Numbers.
    integers : sequence of Port
        Parameters that are whole numbers.
    program : bool
        Whether a program works beside it, which its C starts: it defines `model_open` and the other functions of that
        kind, too. Then it has no states to save, and is for systems of the kind of Unix.
    resources : mapping
        Further files by name, which its C finds.
    pages : mapping
        More about it, for its documentation: paragraphs of plain text by heading.
    """

    name: str
    description: str
    step: float
    sources: Mapping[str, str]
    last: int | None = None
    late: bool = False
    stop: float = 10.0
    inputs: Sequence[Port] = ()
    parameters: Sequence[Port] = ()
    outputs: Sequence[Port] = ()
    integers: Sequence[Port] = ()
    program: bool = False
    resources: Mapping[str, bytes] = field(default_factory=dict)
    pages: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not _IDENTIFIER.fullmatch(self.name):
            raise ModelError(f"the sampled model {self.name!r} needs a name of letters, digits and underscores")
        names = [port.name for port in (*self.inputs, *self.parameters, *self.outputs, *self.integers)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ModelError(f"the sampled model {self.name!r} has two variables {twice[0]!r}")

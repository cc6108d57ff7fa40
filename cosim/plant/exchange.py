"""Giving numbers of any type to an FMU, and taking them, through FMPy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from cosim.plant.failures import PlantError
from cosim.plant.spec import REAL_TYPES, Block

_LARGEST_SINGLE = 3.4028234663852886e38


def give(fmu: object, block: Block, numbers: Sequence[float]) -> None:
    """Give the numbers of a block to an FMU: whole numbers are rounded.

    Raises
    ------
    PlantError
        A variable's type cannot represent its value; the FMU is the subject of the text.
    fmpy.fmi1.FMICallException
        The FMU refuses a value.
    """
    for kind, references, places in _groups(block):
        values = [numbers[place] for place in places]
        if kind not in REAL_TYPES:
            values = [_as_type(block.name_of(place), kind, numbers[place]) for place in places]
        getattr(fmu, f"set{kind}")(references, values)


def take(fmu: object, block: Block) -> list[float]:
    """Return the numbers of a block as an FMU has them.

    Raises
    ------
    fmpy.fmi1.FMICallException
        The FMU does not return them.
    """
    numbers = [0.0] * len(block.start)
    for kind, references, places in _groups(block):
        get = getattr(fmu, f"get{kind}")
        # In FMI 3.0 a variable may have several elements.
        values = get(references) if kind in ("Real", "Integer") else get(references, nValues=len(places))
        for place, value in zip(places, values, strict=True):
            numbers[place] = float(value)
    return numbers


def whole_range(kind: str) -> tuple[int, int]:
    """Return the least and the largest number of a type of whole numbers."""
    bits = 32 if kind == "Integer" else int(kind.partition("Int")[2])
    return (0, 2**bits - 1) if kind.startswith("U") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def _as_type(name: str, kind: str, number: float) -> float:
    least, most = (-_LARGEST_SINGLE, _LARGEST_SINGLE) if kind == "Float32" else whole_range(kind)
    value = number if kind == "Float32" or not math.isfinite(number) else round(number)
    if not least <= value <= most:
        raise PlantError(f"has {name!r} as {kind}, which cannot be {number:g}")
    return value


def _groups(block: Block) -> Iterator[tuple[str, list[int], list[int]]]:
    """Return the variables of each type: their value references, and the places of their elements in the block."""
    kinds = dict.fromkeys(variable.type for variable in block.variables)
    for kind in kinds:
        references: list[int] = []
        places: list[int] = []
        first = 0
        for reference, variable in zip(block.references, block.variables, strict=True):
            if variable.type == kind:
                references.append(reference)
                places += range(first, first + variable.size)
            first += variable.size
        yield kind, references, places

"""The origin of a result, from its attributes: file, changes, seed, versions, and how the run ended."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from cosim.errors import Failure

HOUSE = ("formation-cosim", "formation-controllers")
"""Distributions whose versions are shown, besides the packages of the control laws."""


@dataclass(frozen=True)
class Part:
    """A part of a run that was left and taken up again.

    Attributes
    ----------
    until : float
        The communication point [s] at which the next part goes on.
    changes : tuple of str
        Changes of the scenario in this part, as options of the command line.
    scenario : str
        Its resolved text; empty if the next part goes on with the same scenario.
    run : str
        The folder of the run from which the next part has branched off, as it was named; empty for none.
    """

    until: float
    changes: tuple[str, ...] = ()
    scenario: str = ""
    run: str = ""

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Self:
        """Return the part of which `as_data` has told."""
        until, changes = float(data["until"]), tuple(map(str, data["changes"]))
        if not math.isfinite(until):
            raise ValueError(f"a part of the run that ends at {until} s")
        return cls(until, changes, str(data["scenario"]), str(data.get("run", "")))

    @property
    def as_data(self) -> dict[str, Any]:
        """The part as a result keeps it, in JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Provenance:
    """The origin of a result; fields that an older version has not written are empty.

    Attributes
    ----------
    file : str
        The scenario's file, as it was named.
    changes : tuple of str
        Changes for this run, as options of the command line.
    seed : int or None
        Of the noise.
    versions : dict
        Version by distribution, of the libraries and of each control law's package.
    failure : Failure or None
        Why the run did not reach its end; None if it did.
    parts : tuple of Part
        The parts before the last one, if the run was left and taken up again; without their texts.
    given : dict
        By robot, the first and the last time [s] at which a program gave its commands, in place of its controller or
        of the scenario.
    """

    file: str = ""
    changes: tuple[str, ...] = ()
    seed: int | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    failure: Failure | None = None
    parts: tuple[Part, ...] = ()
    given: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, attributes: Mapping[Any, Any]) -> Self:
        """Read the attributes of a result."""
        failure, file = json.loads(attributes.get("failure", "null")), str(attributes.get("scenario_file", ""))
        if "\0" in file:
            raise ValueError("a scenario's file with a null byte in its name")
        packages: dict[str, dict[str, None]] = {}  # of controllers, which may have several versions of one
        for law in json.loads(attributes.get("controllers", "[]")):
            packages.setdefault(str(law["package"]), {})[str(law["version"])] = None
        return cls(
            file=file,
            changes=tuple(map(str, json.loads(attributes.get("changes", "[]")))),
            seed=int(attributes["seed"]) if "seed" in attributes else None,
            versions={name: str(own) for name, own in json.loads(attributes.get("versions", "{}")).items()}
            | {package: " and ".join(versions) for package, versions in packages.items()},
            failure=_failure(**failure) if failure else None,
            parts=tuple(replace(Part.of(part), scenario="") for part in json.loads(attributes.get("parts", "[]"))),
            given={
                str(robot): (float(first), float(last))
                for robot, (first, last) in json.loads(attributes.get("given", "{}")).items()
            },
        )

    @property
    def variant(self) -> tuple[str, tuple[str, ...]]:
        """File and changes, which runs of one scenario with the same changes share, however they name the file."""
        return os.path.realpath(self.file), self.changes

    @property
    def changed(self) -> str:
        """The changes, in words."""
        return _in_words(self.changes)

    @property
    def resumed(self) -> str:
        """Where the run was taken up again, and the changes up to there, in words; empty if it was not."""
        told = [
            f"at {part.until:.12g} s" + (f" ({_in_words(part.changes)} before)" if part.changes != self.changes else "")
            for part in self.parts
        ]
        return f"resumed {' and '.join(told)}" if told else ""

    @property
    def basis(self) -> str:
        """Seed and versions, in words."""
        laws = sorted(self.versions.keys() - set(HOUSE) - {"python", "fmpy", "numpy", "numba", "xarray"})
        shown = ", ".join(f"{name} {self.versions[name]}" for name in (*HOUSE, *laws) if name in self.versions)
        seed = "" if self.seed is None else f"seed {self.seed}"
        return "; ".join(part for part in (seed, shown) if part)


def _failure(robot: str, time: float, variable: str, message: str) -> Failure:
    return Failure(str(robot), float(time), str(variable), str(message))


def _in_words(changes: tuple[str, ...]) -> str:
    return f"changed by {' '.join(changes)}" if changes else "unchanged"


def attributes(file: Path, changes: tuple[str, ...], failure: Failure | None) -> dict[str, str]:
    """Return the attributes with the file of the run, its changes, and the reason of an early end."""
    told = {"scenario_file": str(file), "changes": json.dumps(changes)}
    if failure:
        told["failure"] = json.dumps(asdict(failure))
    return told

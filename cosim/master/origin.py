"""Where a checkpoint comes from: the scenario of its run, with everything else that decides on the bits."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

from cosim.errors import InputError, Location
from cosim.master.recorded_result import versions
from cosim.master.setup import Setup
from cosim.results.provenance import Part
from cosim.scenario.reader import read_resolved
from cosim.scenario.scenario import Scenario

_DECIDES = ("system", "machine", "formation-cosim", "formation-controllers", "fmpy", "numpy", "numba")
"""Upon these the bits depend, or may."""


@dataclass(frozen=True)
class Origin:
    """Where a checkpoint comes from.

    Attributes
    ----------
    scenario : Scenario
        The scenario of the run.
    files : dict
        SHA-256 of each file that the scenario was read from, by its path.
    fmus : dict
        Name of the file, and SHA-256, of the FMU of each plant.
    laws : dict
        Package, version and checksum of the files of each controller's law; no checksum in older checkpoints.
    environments : dict
        Versions of the libraries in the environment of each law, by the controller; empty for a law without one.
    versions : dict
        Those of the libraries, see `cosim.master.recorded_result.versions`.
    machine : dict
        System and kind of processor.
    parts : tuple of Part
        The parts that the run had before this one.
    """

    scenario: Scenario
    files: Mapping[str, str]
    fmus: Mapping[str, tuple[str, str]]
    laws: Mapping[str, tuple[str, str, str]]
    environments: Mapping[str, Mapping[str, str]]
    versions: Mapping[str, str]
    machine: Mapping[str, str]
    parts: tuple[Part, ...] = ()

    @classmethod
    def of(cls, scenario: Scenario, setup: Setup, parts: tuple[Part, ...] = ()) -> Self:
        """Return the origin of the checkpoints of a run."""
        return cls(
            scenario=scenario,
            files={str(path): _checksum(path) for path in _files(scenario) if path.is_file()},
            fmus={name: (fmu.path.name, fmu.sha256) for name, fmu in setup.fmus.items()},
            laws={name: (law.package, law.version, law.content) for name, law in setup.laws.items()},
            environments={name: dict(law.environment) for name, law in setup.laws.items()},
            versions=json.loads(versions()),
            machine=_machine(),
            parts=parts,
        )

    @cached_property
    def as_json(self) -> bytes:
        """The origin as a checkpoint keeps it."""
        scenario = self.scenario
        told = {
            "text": scenario.text,
            "path": str(scenario.path),
            "folder": str(scenario.folder),
            "places": [[place.file, place.line, place.column] for place in scenario.places],
            "untrusted": [str(folder) for folder in scenario.untrusted],
            "changes": scenario.changes,
        }
        rest = {name: getattr(self, name) for name in ("files", "fmus", "laws", "environments", "versions", "machine")}
        return json.dumps({"scenario": told, **rest, "parts": [part.as_data for part in self.parts]}).encode()

    @classmethod
    def from_json(cls, data: bytes) -> Self:
        """Return the origin that a checkpoint keeps.

        Raises
        ------
        ValueError, TypeError, KeyError
            It makes no sense.
        InputError
            The scenario cannot be read.
        """
        about = json.loads(data)
        told = about["scenario"]
        scenario = read_resolved(
            str(told["text"]),
            Path(told["path"]),
            Path(told["folder"]),
            [Location(str(file), int(line), int(column)) for file, line, column in told["places"]],
            [Path(folder) for folder in told["untrusted"]],
            [str(change) for change in told["changes"]],
        )
        return cls(
            scenario=scenario,
            files=dict(about["files"]),
            fmus={name: (str(file), str(checksum)) for name, (file, checksum) in about["fmus"].items()},
            laws={
                name: (str(package), str(version), str(*content))
                for name, (package, version, *content) in about["laws"].items()
            },
            environments={name: dict(own) for name, own in about["environments"].items()},
            versions=dict(about["versions"]),
            machine=dict(about["machine"]),
            parts=tuple(Part.of(part) for part in about["parts"]),
        )

    def check_surroundings(self, path: Path) -> None:
        """Refuse to go on with other versions, on another kind of machine, or after a file was edited.

        Parameters
        ----------
        path
            The checkpoint, for messages.

        Raises
        ------
        InputError
            The bits would be, or could be, other ones than those of an unbroken run.
        """
        here = json.loads(versions()) | _machine()
        there = {**self.versions, **self.machine}
        if told := _others(here, there):
            raise InputError(
                f"the checkpoint {path} was written with {told}: the run could not go on with the same bits; "
                "take it up with those versions, or run the scenario again"
            )
        for file, checksum in self.files.items():
            if Path(file).is_file() and _checksum(Path(file)) != checksum:
                raise InputError(
                    f"{file} was edited since the checkpoint {path} was written: restore it, or run the scenario "
                    "again; a run goes on with changes by --set"
                )

    def check_parts(self, setup: Setup, path: Path) -> None:
        """Refuse other FMUs, and laws of other packages, versions or files, or with other libraries around them.

        Raises
        ------
        InputError
            Names the first one.
        """
        for name, (file, checksum) in self.fmus.items():
            fmu = setup.opened.get(name)
            if fmu is not None and fmu.sha256 != checksum:
                raise InputError(
                    f"the plant {name!r} is not the one of the checkpoint {path}: the FMU {file} had the SHA-256 "
                    f"{checksum[:12]}..., and {fmu.path} has {fmu.sha256[:12]}..."
                )
        for name, law in self.laws.items():
            found = setup.laws.get(name)
            if found is not None and (found.package, found.version) != law[:2]:
                raise InputError(
                    f"the controller {name!r} comes from {found.package} {found.version}, in the checkpoint {path} "
                    f"from {' '.join(law[:2])}: install that version, or run the scenario again"
                )
            if found is not None and (others := _others(found.environment, self.environments.get(name, {}))):
                raise InputError(
                    f"the environment of the controller {name!r} had {others} when the checkpoint {path} was written: "
                    "the run could not go on with the same bits; install those versions, or run the scenario again"
                )
            if found is not None and law[2] and found.content != law[2]:
                raise InputError(
                    f"the files of {found.package}, from which the controller {name!r} comes, or those of "
                    f"formation-controllers were edited since the checkpoint {path} was written: restore them, or run "
                    "the scenario again"
                )


def _others(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """Return what decides on the bits and differs between some versions, in words; empty if nothing does."""
    return ", ".join(
        f"{name} {there.get(name, '?')} (here {here[name]})"
        for name in here
        if name in _DECIDES and here[name] != there.get(name)
    )


def _machine() -> dict[str, str]:
    return {"system": platform.system(), "machine": platform.machine()}


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _files(scenario: Scenario) -> Iterator[Path]:
    """Return the files whose content is part of a scenario, FMUs apart; each once."""
    found = [scenario.folder / scenario.path.name, *(Path(place.file) for place in scenario.places)]
    found += [Path(plant.binding.where.file) for plant in scenario.plants.values() if plant.binding is not None]
    if scenario.leader.trajectory is not None and scenario.leader.trajectory.file is not None:
        found.append(scenario.leader.trajectory.file)
    inputs = (*scenario.inputs, *scenario.leader.inputs, *(one for robot in scenario.followers for one in robot.inputs))
    found += [wave.path("file") for given in inputs for wave in given.waves if "file" in wave]
    return iter(dict.fromkeys(path.absolute() for path in found))

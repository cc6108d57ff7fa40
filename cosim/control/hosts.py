"""Hosts of other environments: what they tell of laws, and the teams of a run in them."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import formation_controllers as fc
import numpy as np
from numpy.typing import NDArray

from cosim.control.environment import Environment, environment_at
from cosim.control.host import GainFault, parts_of
from cosim.control.host_process import HostError, HostProcess, Refused, Request
from cosim.errors import InputError, printable
from cosim.scenario.scenario import ControllerSource
from cosim.undisturbed import undisturbed

Floats: TypeAlias = NDArray[np.float64]
Gains: TypeAlias = tuple[tuple[str, float | tuple[float, ...]], ...]


@dataclass(frozen=True)
class HostedTeam:
    """A team as its host makes it.

    Attributes
    ----------
    name : str
        The law's name.
    about : dict
        What the host is told, see `cosim.control.host`.
    shapes : list of tuple
        The shapes of inputs, commands and telemetry.
    time_limit : float
        What a tick may take [s].
    """

    name: str
    about: Mapping[str, Any]
    shapes: list[tuple[int, ...]]
    time_limit: float


class Host:
    """The host of an environment. Its process starts when it is needed, and again if it has ended.

    Legal call order: `launch` at any time; `described` before `gains`; `begin` for each run, with all of its teams;
    ticks by the `process`, or by `cosim.control.exchange`; `stop` at the end.

    Parameters
    ----------
    environment
        The environment.
    """

    def __init__(self, environment: Environment) -> None:
        self.environment = environment
        self._process: HostProcess | None = None
        self._inherited: HostProcess | None = None
        self._owner = 0
        self._greeted = False
        self._versions: dict[str, str] = {}
        self._described: dict[str, dict[str, Any]] = {}
        self.teams: tuple[object, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the process, which is of this process alone."""
        return {**self.__dict__, "_process": None, "_inherited": None, "_greeted": False, "teams": ()}

    @property
    def shown(self) -> str:
        """The environment in words."""
        return f"the environment {self.environment.folder}"

    @property
    def versions(self) -> Mapping[str, str]:
        """Versions of Python and of the libraries that laws need, after a law was `described`."""
        return self._versions

    @property
    def process(self) -> HostProcess:
        """Its process, which must have been launched here."""
        assert self._process is not None
        return self._process

    # Laws -----------------------------------------------------------------------------------------------------------

    def launch(self) -> None:
        """Start its process, unless there is one that can serve.

        Raises
        ------
        InputError
            The system does not start it.
        """
        if self._process is not None and self.is_owned:
            if not self._greeted or self._process.can_serve:
                return
            self._process.close()
        self._inherited = self._process  # of a process that has been forked: its pipes are not to be closed here
        self._process, self._owner, self._greeted, self.teams = None, os.getpid(), False, ()
        try:
            with undisturbed():
                self._process = HostProcess(self.environment)
        except OSError as error:
            raise InputError(
                f"the Python of {self.shown}, {self.environment.interpreter}, cannot be started: {error.strerror}"
            ) from None

    def described(self, name: str) -> dict[str, Any]:
        """Return what a law states about itself, each part checked.

        That is ``package`` and ``version``; ``content``, ``interface``, ``vehicles``, ``needs``, ``signals`` and
        ``gain_facts``, or a ``fault``. If there is no such law, the names that are ``known``.

        Raises
        ------
        InputError
            The environment cannot host laws, or the law ends the process.
        """
        self._serving()
        self._described[name] = found = self._describe(name)
        return found

    def installed(self) -> dict[str, tuple[str, str]]:
        """Return package and version of each law that is installed, by name.

        Raises
        ------
        InputError
            The environment cannot host laws.
        """
        self._serving()
        failed = "did not list its controllers"
        try:
            told = self.process.sensible(self.process.request(Request.LIST, None, failed), failed)
            with self.process.sense(failed):
                return {
                    printable(str(name)): (printable(str(package)), printable(str(version)))
                    for name, (package, version) in told.items()
                }
        except (HostError, Refused) as error:
            raise self._failed(error) from None

    def gains(self, name: str, settings: Sequence[tuple[str, float | tuple[float, ...]]]) -> Gains:
        """Return the gains of a law with some of them set.

        Raises
        ------
        GainFault
            One of them is wrong.
        InputError
            The process has ended.
        """
        self._serving()
        failed = f"did not check the gains of {name!r}"
        try:
            told = self.process.sensible(self.process.request(Request.GAINS, [name, settings], failed), failed)
            with self.process.sense(failed):
                return tuple((str(key), _value(value)) for key, value in told.items())
        except Refused as refusal:
            raise GainFault(str(refusal), refusal.place) from None
        except HostError as error:
            raise self._failed(error) from None

    def _serving(self) -> None:
        """See that the process serves, and knows all laws that it has been asked for."""
        self.launch()
        if self._greeted:
            return
        try:
            greeting = self.process.greeting()
        except HostError as error:
            raise self._failed(error) from None
        if "fault" in greeting:
            self.process.close()
            self._process = None
            raise InputError(f"{self.shown} cannot host controllers: {printable(str(greeting['fault']))}")
        versions = greeting.get("versions")
        named = versions.items() if isinstance(versions, dict) else ()
        self._versions = {
            "python": printable(str(greeting.get("python"))),
            **{printable(str(name)): printable(str(version)) for name, version in named},
        }
        self._greeted = True
        for name, before in self._described.items():
            if self._describe(name) != before:
                raise InputError(f"{self.shown} has changed while it was in use: run the scenario once more")

    def _describe(self, name: str) -> dict[str, Any]:
        failed = f"did not describe the controller {name!r}"
        try:
            told = self.process.sensible(self.process.request(Request.DESCRIBE, name, failed), failed)
            with self.process.sense(failed):
                return _checked(told)
        except (HostError, Refused) as error:
            raise self._failed(error) from None

    def _failed(self, error: Exception) -> InputError:
        text = f"the Python of {self.shown} {error}"
        self.stop()
        return InputError(text)

    @property
    def is_owned(self) -> bool:
        """Whether its process was started here, and not by the process from which this one is forked."""
        return self._process is not None and self._owner == os.getpid()

    # A run ----------------------------------------------------------------------------------------------------------

    def begin(self, teams: Sequence[tuple[object, HostedTeam]]) -> list[list[Floats]]:
        """Make the teams of a run, in place of those before; return the arrays of each.

        Parameters
        ----------
        teams
            Each with an object by which it is known.

        Raises
        ------
        InputError
            The process has ended.
        Refused
            A law refuses its team, whose place it has.
        """
        self._serving()
        shapes = [team.shapes for _, team in teams]
        numbers = sum(math.prod(shape) for own in shapes for shape in own)
        about = [{"name": team.name, **team.about} for _, team in teams]
        failed = "did not make the controllers of the run"
        self.teams = ()
        try:
            board, where = self.process.map(numbers)
            told = self.process.request(Request.TEAMS, {**where, "shapes": shapes, "teams": about}, failed)
            if told:
                with self.process.sense(failed):
                    raise Refused(printable(str(told[0]["fault"])), range(len(teams))[int(told[0]["team"])])
        except HostError as error:
            raise self._failed(error) from None
        self.process.use([team.time_limit for _, team in teams])
        self.teams = tuple(known for known, _ in teams)
        return list(parts_of(board.numbers, shapes))

    def restart(self, team: object) -> bool:
        """Lead a team back to before its start; return whether that makes it as good as new."""
        if team not in self.teams or not self.is_owned or not self.process.can_serve:
            return False
        try:
            return self.process.request(Request.RESET, self.teams.index(team), "") is True
        except (HostError, Refused):
            return False

    def stop(self) -> None:
        """End the process until it is needed again."""
        with undisturbed():
            if self._process is not None and self.is_owned:
                self._process.close()
                self._process = None
        self._greeted, self.teams = False, ()


class Hosts:
    """The hosts of a scenario, by environment."""

    def __init__(self) -> None:
        self._hosts: dict[Environment, Host] = {}

    def launch(self, sources: Iterable[ControllerSource]) -> None:
        """Start the processes that controllers will need, to go on beside the harness; faults are told later."""
        for source in sources:
            if source.environment is not None:
                try:
                    self.of(environment_at(source.environment)).launch()
                except InputError:
                    return

    def of(self, environment: Environment) -> Host:
        """Return the host of an environment."""
        return self._hosts.setdefault(environment, Host(environment))

    def stop(self) -> None:
        """End all processes, until they are needed again."""
        for host in self._hosts.values():
            host.stop()


# What hosts tell ----------------------------------------------------------------------------------------------------


def _checked(told: dict[str, Any]) -> dict[str, Any]:
    """Return what a host tells of a law, with parts of the types that they must have, where it makes sense."""
    if "known" in told:
        return {"known": [printable(str(name)) for name in told["known"]]}
    about: dict[str, Any] = {key: printable(str(told[key])) for key in ("package", "version")}
    if "fault" in told:
        return {**about, "fault": printable(str(told["fault"]))}
    signals = tuple(_signal(signal) for signal in told["signals"])
    if len({signal.name for signal in signals}) < len(signals):
        raise ValueError
    return {
        **about,
        "content": printable(str(told["content"])),
        "interface": printable(str(told["interface"])),
        "vehicles": tuple(printable(str(kind)) for kind in told["vehicles"]),
        "needs": tuple(str(need) for need in told["needs"]),
        "signals": signals,
        "gain_facts": {printable(str(name)): dict(facts) for name, facts in told["gain_facts"].items()},
    }


def _signal(told: dict[str, Any]) -> fc.Signal:
    known = {field.name: told[field.name] for field in fields(fc.Signal) if field.name in told}
    texts = {name: printable(str(value)) for name, value in known.items() if isinstance(value, str)}
    components = tuple(printable(str(part)) for part in known.pop("components", ()))
    below = float(known.pop("singular_below", 0.0))
    if not (math.isfinite(below) and below >= 0) or texts.keys() != known.keys():
        raise ValueError
    return fc.Signal(**texts, components=components, singular_below=below)


def _value(value: Any) -> float | tuple[float, ...]:
    return tuple(float(number) for number in value) if isinstance(value, list) else float(value)

"""A team whose law runs in a host, in an environment of its own."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import formation_controllers as fc
import numpy as np
from numpy.typing import NDArray

from cosim.control.host import FIRST, STEP_BY_STEP
from cosim.control.host_process import HostError, HostProcess, Refused, Request
from cosim.control.hosts import Host, HostedTeam
from cosim.control.team import Team
from cosim.errors import InputError, SimulationError, printable
from cosim.plant.bells import Heard
from cosim.scenario.scenario import TIME_LIMIT


class TeamElsewhere(Team):
    """One controller of another environment with the followers that it serves; see `Team`.

    `begin` starts it, with all teams of its host.

    Attributes
    ----------
    host : Host
        Where the law runs.
    inputs : tuple of ndarray
        What the law gets at a tick, as in `formation_controllers.interface.TickInputs`; in shared memory, from its
        start on.
    commanded, signals : ndarray
        Its commands (n, entries) and the numbers of its telemetry; likewise.
    """

    def _make(self) -> None:
        assert self.law.host is not None
        self.host: Host = self.law.host
        self.inputs: tuple[NDArray[np.float64], ...] = ()
        self.commanded = self.signals = np.zeros(0)
        self._is_asked = False

    def as_hosted(self, accelerates: bool) -> HostedTeam:
        """Return the team as its host makes it, given whether the leader's accelerations are known."""
        gains = self.gains[:1] if self.shares_gains else self.gains
        about = {"gains": gains, **self.for_host(accelerates)}
        limit = self.law.source.time_limit
        return HostedTeam(self.law.source.name, about, self.shapes, TIME_LIMIT if limit is None else limit)

    def use(self, arrays: Sequence[NDArray[np.float64]]) -> None:
        """Use these arrays, which the host uses, too."""
        *inputs, self.commanded, signals = arrays
        self.inputs, self.signals = tuple(inputs), signals.reshape(-1)
        self.inputs[1][:] = np.nan

    def give(
        self,
        pose: NDArray[np.float64],
        velocity: NDArray[np.float64],
        leader: NDArray[np.float64],
        acceleration: NDArray[np.float64] | None,
        desired: fc.Desired,
    ) -> None:
        """Give the law what it gets at a tick; see `Team.give`."""
        seen = self.view.seen(leader, acceleration)
        given = (
            pose[self.poses],
            velocity[self.velocities] if self.measured else np.nan,
            seen.pose,
            seen.velocity,
            0.0 if seen.acceleration is None else seen.acceleration,
            *desired,
        )
        for place, values in zip(self.inputs, given, strict=True):
            place[:] = values
        self._is_asked = True

    def step(self, time: float, *, first: bool) -> NDArray[np.float64]:
        """Return the commands of this tick; see `Team.step`. The first team of a host lets all of them step."""
        if self._is_asked:
            self._process.begin(FIRST if first else STEP_BY_STEP)
            self._process.finish()
            for team in self.host.teams:
                assert isinstance(team, TeamElsewhere)
                team._is_asked = False
            if self._process.heard != Heard.DONE:
                raise self.failed(time)
        return self.commanded.copy()

    def telemetry(self, time: float) -> NDArray[np.float64]:
        """Return the controller's signals at the last step; see `Team.telemetry`."""
        return self.signals

    def restart(self, *made_of: object) -> bool:
        """Lead the law back to before its start; see `Team.restart`."""
        return made_of == self.made_of and self.host.restart(self)

    def not_finite(self, command: NDArray[np.float64], time: float) -> SimulationError:
        """Return the failure of a controller that returned commands (n, entries) which are not finite."""
        try:
            told = self._request(Request.NOT_FINITE, self._number)
            return self._told(self._process.sensible(told, "did not answer"), time)
        except (HostError, Refused) as error:
            return self._ended(error, time)

    def to_bytes(self, time: float) -> bytes:
        """Return the state of the law; see `Team.to_bytes`."""
        try:
            return base64.b64decode(str(self._request(Request.STATE, self._number)), validate=True)
        except (HostError, Refused, ValueError) as error:
            raise self._ended(error, time) from None

    def from_bytes(self, state: bytes, time: float) -> None:
        """Let the law go on from a state; see `Team.from_bytes`."""
        try:
            self._request(Request.GO_ON, [self._number, base64.b64encode(state).decode()])
        except (HostError, Refused) as error:
            raise self._ended(error, time) from None

    def failed(self, time: float) -> SimulationError:
        """Return the failure of its host in the last tick: of this team or another one there."""
        process, teams = self._process, self.host.teams
        culprit = process.culprit
        try:
            told = process.failure()
            with process.sense("did not complete the tick"):
                team = teams[int(told["team"])]
                assert isinstance(team, TeamElsewhere)
                return team._told(told, time)
        except (HostError, Refused) as error:
            known = [team for team in teams if isinstance(team, TeamElsewhere)]
            if culprit is not None:
                return known[culprit]._ended(error, time)
            if len(known) == 1:
                return self._ended(error, time)
            robots = " and ".join(robot for team in known for robot in team.robots)
            return SimulationError(robots, time, f"the host of the controllers in {self.host.shown} {error}")

    @property
    def _process(self) -> HostProcess:
        return self.host.process

    @property
    def _number(self) -> int:
        return self.host.teams.index(self)

    def _request(self, kind: Request, about: object) -> Any:
        return self._process.request(kind, about, "did not answer")

    def _told(self, told: dict[str, Any], time: float) -> SimulationError:
        """Return the failure that the host tells of this team's law."""
        row = told.get("row")
        known = row if isinstance(row, int) and 0 <= row < len(self.robots) else None
        variable = "torque" if told.get("variable") == "torque" else ""
        return self._failure(known, f"{self._whence} failed: {printable(str(told.get('said')))}", time, variable)

    def _ended(self, error: Exception, time: float) -> SimulationError:
        """Return the failure of the process, while this team's law was at work."""
        return self._failure(None, f"{self._whence} {error}", time)

    @property
    def _whence(self) -> str:
        return f"of {self.law.package} {self.law.version} in {self.host.shown}"


def begin(teams: Sequence[Team], accelerates: bool) -> None:
    """Start the teams of a run that are in hosts, all of each host together.

    Parameters
    ----------
    teams
        The teams of the run; if all that a host has are these and no others, they have been restarted.
    accelerates
        Whether the leader's accelerations are known.

    Raises
    ------
    InputError
        A law refuses its team, or a host fails.
    """
    hosts: dict[Host, list[TeamElsewhere]] = {}
    for team in teams:
        if isinstance(team, TeamElsewhere):
            hosts.setdefault(team.host, []).append(team)
    for host, own in hosts.items():
        if host.teams == tuple(own) and host.is_owned:
            continue
        try:
            arrays = host.begin([(team, team.as_hosted(accelerates)) for team in own])
        except Refused as refusal:
            law = own[refusal.place].law if 0 <= refusal.place < len(own) else own[0].law
            raise InputError(f"controller {law.source.id!r}: {refusal}", law.source.where) from None
        except InputError as error:
            raise InputError(error.message, own[0].law.source.where) from None
        for team, parts in zip(own, arrays, strict=True):
            team.use(parts)

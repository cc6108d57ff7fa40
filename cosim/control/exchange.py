"""A tick of all laws in hosts from compiled code: one exchange by shared memory, and one bell for each host."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from formation_controllers.interface import TickInputs
from numpy.typing import NDArray

from cosim.compiled import compiled
from cosim.control.host import AS_COMPILED, lines_of
from cosim.control.hosts import Host
from cosim.control.team_elsewhere import TeamElsewhere
from cosim.frames import Bound
from cosim.plant.atomic import claim, load, swap
from cosim.plant.bells import BELL, HEARD_DONE, Copies, Heard, can_ring, listen, ring

FRESH, RUNG, ANSWERED = range(3)
"""How far a tick is: nothing is asked; all hosts are; all have answered, to Python."""
_AS_COMPILED = int(np.float64(AS_COMPILED).view(np.int64))
_CORE = 16
"""Place [bytes] of the harness's core in `cosim.control.host.Board.told`."""


class Exchange:
    """The exchange with the hosts of a run.

    Parameters
    ----------
    teams
        The teams that are in hosts, started.
    inputs
        What each gets at a tick, where compiled code writes it.

    Attributes
    ----------
    call : Bound
        What compiled code calls in a tick; it raises an exception if a host has failed or takes long, see `settle`.
    """

    def __init__(self, teams: Sequence[TeamElsewhere], inputs: Sequence[TickInputs]) -> None:
        self._teams = {team.host: team for team in teams}  # one of each host
        hosts: list[Host] = list(self._teams)
        self._bells = np.zeros(len(hosts), BELL)
        told = np.zeros(len(hosts), dtype=np.int64)
        gives: list[tuple[int, int, int]] = []
        takes: list[tuple[int, int, int]] = []
        for number, host in enumerate(hosts):
            bell = self._bells[number : number + 1]
            host.process.ring_by(bell)
            board = host.process.board
            assert board is not None
            told[number] = _at(board.told)
            takes.append((_at(bell["failed"]), _at(board.tells), board.tells.nbytes))
        for team, own in zip(teams, inputs, strict=True):
            gives += [(_at(to), _at(of), of.nbytes) for to, of in zip(team.inputs, own, strict=True) if of.nbytes]
        self._state = np.zeros(1, dtype=np.int64)
        to, back = (np.array(copies, dtype=np.int64).reshape(-1, 3) for copies in (gives, takes))
        lines = lines_of((there, size) for there, _, size in gives)
        self.call = Bound(exchange, self._bells, told, to, back, lines, self._state)

    def settle(self, time: float) -> bool:
        """Wait for hosts that take long; return whether that was all, so that the tick can go on where it was.

        Raises
        ------
        SimulationError
            A law has failed, or its host, or has taken too long.
        """
        if self._state[0] == FRESH:
            return False
        for host, team in self._teams.items():
            if host.process.heard == Heard.NOTHING:
                host.process.finish()
            if host.process.heard != Heard.DONE:
                raise team.failed(time)
        self._state[0] = ANSWERED
        return True


def can_exchange() -> bool:
    """Return whether compiled code can run a tick of hosts."""
    return can_ring()


@compiled
def exchange(
    bells: NDArray[np.void],
    told: NDArray[np.int64],
    gives: Copies,
    takes: Copies,
    lines: NDArray[np.int64],
    state: NDArray[np.int64],
) -> None:
    """Let all hosts run a tick, and wait for them; what has been asked for is not asked for once more.

    A cache line that both sides use takes long to go to and fro: what a host is told is written if it has changed, and
    the lines of its inputs are fetched once it has answered, while the harness does something else.
    """
    if state[0] == FRESH:
        for i in range(len(bells)):
            if load(told[i]) != _AS_COMPILED:
                swap(told[i], _AS_COMPILED)
            if load(told[i] + _CORE) != bells[i]["core"]:
                swap(told[i] + _CORE, bells[i]["core"])
        ring(bells, gives, 0.0, 0.0)
        state[0] = RUNG
    if state[0] == RUNG:
        listen(bells, takes)
        for i in range(len(bells)):
            if bells[i]["heard"] != HEARD_DONE:
                raise RuntimeError
    for j in range(len(lines)):
        claim(lines[j])
    state[0] = FRESH


def _at(array: NDArray[np.generic]) -> int:
    return int(array.ctypes.data)

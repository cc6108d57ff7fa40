"""Drives FMUs: open loop through a fleet, for tests of the rooms below the master, and in scenarios written for it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.errors import Failure, Location
from cosim.fmu.vehicle import open_fmu
from cosim.master.observer import Observer, Watched
from cosim.master.robot_plants import plant
from cosim.master.simulation import Simulation
from cosim.plant.fleet import Fleet, Member
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.scenario import BindingSource, PlantSource, Scenario

HERE = Location("scenario.xml", 3, 5)
STEP = 0.02
TIME_LIMIT = 30.0
"""Of a process, where no test is about it: other tests may keep the machine busy."""
IN_A_SECOND = ("//rms/@from=0.5 s", "//settled/@by=0.5 s")
"""Changes with which the expectations of clmr_line.xml are about its first second."""
SHORT = ("--horizon=1 s", *(f"--set={change}" for change in IN_A_SECOND))
"""Options with which clmr_line.xml runs for a second, after which its expectations fail."""


def source(**about: Any) -> PlantSource:
    """Return a plant of a scenario."""
    return PlantSource(**{"id": "car", "where": HERE, "time_limit": TIME_LIMIT} | about)


@contextmanager
def fleet(
    *fmus: Path,
    pose: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    binding: BindingSource | None = None,
    interface: str = "",
    isolated: bool | Sequence[bool] = False,
    horizon: float = 100.0,
    solvers: Sequence[str] = (),
    given: Sequence[float] = (),
    **about: Any,
) -> Iterator[tuple[Fleet, np.ndarray]]:
    """Start robots and yield their fleet and its state (robots, 6)."""
    opened = []
    try:
        members: list[Member] = []
        for number, path in enumerate(fmus, 1):
            opened.append(fmu := open_fmu(path, HERE, binding, interface))
            members.append(
                replace(
                    plant(
                        fmu,
                        source(**about | ({"solver": solvers[number - 1]} if solvers else {})),
                        name=f"robot_{number}",
                        parameters=(),
                        pose=pose,
                        given=given,
                        stop_time=horizon,
                    ),
                    isolated=isolated if isinstance(isolated, bool) else isolated[number - 1],
                )
            )
        state = np.empty((len(members), 6))
        started = Fleet(members, state)
        try:
            yield started, state
        finally:
            started.close()
    finally:
        for fmu in opened:
            fmu.close()


def drive(fmu: Path, torques: np.ndarray, step: float = STEP, **options: Any) -> np.ndarray:
    """Return the states (n + 1, 6) of a robot that is driven with torques (n, 2)."""
    with fleet(fmu, **options) as (started, state):
        out = np.empty((len(torques) + 1, 1, 6))
        out[0] = state
        started.run(0, step, np.ascontiguousarray(torques), out[1:])
    return out[:, 0]


def scenario(
    path: Path,
    plants: str,
    *,
    horizon: str = "1 s",
    step: str = "20 ms",
    leader: str = "car",
    followers: Sequence[str] = ("car",),
    law: str = "neural-adaptive-pid",
    more: str = "",
) -> Path:
    """Write a scenario of these plants: a leader that drives along x and followers behind it."""
    robots = "".join(
        f'''
  <follower id="follower_{number}" plant="{plant}" controller="law">
    <pose x="{-2 * number} m" y="0 m" psi="0 deg" gamma="0 deg"/>
    <desired range="{2 * number} m" bearing="0 deg"/>
  </follower>'''
        for number, plant in enumerate(followers, 1)
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f'''<scenario xmlns="{NAMESPACE}" name="{path.stem}">
  <title>{path.stem}</title>
  <simulation horizon="{horizon}" step="{step}" seed="1"/>
  {plants}
  <controller id="law" name="{law}" package="formation-controllers" version="~=0.1.0"/>
  <actuator><saturation limit="20 N.m"/></actuator>
  <leader plant="{leader}">
    <pose x="0 m" y="0 m" psi="0 deg" gamma="0 deg"/>
    <torque tau_drive="2 N.m" tau_steer="0 N.m"/>
  </leader>{robots}{more}
</scenario>
''',
        encoding="utf-8",
    )
    return path


class FailsAt:
    """An observer that raises an error at a tick."""

    def __init__(self, tick: int, error: Exception) -> None:
        self._tick = tick
        self._error = error

    def started(self, run: Watched) -> None:
        """Do nothing."""

    def ticked(self, tick: int) -> None:
        if tick == self._tick:
            raise self._error

    def ended(self, failure: Failure | None) -> None:
        """Do nothing."""


def watch(monkeypatch: pytest.MonkeyPatch, observer: Observer, chosen: Callable[[Scenario], bool]) -> None:
    """Let an observer watch all simulations of chosen scenarios."""
    original = Simulation.__init__

    def watched(self: Simulation, scenario: Scenario, *arguments: Any, **options: Any) -> None:
        observers = [*options.pop("observers", ()), *([observer] if chosen(scenario) else [])]
        original(self, scenario, *arguments, **options, observers=observers)

    monkeypatch.setattr(Simulation, "__init__", watched)

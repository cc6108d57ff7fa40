"""Robots of different kinds in one array: entries of one meaning share a column, the rest is NaN."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cosim.master.loop import Stage, Wiring
from cosim.master.moves import move
from cosim.master.team_arrays import TeamArrays
from cosim.master.wiring import wire_plants
from cosim.storage import Storage
from cosim.vehicle.car_like import CAR_LIKE
from cosim.vehicle.columns import columns, run_columns
from cosim.vehicle.differential_drive import DIFFERENTIAL_DRIVE
from cosim.vehicle.kind import Kind, Role
from cosim.vehicle.tractor_trailer import TRACTOR_TRAILER

SPEED = Role("v_command", "input", "m/s")
ANGLE = Role("gamma_command", "input", "rad")
BICYCLE = replace(DIFFERENTIAL_DRIVE, name="bicycle", command=(SPEED, ANGLE))


def test_kinds_of_the_same_units_share_their_columns() -> None:
    pose = columns([CAR_LIKE, TRACTOR_TRAILER, DIFFERENTIAL_DRIVE], "pose")
    assert pose.labels == ("x", "y", "psi/theta_1/theta", "gamma/theta_0")
    assert pose.units == ("m", "m", "rad", "rad")
    assert pose.of["differential_drive"] == (0, 1, 2)
    found = run_columns([CAR_LIKE, TRACTOR_TRAILER])
    assert list(found.labels) == ["pose_component", "velocity_component", "torque_component"]
    assert found.command.labels == ("tau_drive/tau_right", "tau_steer/tau_left")


def test_commands_of_other_units_have_columns_of_their_own() -> None:
    found = run_columns([CAR_LIKE, BICYCLE])
    assert found.commands == "command"
    assert found.command.labels == ("tau_drive", "tau_steer", "v_command", "gamma_command")
    assert found.command.units == ("N.m", "N.m", "m/s", "rad")
    values = np.array([[[1.0, 2.0], [3.0, 4.0]]])
    spread = found.command.spread(values, [CAR_LIKE, BICYCLE], Storage())
    np.testing.assert_array_equal(spread, [[[1, 2, np.nan, np.nan], [np.nan, np.nan, 3, 4]]])


def test_entries_of_one_kind_are_not_copied() -> None:
    values = np.zeros((3, 2, 4))
    assert columns([CAR_LIKE], "pose").spread(values, [CAR_LIKE, CAR_LIKE], Storage()) is values


def test_entries_in_another_order_keep_their_units() -> None:
    other = replace(BICYCLE, name="other", command=(ANGLE, SPEED))
    found = columns([BICYCLE, other], "command")
    assert found.of == {"bicycle": (0, 1), "other": (1, 0)}
    assert found.labels == ("v_command", "gamma_command")


@pytest.mark.parametrize("kinds", [(CAR_LIKE, CAR_LIKE), (DIFFERENTIAL_DRIVE, CAR_LIKE, TRACTOR_TRAILER)])
def test_the_arrays_are_as_wide_as_the_kinds_need(kinds: tuple[Kind, ...]) -> None:
    now = TeamArrays(kinds)
    assert now.state.shape == (len(kinds), 6)
    assert now.torque.shape == (len(kinds), 2)
    for row, kind in enumerate(kinds):
        pose, velocity = now.visible(row)
        assert (len(pose), len(velocity)) == (len(kind.pose), len(kind.velocity))
        now.pose[row, : len(pose)] = 1.0 + row
        assert (pose == 1.0 + row).all()
        assert np.isnan(now.state[row]).sum() == 6 - len(kind.states)
    assert len(now.told_of_the_leader()) == len(kinds[0].states)


def test_plants_are_given_their_own_commands_and_inputs() -> None:
    one = replace(DIFFERENTIAL_DRIVE, name="one", command=DIFFERENTIAL_DRIVE.command[:1])
    now = TeamArrays([CAR_LIKE, one, CAR_LIKE])
    now.torque[1:] = [[1.0, np.nan], [2.0, 3.0]]
    none, inputs = np.zeros((2, 0)), np.array([[7.0], [8.0]])

    def given(samples: np.ndarray, tick: int) -> list[float]:
        robots: list[Any] = [SimpleNamespace(kind=one, samples=samples), SimpleNamespace(kind=CAR_LIKE, samples=none)]
        wiring = Wiring()
        wire_plants(wiring, now, 1, robots)
        moves, stages, _laws = wiring.arrays()
        move(moves, stages[Stage.GIVE], stages[Stage.GIVE + 1], tick)
        return wiring.given.tolist()

    assert given(none, 0) == [1.0, 2.0, 3.0]
    assert given(inputs, 0) == [1.0, 7.0, 2.0, 3.0]
    assert given(inputs, 1) == [1.0, 8.0, 2.0, 3.0]

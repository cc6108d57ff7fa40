"""The kind of vehicle as the harness finds it: by its entry point, as the package is installed."""

import numpy as np
import pytest
from kinematic_bicycle.kind import BICYCLE
from kinematic_bicycle.model import model
from kinematic_bicycle.vehicle import KinematicBicycle

import cosim
import plants
from cosim.vehicle.kinds import kind_named
from cosim.vehicle.outline import outline_fault, placed
from cosim.vehicle.path import PathMotion


def test_it_is_found_by_its_entry_point():
    assert kind_named("kinematic_bicycle") is BICYCLE


def test_harness_and_controllers_are_told_the_same():
    for group in ("pose", "velocity", "command"):
        roles = [(role.name, role.unit) for role in getattr(BICYCLE, group)]
        assert roles == [tuple(entry) for entry in getattr(KinematicBicycle, group)]
    assert list(BICYCLE.geometry) == [entry.name for entry in KinematicBicycle.geometry]
    assert BICYCLE.vehicle(wheelbase=0.9) == KinematicBicycle(0.9)


def test_the_plant_plays_every_role():
    variables = {v.name: v.unit for v in (*model().states, *model().inputs, *model().parameters, *model().outputs)}
    assert {role.name: role.unit for role in BICYCLE.roles}.items() <= variables.items()


def test_its_motion_on_a_path():
    """On a circle of 5 m at a growing speed: rates are differences, and state and course are inverse."""
    t = np.linspace(0.0, 2.0, 2001)
    v, constant = 1.0 + 0.5 * t, np.ones_like(t)
    s = t + 0.25 * t**2
    path = PathMotion(
        5 * np.sin(s / 5), 5 - 5 * np.cos(s / 5), s / 5, v, 0.5 * constant, 0.2 * constant, 0 * constant, 0 * constant
    )
    bicycle = KinematicBicycle(1.2)
    motion = BICYCLE.on_path.motion(bicycle, path)
    x, _, psi, forward, omega = motion.state.T
    np.testing.assert_allclose(np.gradient(psi, t)[1:-1], omega[1:-1], atol=1e-9)
    np.testing.assert_allclose(np.gradient(x, t)[1:-1], (forward * np.cos(psi))[1:-1], atol=1e-6)
    np.testing.assert_allclose(np.gradient(motion.state[:, 3:], t, axis=0), motion.acceleration, atol=1e-9)
    course = BICYCLE.on_path.course(bicycle, motion.state[700])
    assert course.curvature == pytest.approx(0.2)
    assert BICYCLE.on_path.state(bicycle, course) == pytest.approx(motion.state[700])
    assert BICYCLE.on_path.course(bicycle, [0.0, 0.0, 0.3, 0.0, 0.0]).curvature == 0.0


def test_its_outline_is_where_it_is():
    """A bicycle with a wheelbase of 2 m heads along Y: its body reaches half a metre beyond both wheels' middles."""
    outline = BICYCLE.outline(KinematicBicycle(2.0))
    assert outline_fault(outline, ("x", "y", "psi")) == ""
    assert [part.name for part in outline if part.collides] == ["body"]
    body, rear, front = placed(outline, {"x": np.array(1.0), "y": np.array(3.0), "psi": np.array(np.pi / 2)})
    np.testing.assert_allclose([body.min(axis=0), body.max(axis=0)], [[0.5, 2.5], [1.5, 5.5]])
    np.testing.assert_allclose([rear.mean(axis=0), front.mean(axis=0)], [[1.0, 3.0], [1.0, 5.0]])


def test_its_fmu_is_driven_as_it_is(tmp_path):
    fmu = plants.build(model(), out=tmp_path)
    comparison = cosim.compare_plants(fmu, cosim.PlantFile(fmu, parameters={"a": "1.5 m"}), duration=2.0)
    largest = {found.role.name: found.largest for found in comparison.roles}
    assert list(largest) == ["x", "y", "psi", "v", "omega"]
    assert largest["v"] == 0.0, "the same commands"
    assert largest["psi"] > 0.01, "another wheelbase"

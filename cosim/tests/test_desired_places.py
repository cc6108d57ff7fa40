"""Desired places change smoothly, and their derivatives are right."""

import math

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from cosim.errors import Location
from cosim.scenario.scenario import PlaceChange
from cosim.signals.desired_places import desired_samples

WHERE = Location("scenario.xml", 1)
START = (3.1, math.pi / 4)
CHANGES = (PlaceChange(0.3, 0.7, 5.3, -0.1, WHERE), PlaceChange(0.7, 1.2, 5.3, 0.7, WHERE))


def test_without_changes_the_place_is_as_given() -> None:
    q, q_dot, q_ddot = desired_samples(START, (), np.arange(4) * 0.02)
    assert np.array_equal(q, np.tile(START, (4, 1)))
    assert not q_dot.any()
    assert not q_ddot.any()


def test_outside_changes_every_number_is_exactly_as_given() -> None:
    times = np.arange(200) * 0.01  # 0.3 and 0.7 are not among these numbers, but 0.30000000000000004
    q, q_dot, q_ddot = desired_samples(START, CHANGES, times)
    assert np.array_equal(q[:31], np.tile(START, (31, 1)))
    assert np.array_equal(q[70], (5.3, -0.1))
    assert np.array_equal(q[120:], np.tile((5.3, 0.7), (80, 1)))
    assert np.array_equal(q[70:, 0], np.full(130, 5.3))  # a range that is not changed
    still = np.r_[:31, 70, 120:200]
    assert not q_dot[still].any()
    assert not q_ddot[still].any()


def test_a_change_ends_at_the_point_that_the_decimal_number_means() -> None:
    times = np.arange(40) * 0.03
    for k in range(1, 40):  # k * 0.03 is often less than what the decimal number reads as
        q, q_dot, q_ddot = desired_samples(START, [PlaceChange(0.0, float(f"{k * 0.03:.2f}"), 5.3, -0.1, WHERE)], times)
        assert np.array_equal(q[k:], np.tile((5.3, -0.1), (40 - k, 1)))
        assert not q_dot[k:].any()
        assert not q_ddot[k:].any()
        assert q_dot[1:k].all()


def test_the_course_is_the_quintic() -> None:
    q, q_dot, q_ddot = desired_samples(START, CHANGES[:1], np.array([0.4, 0.5, 0.6]))
    assert q[1] == pytest.approx([(3.1 + 5.3) / 2, (math.pi / 4 - 0.1) / 2])
    assert q_dot[1] == pytest.approx(np.array([2.2, -0.1 - math.pi / 4]) * 1.875 / 0.4)  # the peak of velocity
    assert q_ddot[1] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert q[0] == pytest.approx(np.array(START) + np.array([2.2, -0.1 - math.pi / 4]) * 53 / 512)  # s = 1/4
    assert q_ddot[0] == pytest.approx(-q_ddot[2])


def test_the_derivatives_are_those_of_the_course() -> None:
    times = np.linspace(0.0, 1.5, 15001)
    q, q_dot, q_ddot = desired_samples(START, CHANGES, times)
    assert cumulative_simpson(q_ddot, x=times, axis=0, initial=0) == pytest.approx(q_dot, abs=1e-7)
    assert cumulative_simpson(q_dot, x=times, axis=0, initial=0) + START == pytest.approx(q, abs=1e-7)


def test_a_change_from_the_start_begins_at_the_first_place() -> None:
    q, q_dot, _ = desired_samples(START, [PlaceChange(0.0, 1.0, 4.0, 0.0, WHERE)], np.array([0.0, 0.5, 1.0, 2.0]))
    assert np.array_equal(q[0], START)
    assert np.array_equal(q[2:], [(4.0, 0.0), (4.0, 0.0)])
    assert np.count_nonzero(q_dot) == 2

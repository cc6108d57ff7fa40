"""Gains: defaults, shapes, bounds and refusals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from formation_controllers import GainError, gain_info
from formation_controllers.gains import gain_records
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePidGains


def test_defaults_are_those_printed_for_the_first_simulation():
    gains = NeuralAdaptivePidGains()
    assert gains == NeuralAdaptivePidGains.from_mapping(
        {
            "K_p": 10,
            "Lambda_0": [2, 2],
            "Lambda_1": 0.05,
            "k_d": 10,
            "epsilon_t": 10,
            "gamma_theta": 0.5,
            "theta_m": 10,
            "gamma_w": 10,
            "W_m": 1000,
            "centres": range(-4, 5),
            "widths": 10,
        }
    )
    assert gains.K_p == (10.0, 10.0)
    assert gains.widths == (10.0,) * 9


def test_every_gain_says_what_it_is():
    for name, info in gain_info(NeuralAdaptivePidGains).items():
        assert info.symbol, name
        assert info.unit, name
        assert "(" in info.description or info.symbol == "-", f"{name} names no equation"


def test_gains_may_be_numbers_of_numpy():
    gains = NeuralAdaptivePidGains(
        K_p=np.array(3.0), k_d=np.float64(7), widths=np.array([5]), Lambda_0=np.array([1, 2])
    )
    assert (gains.K_p, gains.k_d, gains.widths, gains.Lambda_0) == ((3.0, 3.0), 7.0, (5.0,) * 9, (1.0, 2.0))
    assert type(gains.k_d) is float


def test_gains_are_frozen_and_hashable():
    gains = NeuralAdaptivePidGains()
    with pytest.raises(dataclasses.FrozenInstanceError):
        gains.K_p = 20
    assert hash(gains) == hash(NeuralAdaptivePidGains(K_p=[10, 10]))


def test_records_keep_each_robots_own_gains():
    records = gain_records([NeuralAdaptivePidGains(K_p=(1, 2)), NeuralAdaptivePidGains(k_d=7)])
    assert records["K_p"].tolist() == [[1, 2], [10, 10]]
    assert records["k_d"].tolist() == [10, 7]
    assert records["centres"].shape == (2, 9)


def test_records_refuse_vectors_of_different_lengths():
    with pytest.raises(GainError, match=r"robot 1: gain 'centres' has 2 entries: expected 9, as robot 0 has"):
        gain_records([NeuralAdaptivePidGains(), NeuralAdaptivePidGains(centres=(0, 1))])


def test_a_gain_may_be_infinite_where_that_switches_it_off():
    assert NeuralAdaptivePidGains(torque_limit=math.inf).torque_limit == math.inf
    with pytest.raises(GainError, match="'torque_limit' is nan: expected a number"):
        NeuralAdaptivePidGains(torque_limit=math.nan)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"Kp": 10}, r"unknown gain 'Kp'; did you mean 'K_p'\? known: K_p, Lambda_0"),
        ({"K_p": 0}, r"'K_p' is 0: must be greater than 0 \(the matrix must be positive definite\)"),
        ({"K_p": (10, -1)}, r"'K_p' is -1: must be greater than 0"),
        ({"K_p": (1, 2, 3)}, r"'K_p' is \(1, 2, 3\): expected one number or a pair"),
        ({"Lambda_1": -0.1}, r"'Lambda_1' is -0.1: must be at least 0"),
        ({"guard": 1}, r"'guard' is 1: must be less than 1 \(a cosine is at most 1\)"),
        ({"k_d": (1, 2)}, r"'k_d' is \(1, 2\): expected one number"),
        ({"epsilon_t": 0}, r"'epsilon_t' is 0: must be greater than 0 \(the robust term divides by it\)"),
        ({"gamma_w": math.nan}, r"'gamma_w' is nan: expected a finite number"),
        ({"W_m": math.inf}, r"'W_m' is inf: expected a finite number"),
        ({"theta_m": "ten"}, r"'theta_m' is 'ten': expected one number"),
        ({"theta_m": None}, r"'theta_m' is None: expected one number"),
        ({"theta_m": True}, r"'theta_m' is True: expected one number"),
        ({"theta_m": 1j}, r"'theta_m' is 1j: expected one number"),
        ({"theta_m": np.complex128(1j)}, r"'theta_m' is .*: expected one number"),
        ({"theta_m": np.bool_(True)}, r"'theta_m' is .*True.*: expected one number"),
        ({"theta_m": b"1"}, r"'theta_m' is b'1': expected one number"),
        ({"theta_m": np.array("1")}, r"'theta_m' is array.*: expected one number"),
        ({"theta_m": 10**400}, r"'theta_m' is beyond the largest number of double precision"),
        ({"K_p": b"12"}, r"'K_p' is b'12': expected one number or a pair"),
        ({"K_p": (True, 1)}, r"'K_p' is \(True, 1\): expected one number or a pair"),
        ({"K_p": np.eye(2)}, r"'K_p' is array(.|\n)*: expected one number or a pair"),
        ({"K_p": {1: 2}}, r"'K_p' is \{1: 2\}: expected one number or a pair"),
        ({3: 10}, r"unknown gain 3; known: K_p"),
        ({"centres": ()}, r"'centres' is \(\): expected one or more numbers"),
        ({"widths": (1, 2)}, r"'widths' has 2 entries: expected 1, or 9"),
    ],
)
def test_wrong_gains_are_refused_by_name_with_the_reason(values, message):
    with pytest.raises(GainError, match=message):
        NeuralAdaptivePidGains.from_mapping(values)

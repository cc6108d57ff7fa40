"""Saved states continue bit for bit, and bytes from strangers do no harm."""

import math
from collections.abc import Callable

import pytest

from . import driver
from .driver import Instance, Refused
from .fmus import Fmu

EULER, RUNGE_KUTTA_4, DORMAND_PRINCE_45 = 1, 2, 3


def model_exchange_euler(instance: Instance, n: int, steps: int, h: float) -> list[float]:
    states = instance.get(*range(n))
    instance.enter_continuous_time()
    for k in range(steps):
        slopes = instance.derivatives(n)
        states = [x + h * slope for x, slope in zip(states, slopes, strict=True)]
        instance.place((k + 1) * h, states)
        instance.complete_step()
    return states


@pytest.mark.parametrize("solver", [EULER, RUNGE_KUTTA_4, DORMAND_PRINCE_45])
def test_saved_state_resumes_bit_for_bit(new: Callable, car: Fmu, solver: int) -> None:
    def prepared() -> Instance:
        instance = new()
        instance.set({car["tau_drive"]: 20.0, car["tau_steer"]: 5.0, car["m_c"]: 12.0, car["solver_step"]: 0.1})
        instance.set_enumeration(car["solver"], solver)
        return instance.start()

    def run_on(instance: Instance) -> list[float]:
        for k in range(5):
            instance.set({car["tau_steer"]: 5.0 - k})
            instance.step(0.5 + 0.3 * k, 0.3)
        return instance.get(*range(car["time"] - 4), car["time"])

    one = prepared()
    one.step(0.0, 0.5)
    state = one.save()
    expected = run_on(one)
    assert one.statuses <= {driver.OK, driver.WARNING}
    one.restore(state)
    assert run_on(one) == expected
    stored = one.serialize(state)
    other = new()
    again = other.deserialize(stored)
    other.restore(again)
    assert other.serialize(again) == stored
    assert run_on(other) == expected
    other.forget(again)
    one.forget(state)


def test_saved_state_in_model_exchange(new: Callable, car: Fmu) -> None:
    one = new("model_exchange").start()
    one.set({car["tau_drive"]: 20.0})
    model_exchange_euler(one, 6, 10, 0.02)
    state = one.save()
    before = one.derivatives(6)
    one.place(7.0, [1.0] * 6)
    assert one.derivatives(6) != before
    one.restore(state)
    assert one.derivatives(6) == before
    assert one.get(car["time"]) == [0.2]
    with pytest.raises(Refused, match="other interface"):
        new().restore(state)
    with pytest.raises(Refused, match="other interface"):
        new().deserialize(one.serialize(state))
    one.forget(state)


def test_bytes_from_strangers_are_checked(new: Callable, car: Fmu) -> None:
    """Each byte changed in turn: the bytes are refused, or the state that they make is sound."""
    instance = new().start()
    state = instance.save()
    stored = instance.serialize(state)
    instance.forget(state)
    for wrong in (b"", stored[:-1], stored + b"\0", b"x" + stored[1:], bytes(len(stored))):
        with pytest.raises(Refused, match="not a state of this FMU"):
            instance.deserialize(wrong)
    refused, worst = 0, driver.OK
    for position in range(len(stored)):
        for value in (0x00, 0x7F, 0xFF):
            data = stored[:position] + bytes([value]) + stored[position + 1 :]
            other = instance
            try:
                state = other.deserialize(data)
            except Refused:
                refused += 1
                continue
            other.restore(state)
            try:
                assert all(map(math.isfinite, other.get(*range(6), car["m_c"], car["time"])))
                other.step(other.get(car["time"])[0], 0.02)
            except Refused as refusal:
                worst = max(worst, refusal.status)
            other.forget(state)
    assert refused > 100
    assert worst == driver.ERROR

"""Limits of the equations, and their messages in the log."""

from collections.abc import Callable

import fmpy
import pytest

from . import driver
from .driver import Instance, Refused
from .fmus import Fmu

# ---- limits ----


def test_past_the_singularity_a_warning(new: Callable, car: Fmu) -> None:
    """Steering past 90 degrees: one message with its place and time, status Warning meanwhile, a message at its end."""
    instance = new()
    instance.call("SetDebugLogging", 1, driver.ctypes.c_size_t(0), None)
    instance.set({car["gamma"]: 1.45, car["omega"]: 4.0})
    instance.start()
    instance.messages.clear()
    statuses = [instance.step(0.02 * k, 0.02) for k in range(5)]
    assert statuses == [driver.OK, driver.WARNING, driver.WARNING, driver.WARNING, driver.WARNING]
    ((status, category, message),) = instance.messages
    assert (status, category) == (driver.WARNING, "logStatusWarning")
    assert "gamma is 1.5" in message
    assert "at time 0.04 s, above its limit of 1.57" in message
    assert "singular" in message
    instance.set({car["tau_steer"]: -200.0})
    k = 5
    while instance.step(0.02 * k, 0.02) == driver.WARNING:
        k += 1
        assert k < 100
    assert instance.messages[-1][1] == "logEvents"
    assert "within its limits again" in instance.messages[-1][2]


def test_at_the_singularity_stop(new: Callable, car: Fmu) -> None:
    instance = new()
    instance.set({car["gamma"]: 1.45, car["omega"]: 4.0})
    instance.set_enumeration(car["at_singularity"], 2)
    instance.start()
    instance.step(0.0, 0.02)
    good = instance.get(*range(6))
    with pytest.raises(Refused, match=r"DoStep: .*gamma is 1.5\d+ rad at time 0.04 s, above its limit"):
        instance.step(0.02, 0.02)
    assert instance.get(*range(6), car["time"]) == [*good, 0.02]
    if not instance.is_2:
        assert (instance.flags, instance.last_successful_time) == ([False] * 3, 0.02)
    with pytest.raises(Refused, match="stopped by a failed step"):
        instance.step(0.02, 0.02)
    instance.reset()
    instance.set({car["gamma"]: 2.0})
    instance.set_enumeration(car["at_singularity"], 2)
    with pytest.raises(Refused, match="gamma is 2 rad at time 0 s, above its limit"):
        instance.start()


def test_limits_in_model_exchange(new: Callable, car: Fmu) -> None:
    """A trial beyond the limit is discarded where the simulation must stop; else accepted states are warned of."""
    instance = new("model_exchange").start()
    instance.enter_continuous_time()
    beyond = [0.0, 0.0, 0.0, 1.7, 0.0, 0.0]
    instance.place(0.3, beyond)
    instance.derivatives(6)
    assert instance.messages == []
    assert instance.complete_step() == driver.WARNING
    assert instance.complete_step() == driver.WARNING
    (message,) = instance.messages
    assert "gamma is 1.7 rad at time 0.3 s" in message[2]

    instance.reset()
    instance.set_enumeration(car["at_singularity"], 2)
    instance.start()
    instance.enter_continuous_time()
    instance.place(0.3, beyond)
    with pytest.raises(Refused, match=r"gamma is 1\.7 rad") as refusal:
        instance.derivatives(6)
    assert refusal.value.status == driver.DISCARD
    instance.place(0.1, [0.0] * 6)
    assert instance.derivatives(6) == [0.0] * 6
    instance.place(0.3, beyond)
    with pytest.raises(Refused, match=r"gamma is 1\.7 rad"):
        instance.complete_step()


def test_an_importer_is_told_of_limits_in_model_exchange(car: Fmu, capsys: pytest.CaptureFixture[str]) -> None:
    """FMI 3.0 has importers that complete no step unless the description asks for it."""
    end = fmpy.simulate_fmu(  # which prints messages: FMPy would keep a logger of ours beyond its end
        car.path,
        fmi_type="ModelExchange",
        solver="Euler",
        start_values={"gamma": 1.45, "omega": 4.0},
        output=["gamma"],
        stop_time=0.1,
        step_size=0.02,
        debug_logging=True,
    )
    assert end["gamma"][-1] > 1.571
    assert capsys.readouterr().out.count("above its limit of 1.57") == 1


def test_messages_are_escaped(fmus: Callable, fmi: str) -> None:
    """A number sign begins a value reference in FMI, a percent sign a format in FMI 2.0: both are doubled."""
    fmu = fmus("many_functions", fmi)
    instance = Instance(fmu.library, "co_simulation")
    instance.set({fmu["x"]: -5.0})
    instance.start()
    assert instance.messages == []
    instance.free()
    instance = Instance(fmu.library, "co_simulation")
    instance.set({fmu["x"]: -50.0})
    instance.start()
    escaped = "##1 of 100 %% made up" if fmi == "2.0" else "##1 of 100 % made up"
    assert escaped in instance.messages[0][2]
    instance.free()


# ---- the log ----


def test_log_switch(new: Callable, car: Fmu) -> None:
    instance = new()
    size, names = driver.ctypes.c_size_t, (driver.ctypes.c_char_p * 1)

    def categories() -> list[str]:
        instance.messages.clear()
        instance.reset()
        with pytest.raises(Refused):
            instance.get(2**31)
        return [category for _, category, _ in instance.messages]

    assert categories() == ["logStatusError"]
    instance.call("SetDebugLogging", 1, size(1), names(b"logEvents"))
    # FMI 2.0 has no way to ask for silence at the start, so problems are always reported there.
    assert categories() == ["logEvents", "logStatusError"] if instance.is_2 else ["logEvents"]
    instance.call("SetDebugLogging", 1, size(1), names(b"logAll"))
    assert categories() == ["logEvents", "logStatusError"]
    instance.call("SetDebugLogging", 0, size(0), None)
    assert categories() == (["logStatusError"] if instance.is_2 else [])
    with pytest.raises(Refused):
        instance.call("SetDebugLogging", 1, size(1), names(b"logNonsense"))

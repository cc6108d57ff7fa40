"""The stubs behave as stated: FMPy accepts the valid ones, and each shows its own fault."""

import ctypes
import json
import math
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy import fmi1, fmi2, fmi3, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

from .broken import BROKEN, EVIL, make_broken
from .stub import make_fmu

FMI = ("1.0", "2.0", "3.0")
DRIVEN = {"tau_drive": 10.0, "tau_steer": 1.0}


@pytest.fixture(autouse=True)
def _unpacked_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """FMPy leaves what it has unpacked if a simulation fails."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@pytest.fixture
def made(tmp_path: Path) -> Callable[..., str]:
    return lambda **options: str(make_fmu(tmp_path, **options))


class Messages:
    """A logger for FMPy that keeps its messages."""

    def __init__(self) -> None:
        self.said: list[tuple[int, bytes]] = []

    def __call__(self, *arguments: Any) -> None:
        self.said.append((arguments[-3], arguments[-1]))


def simulate(fmu: str, **options: Any) -> np.ndarray:
    return simulate_fmu(fmu, **{"stop_time": 2.0, "output_interval": 0.02, "logger": Messages()} | options)


def euler(
    n: int = 100, h: float = 0.02, torque: tuple[float, float] = (10.0, 1.0), brake: float = math.inf
) -> list[float]:
    x = y = psi = gamma = v = omega = 0.0
    for k in range(n):
        if k * h > brake - 1e-9:
            v, brake = 0.0, math.inf
        rates = (v * math.cos(psi), v * math.sin(psi), v * math.tan(gamma) / 1.2, omega, torque[0] / 10, torque[1] / 10)
        x, y, psi, gamma, v, omega = (z + h * r for z, r in zip((x, y, psi, gamma, v, omega), rates, strict=True))
    return [x, y, psi, gamma, v, omega]


# Good and unusual ones --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        *({"fmi": fmi} for fmi in FMI),
        *({"fmi": fmi, "units": units} for fmi in FMI for units in ("deg", "names", "none")),
        *({"fmi": fmi, "initial": "parameters", "velocities": False, "drive": False} for fmi in FMI),
        *({"fmi": fmi, "feedthrough": True, "once": True, "execution_tool": True, "fillers": 5} for fmi in FMI),
        *(
            {
                "fmi": fmi,
                "interface": interface,
                "units": units,
                "end_stop": 0.5,
                "time_event": True,
                "step_event": True,
            }
            | {"feedthrough": True, "save": True, "initial": initial, "velocities": False}
            for fmi in FMI[1:]
            for interface in ("model_exchange", "both")
            for units in ("deg", "names", "none")
            for initial in ("exact", "parameters")
        ),
        *(
            {"fmi": "1.0", "interface": "model_exchange", "end_stop": 0.5, "time_event": True, "step_event": True}
            | {"units": units}
            for units in ("deg", "names", "none")
        ),
        {"fmi": "3.0", "arrays": True, "feedthrough": True},
        {"fmi": "3.0", "arrays": True, "interface": "both", "end_stop": 0.5, "time_event": True, "feedthrough": True},
        {"fmi": "3.0", "arrays": True, "initial": "parameters", "units": "deg"},
        {"fmi": "3.0", "fixed_step": 0.005},
        {"fmi": "3.0", "event_mode": True, "early_return": "allowed", "intermediate_update": True},
        {"names": {"x": "chassis.r[1]", "tau_drive": "drive torque"}},
    ],
)
def test_no_complaint_of_what_is_meant_to_be_valid(made: Callable[..., str], options: dict[str, Any]) -> None:
    assert validate_fmu(made(**options)) == []


@pytest.mark.parametrize("fmi", FMI)
def test_the_good_one(made: Callable[..., str], fmi: str) -> None:
    # FMPy ignores the step size that FMI 1 and 2 suggest if it is told another
    result = simulate(made(fmi=fmi), start_values=DRIVEN)
    assert list(result[-1])[1:] == pytest.approx(euler(), abs=1e-12)


@pytest.mark.parametrize(
    ("fmi", "interface"), [("1.0", "model_exchange"), *((f, i) for f in FMI[1:] for i in ("model_exchange", "both"))]
)
def test_model_exchange(made: Callable[..., str], fmi: str, interface: str) -> None:
    fmu = made(fmi=fmi, interface=interface)
    options = {"fmi_type": "ModelExchange", "start_values": DRIVEN}
    result = simulate(fmu, solver="Euler", step_size=0.02, **options)
    assert list(result[-1])[1:] == pytest.approx(euler(), abs=1e-12)
    result = simulate(fmu, relative_tolerance=1e-8, **options)
    assert result["v"][-1] == pytest.approx(2.0, abs=1e-5)
    assert result["gamma"][-1] == pytest.approx(0.2, abs=1e-5)


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize("initial", ["exact", "parameters"])
def test_initial_pose(made: Callable[..., str], fmi: str, initial: str) -> None:
    end = "" if initial == "exact" else "0"
    start = dict(zip((f"{name}{end}" for name in ("x", "y", "psi", "gamma")), (1.0, 2.0, 30.0, 4.0), strict=True))
    result = simulate(made(fmi=fmi, initial=initial, units="deg"), start_values=start)
    assert list(result[0])[1:5] == pytest.approx([1.0, 2.0, 30.0, 4.0])
    assert list(result[-1])[1:5] == pytest.approx([1.0, 2.0, 30.0, 4.0])


@pytest.mark.parametrize("fmi", FMI[1:])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_degrees(made: Callable[..., str], fmi: str, kind: str) -> None:
    factors = np.array([1.0, 1.0, 180 / np.pi, 180 / np.pi, 3.6, 180 / np.pi])
    fmu = made(fmi=fmi, units="deg", interface="both")
    result = simulate(fmu, start_values=DRIVEN, fmi_type=kind, solver="Euler", step_size=0.02)
    assert list(result[-1])[1:] == pytest.approx(euler() * factors, abs=1e-9)


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_arrays(made: Callable[..., str], kind: str) -> None:
    fmu = made(fmi="3.0", arrays=True, interface="both")
    result = simulate(fmu, start_values={"torque": [10.0, 1.0]}, fmi_type=kind, solver="Euler", step_size=0.02)
    assert list(result["pose"][-1]) == pytest.approx(euler()[:4], abs=1e-12)
    result = simulate(fmu, start_values={"pose": [1.0, 2.0, 0.0, 0.0]}, fmi_type=kind)
    assert list(result["pose"][-1]) == pytest.approx([1.0, 2.0, 0.0, 0.0])


@pytest.mark.parametrize("fmi", FMI)
def test_feedthrough(made: Callable[..., str], fmi: str) -> None:
    """The output at a communication point follows from the input at that point, which was set after the step."""
    fmu = made(fmi=fmi, feedthrough=True)
    signals = np.array([(0.0, 10.0), (1.0, 10.0), (1.0, 20.0), (2.0, 20.0)], [("time", float), ("tau_drive", float)])
    result = simulate(fmu, input=signals)
    assert result["power"] == pytest.approx(np.where(result["time"] <= 1.0, 10.0, 20.0) * result["v"], abs=1e-9)


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize("when", [1.0, 1.01])
def test_time_event_in_co_simulation(made: Callable[..., str], fmi: str, when: float) -> None:
    result = simulate(made(fmi=fmi, time_event=True, when=when), start_values=DRIVEN)
    assert result["v"][-1] == pytest.approx(2.0 - when, abs=1e-9)
    assert result["events"][-1] == 1
    if when == 1.0:
        assert list(result[-1])[1:7] == pytest.approx(euler(brake=1.0), abs=1e-9)


@pytest.mark.parametrize("fmi", FMI[1:])
def test_time_event_in_model_exchange(made: Callable[..., str], fmi: str) -> None:
    fmu = made(fmi=fmi, time_event=True, when=1.01, interface="model_exchange")
    result = simulate(fmu, start_values=DRIVEN)
    assert result["v"][-1] == pytest.approx(0.99, abs=1e-9)
    assert result["events"][-1] == 1
    assert result["v"][result["time"] == 1.01] == pytest.approx([1.01, 0.0])


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_end_stop(made: Callable[..., str], fmi: str, kind: str) -> None:
    """The steering is pressed to the left stop, released, and pressed to the right one."""
    one = {"CoSimulation": "co_simulation", "ModelExchange": "model_exchange"}[kind]
    fmu = made(fmi=fmi, end_stop=0.5, interface=one if fmi == "1.0" else "both")
    points = [(0.0, 20.0), (2.0, 20.0), (2.0, -20.0), (4.0, -20.0)]
    signals = np.array(points, [("time", float), ("tau_steer", float)])
    result = simulate(fmu, input=signals, fmi_type=kind, stop_time=4.0)
    assert result["gamma"].max() == pytest.approx(0.5, abs=0.03)
    assert result["gamma"].min() == pytest.approx(-0.5, abs=0.03)
    held = (result["time"] > 0.8) & (result["time"] < 1.99)
    assert result["gamma"][held] == pytest.approx(0.5, abs=1e-12)
    assert result["gamma"][-1] == pytest.approx(-0.5, abs=1e-12)
    assert result["omega"][-1] == 0.0
    assert result["events"][-1] == 3


@pytest.mark.parametrize(
    ("fmi", "kind"),  # not Model Exchange of FMI 1.0, which FMPy does not tell that a step is completed
    [*((fmi, "CoSimulation") for fmi in FMI), ("2.0", "ModelExchange"), ("3.0", "ModelExchange")],
)
def test_step_event(made: Callable[..., str], fmi: str, kind: str) -> None:
    interface = "co_simulation" if fmi == "1.0" else "both"
    fmu = made(fmi=fmi, step_event=True, interface=interface)
    result = simulate(fmu, start_values={"gamma": 0.8, "v": 5.0}, fmi_type=kind)
    assert np.abs(result["psi"]).max() < np.pi + 0.5
    assert np.abs(result["psi"][-1]) <= np.pi
    assert result["events"][-1] == 1
    expected = 2.0 * 5.0 * math.tan(0.8) / 1.2 - 2 * math.pi
    assert result["psi"][-1] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("when", [1.0, 1.01])
@pytest.mark.parametrize("early", [False, True])
def test_event_mode(made: Callable[..., str], when: float, early: bool) -> None:
    fmu = made(fmi="3.0", event_mode=True, early_return="allowed" if early else "", when=when)
    result = simulate(fmu, start_values=DRIVEN, use_event_mode=True, early_return_allowed=early)
    delayed = when if early or when == 1.0 else 1.02  # without early return, the end of the step is the first chance
    assert result["v"][-1] == pytest.approx(2.0 - delayed, abs=1e-9)
    assert result["events"][-1] == 1
    unused = simulate(fmu, start_values=DRIVEN)
    assert unused["v"][-1] == pytest.approx(2.0 - when, abs=1e-9)


def test_early_return(made: Callable[..., str]) -> None:
    fmu = made(fmi="3.0", early_return="allowed")
    whole = simulate(fmu, start_values=DRIVEN)
    early = simulate(fmu, start_values=DRIVEN, early_return_allowed=True)
    assert list(whole[-1])[1:] == pytest.approx(euler(), abs=1e-12)
    assert list(early[-1])[1:] == pytest.approx(euler(200, 0.01), abs=1e-9)


def test_early_return_that_was_not_allowed(made: Callable[..., str]) -> None:
    fmu = made(fmi="3.0", early_return="always")
    with pytest.raises(Exception, match="Early Return is not allowed"):
        simulate(fmu)


class Instance:
    """An initialised Co-Simulation instance, to call functions of."""

    def __init__(self, fmu: str, folder: Path, initialise: bool = True, **options: Any) -> None:
        self.description = fmpy.read_model_description(fmu)
        self.references = {variable.name: variable.valueReference for variable in self.description.modelVariables}
        unpacked = fmpy.extract(fmu, str(folder))
        self.messages = Messages()
        self.fmu = fmpy.instantiate_fmu(unpacked, self.description, "CoSimulation", logger=self.messages, **options)
        if not initialise:
            return
        if isinstance(self.fmu, fmi1.FMU1Slave):
            self.fmu.initialize()
            return
        if isinstance(self.fmu, fmi2.FMU2Slave):
            self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def get(self, name: str) -> float:
        getter = self.fmu.getFloat64 if isinstance(self.fmu, fmi3.FMU3Slave) else self.fmu.getReal
        return getter([self.references[name]])[0]

    def set(self, name: str, value: float) -> None:
        setter = self.fmu.setFloat64 if isinstance(self.fmu, fmi3.FMU3Slave) else self.fmu.setReal
        setter([self.references[name]], [value])

    def step(self, time: float, h: float = 0.02) -> Any:
        return self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=h)


def test_early_return_says_to_which_time(made: Callable[..., str], tmp_path: Path) -> None:
    one = Instance(made(fmi="3.0", early_return="always"), tmp_path / "one")
    assert one.step(0.0) == (False, False, True, 0.01)
    assert one.step(0.01, 0.01) == (False, False, False, 0.02)
    one.fmu.freeInstance()


def test_intermediate_update(made: Callable[..., str], tmp_path: Path) -> None:
    times = []

    def update(_: Any, time: float, *flags: Any) -> None:
        *rest, requested, until = flags
        times.append((time, *rest))
        if time > 0.02:
            requested[0] = True
            until[0] = time

    callback = fmi3.fmi3IntermediateUpdateCallback(update)
    fmu = made(fmi="3.0", intermediate_update=True, early_return="allowed")
    for allowed in (False, True):
        folder = tmp_path / str(allowed)
        one = Instance(fmu, folder, intermediate_update=callback, early_return_allowed=allowed)
        if not allowed:
            assert one.step(0.0) == (False, False, False, 0.02)
            assert one.step(0.02) == (False, False, False, 0.04)
            assert times == [(0.01, False, True, True, False), (pytest.approx(0.03), False, True, True, False)]
        else:
            times.clear()
            assert one.step(0.0) == (False, False, True, 0.01)
            assert one.step(0.01, 0.1) == (False, False, True, pytest.approx(0.06))
            assert times[1] == (pytest.approx(0.06), False, True, True, True)
        one.fmu.freeInstance()


@pytest.mark.parametrize("fmi", FMI)
def test_fixed_step(made: Callable[..., str], tmp_path: Path, fmi: str) -> None:
    fmu = made(fmi=fmi, fixed_step=0.005)
    result = simulate(fmu, start_values=DRIVEN)
    assert list(result[-1])[1:] == pytest.approx(euler(400, 0.005), abs=1e-9)
    one = Instance(fmu, tmp_path / "one")
    assert step_status(one, 0.0, 0.002) == 3
    assert b"no multiple of the fixed internal step 0.005" in one.messages.said[-1][1]
    assert step_status(one, 0.0, 0.010) == 0
    one.fmu.freeInstance()
    interface = fmpy.read_model_description(fmu).coSimulation
    assert interface.fixedInternalStepSize == ("0.005" if fmi == "3.0" else None)


def step_status(one: Instance, time: float, h: float = 0.02) -> int:
    """Return the status of a step; FMPy takes that of FMI 1 for a string, and would crash."""
    if isinstance(one.fmu, fmi1.FMU1Slave):
        step = one.fmu.dll[f"{one.fmu.modelIdentifier}_fmiDoStep"]
        step.argtypes = (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_char)
        step.restype = ctypes.c_int
        return int(step(one.fmu.component, time, h, 1))
    try:
        one.step(time, h)
    except FMICallException as error:
        return error.status
    return 0


@pytest.mark.parametrize("fmi", FMI)
def test_once_per_process(made: Callable[..., str], tmp_path: Path, fmi: str) -> None:
    fmu = made(fmi=fmi, once=True)
    assert fmpy.read_model_description(fmu).coSimulation.canBeInstantiatedOnlyOncePerProcess or fmi == "1.0"
    one = Instance(fmu, tmp_path / "one")
    if fmi == "1.0":
        two = Instance(fmu, tmp_path / "two", initialise=False)
        assert two.fmu.component is None
    else:
        with pytest.raises(Exception, match="Failed to instantiate"):
            Instance(fmu, tmp_path / "two")
    one.fmu.freeInstance()
    three = Instance(fmu, tmp_path / "three")
    three.fmu.freeInstance()


@pytest.mark.parametrize("fmi", FMI[1:])
@pytest.mark.parametrize("save", [False, True])
def test_saved_state(made: Callable[..., str], tmp_path: Path, fmi: str, save: bool) -> None:
    one = Instance(made(fmi=fmi, save=save), tmp_path / "one")
    one.set("tau_drive", 10.0)
    one.step(0.0)
    if not save:
        with pytest.raises(FMICallException):
            one.fmu.getFMUState()
    else:
        state = one.fmu.getFMUState()
        bytes_ = one.fmu.serializeFMUState(state)
        one.step(0.02)
        after = one.get("v")
        for restored in (state, one.fmu.deserializeFMUState(bytes_)):
            one.fmu.setFMUState(restored)
            assert one.get("v") < after
            one.step(0.02)
            assert one.get("v") == after
            one.fmu.freeFMUState(restored)
    one.fmu.freeInstance()


@pytest.mark.parametrize("fmi", FMI[1:])
def test_calls_out_of_order_are_refused(made: Callable[..., str], tmp_path: Path, fmi: str) -> None:
    one = Instance(made(fmi=fmi), tmp_path / "one", initialise=False)
    assert step_status(one, 0.0) == 3
    assert b"DoStep was called in the wrong mode: instantiated" in one.messages.said[-1][1]
    one.fmu.freeInstance()


@pytest.mark.parametrize("fmi", FMI)
def test_wrong_times_and_values_are_refused(made: Callable[..., str], tmp_path: Path, fmi: str) -> None:
    one = Instance(made(fmi=fmi), tmp_path / "one")
    assert [step_status(one, 0.0, -0.02), step_status(one, 0.0, 0.0), step_status(one, 1.0), step_status(one, 0.0)] == [
        3,
        3,
        3,
        0,
    ]
    with pytest.raises(FMICallException):
        one.set("when", -1.0)
    with pytest.raises(FMICallException):
        one.set("x", 1.0)
    one.fmu.freeInstance()


@pytest.mark.parametrize("fmi", FMI)
def test_the_enumeration(made: Callable[..., str], fmi: str) -> None:
    fmu = made(fmi=fmi)
    assert simulate(fmu, start_values={"drive": 1}, output=["drive"])["drive"][-1] == 1
    with pytest.raises(FMICallException):
        simulate(fmu, start_values={"drive": 4})


# Bad ones that can be borne ---------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", FMI)
def test_nothing(made: Callable[..., str], fmi: str) -> None:
    result = simulate(made(fmi=fmi, behaviour="nothing"), start_values=DRIVEN | {"x": 1.0})
    assert list(result[-1])[1:] == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize(
    ("behaviour", "status"),
    [("warning", 1), ("discard", 2), ("error", 3), ("fatal", 4), ("pending", 5), ("illegal", 17)],
)
def test_status_of_a_step(made: Callable[..., str], tmp_path: Path, fmi: str, behaviour: str, status: int) -> None:
    one = Instance(made(fmi=fmi, behaviour=behaviour, when=0.04), tmp_path / "one")
    assert [step_status(one, 0.0), step_status(one, 0.02)] == [0, 0]
    assert one.messages.said == []
    assert step_status(one, 0.04) == (
        status if behaviour != "warning" or fmi == "1.0" else 0
    )  # FMPy is silent of warnings
    said = f"step returns {behaviour} at t = 0.04 s, as it was made to"
    assert one.messages.said == [(status, said.encode())]
    one.fmu.freeInstance()


@pytest.mark.parametrize("fmi", FMI[1:])
def test_status_in_model_exchange(made: Callable[..., str], fmi: str) -> None:
    messages = Messages()
    with pytest.raises(FMICallException, match="error"):
        simulate(
            made(fmi=fmi, behaviour="error", interface="model_exchange"),
            solver="Euler",
            step_size=0.02,
            logger=messages,
        )
    assert b"step returns error at t = 1 s" in messages.said[0][1]


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize("place", ["set", "get"])
def test_refused_values(made: Callable[..., str], tmp_path: Path, fmi: str, place: str) -> None:
    one = Instance(made(fmi=fmi, behaviour="error", place=place, when=0.02), tmp_path / "one")
    calls = {"set": lambda: one.set("tau_drive", 1.0), "get": lambda: one.get("x")}
    calls[place]()
    assert step_status(one, 0.0) == 0
    with pytest.raises(FMICallException):
        calls.pop(place)()
    calls.popitem()[1]()
    one.fmu.freeInstance()


@pytest.mark.parametrize("fmi", FMI[1:])
def test_no_instance(made: Callable[..., str], tmp_path: Path, fmi: str) -> None:
    messages = Messages()
    with pytest.raises(Exception, match="Failed to instantiate"):
        simulate(made(fmi=fmi, behaviour="error", place="instantiate"), logger=messages)
    assert messages.said == [(3, b"instantiate returns error at t = 0 s, as it was made to")]


@pytest.mark.parametrize("fmi", FMI[1:])
@pytest.mark.parametrize("place", ["initialization", "terminate"])
def test_error_in_other_places(made: Callable[..., str], fmi: str, place: str) -> None:
    messages = Messages()
    with pytest.raises(FMICallException, match=r"fmi\d(ExitInit|Terminate)"):
        simulate(made(fmi=fmi, behaviour="error", place=place), logger=messages)
    assert messages.said[0][1].startswith(place.encode())


@pytest.mark.parametrize("fmi", FMI)
@pytest.mark.parametrize(("behaviour", "name"), [("nan", "x"), ("infinity", "v")])
def test_values_that_are_no_numbers(made: Callable[..., str], fmi: str, behaviour: str, name: str) -> None:
    result = simulate(made(fmi=fmi, behaviour=behaviour))
    assert np.array_equal(np.isfinite(result[name]), result["time"] < 0.999)
    if fmi != "1.0":
        fmu = made(fmi=fmi, behaviour=behaviour, interface="model_exchange")
        result = simulate(fmu, solver="Euler", step_size=0.02)
        assert np.array_equal(np.isfinite(result[name]), result["time"] < 0.999)


@pytest.mark.parametrize("fmi", FMI)
def test_end_of_the_simulation_asked_for(made: Callable[..., str], tmp_path: Path, fmi: str) -> None:
    fmu = made(fmi=fmi, behaviour="terminate")
    if fmi == "1.0":
        one = Instance(made(fmi=fmi, behaviour="terminate", when=0.0), tmp_path / "one")
        assert step_status(one, 0.0) == 2
        one.fmu.freeInstance()
        return
    assert simulate(fmu)["time"][-1] == pytest.approx(1.0, abs=0.021)
    fmu = made(fmi=fmi, behaviour="terminate", interface="model_exchange")
    assert simulate(fmu, solver="Euler", step_size=0.02)["time"][-1] == pytest.approx(1.0, abs=0.021)


@pytest.mark.parametrize("fmi", FMI)
def test_logs(made: Callable[..., str], fmi: str) -> None:
    messages = Messages()
    simulate(made(fmi=fmi, behaviour="log_million", lines=1000), logger=messages)
    assert [text for _, text in messages.said] == [f"line {i} of 1000".encode() for i in range(1, 1001)]

    odd = Messages()
    simulate(made(fmi=fmi, behaviour="log_odd"), logger=odd)
    [(status, text)] = odd.said
    assert status == 1
    assert text.startswith(b"100 % sure of %s and %d: \xff\xfe not UTF-8, \x1b[31mred")

    percent = Messages()
    simulate(made(fmi=fmi, behaviour="log_percent"), logger=percent)
    assert len(percent.said) == 1

    long = Messages()
    simulate(made(fmi=fmi, behaviour="log_long"), logger=long)
    assert len(long.said) == 1
    assert len(long.said[0][1]) == 1_000_000 if fmi == "3.0" else 0 < len(long.said[0][1]) <= 1_000_000


@pytest.mark.parametrize("fmi", FMI)
def test_print(made: Callable[..., str], fmi: str, capfd: pytest.CaptureFixture[str]) -> None:
    simulate(made(fmi=fmi, behaviour="print", when=1.9), stop_time=2.0)
    assert capfd.readouterr().out.count("stub prints at t = 1.9") == 5


def test_slow(made: Callable[..., str], tmp_path: Path) -> None:
    one = Instance(made(behaviour="slow", when=0.02, seconds=0.05), tmp_path / "one")
    one.step(0.0)
    begin = time.perf_counter()
    one.step(0.02)
    assert time.perf_counter() - begin > 0.05
    one.fmu.freeInstance()


# Those that cannot: each in a process of its own ------------------------------------------------------------

# The status of the process, where -15 and -9 are those of the signals that end what hangs.
_DEADLY = {
    "segfault": -11,
    "exit": 7,
    "abort": -6,
    "hang": -15,
    "hang_stubborn": -9,
    "spin": -15,
    "fatal_strict": -6,
}
_CASES = [(behaviour, "step", fmi) for behaviour in ("segfault", "exit", "hang") for fmi in FMI] + [
    *((behaviour, "step", "2.0") for behaviour in ("abort", "hang_stubborn", "spin", "fatal_strict")),
    *((behaviour, "instantiate", "2.0") for behaviour in ("segfault", "exit", "hang")),
    *(("segfault", place, "3.0") for place in ("initialization", "terminate", "free")),
    *(("hang", place, "3.0") for place in ("initialization", "terminate", "free")),
    ("segfault", "set", "2.0"),
    ("segfault", "get", "2.0"),
]  # fmt: skip


@pytest.fixture(scope="module")
def apart(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Outcome of the processes that ran dangerous stubs."""
    folder = tmp_path_factory.mktemp("apart")
    jobs: list[dict[str, Any]] = []
    for behaviour, place, fmi in _CASES:
        name = f"{behaviour}_{place}_{fmi[0]}"
        fmu = make_fmu(folder, fmi=fmi, behaviour=behaviour, place=place, name=name, when=0.2)
        jobs.append({"name": name, "fmu": str(fmu), "hangs": _DEADLY[behaviour] in (-15, -9)})
    for behaviour in ("good", "rounding", "chdir", "close_descriptors"):
        jobs.append({"name": behaviour, "fmu": str(make_fmu(folder, behaviour=behaviour, name=behaviour, when=0.2))})
    for behaviour, deed in (("good", "interrupt"), ("signals", "interrupt"), ("good", "divide"), ("trap", "divide")):
        name = f"{behaviour}_{deed}"
        jobs.append({"name": name, "fmu": str(make_fmu(folder, behaviour=behaviour, name=name)), deed: True})
    result = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("apart.py"))],
        input=json.dumps(jobs), capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(result.stdout)


@pytest.mark.parametrize(("behaviour", "place", "fmi"), _CASES)
def test_deadly(apart: dict[str, Any], behaviour: str, place: str, fmi: str) -> None:
    found = apart[f"{behaviour}_{place}_{fmi[0]}"]
    assert found["exit"] == _DEADLY[behaviour]
    assert found["killed"] == (found["exit"] in (-15, -9))
    assert found["log"][0].startswith(f"{place} ")


def test_changes_to_the_process(apart: dict[str, Any]) -> None:
    good = apart["good"]
    assert good["exit"] == 0
    assert good["said"]["sum"] == 1.0
    assert apart["rounding"]["said"]["sum"] > 1.0
    assert apart["chdir"]["said"]["cwd"] == "/" != good["said"]["cwd"]
    assert apart["close_descriptors"]["exit"] == 0
    assert apart["good_interrupt"]["exit"] == -2
    assert apart["signals_interrupt"]["exit"] == 0
    assert apart["good_divide"]["exit"] == 0
    if sys.platform == "linux":
        assert apart["trap_divide"]["exit"] == -8


# Broken files -----------------------------------------------------------------------------------------------

# Where FMPy notices what is wrong with a file, and what it says; nothing where it does not notice.
_NOTICED = {
    "empty_file": ("open", "not a zip file"),
    "no_zip": ("open", "not a zip file"),
    "empty_zip": ("validate", "no item named 'modelDescription.xml'"),
    "truncated": ("open", "not a zip file"),
    "crc": ("run", "Bad CRC-32"),
    "description_crc": ("validate", "Bad CRC-32"),
    "encrypted": ("validate", "is encrypted"),
    "no_description": ("validate", "no item named 'modelDescription.xml'"),
    "two_descriptions": ("", ""),
    "no_xml": ("validate", "Start tag expected"),
    "no_utf8": ("validate", "Invalid bytes in character encoding"),
    "fmi_4": ("validate", "Unsupported FMI version: 4.0"),
    "entity_bomb": ("validate", "Maximum entity amplification factor exceeded"),
    "external_entity": ("validate", ""),
    "parent_entry": ("", ""),
    "backslash_entry": ("validate", "contains a backslash"),
    "absolute_entry": ("extract", "Illegal path"),
    "link_entry": ("", ""),
    "identifier_outside": ("run", "Cannot find shared library"),
    "no_identifier": ("run", "Cannot find shared library"),
    "duplicate_names": ("validate", "is not unique"),
    "duplicate_references": ("validate", "same value reference"),
    "undefined_unit": ("validate", "is not defined"),
    "no_start": ("validate", "has no start value"),
    "wrong_token": ("run", "Failed to instantiate"),
    "no_binaries": ("run", "cannot be simulated on the current platform"),
    "other_platforms": ("run", "cannot be simulated on the current platform"),
    "other_machine": ("run", "Failed to load shared library"),
    "text_binary": ("run", "Failed to load shared library"),
    "empty_binary": ("run", "Failed to load shared library"),
    "misnamed_binary": ("run", "Cannot find shared library"),
    "no_do_step": ("run", "undefined symbol"),
}


_VERSIONS_DIFFER = ("crc", "fmi_4", "duplicate_references", "undefined_unit", "no_start", "wrong_token")
_VERSIONS_DIFFER += ("no_binaries", "other_platforms", "text_binary", "no_do_step")


@pytest.mark.parametrize(
    ("kind", "fmi"), [(kind, fmi) for kind in BROKEN for fmi in (FMI if kind in _VERSIONS_DIFFER else ("2.0",))]
)
def test_broken(tmp_path: Path, kind: str, fmi: str) -> None:
    path = make_broken(tmp_path, kind, fmi=fmi)
    stage, message = _NOTICED[kind]
    if (kind in ("undefined_unit", "no_start") and fmi == "1.0") or (kind == "duplicate_references" and fmi != "3.0"):
        stage = ""  # which is allowed there
    if stage == "open":
        with pytest.raises(zipfile.BadZipFile, match=message):
            zipfile.ZipFile(path)
        return
    complaints = " ".join(validate_fmu(str(path)))
    assert bool(complaints) == (stage == "validate")
    if stage == "validate":
        assert message in complaints
    elif stage == "extract":
        with pytest.raises(Exception, match=message):
            fmpy.extract(str(path), str(tmp_path / "unpacked"))
    elif stage == "run" and (kind, fmi) != ("wrong_token", "1.0"):  # where FMPy would go on with a null pointer
        with pytest.raises(Exception, match=message):
            simulate(str(path))


@pytest.mark.parametrize("kind", ["parent_entry", "backslash_entry", "absolute_entry", "link_entry"])
def test_entries_outside(tmp_path: Path, kind: str) -> None:
    with zipfile.ZipFile(make_broken(tmp_path, kind)) as archive:
        [evil] = [name for name in archive.namelist() if EVIL in name]
        entries = {entry.filename: entry for entry in archive.infolist()}
    prefix = {
        "parent_entry": "../",
        "backslash_entry": "..\\",
        "absolute_entry": "/tmp/",
        "link_entry": "resources/link/",
    }
    assert evil == prefix[kind] + EVIL
    if kind == "link_entry":
        assert entries["resources/link"].external_attr >> 28 == 0o12


def test_two_descriptions(tmp_path: Path) -> None:
    with zipfile.ZipFile(make_broken(tmp_path, "two_descriptions")) as archive:
        assert archive.namelist().count("modelDescription.xml") == 2


def test_a_wrong_token_is_told(tmp_path: Path) -> None:
    for fmi in FMI:
        messages = Messages()
        path = str(make_broken(tmp_path, "wrong_token", fmi=fmi))
        if fmi == "1.0":
            one = Instance(path, tmp_path / "one", initialise=False)
            assert one.fmu.component is None
            messages = one.messages
        else:
            with pytest.raises(Exception, match="Failed to instantiate"):
                simulate(path, logger=messages)
        assert messages.said == [(3, b"the token {00000000-0000-0000-0000-000000000000} is not that of this binary")]


def test_many_variables(made: Callable[..., str]) -> None:
    assert len(fmpy.read_model_description(made(fillers=10_000)).modelVariables) > 10_000


def test_what_cannot_be_made(tmp_path: Path) -> None:
    for options in (
        {"behaviour": "unknown"},
        {"place": "unknown"},
        {"fmi": "4.0"},
        {"fmi": "1.0", "interface": "both"},
        {"event_mode": True},
        {"fmi": "3.0", "early_return": "sometimes"},
        {"units": "feet"},
    ):
        with pytest.raises(ValueError, match="no stub can be made"):
            make_fmu(tmp_path, **options)
    with pytest.raises(ValueError, match="there is no kind"):
        make_broken(tmp_path, "unknown")

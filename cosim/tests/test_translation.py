"""Python functions become C with the same bits."""

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formation_controllers import CarLike, Team, elementary, load
from formation_controllers.interface import TickInputs
from formation_controllers.vehicles import DifferentialDrive, TractorTrailer, Vehicle

from cosim.translation import CSource, Entry, translate

FLAGS = (
    *("-std=c11", "-ffp-contract=off", "-shared", "-fPIC", "-Werror"),
    *("-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Wmissing-prototypes"),
)
LAWS = ("neural-adaptive-pid", "observer-pid", "neural-high-gain", "feedback-linearisation")
VEHICLES = (CarLike(0.5), TractorTrailer(0.4, 0.1, 0.25), DifferentialDrive(0.1, 0.25))


def compiled(source: CSource, folder: Path, optimised: str) -> ctypes.CDLL:
    folder.mkdir(exist_ok=True)
    (folder / source.header_name).write_text(source.header, encoding="utf-8")
    (folder / source.source_name).write_text(source.source, encoding="utf-8")
    library = folder / f"library{optimised}.so"
    subprocess.run(["gcc", *FLAGS, optimised, source.source_name, "-o", library, "-lm"], cwd=folder, check=True)
    return ctypes.CDLL(str(library))


def as_struct(value: Any, dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """Return a named tuple as the struct that C takes."""
    found = np.zeros((), dtype)

    def fill(place: Any, own: Any) -> None:
        for name, item in zip(own._fields, own, strict=True):
            if name in (place.dtype.names or ()):
                if hasattr(item, "_fields"):
                    fill(place[name], item)
                else:
                    place[name] = item

    fill(found, value)
    return found


def address(array: np.ndarray[Any, Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def bits(array: np.ndarray[Any, Any]) -> bytes:
    """Return all bits; of NaN just that it is one, as neither IEEE 754 nor a compiler keeps its sign."""
    numbers = np.ascontiguousarray(array).view(np.float64)
    return np.where(np.isnan(numbers), np.nan, numbers).tobytes()


def random_inputs(vehicle: Vehicle, size: int, random: np.random.Generator) -> TickInputs:
    poses, velocities = len(vehicle.pose), len(vehicle.velocity)
    return TickInputs(
        random.normal(0, 3, (size, poses)),
        random.normal(0, 2, (size, velocities)),
        random.normal(0, 3, poses),
        *(random.normal(0, 1, velocities) for _ in range(2)),
        *(random.normal(0, 1, (size, 2)) for _ in range(3)),
    )


@pytest.mark.parametrize("law", LAWS)
def test_law_in_c_has_the_same_bits(law: str, tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    name = law.replace("-", "_")
    for place, vehicle in enumerate(VEHICLES):
        size = 3
        gains: dict[str, float] = {"guard": 0.1} if place == 1 else {}
        if place and law != "feedback-linearisation":
            gains["torque_limit"] = 5.0
        controller = load(law)(Team(vehicle, size, 0.02), load(law).gains_type(**gains))
        tick = controller.compiled_tick()
        example = random_inputs(vehicle, size, random), tick.own, np.zeros((size, 2))
        source = translate(name, [Entry("tick", tick.function, example)], primitives=elementary.PRIMITIVES)
        libraries = [compiled(source, tmp_path / str(place), optimised) for optimised in ("-O0", "-O2")]
        inputs_type, records_type = (
            next(dtype for own, dtype in source.structs.items() if own.endswith(tail))
            for tail in ("TickInputs", "TeamRecords")
        )
        guarded = held = unfinite = 0
        for step in range(120):
            inputs = random_inputs(vehicle, size, random)
            if step % 10 == 0:
                inputs.pose[0] = inputs.leader_pose
            if step % 20 == 0:
                for field in tick.own.state.dtype.names:
                    tick.own.state[field] = random.normal(0, 1, tick.own.state[field].shape)
            records = [as_struct(tick.own, records_type) for _ in libraries]
            torques = [np.full((size, 2), np.nan) for _ in libraries]
            for library, own, torque in zip(libraries, records, torques, strict=True):
                given = as_struct(inputs, inputs_type)
                getattr(library, f"{name}_tick")(address(given), address(own), address(torque))
            expected = np.full((size, 2), np.nan)
            tick.function(inputs, tick.own, expected)
            for own, torque in zip(records, torques, strict=True):
                assert bits(torque) == bits(expected)
                assert bits(own["state"]) == bits(tick.own.state)
                assert bits(own["telemetry"]) == bits(tick.own.telemetry)
            guarded += bool(tick.own.telemetry["guarded"].any())
            held += "held" in tick.own.telemetry.dtype.names and bool(tick.own.telemetry["held"].any())
            unfinite += not np.isfinite(expected).all()
        assert guarded or "guard" not in gains
        assert held or "torque_limit" not in gains
        assert unfinite or vehicle.kind != "differential_drive"

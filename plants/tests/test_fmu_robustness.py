"""Misuse, memory and many instances, in both versions of FMI."""

import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle, pairwise
from pathlib import Path

import pytest

import plants

from . import driver
from .driver import Instance, Library, Refused
from .fmus import VERSIONS, Fmu

# ---- misuse ----


def test_modes_are_told_apart(new: Callable, car: Fmu, fmi: str) -> None:
    stepper, model = new().start(), new("model_exchange").start()
    for call in (stepper.enter_continuous_time, lambda: stepper.place(0.0, [0.0] * 6), lambda: stepper.derivatives(6)):
        with pytest.raises(Refused, match="must not be called in Co-Simulation"):
            call()
    with pytest.raises(Refused, match="must not be called in Model Exchange"):
        model.step(0.0, 0.02)
    with pytest.raises(Refused, match="must not be called while the instance is in event mode"):
        model.complete_step()
    model.enter_continuous_time()
    for states in ([0.0] * 5, [0.0] * 5 + [math.nan]):
        with pytest.raises(Refused, match=r"there are 6 continuous states, not 5|state omega is set to nan"):
            model.place(0.0, states)
    with pytest.raises(Refused, match="fixed"):
        model.set({car["x"]: 1.0})
    model.set({car["tau_drive"]: 1.0})
    with pytest.raises(Refused, match="time is computed"):
        model.set({car["time"]: 1.0})
    model.place(0.0, [1e308] * 6)
    with pytest.raises(Refused, match="try a smaller step") as refusal:
        model.derivatives(6)
    assert refusal.value.status == driver.DISCARD


@pytest.mark.parametrize("interface", driver.INTERFACES)
def test_instances_that_cannot_be(car: Fmu, fmi: str, interface: str) -> None:
    messages = []

    def log(*message: object) -> None:
        messages.append(message)

    for library, name, expected in (
        (replace_token(car.library), b"one", "wrong GUID: expected {"),
        (car.library, b"", "the instance has no name"),
        (car.library, None, "the instance has no name"),
    ):
        address, _ = library.instantiate(interface, log, name)
        assert address is None
        assert expected in messages.pop()[2]
    assert messages == []


def test_fmi_3_refuses_what_it_does_not_offer(fmus: Callable) -> None:
    library, messages = fmus("car_like", "3.0").library, []
    for changes, expected in (
        ({"interface": "scheduled_execution"}, "for Co-Simulation and Model Exchange only"),
        ({"interface": "co_simulation", "event_mode": True}, "hasEventMode is false"),
        ({"interface": "co_simulation", "intermediate": 1}, "providesIntermediateUpdate is false"),
    ):
        address, _ = library.instantiate(log=lambda *message: messages.append(message), **changes)
        assert address is None
        assert expected in messages.pop()[2]
    assert messages == []


def replace_token(library: Library) -> Library:
    return Library(library.path, library.fmi, "{wrong}", library.time)


@pytest.mark.parametrize("interface", driver.INTERFACES)
def test_random_calls_never_crash(car: Fmu, interface: str) -> None:
    counted = driver.call_at_random(car.library, interface, seed=5, n=20_000)
    assert counted["wrong status"] == 0
    assert min(counted["accepted"], counted["refused"]) > 2000
    assert counted["steps"] > (200 if interface == "co_simulation" else -1)


def sanitized(fmu: Fmu, folder: Path) -> tuple[Path, dict[str, str]]:
    """Compile an FMU's sources with sanitizers; return the library and the environment that it needs."""
    compiler = shutil.which("gcc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs gcc with its sanitizers, on Linux")
    library = folder / "sanitized.so"
    sources = sorted(map(str, (fmu.folder / "sources").glob("*.c")))
    flags = ["-std=c11", "-g1", "-O0", "-fPIC", "-shared", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    result = subprocess.run([compiler, *flags, "-o", library, *sources, "-lm"], capture_output=True, text=True)
    if result.returncode != 0:
        pytest.skip(f"gcc has no sanitizers here: {result.stderr.strip().splitlines()[-1]}")
    runtimes = [
        subprocess.run([compiler, f"-print-file-name={name}"], capture_output=True, text=True).stdout.strip()
        for name in ("libasan.so", "libubsan.so")
    ]
    # Python itself keeps some memory to its end, which is no leak of the FMU's.
    return library, {"LD_PRELOAD": " ".join(runtimes), "ASAN_OPTIONS": "detect_leaks=0", "PYTHONMALLOC": "malloc"}


def call_sanitized(fmu: Fmu, fmi: str, n: int, folder: Path) -> subprocess.CompletedProcess[str]:
    """Call the functions of an FMU, compiled with sanitizers, n times by each interface, in a process of its own."""
    library, environment = sanitized(fmu, folder)
    arguments = [library, fmi, fmu.library.token.decode(), str(fmu.library.time), "17", str(n)]
    command = [sys.executable, driver.__file__, *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | environment)


@pytest.mark.parametrize(
    ("name", "fmi"),
    [*(("many_functions", fmi) for fmi in VERSIONS), *zip(plants.models(), cycle(VERSIONS), strict=False)],
)
def test_random_calls_are_clean_under_sanitizers(fmus: Callable, fmi: str, name: str, tmp_path: Path) -> None:
    """Each version with the model that has all that a model can have; the equations of the others are of no version."""
    result = call_sanitized(fmus(name, fmi), fmi, 10_000, tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.count("'wrong status': 0") == len(driver.INTERFACES)


def test_sanitizers_do_see_errors(fmus: Callable, tmp_path: Path) -> None:
    """The test above can fail: with a table of parameters too short, the sanitizer ends the process."""
    fmu = fmus("car_like", "2.0")
    shutil.copytree(fmu.folder, tmp_path / "fmu")
    state = tmp_path / "fmu" / "sources" / "simulation_state.h"
    state.write_text(state.read_text().replace("double values[N_REALS];", "double values[N_STATES];"))
    broken = Fmu(fmu.path, tmp_path / "fmu", fmu.library, fmu.references)
    result = call_sanitized(broken, "2.0", 100, tmp_path)
    assert result.returncode != 0
    assert "runtime error" in result.stderr or "AddressSanitizer" in result.stderr


# ---- many instances ----


def resident_pages() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1])


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads the size of this process from /proc")
def test_memory_is_flat_over_ten_thousand_instances(car: Fmu, fmi: str) -> None:
    def live() -> None:
        instance = Instance(car.library, "co_simulation")
        instance.start().step(0.0, 0.02)
        state = instance.save()
        instance.serialize(state)
        instance.forget(state)
        instance.free()

    for _ in range(1000):
        live()
    before = resident_pages()
    for _ in range(10_000):
        live()
    # An instance that leaked would cost more than 1 kB each, 2500 pages in all.
    assert resident_pages() - before < 250


def test_a_thousand_instances_at_once(car: Fmu) -> None:
    instances = [Instance(car.library, "co_simulation") for _ in range(1000)]
    for i, instance in enumerate(instances):
        instance.set({car["tau_drive"]: i / 100})
        instance.start()
    for k in range(5):
        for instance in instances:
            instance.step(0.02 * k, 0.02)
    speeds = [instance.get(car["v"])[0] for instance in instances]
    assert all(later > earlier for earlier, later in pairwise(speeds))
    for instance in instances:
        instance.free()


def test_threads_step_instances_of_their_own(car: Fmu) -> None:
    def run(drive: float) -> list[float]:
        instance = Instance(car.library, "co_simulation")
        instance.set({car["tau_drive"]: drive, car["tau_steer"]: 1.0, car["solver_step"]: 1e-5})
        instance.start()
        for k in range(20):
            instance.step(0.02 * k, 0.02)
        result = instance.get(*range(6))
        instance.free()
        return result

    drives = [3.0, 5.0, 7.0, 9.0]
    alone = [run(drive) for drive in drives]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(run, drives))
    assert together == alone

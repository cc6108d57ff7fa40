"""An FMU built once a session, and instances of it driven call by call through FMPy."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fmpy
import fmpy.fmi2
import pytest

import plants


class Instance:
    """One instance of an FMU, its variables by name; `messages` collects what it logs."""

    def __init__(self, folder: Path, name: str, **changes: Any) -> None:
        self.description = fmpy.read_model_description(folder)
        self.variables = {variable.name: variable for variable in self.description.modelVariables}
        self.messages: list[str] = []
        self.fmu = fmpy.fmi2.FMU2Slave(
            instanceName=name,
            guid=changes.get("guid", self.description.guid),
            unzipDirectory=str(folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )
        # Kept here: the FMU calls it for as long as it lives.
        self.callbacks = fmpy.fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(self._log)
        self.callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self.callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self.fmu.instantiate(callbacks=self.callbacks)

    def _log(self, environment: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
        self.messages.append(f"{name.decode()}: {message.decode()}")

    def start(self, time: float = 0.0, stop_time: float | None = None, **values: float) -> "Instance":
        """Set values, initialise, and be ready to step."""
        self.set(**values)
        self.fmu.setupExperiment(startTime=time, stopTime=stop_time)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def set(self, **values: float) -> None:
        for name, value in values.items():
            variable = self.variables[name]
            if variable.type == "Real":
                self.fmu.setReal([variable.valueReference], [value])
            else:
                self.fmu.setInteger([variable.valueReference], [value])

    def get(self, *names: str) -> list[float]:
        values: list[float] = self.fmu.getReal([self.variables[name].valueReference for name in names])
        return values

    def step(self, time: float, step: float) -> None:
        self.fmu.doStep(time, step)


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of the tests' own."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FORMATION_CACHE", str(folder))
        yield folder


@pytest.fixture(scope="session")
def fmu(cache: Path) -> Path:
    """The FMU of the car-like robot."""
    return plants.build("car_like")


@pytest.fixture(scope="session")
def unzipped(fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The content of that FMU."""
    folder = tmp_path_factory.mktemp("car_like")
    fmpy.extract(fmu, folder)
    return folder


@pytest.fixture
def new_car(unzipped: Path) -> Iterator[Callable[..., Instance]]:
    """Make instances of the car-like robot, freed at the end of the test."""
    made = []

    def new(name: str = "car", **changes: Any) -> Instance:
        made.append(Instance(unzipped, name, **changes))
        return made[-1]

    yield new
    for instance in made:
        instance.fmu.freeInstance()

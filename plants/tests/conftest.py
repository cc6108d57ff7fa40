"""FMUs built once a session, and instances of them: through FMPy for FMI 2.0 Co-Simulation, or call by call."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fmpy
import fmpy.fmi2
import pytest

import plants

from . import driver
from .driver import Library
from .fmus import MODELS, VERSIONS, Fmu


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


@pytest.fixture(scope="session")
def fmu(own_caches: None) -> Path:
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


@pytest.fixture(scope="session")
def fmus(own_caches: None, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Fmu]:
    """Return an FMU by model and version, built once."""
    built: dict[tuple[str, str], Fmu] = {}

    def get(name: str, fmi: str) -> Fmu:
        if (name, fmi) not in built:
            path = plants.build(name if name in plants.models() else MODELS[name], fmi=fmi)
            folder = tmp_path_factory.mktemp(name)
            fmpy.extract(path, folder)
            description = fmpy.read_model_description(folder)
            references = {v.name: v.valueReference for v in description.modelVariables}
            references.setdefault("time", len(references))  # always the last one, not always listed in FMI 2.0
            (binary,) = (folder / "binaries").glob("*/*")
            token = description.guid if fmi == "2.0" else description.instantiationToken
            built[name, fmi] = Fmu(path, folder, Library(str(binary), fmi, token, references["time"]), references)
        return built[name, fmi]

    return get


@pytest.fixture(params=VERSIONS)
def fmi(request: pytest.FixtureRequest) -> str:
    version: str = request.param
    return version


@pytest.fixture
def car(fmus: Callable[[str, str], Fmu], fmi: str) -> Fmu:
    return fmus("car_like", fmi)


@pytest.fixture
def new(car: Fmu) -> Iterator[Callable[..., driver.Instance]]:
    """Make instances of the car-like robot, freed at the end of the test."""
    made = []

    def make(interface: str = "co_simulation") -> driver.Instance:
        made.append(driver.Instance(car.library, interface))
        return made[-1]

    yield make
    for instance in made:
        instance.free()

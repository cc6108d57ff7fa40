"""Our FMUs in masters that are not ours: the same trajectory as in FMPy, to rounding."""

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave

import plants

from .other_masters import need

STEP = 0.02
STEPS = 250
START = {"x": 1.0, "y": -2.0, "psi": 0.5, "theta_1": 0.5, "theta_0": 0.4}
TORQUES = (8.0, 1.0)


@pytest.fixture(scope="module", params=sorted(plants.models()))
def fmu(request: pytest.FixtureRequest) -> Path:
    return plants.build(request.param)


class Experiment:
    """An FMU with start values and constant torques, and the results of FMPy's own methods."""

    def __init__(self, fmu: Path, directory: Path) -> None:
        self.path = str(fmu)
        description = fmpy.read_model_description(self.path)
        variables = {variable.name: variable for variable in description.modelVariables}
        self.reference = {name: variable.valueReference for name, variable in variables.items()}
        torques = [name for name, variable in variables.items() if variable.causality == "input"][:2]
        assert all(name.startswith("tau_") for name in torques)
        self.start = {name: value for name, value in START.items() if name in variables}
        self.start |= dict(zip(torques, TORQUES, strict=True))
        self.outputs = [name for name, variable in variables.items() if variable.causality == "output"]
        self.expected = self._in_fmpy(description, fmpy.extract(self.path, directory))

    def _in_fmpy(self, description: object, directory: Path) -> np.ndarray:
        slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=directory,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="robot",
        )
        slave.instantiate()
        slave.setReal([self.reference[name] for name in self.start], list(self.start.values()))
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        for k in range(STEPS):
            slave.doStep(k * STEP, STEP)
        values = slave.getReal([self.reference[name] for name in self.outputs])
        slave.terminate()
        slave.freeInstance()
        return np.array(values)


@pytest.fixture(scope="module")
def experiment(fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return Experiment(fmu, tmp_path_factory.mktemp("unpacked"))


def test_the_robot_moves(experiment: Experiment) -> None:
    start = np.array([experiment.start.get(name, 0.0) for name in experiment.outputs])
    assert np.abs(experiment.expected - start).max() > 0.1


def test_libcosim(experiment: Experiment, capfd: pytest.CaptureFixture[str]) -> None:
    need("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.TRACE)  # a level holds for the process: another test may have set its own
    execution = CosimExecution.from_step_size(round(STEP * 1e9))
    robot = execution.add_local_slave(CosimLocalSlave(experiment.path, "robot"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    for name, value in experiment.start.items():
        assert execution.real_initial_value(robot, experiment.reference[name], value)
    assert execution.step(STEPS)
    outputs = observer.last_real_values(robot, [experiment.reference[name] for name in experiment.outputs])
    assert outputs == pytest.approx(experiment.expected, rel=1e-12, abs=1e-12)
    logged = "".join(capfd.readouterr())
    assert "Parsing model description XML" in logged
    assert "[error]" not in logged


def test_ecos(experiment: Experiment) -> None:
    need("ecospy")
    from ecospy.EcosParameterSet import EcosParameterSet
    from ecospy.EcosSimulation import EcosSimulation
    from ecospy.EcosSimulationStructure import EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("robot", experiment.path)
    start = EcosParameterSet()
    for name, value in experiment.start.items():
        start.add_real(f"robot::{name}", value)
    structure.add_parameter_set("start", start)
    with EcosSimulation(structure=structure, step_size=STEP) as simulation:
        simulation.init(parameter_set="start")
        simulation.step(STEPS)
        outputs = [simulation.get_real(f"robot::{name}") for name in experiment.outputs]
    assert outputs == pytest.approx(experiment.expected, rel=1e-12, abs=1e-12)

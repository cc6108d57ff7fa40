"""A Model Exchange FMU integrated by CVODE, with variable order and steps and events where they happen: FMPy's."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.plant.instance import Instance
from cosim.plant.outcome import COMPLETE, END, ERROR, PlantError, failure
from cosim.plant.spec import MODEL_EXCHANGE, PlantSpec

_CLOSE = 1e-9
"""Part of a communication step below which two times are the same."""


def uses_cvode(spec: PlantSpec) -> bool:
    """Return whether CVODE integrates a plant."""
    return spec.interface == MODEL_EXCHANGE and spec.solver == "cvode"


class CvodePlant:
    """A plant that CVODE integrates, with the interface of a plant that is stepped elsewhere.

    Parameters
    ----------
    spec
        The plant; its interface is Model Exchange.

    Raises
    ------
    PlantError
        See `Instance`.
    """

    def __init__(self, spec: PlantSpec) -> None:
        from fmpy.sundials import CVodeSolver

        self.spec = spec
        self._instance = Instance(spec)
        fmu = self._fmu = self._instance.fmu
        self._three = spec.fmi.startswith("3")
        self._solver: Any = None
        try:
            self._solver = CVodeSolver(
                nx=self._instance.states,
                nz=self._instance.event_indicators,
                get_x=fmu.getContinuousStates,
                set_x=fmu.setContinuousStates,
                get_dx=fmu.getContinuousStateDerivatives if self._three else fmu.getDerivatives,
                get_z=fmu.getEventIndicators,
                get_nominals=fmu.getNominalsOfContinuousStates,
                set_time=fmu.setTime,
                input=_HeldInput(),
                startTime=0.0,
                relativeTolerance=spec.tolerance,
                maxNumSteps=100_000,
            )
            self.first_outputs = self._outputs()
        except Exception as error:
            said = self._instance.log.take() or str(error)
            self.close()
            raise PlantError(said) from None

    def begin(self, time: float, step: float, inputs: NDArray[np.float64]) -> None:
        """Do nothing yet."""
        self._pending = (time, step, inputs)

    def finish(self, outputs: NDArray[np.float64]) -> None:
        """Take the step and write the outputs.

        Raises
        ------
        PlantError
            The FMU or CVODE failed.
        """
        time, step, inputs = self._pending
        try:
            self._set_inputs(inputs)
            self._integrate(time, step)
            outputs[:] = self._outputs()
        except PlantError:
            raise
        except Exception as error:  # FMPy's: of a call, or of CVODE
            self._instance.status = getattr(error, "status", ERROR)
            raise PlantError(failure(COMPLETE, 0, self._instance.log.take() or str(error))) from None

    def change(self, values: Any) -> None:
        """See `Instance.change`."""
        self._instance.change(values)

    def take_messages(self) -> str:
        """Return what the FMU has logged since the last time."""
        return self._instance.log.take()

    def close(self) -> None:
        """End the plant."""
        self._instance.close()

    def _integrate(self, time: float, step: float) -> None:
        end = time + step
        self._solver.reset(time)  # inputs and parameters have changed
        while time < end - _CLOSE * step:
            until = min(end, max(self._instance.next_event, time + _CLOSE * step))
            state_event, _, time = self._solver.step(time, until)
            self._fmu.setTime(time)
            step_event, terminate = self._fmu.completedIntegratorStep()
            if terminate:
                raise PlantError(failure(END, 0, self._instance.log.take()))
            if state_event or step_event or time >= self._instance.next_event - _CLOSE * step:
                self._instance.handle_event()
                self._solver.reset(time)

    def _set_inputs(self, inputs: NDArray[np.float64]) -> None:
        names = self.spec.inputs.references
        if names and self._three:
            self._fmu.setFloat64(names, inputs)
        elif names:
            self._fmu.setReal(names, inputs)

    def _outputs(self) -> list[float]:
        block = self.spec.outputs
        if self._three:
            return list(self._fmu.getFloat64(block.references, nValues=len(block.start)))
        return list(self._fmu.getReal(block.references))


class _HeldInput:
    """FMPy's solver applies the inputs at every evaluation; here they are held over a step."""

    def apply(self, time: float) -> None:
        pass

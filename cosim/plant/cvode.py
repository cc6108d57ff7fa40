"""A Model Exchange FMU integrated by CVODE, with variable order and steps and events where they happen: FMPy's.

The FMU learns of a completed step of the solver at the end of a communication step only.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.sundials import CVodeSolver, libraries
from fmpy.sundials.cvode import CV_NORMAL, CV_ROOT_RETURN, CVode, CVodeFree
from fmpy.sundials.nvector_serial import NV_DATA_S
from numpy.typing import NDArray

from cosim.plant.exchange import give, take
from cosim.plant.failures import COMPLETE, DISCARD, END, ITERATE, PlantError, failure
from cosim.plant.instance import Instance
from cosim.plant.message import Message
from cosim.plant.saved import PlantState
from cosim.plant.spec import PlantSpec, Value

_CLOSE = 1e-9
"""Part of a communication step below which two times are the same."""
_MAX_PARTS = 100_000
"""Into how many parts events may cut a communication step."""
_FREED = {
    "LS": "SUNLinSolFree",
    "A": "SUNMatDestroy",
    "abstol": "N_VDestroy",
    "x": "N_VDestroy",
    "sunctx": "SUNContext_Free",
}
"""What FMPy's solver holds, and how SUNDIALS frees it; in this order."""
_TRY_A_SHORTER_STEP, _STOP = 1, -1
_MAX_STEPS = 10_000
"""How many steps CVODE may take for a part."""


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
        self.spec = spec
        self._instance = Instance(spec)
        self._given = np.full(len(spec.inputs.start), np.nan)
        self._ending = ExitStack()
        self._ending.callback(self._instance.close)
        try:
            self._fmu = self._instance.fmu
            assert spec.tolerance is not None
            self._solver = _Solver(self._instance, spec.tolerance)
            self._ending.callback(self._solver.close)
            self.first_outputs = list(spec.outputs.start) if spec.late_outputs else self._outputs()
        except BaseException as error:
            said = self._instance.log.take() or str(error)
            self.close()
            if not isinstance(error, Exception):
                raise
            raise PlantError(said) from None

    def step(self, time: float, step: float, inputs: NDArray[np.float64], outputs: NDArray[np.float64]) -> None:
        """Take the step and write the outputs.

        Raises
        ------
        PlantError
            The FMU or CVODE failed.
        """
        try:
            if self.spec.inputs.references and not np.array_equal(inputs, self._given):
                self._given = inputs.copy()
                self._instance.handle_event(self._give)
            self._integrate(time, step)
            outputs[:] = self._outputs()
        except PlantError:
            raise
        except Exception as error:  # FMPy's: of a call, or of CVODE
            status = error.status if isinstance(error, FMICallException) else 0
            self._instance.status = max(self._instance.status, status)
            raise PlantError(failure(COMPLETE, status, self._instance.log.take() or str(error))) from None

    def change(self, values: Sequence[Value]) -> None:
        """See `Instance.change`."""
        self._instance.change(values)

    def saved(self, inputs: NDArray[np.float64], outputs: NDArray[np.float64]) -> PlantState:
        """Return the state after the last step.

        CVODE's own memory is no part of it: at the start of each communication step it is begun anew, with the states
        and nominal values of the FMU, because the inputs jump there.
        """
        numbers = tuple(inputs.tolist()), tuple(outputs.tolist()), tuple(self._given.tolist())
        return PlantState(self._instance.saved(), *numbers, self._instance.next_event)

    def restore(self, state: PlantState) -> list[float]:
        """Go on from a saved state, and return the outputs there."""
        self._instance.restore(state.fmu)
        self._instance.next_event = state.next_event
        self._given = np.array(state.given)
        return self._outputs()

    def take_messages(self) -> str:
        """Return the FMU's messages since the last call."""
        return self._instance.log.take()

    def take_data(self) -> list[Message]:
        """See `Log.take_data`."""
        return self._instance.log.take_data()

    def close(self) -> None:
        """End the plant."""
        self._ending.close()

    def _integrate(self, time: float, step: float) -> None:
        end = time + step
        close = max(_CLOSE * step, 8 * sys.float_info.epsilon * end)
        self._solver.reset(time)  # inputs and parameters have changed
        for _ in range(_MAX_PARTS):
            if end - time <= close:
                return
            event = self._instance.next_event <= end + close  # rounding may have put the end before it
            until = self._instance.next_event if event else end
            if until - time > close:
                state_event, time = self._solver.advance(time, until)
                event = state_event or time >= self._instance.next_event
            time = max(time, until) if event and until - time <= close else time
            self._fmu.setTime(time)
            event |= self._completed()
            if event:
                self._instance.handle_event()
                if self._instance.next_event <= time:
                    break
                self._solver.reset(time)
        raise PlantError(failure(ITERATE, 0, self._instance.log.take()))

    def _completed(self) -> bool:
        """Complete a step of the solver; return whether that is an event."""
        if not self.spec.completed_steps:
            return False
        found = self._fmu.completedIntegratorStep()
        event, terminate = found if isinstance(found, tuple) else (found, False)  # FMI 1.0 has no such flag
        if terminate:
            raise PlantError(failure(END, 0, self._instance.log.take()))
        return bool(event)

    def _give(self) -> None:
        give(self._fmu, self.spec.inputs, self._given.tolist())

    def _outputs(self) -> list[float]:
        return take(self._fmu, self.spec.outputs)


class _Solver(CVodeSolver):  # type: ignore[misc]
    """FMPy's solver, in which a failure of the FMU within CVODE is not lost."""

    def __init__(self, instance: Instance, tolerance: float) -> None:
        fmu = self._fmu = instance.fmu
        self._one = instance.spec.fmi.startswith("1")
        self._failure: FMICallException | None = None
        super().__init__(
            nx=instance.states,
            nz=instance.event_indicators,
            get_x=fmu.getContinuousStates,
            set_x=fmu.setContinuousStates,
            get_dx=fmu.getContinuousStateDerivatives if instance.spec.fmi.startswith("3") else fmu.getDerivatives,
            get_z=fmu.getEventIndicators,
            get_nominals=self._nominals,
            set_time=fmu.setTime,
            input=_HeldInput(),
            startTime=0.0,
            relativeTolerance=tolerance,
            maxNumSteps=_MAX_STEPS,
        )
        if hasattr(libraries, "sundials_core"):  # from SUNDIALS 6 on
            _silence(self.sunctx)

    def close(self) -> None:
        """Free all that CVODE holds, open files among it; FMPy leaves most of it to the end of the process."""
        held, core = self.__dict__, getattr(libraries, "sundials_core", None)
        if memory := held.pop("cvode_mem", None):
            CVodeFree(ctypes.byref(ctypes.c_void_p(memory)))
        for name, free in _FREED.items() if core is not None else ():
            if (part := held.pop(name, None)) is not None:
                where = ctypes.byref(part) if name == "sunctx" else part
                getattr(core, free)(ctypes.c_void_p(where) if isinstance(where, int) else where)

    def __del__(self) -> None:
        """Free what it holds even if it could not be made."""
        self.close()

    def advance(self, time: float, until: float) -> tuple[bool, float]:
        """Integrate, and never look beyond; return whether there is a state event, and the time that was reached."""
        self._failure = None
        reached = ctypes.c_double(time)
        libraries.sundials_cvode.CVodeSetStopTime(ctypes.c_void_p(self.cvode_mem), ctypes.c_double(until))
        flag = CVode(self.cvode_mem, until, self.x, ctypes.byref(reached), CV_NORMAL)
        if flag < 0:
            reason = self.error_info[-1] if self.error_info else f"error {flag}"
            raise self._failure or PlantError(failure(COMPLETE, 0, f"CVODE: {reason}"))
        if not self.discrete:
            self.set_x(self.px, self.nx)
        return flag == CV_ROOT_RETURN, reached.value

    def f(self, *arguments: object) -> int:
        """Return the derivatives; called by CVODE, which an exception would not stop."""
        try:
            super().f(*arguments)
        except FMICallException as error:
            return self._failed(error)
        derivatives = np.ctypeslib.as_array(NV_DATA_S(arguments[2]), (self.nx,))
        return 0 if np.isfinite(derivatives).all() else _TRY_A_SHORTER_STEP

    def g(self, *arguments: object) -> int:
        """Return the event indicators; called by CVODE, which an exception would not stop."""
        try:
            return int(super().g(*arguments))
        except FMICallException as error:
            return self._failed(error)

    def _failed(self, error: FMICallException) -> int:
        """Return the status that makes CVODE try a shorter step, if the FMU discards the states, or stop."""
        self._failure = error
        return _TRY_A_SHORTER_STEP if error.status == DISCARD else _STOP

    def _nominals(self, place: ctypes._Pointer[ctypes.c_double], n: int) -> None:
        if self._one:
            self._fmu.getNominalContinuousStates(place, n)
        else:
            self._fmu.getNominalsOfContinuousStates(place, n)
        nominals = np.ctypeslib.as_array(place, (n,))
        nominals[~(np.isfinite(nominals) & (nominals > 0.0))] = 1.0


def _silence(context: ctypes.c_void_p) -> None:
    """Keep SUNDIALS from writing to the terminal; FMPy reports the same."""
    logger, core = ctypes.c_void_p(), libraries.sundials_core
    core.SUNContext_GetLogger(context, ctypes.byref(logger))
    for kind in ("Error", "Warning"):
        getattr(core, f"SUNLogger_Set{kind}Filename")(logger, os.devnull.encode())


class _HeldInput:
    """FMPy's solver applies the inputs at every evaluation; here they are held over a step."""

    def apply(self, time: float) -> None:
        pass

"""Plants of different kinds in one fleet: none hides the failure of another."""

from pathlib import Path

import numpy as np
import pytest

from cosim.errors import SimulationError
from tests.stub.stub import make_fmu

from .driving import STEP, fleet

TORQUES = np.zeros((50, 4))


@pytest.mark.parametrize("behaviour", ["error", "discard", "fatal"])
@pytest.mark.parametrize("other", ["", "isolated", "cvode"])
def test_a_failure_is_told_whoever_else_is_there(tmp_path: Path, behaviour: str, other: str) -> None:
    good = make_fmu(tmp_path, interface="model_exchange" if other == "cvode" else "co_simulation")
    bad = make_fmu(tmp_path, behaviour=behaviour, when=0.1, name="bad")
    out = np.full((50, 2, 6), np.nan)
    kinds = {"isolated": (other == "isolated", False), "solvers": ("cvode" if other == "cvode" else "", "")}
    with fleet(good, bad, **kinds) as (started, _), pytest.raises(SimulationError) as caught:
        started.run(0, STEP, TORQUES, out)
    assert np.isfinite(out[:5]).all()
    assert np.isnan(out[5:]).all()
    failed = f"the plant bad.fmu did not complete the step (status {behaviour.capitalize()})"
    assert str(caught.value).startswith(f"robot_2 at t = 0.1 s: {failed}")


def test_all_failures_of_a_step_are_told(tmp_path: Path) -> None:
    first, second = (make_fmu(tmp_path, behaviour="error", when=0.1, name=name) for name in ("first", "second"))
    out = np.empty((50, 2, 6))
    with fleet(first, second, isolated=(False, True)) as (started, _), pytest.raises(SimulationError) as caught:
        started.run(0, STEP, TORQUES, out)
    assert "robot_1 at t = 0.1 s: the plant first.fmu did not complete the step (status Error)" in str(caught.value)
    assert "; robot_2: the plant second.fmu did not complete the step (status Error)" in str(caught.value)

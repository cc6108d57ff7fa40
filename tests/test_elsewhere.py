"""A short comparison with other masters; ``python -m tests.elsewhere`` is the long one."""

from __future__ import annotations

import numpy as np
import pytest

from . import elsewhere
from .ssp_masters import Exported


def test_differences_are_found() -> None:
    values = np.array([[1.0, np.nan], [2.0, 3.0]])
    assert elsewhere.apart(values, values.copy()) == 0.0
    assert elsewhere.apart(values, values + 1e-13) == pytest.approx(1e-13, rel=0.01)
    assert elsewhere.apart(values, np.where(np.isnan(values), 0.0, values)) == np.inf
    assert elsewhere.apart(values, values[:1]) == np.inf
    assert elsewhere.apart(values, np.where(values == 2.0, np.inf, values)) == np.inf


def test_numbers_that_are_missing_in_another_master_are_a_difference() -> None:
    exported = object.__new__(Exported)
    exported.expected = {"leader.x": np.array([0.0, 1.0, 2.0]), "follower_1.x": np.array([0.0, 1.0, 2.0])}
    assert exported.apart({"leader.x": np.array([1.0, 2.0]), "follower_1.x": np.array([1.0, np.nan])}) == np.inf


def test_a_loop_that_fmpy_closes(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elsewhere, "FMI", ("3.0",))
    assert elsewhere.teams(["one_sample_delay"], 0.2)
    assert capsys.readouterr().out.splitlines()[-1] == "| `one_sample_delay` | 10 | 0 |"
    monkeypatch.setattr(elsewhere, "apart", lambda one, other: 2e-12)
    assert not elsewhere.teams(["one_sample_delay"], 0.2)
    assert capsys.readouterr().out.splitlines()[-1] == "| `one_sample_delay` | 10 | **2e-12** |"

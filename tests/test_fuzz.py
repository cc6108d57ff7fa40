"""A short run of the fuzzers; ``python -m tests.fuzz`` is the long one."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.fuzz.fuzz import run


@pytest.mark.parametrize(("kind", "seeds"), [("scenarios", range(150)), ("fmus", range(60))])
def test_nothing_but_results_and_refusals(
    kind: str, seeds: range, tmp_path: Path, make: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.fuzz.fuzz.SECONDS", 60.0)  # the machine may be busy
    fmus = tuple(make(fmi=version).read_bytes() for version in ("1.0", "2.0", "3.0"))
    assert list(run(kind, seeds, tmp_path, fmus)) == []

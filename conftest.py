"""Shared by all tests that run from the root: caches of their own, so that nothing built by hand can hide a fault."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from cosim.scenario.scenario import Scenario

ROOT = Path(__file__).parent

for number in ("SIGINT", "SIGTERM", "SIGHUP"):
    if (found := getattr(signal, number, None)) is not None and signal.getsignal(found) == signal.SIG_IGN:
        # nohup and the background of a script ignore them, and so would all that the tests start and interrupt
        signal.signal(found, signal.default_int_handler if number == "SIGINT" else signal.SIG_DFL)


@pytest.fixture(scope="session", autouse=True)
def own_caches(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep what is built for these tests alone, each FMU once for all processes that share the tests."""
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FORMATION_CACHE", str(folder / "fmu-cache"))
        patch.setenv("MPLBACKEND", "agg")
        patch.setenv("FORMATION_PATIENCE", "3600")  # nothing is said because the machine is busy
        patch.setattr("cosim.cli.console.PATIENCE", 3600.0)
        patch.setattr("cosim.compiling.LONG", 3600.0)
        yield


@pytest.fixture(scope="module", autouse=True)
def no_instance_left() -> Iterator[None]:
    """Demand of the tests of a module that all instances of FMUs that they have made are freed."""
    yield
    log = sys.modules.get("cosim.plant.log")
    if log is not None and (left := [one._name.decode() for one in log.Log._open.values()]):
        log.Log.begin_anew()
        pytest.fail(f"instances of the robots {left} are left open")


@pytest.fixture(scope="session")
def scenarios() -> Path:
    """Return the folder of the scenarios that come with the project."""
    return ROOT / "scenarios"


@pytest.fixture
def line(scenarios: Path) -> str:
    """Return the file of four followers on a line."""
    return str(scenarios / "clmr_line.xml")


@pytest.fixture(scope="session")
def make(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return a function that makes stubs, FMUs that do as they are told, each once."""
    from tests.stub.stub import make_fmu

    @cache
    def made(**options: Any) -> Path:
        return make_fmu(tmp_path_factory.mktemp("fmu"), **options)

    return made


@pytest.fixture(scope="session")
def short_line(scenarios: Path) -> Scenario:
    """Return the first second of four followers on a line, of which nothing is expected."""
    from cosim.scenario.reader import read_scenario

    return read_scenario(scenarios / "clmr_line.xml").edited(horizon=1.0, expectations=False)

"""The search for control laws: once in a process, and again for one that has been installed since."""

from pathlib import Path

import formation_controllers as fc
import pytest
from formation_controllers import registry

from cosim.control import installed_laws
from cosim.control.installed_laws import installed
from cosim.control.law import find_law
from cosim.errors import InputError, Location
from cosim.scenario.scenario import ControllerSource


def source(name: str) -> ControllerSource:
    return ControllerSource(
        id=name, name=name, package="formation-controllers", version="", gains=(), where=Location("s.xml", 1)
    )


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list that gets an entry with each search."""
    made: list[str] = []
    search = registry.entry_points

    def counted(group: str) -> object:
        made.append(group)
        return search(group=group)

    monkeypatch.setattr(registry, "entry_points", counted)
    installed_laws._known.cache_clear()
    return made


def test_entry_points_are_read_once_for_all_laws(searches: list[str]) -> None:
    laws = [find_law(source(name)).controller_type for name in ("lqg", "neural-adaptive-pid", "lqg")]
    assert laws == [fc.load("lqg"), fc.load("neural-adaptive-pid"), fc.load("lqg")]
    assert len(searches) == 1 + 3, "fc.load searches for itself"


@pytest.mark.parametrize("elsewhere", [True, False])
def test_a_law_that_was_installed_since_is_found(
    searches: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, elsewhere: bool
) -> None:
    if not elsewhere:
        monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InputError, match="no installed package offers a controller 'later'"):
        installed("later")
    about = tmp_path / "later-2.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: later\nVersion: 2.0\n")
    (about / "entry_points.txt").write_text("[formation.controllers]\nlater = later:Law\n")
    if elsewhere:
        monkeypatch.syspath_prepend(str(tmp_path))
    assert installed("later").version == "2.0"

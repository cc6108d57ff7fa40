"""The runs of a study are made with the code that its rows are told to be of, whatever the versions say."""

import re
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from pathlib import Path

import pytest

from cosim.control import host
from cosim.errors import InputError
from cosim.master.code import check_code, check_laws
from cosim.scenario.reader import read_scenario
from cosim.studies.conduct import check_study, conduct
from cosim.studies.crew import Crew
from cosim.studies.engine import Workers
from cosim.studies.plan import Plan
from cosim.studies.reader import read_study
from cosim.studies.row import BROKEN, PASSED
from cosim.studies.study import Study
from cosim.studies.task import Task
from cosim.studies.worker_process import Processes
from cosim.tests.studies import write_study

from .environments import distribution
from .test_own_law import LAW

OTHER = LAW.replace("np.zeros((len(pose), 2))", "np.full((len(pose), 2), 5.0)")
Install = Callable[[str], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Return a function that installs the law with a text, as if Python were started anew."""
    site = tmp_path / "site"
    distribution(site, "my-law", "1.0", ["mine = my_law:MyLaw"], LAW)
    monkeypatch.syspath_prepend(str(site))

    def change(text: str) -> None:
        (site / "my_law.py").write_text(text)
        host._content.cache_clear()
        sys.modules.pop("my_law", None)

    yield change
    sys.modules.pop("my_law", None)


@pytest.fixture
def study(tmp_path: Path) -> Study:
    path = write_study(tmp_path)
    base = tmp_path / "base.xml"
    law = '<controller id="pid" name="mine" package="my-law" version="==1.0"/>'
    base.write_text(re.sub("(?s)<controller.*?</controller>", law, base.read_text("utf-8")), "utf-8")
    return read_study(path)


def task_of(study: Study) -> Task:
    plan, keys, _ = check_study(study)
    workers = Workers(study, Crew(lambda task: Future(), lambda: 1), keys.code)
    return workers.task([(run, keys.of(run)) for run in list(plan)[:2]])


def test_a_law_that_was_edited_makes_its_runs_anew(install: Install, study: Study, tmp_path: Path) -> None:
    first = conduct(study, tmp_path, workers=0)
    install(OTHER)
    changed = conduct(study, tmp_path, workers=0)
    assert (first.made, changed.made, changed.before) == (6, 6, 0)
    assert [row.measures for row in changed.rows] != [row.measures for row in first.rows]
    install(LAW)
    again = conduct(study, tmp_path, workers=0)
    assert (again.made, again.rows) == (0, first.rows)


def test_a_law_that_a_value_names_makes_its_runs_anew_if_it_was_edited(tmp_path: Path, install: Install) -> None:
    """Though it stands in another module than the law of the scenario."""
    about = next((tmp_path / "site").glob("*.dist-info")) / "entry_points.txt"
    about.write_text("[formation.controllers]\nmine = my_law:MyLaw\nother = my_other:MyLaw\n")
    elsewhere = tmp_path / "site" / "my_other.py"
    vary = '<vary name="law" select="controller/@name"><list values="mine, other"/></vary>'
    path = write_study(tmp_path, vary, '<sample method="grid"/>')
    base = tmp_path / "base.xml"
    law = '<controller id="pid" name="mine" package="my-law" version="==1.0"/>'
    base.write_text(re.sub("(?s)<controller.*?</controller>", law, base.read_text("utf-8")), "utf-8")
    made = []
    for text in (OTHER, OTHER.replace("5.0", "11.25")):  # another length: Python's own cache goes by it and by seconds
        elsewhere.write_text(text)
        install(LAW)
        sys.modules.pop("my_other", None)
        made.append(conduct(read_study(path), tmp_path, workers=0))
    sys.modules.pop("my_other", None)
    assert [outcome.made for outcome in made] == [2, 1]
    assert made[0].rows[0] == made[1].rows[0]
    assert made[0].rows[1].measures != made[1].rows[1].measures


def test_a_law_that_a_value_names_counts_though_it_needs_other_values_of_its_run(
    tmp_path: Path, install: Install
) -> None:
    """The law alone is refused with the gain of the scenario."""
    limited = LAW.replace("above=0)", "above=0, below=1)")
    assert limited != LAW
    about = next((tmp_path / "site").glob("*.dist-info")) / "entry_points.txt"
    about.write_text("[formation.controllers]\nmine = my_law:MyLaw\nother = my_other:MyLaw\n")
    elsewhere = tmp_path / "site" / "my_other.py"
    vary = """<vary name="law" select="controller/@name"><list values="mine, other"/></vary>
  <vary name="K" select="controller/gain/@value"><list values="0.5, 2"/></vary>"""
    path = write_study(tmp_path, vary, '<sample method="grid"/>')
    base = tmp_path / "base.xml"
    law = '<controller id="pid" name="mine" package="my-law" version="==1.0"><gain name="K" value="5"/></controller>'
    base.write_text(re.sub("(?s)<controller.*?</controller>", law, base.read_text("utf-8")), "utf-8")
    made = []
    for text in (limited, limited.replace("np.zeros((len(pose), 2))", "np.full((len(pose), 2), 5.0)")):
        elsewhere.write_text(text)
        install(LAW)
        sys.modules.pop("my_other", None)
        made.append(conduct(read_study(path), tmp_path, workers=0))
    sys.modules.pop("my_other", None)
    assert [row.status for row in made[0].rows] == [PASSED, PASSED, PASSED, BROKEN], made[0].rows[2].message
    assert [outcome.made for outcome in made] == [4, 1], "what cannot begin is not tried again"
    assert made[0].rows[2].measures != made[1].rows[2].measures


@pytest.mark.parametrize("package", ["cosim", "plants", "formation_controllers"])
def test_an_edit_of_formation_makes_all_runs_anew(
    install: Install, study: Study, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def keys() -> list[str]:
        plan, of_runs, _ = check_study(study)
        return [of_runs.of(run) for run in plan]

    (root,) = sys.modules[package].__path__
    before, as_it_is = keys(), host._content
    monkeypatch.setattr(host, "_content", lambda folder: as_it_is(folder) + b"edited" * (folder == root))
    assert not set(before) & set(keys())


def test_what_counts_of_a_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "some_law"
    monkeypatch.syspath_prepend(str(tmp_path))

    def content(file: str, text: str) -> str:
        (package / file).parent.mkdir(parents=True, exist_ok=True)
        (package / file).write_text(text)
        host._content.cache_clear()
        return host.content_of("some_law.inner")

    known = [
        content(file, text)
        for text in ("1", "2")
        for file in ("__init__.py", "inner/law.py", "fast.cpython-311-x86_64-linux-gnu.so", "weights.npz")
    ]
    assert len(set(known)) == 8
    for file in ("__pycache__/law.pyc", "inner/tests/test_law.py", ".law.py.swp"):
        assert content(file, "3") == known[-1]
    (package / "weights.npz").rename(package / "other.npz")
    host._content.cache_clear()
    assert host.content_of("some_law") not in known
    assert host.content_of("there_is_none") == host.content_of("there_is_none_either")


def test_a_process_with_other_code_is_replaced_or_refused(install: Install, study: Study) -> None:
    """One that was started before the law was edited is replaced; a new one has what is there."""
    wants_first = task_of(study)
    install(OTHER)
    wants_other = task_of(study)
    processes = Processes()
    try:
        install(LAW)
        first, _ = processes.make(wants_first)
        install(OTHER)
        other, _ = processes.make(wants_other)
        assert [row.status for row in (*first, *other)] == [PASSED] * 4
        assert [row.measures for row in first] != [row.measures for row in other]
        with pytest.raises(
            InputError, match=r"worker on .* has my-law 1\.0 \(files .*where this command has my-law 1\.0"
        ):
            processes.make(wants_first)
    finally:
        processes.close()


def test_a_worker_without_the_law_is_refused(install: Install, study: Study, tmp_path: Path) -> None:
    """It cannot set up the scenario, which says nothing about its runs."""
    wanted = task_of(study).code
    scenario = read_scenario(tmp_path / "base.xml")
    check_laws(wanted, scenario)
    check_laws({}, scenario)
    with pytest.raises(InputError, match=r"has no law 'mine' that can be loaded, where this command has my-law 1\.0"):
        check_code(wanted, {"law mine": "no law 'mine' that can be loaded"})
    (about,) = (tmp_path / "site").glob("*.dist-info")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: my-law\nVersion: 1.1\n")
    processes = Processes()
    try:
        with pytest.raises(InputError, match=r"has my-law 1\.1 .*where this command has my-law 1\.0"):
            processes.make(task_with(study, wanted))
        (about / "entry_points.txt").unlink()
        with pytest.raises(InputError, match=r"has no law 'mine' that can be loaded, where this command has my-law"):
            processes.make(task_with(study, wanted))
    finally:
        processes.close()


def task_with(study: Study, code: Mapping[str, str]) -> Task:
    """Return a task of a study whose law is another one here, so that it cannot be checked."""
    workers = Workers(study, Crew(lambda task: Future(), lambda: 1), code)
    return workers.task([(run, str(run.number)) for run in list(Plan(study))[:2]])

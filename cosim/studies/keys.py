"""What determines a run, as a checksum: a run that was made with the same one need not be made again."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path

from lxml import etree

from cosim.errors import InputError
from cosim.master.code import code_of, code_of_vehicles
from cosim.master.content import checksum, parts_told
from cosim.master.setup import Setup, set_up
from cosim.scenario.edits import split_setting
from cosim.scenario.grammar import local_name
from cosim.scenario.scenario import Expectation, Scenario
from cosim.studies.compared_cases import COMPARED
from cosim.studies.elsewhere import LIBRARIES
from cosim.studies.measuring import made_by_runs
from cosim.studies.plan import Run
from cosim.studies.study import Measured, Study

_FOR_PEOPLE = ("title", "description")
_OF_MANY_PARTS = ("compare", "controller", "plant")
"""Elements that name a scenario, a law with its environment, or a binding: one file does not tell what lies behind."""


def key_of_scenario(scenario: Scenario, setup: Setup) -> str:
    """Return the checksum of all that determines the runs of a scenario, but for its changes.

    That is the resolved text without comments, title and description, the content of each file that it names, the
    versions of the packages, and the files of Formation and of what brings laws and kinds of vehicle.
    """
    return _digest(_determining(scenario, setup))


def key_with_envelopes(scenario: str, envelopes: Sequence[Expectation]) -> str:
    """Return the checksum of a scenario, and of what its runs keep besides figures."""
    if not envelopes:
        return scenario
    kept = [sorted((name, text) for name, text in one.attributes.items() if name not in COMPARED) for one in envelopes]
    return _digest([scenario, *(f"envelope {attributes}" for attributes in kept)])


def key_of_measures(scenario: str, measures: Iterable[Measured]) -> str:
    """Return the checksum of a scenario with what is measured, over several followers, other than of the worst one.

    A row has its figures in the order of the measures, and the scenario does not tell measures apart that differ in
    nothing else.
    """
    places = enumerate(made_by_runs(measures))
    others = [f"{place} {measured.over}" for place, measured in places if measured.over != "worst"]
    return _digest([scenario, *others]) if others else scenario


class RunKeys:
    """The checksums of the runs of a study: of the scenario, the changes, and what lies behind a path that varies.

    Whatever a path leads to is looked at once, however many runs have it.

    Legal call order: `add` of each scenario, then `of` runs.

    Parameters
    ----------
    study
        The study.

    Attributes
    ----------
    scenarios : dict
        The checksum of each scenario, with what is measured; by the indices of cases.
    code : dict
        The code of all runs up to now; see `cosim.master.code.code_of`.
    """

    def __init__(self, study: Study) -> None:
        self._study = study
        self.scenarios: dict[tuple[int, ...], str] = {}
        self.code: dict[str, str] = {}
        self._contents: dict[Path, str] = {}
        self._edited: dict[tuple[tuple[int, ...], tuple[str, ...]], tuple[str, str]] = {}

    def add(self, cases: tuple[int, ...], setup: Setup) -> None:
        """Add the scenario of some cases, which is set up."""
        key = key_of_measures(key_of_scenario(self._study.bases[cases], setup), self._study.measures)
        self.scenarios[cases] = key_with_envelopes(key, self._study.envelopes)
        self.code |= code_of(setup)

    def of(self, run: Run) -> str:
        """Return the checksum of a run."""
        return _digest([self.scenarios[run.cases], *run.changes, *self._behind(run)])

    def _behind(self, run: Run) -> Iterator[str]:
        if not self._study.naming:
            return
        edits = []
        for change in run.changes:
            select, value = split_setting(change)
            tag = self._study.naming.get(select)
            if tag in _OF_MANY_PARTS:
                edits.append(change)
            if tag not in (None, "compare", "controller"):
                yield f"file {self._content(self._study.bases[run.cases].folder / value)}"
        if edits:
            yield f"edited {self._of_edited(run.cases, tuple(edits), run.changes)}"

    def _content(self, file: Path) -> str:
        if file not in self._contents:
            self._contents[file] = checksum(file)
        return self._contents[file]

    def _of_edited(self, cases: tuple[int, ...], edits: tuple[str, ...], changes: tuple[str, ...]) -> str:
        """Return the checksum of a scenario with edits, or with all changes of a run if they make no sense alone."""
        key, error = self._known(cases, edits)
        if error:
            key, error = self._known(cases, changes)
        return key or error  # which breaks its runs, until it is mended

    def _known(self, cases: tuple[int, ...], edits: tuple[str, ...]) -> tuple[str, str]:
        """Return the checksum of an edited scenario, or why there is none."""
        if (cases, edits) not in self._edited:
            try:
                with ExitStack() as cleanup:
                    scenario = self._study.bases[cases].edited(edits)
                    setup = set_up(scenario, cleanup, {})
                    self._edited[cases, edits] = key_of_scenario(scenario, setup), ""
                    self.code |= code_of(setup)
            except InputError as error:
                self._edited[cases, edits] = "", str(error)
        return self._edited[cases, edits]


def _determining(scenario: Scenario, setup: Setup) -> Iterator[str]:
    for library in LIBRARIES:
        yield f"{library} {version(library)}"
    yield from (f"code {name} {its}" for name, its in code_of_vehicles(setup).items())
    yield from parts_told(scenario, setup.laws, setup.opened)
    for path, other in setup.others.items():
        yield f"other {path.name} {key_of_scenario(other.scenario, other.setup)}"
    root = etree.fromstring(scenario.text.encode(), etree.XMLParser(remove_comments=True, remove_pis=True))
    for element in list(root.iter("*")):
        element.tail, element.text = None, (element.text or "").strip()
        if local_name(element) in _FOR_PEOPLE:
            element.clear()
    root.attrib.pop("name", None)
    yield etree.tostring(root, method="c14n").decode()


def _digest(parts: Iterator[str] | Sequence[str]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode("utf-8", "surrogateescape")
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()

"""Verdicts as JUnit XML, which continuous integration reads: a suite for each scenario, a case for each verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from lxml import etree

from cosim.errors import Location
from cosim.results.verdict import Verdict
from cosim.scenario.xml_tree import NOT_XML


class Judged(Protocol):
    """What has verdicts: the summary of a run, or the outcome of a study."""

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """The verdicts."""

    @property
    def passed(self) -> bool:
        """Whether everything is as it must be."""


@dataclass
class Outcome:
    """The outcome of a scenario or a study; filled in as it becomes known.

    Attributes
    ----------
    name : str
        The scenario's name; the file's, as long as it has not been read.
    path : Path
        Its file.
    seconds : float
        How long that took.
    error : BaseException or None
        Why there is no complete result, if there is none.
    left : str
        Where the run was left, if it was to go no further.
    summary : Judged or None
        Its verdicts, if it was run.
    """

    name: str
    path: Path
    seconds: float = 0.0
    error: BaseException | None = None
    left: str = ""
    summary: Judged | None = None


def junit_xml(outcomes: Sequence[Outcome]) -> bytes:
    """Return a JUnit document.

    Each suite begins with a case "run", which fails with an error if the scenario is wrong or its run did not reach
    the end; it is skipped if the run was left as asked. An expectation that could not be judged is an error, too. One
    that fails as it is known to is skipped, with the reason; one that holds although it is marked as failing is a
    failure.
    """
    root = etree.Element("testsuites")
    for outcome in outcomes:
        root.append(_suite(outcome))
    for count in ("tests", "failures", "errors", "skipped"):
        root.set(count, str(sum(int(suite.get(count, "0")) for suite in root)))
    root.set("time", f"{sum(outcome.seconds for outcome in outcomes):.3f}")
    document: bytes = etree.tostring(root, encoding="utf-8", xml_declaration=True, pretty_print=True)
    return document


def _suite(outcome: Outcome) -> etree._Element:
    suite = etree.Element("testsuite", name=_text(outcome.name))
    run = _case(suite, outcome, "run", Location(str(outcome.path), 1), outcome.seconds)
    if outcome.error:
        said = str(outcome.error) or "the run was ended"
        etree.SubElement(run, "error", type=type(outcome.error).__name__, message=_text(said))
    elif outcome.left:
        etree.SubElement(run, "skipped", message=_text(outcome.left))
    for verdict in outcome.summary.verdicts if outcome.summary else ():
        about = f"{verdict.expectation} [{verdict.robot}]" if verdict.robot else verdict.expectation
        _judged(_case(suite, outcome, about, verdict.where, 0.0), verdict)
    for count, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(count, str(sum(1 for _ in suite.iter(tag))))
    suite.set("time", f"{outcome.seconds:.3f}")
    return suite


def _case(suite: etree._Element, outcome: Outcome, name: str, where: Location, seconds: float) -> etree._Element:
    return etree.SubElement(
        suite,
        "testcase",
        classname=_text(outcome.name),
        name=_text(name),
        file=_text(where.file),
        line=str(where.line),
        time=f"{seconds:.3f}",
    )


def _judged(case: etree._Element, verdict: Verdict) -> None:
    said = f"{verdict.finding}; {verdict.outcome}" if verdict.known_failure else verdict.finding
    if not verdict.judged:
        etree.SubElement(case, "error", type="not judged", message=_text(said))
    elif verdict.as_marked and not verdict.passed:
        etree.SubElement(case, "skipped", message=_text(said))
    elif not verdict.as_marked:
        etree.SubElement(case, "failure", type="expectation", message=_text(said))
    etree.SubElement(case, "system-out").text = _text(str(verdict))


def _text(text: str) -> str:
    """Return a text without the characters that XML cannot hold."""
    return NOT_XML.sub("\N{REPLACEMENT CHARACTER}", text)

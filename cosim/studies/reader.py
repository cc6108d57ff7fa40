"""From a study file to a study; checks beyond the schema."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TypeVar

from lxml import etree

from cosim.errors import AfterTheEnd, InputError, Location, nearest, printable, shown
from cosim.quantity import split
from cosim.scenario.document import Document, read_study_document, read_variant_of
from cosim.scenario.edits import Change, as_changes, in_words
from cosim.scenario.grammar import NAMESPACE, attributes_of
from cosim.scenario.reader import scenario_in
from cosim.scenario.reader.element import Element
from cosim.scenario.scenario import Expectation, Scenario
from cosim.scenario.tree_edits import insert, put
from cosim.scenario.variant import RULES
from cosim.scenario.xpath_selection import assign, selected_or_added
from cosim.studies.courses import is_of_paths
from cosim.studies.horizons import is_timing, longest_horizon
from cosim.studies.read_keep import read_keep
from cosim.studies.read_measures import read_measures
from cosim.studies.read_search import draws_of, read_search, read_tune
from cosim.studies.study import Measured, Requirement, Sample, Study, Target, Vary
from cosim.studies.values import Count, Finite, Values, number_of, values_of

MOST_CASES = 1000
"""Upper limit for combinations of cases: each is a scenario of its own."""
_REQUIREMENTS = ("probability", "quantile", "mean", "worst", "better")
_OF_LAWS = (("controller", "package"), ("controller", "name"))
"""Attributes that say which law it is, by their elements."""
_OF_THE_TABLE = re.compile(
    r"run|draw|run_key|status|passed|message|margin_\d+|(sensitivity|envelope)_\w+|measured|(with_)?varied|crossed"
)
"""Names that the table of runs has for other things; see `cosim.studies.table`."""
_T = TypeVar("_T", Vary, Measured)


def read_study(path: str | Path, changes: Iterable[str | Change] = ()) -> Study:
    """Read a study file, with the scenarios that it is about.

    Parameters
    ----------
    path
        The file.
    changes
        Made in every scenario, before the study's own: ``XPATH=VALUE`` each, as for ``--set``.

    Raises
    ------
    InputError
        The file is no study, or a scenario of it is wrong; with file, line and column.
    """
    document = read_study_document(Path(path))
    made = tuple(as_changes(changes))
    root = Element.root(document)
    vary = _distinct(map(_vary, root.children("vary")), "value")
    _check_cases(vary)
    measures, expected = read_measures(root.children("measure"))
    tune, search = root.find("tune"), root.find("search")
    tuned = None if tune is None else read_tune(tune, vary, measures)
    searched = None if search is None else read_search(search, vary)
    searching = tuned or searched
    sample = _sample(root.child("sample"), vary) if searching is None else draws_of(searching)
    study = Study(
        document=document,
        name=root.get("name"),
        title=printable(root.child("title").text),
        vary=vary,
        sample=sample,
        measures=_distinct(measures, "measure"),
        requirements=tuple(_requirement(element) for element in root.inside if element.kind in _REQUIREMENTS),
        bases=_bases(document, root, expected, made, partial(longest_horizon, vary, sample)),
        tune=tuned,
        search=searched,
        changes=made,
        keep=tuple(read_keep(element, measures) for element in root.children("keep")),
        envelopes=tuple(map(_envelope, root.children("envelope"))),
    )
    _check_names(study)
    return _with_places(study)


def _check_names(study: Study) -> None:
    values = {vary.name for vary in study.vary}
    named: tuple[Vary | Measured, ...] = (*study.vary, *study.measures)
    for one in named:
        if _OF_THE_TABLE.fullmatch(one.name):
            raise InputError(f"the table of runs has another {one.name!r}: choose another name", one.where)
    for measured in study.measures:
        if measured.name in values:
            raise InputError(f"a value is named {measured.name!r}, too: choose another name", measured.where)


# Values ------------------------------------------------------------------------------------------------------


def _vary(element: Element) -> Vary:
    cases = list(element.children("case"))
    also = tuple(map(_target, element.children("also")))
    if cases:
        names = [case.get("name") for case in cases]
        for name, case in zip(names, cases, strict=True):
            if names.count(name) > 1:
                raise case.error(f"the case {name!r} is given twice")
        if "select" in element or "entry" in element or "case" in element or also:
            raise element.error(
                "cases say themselves what changes: leave select=..., entry=..., case=... and <also> out"
            )
        return Vary(element.get("name"), Finite(names), (), True, "cross" in element, element.where)
    values = values_of(next(child for child in element.inside if child.kind != "also"))
    if "select" in element:
        also = (Target(element.get("select"), where=element.where, entry=int(element.get("entry", "0"))), *also)
    elif "entry" in element:
        raise element.error("entry=... is about select=...: add it, or give the entry in <also>")
    if not also:
        raise element.error(f"nothing gets the value {element.get('name')!r}: add select=... or <also select=.../>")
    if "cross" in element and not isinstance(values, Finite):
        raise element.error('cross="yes" needs a list, a grid, a range or cases: another value has no end')
    if any(target.factor or target.offset for target in also):
        _check_numbers(element, values)
    return Vary(element.get("name"), values, also, False, "cross" in element, element.where, element.get("case"))


def _check_cases(vary: Sequence[Vary]) -> None:
    names = [name for one in vary if one.cases for name in _texts(one)]
    for one in vary:
        if one.case and one.case not in names:
            raise InputError(f"no value has a case {one.case!r}: {nearest(one.case, names)}", one.where)


def _target(element: Element) -> Target:
    factor, offset = (number_of(element, name) if name in element else None for name in ("factor", "offset"))
    return Target(element.get("select"), factor, offset, element.where, int(element.get("entry", "0")))


def _check_numbers(element: Element, values: Values) -> None:
    """Refuse a list of words where a number is to be computed from each."""
    for text in values.texts[:1000] if isinstance(values, Finite) else ():
        try:
            split(text)
        except ValueError:
            raise element.error(f"{text!r} is not a number with a unit, so it has no factor and offset") from None


def _sample(element: Element, vary: Sequence[Vary]) -> Sample:
    method, given = element.get("method"), "runs" in element
    whole = method in ("grid", "one_at_a_time")
    if given and whole:
        raise element.error(f'method="{method}" of <sample> makes as many runs as there are values: leave runs=... out')
    if not given and not whole:
        raise element.error(f'method="{method}" of <sample> needs runs=...')
    for one in vary if whole else ():
        if not isinstance(one.values, Finite | Count):
            raise InputError(
                f'the value {one.name!r} is random, which method="{method}" of <sample> does not draw: give a list, a '
                "grid or a range, or another method",
                one.where,
            )
        if isinstance(one.values, Count) and method == "one_at_a_time":
            raise InputError(
                f"{one.name!r} grows from run to run, so that no run would be the scenario as it is, and its effect "
                f'would be taken for that of others: give a <range>, which method="{method}" of <sample> varies alone, '
                "or leave it out",
                one.where,
            )
    if "second_order" in element and method != "saltelli":
        raise element.error('second_order="yes" of <sample> is about indices: only method="saltelli" has them')
    return Sample(
        method=method,
        runs=int(element.get("runs")) if given else None,
        seed=int(element.get("seed", "0")),
        where=element.where,
        second_order="second_order" in element,
    )


def _requirement(element: Element) -> Requirement:
    return Requirement(element.kind, element.attributes, element.where, tuple(map(_requirement, element.inside)))


def _envelope(element: Element) -> Expectation:
    start = element.quantity("from", "s") if "from" in element else 0.0
    stop = element.quantity("to", "s") if "to" in element else math.inf
    if not is_of_paths(element) and "unit" not in element:
        raise element.error("<envelope> needs unit=..., such as that of the signal")
    robots = tuple(dict.fromkeys(element.get("robots").split()))
    return Expectation(element.kind, element.attributes, element.where, element.folder, start, stop, robots)


# Scenarios ---------------------------------------------------------------------------------------------------


def _bases(
    document: Document,
    root: Element,
    measures: Sequence[tuple[etree._Element, Location]],
    changes: Sequence[Change],
    horizon: Callable[[Collection[str]], str],
) -> Mapping[tuple[int, ...], Scenario]:
    """Return the scenario for each combination of cases; `horizon` returns the change to the longest one of some."""
    namespace = f"{{{NAMESPACE}}}"
    choices = [list(vary.iterchildren(namespace + "case")) for vary in document.root.iterchildren(namespace + "vary")]
    choices = [cases for cases in choices if cases]
    combinations = 1
    for cases in choices:
        combinations *= len(cases)
    if combinations > MOST_CASES:
        raise root.error(f"the cases have {combinations} combinations, which is more than {MOST_CASES}")
    bases = {}
    for indices in product(*(range(len(cases)) for cases in choices)):
        chosen = [cases[index] for cases, index in zip(choices, indices, strict=True)]
        try:
            bases[indices] = _base(document, root, chosen, measures, changes)
        except AfterTheEnd:
            if not (longer := horizon([case.get("name", "") for case in chosen])):
                raise
            bases[indices] = _base(document, root, chosen, measures, [*changes, *as_changes([longer])])
    return bases


def _base(
    document: Document,
    root: Element,
    cases: Sequence[etree._Element],
    measures: Sequence[tuple[etree._Element, Location]],
    changes: Sequence[Change],
) -> Scenario:
    given = [case for case in cases if case.get("of")]
    if len(given) > 1:
        raise InputError("a second case names a scenario; only one value may", document.where(given[1]))
    of = given[0].get("of", "") if given else root.get("of")
    rules = [rule for case in cases for rule in case.iterchildren(*(f"{{{NAMESPACE}}}{tag}" for tag in RULES))]
    rules = [*document.root.iterchildren(f"{{{NAMESPACE}}}title"), *rules]
    added = [(copy.deepcopy(element), where) for element, where in measures]
    all_changes: list[Change] = [*changes, partial(_add_expectations, elements=[element for element, _ in added])]
    varied = read_variant_of(of, document, rules, all_changes, dict(added))
    return scenario_in(varied, changes=map(in_words, changes))


def _add_expectations(root: etree._Element, elements: Sequence[etree._Element]) -> None:
    if elements and root.find("expect") is None:
        insert(root, [etree.Element("expect")])
    for element in elements:
        put(expect := root.find("expect"), expect[-1] if len(expect) else None, [element])


def _with_places(study: Study) -> Study:
    """Return a study with what is where values go; check that each has one place there, and no two the same one."""
    found: dict[tuple[int, ...], dict[str, str]] = {}
    naming: dict[str, str] = {}
    having = [vary for vary in study.vary if vary.cases]
    for cases, scenario in study.bases.items():
        named = [_texts(vary)[index] for vary, index in zip(having, cases, strict=True)]
        vary = [one for one in study.vary if not one.case or one.case in named]
        own: dict[str, str] = {}
        scenario.edited([partial(_select, vary=vary, found=own, naming=naming)])
        if len(scenario.changes) > len(study.changes):  # it was made longer: the horizon is not its own
            own = {select: text for select, text in own.items() if not is_timing(select)}
        found[cases] = own
    return replace(study, own=found, naming=naming)


def _texts(vary: Vary) -> Sequence[str]:
    return vary.values.texts if isinstance(vary.values, Finite) else ()


def _select(root: etree._Element, vary: Sequence[Vary], found: dict[str, str], naming: dict[str, str]) -> None:
    taken: dict[tuple[object, str], dict[int, Vary]] = {}
    written = set(root.iter())
    for one in vary:
        for target in one.targets:
            try:
                nodes = selected_or_added(root, target.select)
                if len(nodes) > 1:
                    raise ValueError(f"{target.select!r} selects {len(nodes)} nodes: expected one; <also> adds others")
                own = str(getattr(nodes[0], "text", nodes[0]) or "")
                element = assign(nodes[0], own)
                _check_entry(target, own)
            except ValueError as error:
                raise InputError(str(error), target.where) from None
            name = getattr(nodes[0], "attrname", "")
            if attributes_of(element.tag).get(name) == "path" or (element.tag, name) in _OF_LAWS:
                naming[target.select] = element.tag
            entries = taken.setdefault((element, name), {})
            other = next((entries[at] for at in entries if at == target.entry or not at or not target.entry), None)
            if other is not None:
                raise InputError(f"{target.select!r} selects what the value {other.name!r} has already", target.where)
            entries[target.entry] = one
            if len(entries) > 1 and target.select not in found:
                raise InputError(
                    f"{target.select!r} selects what the value {next(iter(entries.values())).name!r} has under another "
                    "select: write both alike",
                    target.where,
                )
            found[target.select] = own
    for element in set(root.iter()) - written:  # what a run adds with its value is nothing yet
        if (parent := element.getparent()) is not None:
            parent.remove(element)


def _check_entry(target: Target, own: str) -> None:
    entries = own.split()
    if not target.entry:
        return
    try:
        list(map(float, entries))
    except ValueError:
        raise ValueError(f"{target.select!r} selects {shown(own)!r}, which is not several numbers") from None
    if target.entry > len(entries):
        raise ValueError(
            f"{target.select!r} selects {shown(own)!r}, which has no entry {target.entry}: write all of them there, "
            "with spaces between them"
        )


def _distinct(items: Iterable[_T], what: str) -> tuple[_T, ...]:
    """Return items with names; refuse a name that is given twice."""
    found: dict[str, _T] = {}
    for item in items:
        if item.name in found:
            raise InputError(f"the {what} {item.name!r} is given twice", item.where)
        found[item.name] = item
    return tuple(found.values())

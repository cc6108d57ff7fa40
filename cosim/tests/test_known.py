"""What is known is not worked out again, and nothing of one call is in the next."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree

from cosim.errors import InputError
from cosim.known import Known
from cosim.scenario.attribute_edits import AttributeEdits
from cosim.scenario.document import parse_document
from cosim.scenario.edits import as_changes, set_horizon
from cosim.scenario.reader import Variations, read_scenario
from cosim.scenario.reader.element import Element
from cosim.scenario.scenario import Scenario
from cosim.scenario.tree_edits import serialised

EXAMPLE = Path(__file__).with_name("example.xml")


def test_a_function_is_called_again_for_other_arguments_alone() -> None:
    calls = []

    def double(values: list[int], *, times: int = 2) -> list[int]:
        calls.append(values)
        return values * times

    known = Known()
    assert known.of("a", double, [1]) is known.of("a", double, [1])
    assert known.of("b", double, [2]) == [2, 2]
    assert known.of("a", double, [1]) == [1, 1]
    assert calls == [[1], [2]]
    assert known.of("a", double, [1], times=3) == [1, 1, 1]
    assert known.of("a", double, [1]) == [1, 1]
    assert len(calls) == 4


def test_a_function_that_refuses_its_arguments_is_called_again() -> None:
    known = Known()
    for _ in range(2):
        with pytest.raises(ValueError, match="invalid literal"):
            known.of("", int, "one")
    assert known.of("", int, "1") == 1


def without_a_follower(root: etree._Element) -> None:
    root.remove(root.findall("follower")[1])


def with_a_bias(root: etree._Element) -> None:
    etree.SubElement(root.find("sensor"), "bias", x="1 mm")


CHANGES = (
    [],
    ["simulation/@seed=7"],
    ["//plant/parameter[1]/@value=2 m"],
    ["follower[1]/pose/@y=1 m", "//gain[1]/@value=11"],
    ["follower[2]/parameter[@name='m_c']/@value=31 kg"],
    [set_horizon(0.2)],
    [without_a_follower],
    [with_a_bias, "sensor/noise/@x=2 mm"],
    ["simulation/@seed=one"],
    ["follower[1]/@plant=none"],
)


def outcome(of: Scenario | Variations, changes: list[Any]) -> object:
    """Return the changed scenario, or why it is refused."""
    try:
        return of.edited(changes)
    except InputError as error:
        return str(error), error.where


def test_a_scenario_that_is_changed_often_is_the_same_as_one_that_is_changed_once() -> None:
    scenario = read_scenario(EXAMPLE).edited(expectations=False)
    often, random = Variations(scenario), np.random.default_rng(3)
    alone = [outcome(scenario, changes) for changes in CHANGES]
    assert sum(isinstance(one, tuple) for one in alone) == 2, "not the last two are refused"
    for index in random.integers(len(CHANGES), size=60):
        assert outcome(often, CHANGES[index]) == alone[index]


def test_only_what_has_changed_is_read_again() -> None:
    scenario = read_scenario(EXAMPLE)
    often = Variations(scenario)
    first, second = (often.edited([f"follower[1]/pose/@y={y} m"]) for y in (1, 2))
    assert first.followers[0].pose != second.followers[0].pose
    assert first.followers[1] is second.followers[1]
    assert all(first.plants[name] is plant for name, plant in second.plants.items())


ATTRIBUTES = (
    ["simulation/@seed=7", "simulation/@seed= 8 "],
    ["//parameter[@name='m_c']/@value=31   kg", "follower[1]/pose/@y=1 m"],
    ["//gain/@value=3", "//gain[@value=3]/@value=4"],
    ["leader/pose/@x=1 m"],
)
BY_COPY = (
    ["title=Another one"],
    ["plant/parameter[@name='no such']/@value=3"],
    ["simulation/@seed=7", "simulation/@seed=one"],
    ["simulation/@seed=7", "//no/@such=1"],
    ["simulation/@seed=7", "///=1"],
    ["simulation/@seed=7", "follower[1]/@id=\x00"],
    [set_horizon(0.2)],
    [without_a_follower],
)


def test_attributes_are_changed_in_place_with_the_text_and_elements_of_a_changed_copy() -> None:
    scenario = read_scenario(EXAMPLE)
    document = parse_document(scenario.text, EXAMPLE)
    edits, root = AttributeEdits(document), Element.root(document)
    for changes in (*ATTRIBUTES, *BY_COPY, *ATTRIBUTES, []):
        made, found = as_changes(changes), edits.made(as_changes(changes))
        assert (found is None) == (changes in BY_COPY), changes
        if found is not None:
            changed = document.changed(made) if made else document
            again = root.with_attributes(found[1])
            assert Element.root(changed, again) is again, "all is equal"
            assert (found[0], edits.places) == (serialised(changed.root), changed.places)
    assert root.with_attributes({0: root.attributes}) is root

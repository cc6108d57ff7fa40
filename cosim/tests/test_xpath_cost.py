"""The time that an XPath may take is bounded before it is asked."""

import time

import pytest
from lxml import etree

from cosim.scenario.xpath_cost import BUDGET, affordable, cost, size_of
from cosim.scenario.xpath_once import ask

CHEAP = [
    "//parameter[@name='a']/@value",
    "simulation/@seed",
    "/scenario/follower[2]/sensor",
    "//follower[@id='a' and @plant=\"b\"][1]//noise/@x",
    "//*[@at or @from][position() = last()]",
    "(//gain)[1]/..",
    "//a | //b",
    "//a[//b]",
    "//a[/scenario]",
    "//a[//b[//c]]",
    "//*[count(//*[count(//*) > 0]) > 0]/@x",
    "//*[" * 7 + "a" + "]" * 7,
]
SQUARES = [
    "//a[../b]",
    "//a[.//b]",
    "//a[//b and position() = 1]",
    "//a[b = c]",
    "//a[not(@id = //b/@id)]",
    "//a/following::b",
]
CUBES = ["//a[.//b[.//c]]", "//a[../b[../c]]", "//a/following::*[..//b]", "//*[count(..//*[count(..//*) > 0]) > 0]/@x"]


def tree(elements: int) -> etree._Element:
    root = etree.Element("scenario")
    for number in range(elements // 2):
        etree.SubElement(etree.SubElement(root, "a", id=str(number)), "b")
    return root


@pytest.mark.parametrize("xpath", CHEAP)
def test_usual_xpaths_are_affordable_in_large_scenarios(xpath: str) -> None:
    affordable(tree(5000), xpath)
    assert cost(xpath, 100) < 2000


@pytest.mark.parametrize(("xpaths", "degree"), [(SQUARES, 2), (CUBES, 3)])
def test_predicates_multiply(xpaths: list[str], degree: int) -> None:
    for xpath in xpaths:
        assert 1000**degree <= cost(xpath, 1000) < 1000 ** (degree + 1), xpath
        affordable(tree(150), xpath)
        with pytest.raises(ValueError, match="takes too long"):
            affordable(tree(20_000), xpath)


@pytest.mark.parametrize(
    "xpath",
    [
        ".//*[" * 7 + "a" + "]" * 7,
        "//*[contains(.//*, '" + "a" * 15_000 + "')]",
        "//*[" * 51 + "a" + "]" * 51,
        "a" * 30_000,
        "|".join(["//*"] * 1000),
        "//*/following::*/preceding::*/following::*",
    ],
)
def test_others_are_refused_at_once(xpath: str) -> None:
    with pytest.raises(ValueError, match=r"takes too long|at most"):
        affordable(tree(2000), xpath)


@pytest.mark.parametrize(
    "xpath", ["", "[", "]", "//*[[[", "//a]]", "'", "@@", "a::", "((((", "$x", "\u0000", "//é[@ü='ö']"]
)
def test_a_text_that_is_no_xpath_has_some_cost(xpath: str) -> None:
    assert 0 < cost(xpath, 100) <= BUDGET


@pytest.mark.parametrize("xpath", [*CHEAP, *SQUARES, "//*//*", "//*[count(//*) > 0]", "//*[. = //*]"])
def test_an_affordable_one_takes_no_longer_than_stated(xpath: str) -> None:
    """Compared with a plain path, of which the cost is the number of elements."""
    root = tree(3000)
    if cost(xpath, size_of(root)) > BUDGET:
        pytest.skip("is refused")

    def seconds(asked: str) -> float:
        started = time.process_time()
        ask(root, asked)
        return time.process_time() - started

    plain = max(min(seconds("//*[@id]") for _ in range(5)), 1e-5)
    assert seconds(xpath) / plain < 20 * cost(xpath, size_of(root)) / cost("//*[@id]", size_of(root))


def test_text_counts() -> None:
    root = tree(10)
    root.text = "a" * 100_000
    assert size_of(root) == 11 + 1000
    affordable(root, "//*[contains(., 'abc')]")
    with pytest.raises(ValueError, match="takes too long"):
        affordable(root, "//*[translate(., '" + "a" * 15_000 + "', 'b')]" + "[1]" * 1000)

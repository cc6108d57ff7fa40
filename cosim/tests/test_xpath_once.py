"""An XPath returns the same whether what is the same at each node is evaluated once or at each of them."""

import random
import time
from collections.abc import Callable

import pytest
from lxml import etree

from cosim.scenario.xpath_once import ask, separated

TREE = etree.fromstring(
    '<scenario x="1"><!-- c --><a id="1"><b x="2">two</b><b/></a><a id="2" x="3"><c><a/></c></a><?p q?><b>2</b>'
    "</scenario>"
)


@pytest.mark.parametrize(
    ("xpath", "parts"),
    [
        ("//a[//b]", ("//b", "//a[$once_0]")),
        ("//a[//b[//c]]/@x", ("//c", "//b[$once_0]", "//a[$once_1]/@x")),
        ("//a[@id and c[count(//b) > 2]]", ("count(//b) > 2", "//a[@id and c[$once_0]]")),
        ("//a[-count(/*/b) * 2 + 4]", ("-count(/*/b) * 2 + 4", "//a[$once_0]")),
        ("//a[not(//b/text() = 'x]')][/]", ("not(//b/text() = 'x]')", "/", "//a[$once_0][$once_1]")),
    ],
)
def test_what_is_evaluated_once(xpath: str, parts: tuple[str, ...]) -> None:
    assert separated(xpath) == parts


@pytest.mark.parametrize(
    "predicate",
    [
        *("2", "b", ".//b", "../b", "@id", ".", "//b and position() = 1", "//b = last()", "string() = //b", "//b or b"),
        *("id('x')", "lang('en') = //b", "$x", "//x:b", "count(b) = count(//b)", "//b[", "'", ""),
    ],
)
def test_what_is_not(predicate: str) -> None:
    assert separated(f"//a[{predicate}]") == (f"//a[{predicate}]",)


def test_the_same_is_returned() -> None:
    """Of random XPaths, among them some that are none."""
    rng = random.Random(1)

    def path(depth: int, begin: str) -> str:
        steps = ["a", "b", "c", "*", "..", ".", "@x", "text()", "node()", "parent::a", "following::*", "comment()"]
        return begin + "/".join(rng.choice(steps) + predicate(depth) for _ in range(rng.randint(1, 2)))

    def predicate(depth: int) -> str:
        return f"[{expression(depth - 1)}]" if depth and rng.random() < 0.5 else ""

    def operand(depth: int) -> str:
        of = path(depth, rng.choice(("/", "//", "//", "", ".//")))
        kinds = (
            of,
            of,
            of,
            f"count({of})",
            f"not({of})",
            f"string({of})",
            "2",
            "'2'",
            "/",
            "last()",
            f"-{of}",
            f"({of}",
        )
        return rng.choice(kinds)

    def expression(depth: int) -> str:
        operators = ("=", " and ", " or ", "+", ">", "|", " - ", " div ", "*")
        return operand(depth) if rng.random() < 0.6 else operand(depth) + rng.choice(operators) + operand(depth)

    def result(evaluate: object) -> object:
        try:
            found = evaluate()  # type: ignore[operator]
        except etree.XPathError:
            return "no XPath"
        return found if found == found else "not a number"

    several = 0
    for _ in range(5000):
        xpath = path(3, rng.choice(("//", "/", "/*/")))
        several += len(separated(xpath)) > 1
        found, expected = (result(lambda of=of, asked=xpath: of(TREE, asked)) for of in (ask, etree._Element.xpath))
        assert found == expected or (found == "no XPath" and not expected), xpath  # where a predicate is never reached
    assert several > 500


def test_it_is_linear() -> None:
    root = etree.Element("scenario")
    for _ in range(5000):
        etree.SubElement(root, "a")

    def least(ask: Callable[[etree._Element, str], object]) -> float:
        """Return the least CPU time of three: a collection of garbage may come between."""
        times = []
        for _ in range(3):
            begin = time.process_time()
            assert ask(root, "//a[//b]") == []
            times.append(time.process_time() - begin)
        return min(times)

    as_it_stands = least(lambda root, xpath: root.xpath(xpath))  # looks at each node for each node
    assert least(ask) < as_it_stands / 20

"""What is said of an XPath that selects nothing, in scenarios of any size."""

import pytest
from lxml import etree

from cosim import xpaths


@pytest.mark.parametrize("tag", ["input", "input{}"])
def test_few_xpaths_are_tried_in_a_large_scenario(tag: str, monkeypatch: pytest.MonkeyPatch) -> None:
    elements = "".join(f'<{tag.format(i)} name="tau"/>' for i in range(1000))
    tried: list[str] = []
    monkeypatch.setattr(xpaths, "_selects", lambda root, xpath: bool(tried.append(xpath)))
    assert xpaths.advice(etree.fromstring(f"<scenario>{elements}</scenario>"), "tau") == ""
    assert len(set(tried)) == len(tried) <= xpaths.MAX_TRIED


def test_a_long_xpath_is_likened_to_none() -> None:
    root = etree.fromstring("<scenario><simulation seed='1'/></scenario>")
    assert "//simulation/@seed" in xpaths.advice(root, "//simulation/@sed")
    assert xpaths.advice(root, "//simulation/@sed" + "/gain" * 1000) == ""

"""Advice about an XPath that selects nothing, in scenarios of any size."""

import pytest
from lxml import etree

from cosim.scenario import xpath_advice


@pytest.mark.parametrize("tag", ["input", "input{}"])
def test_few_xpaths_are_tried_in_a_large_scenario(tag: str, monkeypatch: pytest.MonkeyPatch) -> None:
    elements = "".join(f'<{tag.format(i)} name="tau"/>' for i in range(1000))
    tried: list[str] = []
    monkeypatch.setattr(xpath_advice, "_selects", lambda root, xpath: bool(tried.append(xpath)))
    assert xpath_advice.advice(etree.fromstring(f"<scenario>{elements}</scenario>"), "tau") == ""
    assert len(set(tried)) == len(tried) <= xpath_advice.MAX_TRIED


def test_a_long_xpath_is_likened_to_none() -> None:
    root = etree.fromstring("<scenario><simulation seed='1'/></scenario>")
    assert "//simulation/@seed" in xpath_advice.advice(root, "//simulation/@sed")
    assert xpath_advice.advice(root, "//simulation/@sed" + "/gain" * 1000) == ""

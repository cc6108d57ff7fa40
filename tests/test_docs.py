"""What the documentation names is what there is."""

import re
from pathlib import Path

import cosim

ROOT = Path(__file__).parents[1]


def test_the_page_on_results_names_every_variable_and_attribute(scenarios: Path) -> None:
    replacements = ["//simulation/@horizon=1 s", "//rms/@from=0 s"]
    result = cosim.run(scenarios / "clmr_line.xml", replacements)
    named = set(re.findall(r"`(\w+)`", (ROOT / "docs" / "results.md").read_text(encoding="utf-8")))
    telemetry = set(re.findall(r"`(\w+)`", (ROOT / "controllers" / "README.md").read_text(encoding="utf-8")))
    assert set(result.data_vars) <= named | telemetry
    assert set(result.attrs) <= named


def test_links_between_pages_lead_somewhere() -> None:
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("controllers/*.md"), *ROOT.glob("plants/**/*.md")]
    assert len(pages) > 5
    for page in pages:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"

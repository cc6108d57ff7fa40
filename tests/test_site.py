"""The documentation as a site: built strictly, every page reachable, every link resolved, nothing from elsewhere.

Sphinx comes with the extra ``docs``. Without it the tests are skipped, unless FORMATION_REQUIRE_DOCS is set.
"""

import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

import pytest
from lxml import etree
from lxml import html as markup

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "docs" / "site" / "build.py"
MISSING = [name for name in ("furo", "myst_parser", "sphinx") if importlib.util.find_spec(name) is None]

if MISSING and os.environ.get("FORMATION_REQUIRE_DOCS"):
    raise RuntimeError(f"missing: {MISSING}")
pytestmark = pytest.mark.skipif(bool(MISSING), reason='needs Sphinx: pip install -e ".[docs]"')


class Link(NamedTuple):
    """An attribute of an element that names a file."""

    page: Path
    element: str
    attribute: str
    target: str


def built(out: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(BUILD), "--out", str(out), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    done = built(out, str(ROOT / "scenarios" / "figure_eight.xml"))
    assert done.returncode == 0, done.stderr
    return out


@cache
def parsed(page: Path) -> etree._Element:
    return markup.fromstring(page.read_bytes())


def links(page: Path) -> Iterator[Link]:
    for element in parsed(page).iter(etree.Element):
        for attribute in ("href", "src", "data", "poster", "srcset"):
            if target := element.get(attribute):
                yield Link(page, element.tag, attribute, target)


def pages(site: Path) -> list[Path]:
    """Return the pages of the site, without those of runs, which the browser's tests open."""
    return sorted(page for page in site.rglob("*.html") if "runs" not in page.relative_to(site).parts)


def test_every_link_leads_to_a_file_and_an_anchor(site: Path) -> None:
    seen = 0
    for page in pages(site):
        for link in links(page):
            url = urlsplit(link.target)
            if url.scheme:
                continue
            target = (page.parent / unquote(url.path)).resolve() if url.path else page
            assert target.is_file(), link
            if url.fragment and target.suffix == ".html" and "runs" not in target.relative_to(site).parts:
                anchor = unquote(url.fragment)
                assert parsed(target).xpath("//*[@id=$anchor or @name=$anchor]", anchor=anchor), link
            seen += 1
    assert seen > 1000


def test_every_page_can_be_reached_from_the_first(site: Path) -> None:
    reached, ahead = set(), [site / "index.html"]
    while ahead:
        page = ahead.pop()
        if page in reached or page.suffix != ".html":
            continue
        reached.add(page)
        if "runs" not in page.relative_to(site).parts:
            paths = [urlsplit(link.target) for link in links(page) if link.element == "a"]
            ahead += [(page.parent / unquote(url.path)).resolve() for url in paths if url.path and not url.scheme]
    assert reached == set(site.rglob("*.html")) - {site / "search.html"}, "the form of each page leads to the search"
    assert parsed(site / "index.html").xpath("//form[@action='search.html']")


def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    for page in pages(site):
        for link in links(page):
            if link.element != "a" and (link.attribute, link.element) != ("href", "form"):
                assert not urlsplit(link.target).netloc, link
    for style in site.rglob("*.css"):
        for target in re.findall(r"url\(([^)]*)\)|@import", style.read_text(encoding="utf-8")):
            assert not re.match(r"\s*['\"]?(https?:)?//", target), (style, target)


def test_pages_gallery_and_reference_are_there(site: Path) -> None:
    for page in (ROOT / "docs").glob("*.md"):
        assert (site / "docs" / f"{page.stem}.html").is_file()
    gallery = (site / "gallery.html").read_text(encoding="utf-8")
    assert "runs/figure_eight/report.html" in gallery
    assert (site / "runs" / "figure_eight" / "paths.png").read_bytes().startswith(b"\x89PNG")
    reference = parsed(site / "reference" / "cosim.html")
    assert reference.xpath("//*[@id='cosim.run']")
    assert reference.xpath("//*[@id='cosim.Simulation']")
    assert parsed(site / "reference" / "formation_controllers.html").xpath("//*[@id='formation_controllers.Team']")


def test_the_search_knows_the_words_of_pages(site: Path) -> None:
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    assert index.startswith("Search.setIndex(")
    for word in ("bearing", "simulation", "trailer"):
        assert word[:6] in index


@pytest.mark.parametrize(
    ("line", "sentence"),
    [("[a](docs/nowhere.md)", "nowhere.md"), ("[a](#no-such-heading)", "no-such-heading"), ("![a](b.png)", "b.png")],
)
def test_a_link_that_leads_nowhere_is_an_error(tmp_path: Path, line: str, sentence: str) -> None:
    (tmp_path / "_static").mkdir()
    (tmp_path / "_extra").mkdir()
    (tmp_path / "_static" / "gallery.css").touch()
    (tmp_path / "index.md").write_text(f"# A page\n\n{line}\n")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "-q",
        "-c",
        str(BUILD.parent),
        str(tmp_path),
        str(tmp_path / "out"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode != 0
    assert sentence in done.stderr

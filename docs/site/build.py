"""Build the documentation as a site: python docs/site/build.py [--out DIR] [--runs DIR] [SCENARIO.xml ...].

The pages are those that GitHub shows; they are gathered into one folder with three that are made here: the start page,
which is the README, the gallery with the picture and the page of each scenario's run, and the reference of the public
functions and classes, from their docstrings. Every warning of Sphinx is an error, so each link leads somewhere.
"""

from __future__ import annotations

import argparse
import html
import io
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image
from sphinx.cmd.build import build_main

import cosim
from cosim.results.figure_paths import draw_paths
from cosim.results.figure_style import colours_of
from cosim.results.result import Result

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PAGES = ("README.md", "CHANGELOG.md", "docs/*.md", "plants/**/README.md", "controllers/*.md")
REFERENCE = {
    "cosim": "Runs, results and studies from Python.",
    "plants": "Vehicle models, and the FMUs that are built from them.",
    "formation_controllers": "Control laws, and what a law of your own is given.",
}
"""The packages of the reference."""
_LINK = re.compile(r"\[([^\]\[]*)\]\((?![a-z]+:)([^)#\s]+)(#[^)\s]*)?\)")
_GALLERY = """# Gallery

Each scenario that comes with Formation, run when this site was built. A picture leads to the page of its run, on which
the robots drive; [The results of a run](docs/results.md#report-html) explains that page.

<div class="gallery">
CARDS
</div>
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Build the site; return Sphinx's exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="*", type=Path, metavar="SCENARIO.xml", help="of the gallery (all)")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "site", metavar="DIR", help="folder (build/site)")
    parser.add_argument(
        "--runs", type=Path, metavar="DIR", help="results of the scenarios, as formation run writes them"
    )
    options = parser.parse_args(arguments)
    scenarios = options.scenarios or sorted((ROOT / "scenarios").glob("*.xml"))
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "source"
        runs = options.runs or _runs(scenarios, Path(folder) / "runs")
        gather(source)
        (source / "gallery.md").write_text(gallery(scenarios, runs, source / "_extra"), encoding="utf-8")
        for package, about in REFERENCE.items():
            (source / "reference" / f"{package}.rst").write_text(reference(package, about), encoding="utf-8")
        strict = ["--fail-on-warning", "--keep-going", "--quiet", "--jobs", "auto"]
        status = build_main([*strict, "--doctree-dir", f"{folder}/doctrees", str(source), str(options.out)])
    print(f"site in {options.out}/index.html" if status == 0 else "the site has faults, see above")
    return status


def _runs(scenarios: Sequence[Path], folder: Path) -> Path:
    """Run scenarios, and return the folder of their results; a scenario may well miss an expectation."""
    command = [sys.executable, "-m", "cosim", "run", *map(str, scenarios), "--no-figure", "--out", str(folder)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    if done.returncode > 1:
        raise SystemExit(f"{' '.join(command)} ended with status {done.returncode}")
    return folder


# Pages ------------------------------------------------------------------------------------------------------


def gather(source: Path) -> None:
    """Copy the pages and the files to which they link into a folder, with the configuration; the README starts it."""
    pages = [path for pattern in PAGES for path in sorted(ROOT.glob(pattern))]
    for page in pages:
        place = source / page.relative_to(ROOT)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(_LINK.sub(partial(_link, page, source), page.read_text(encoding="utf-8")), encoding="utf-8")
    for name in ("reference", "_extra", "_static"):
        (source / name).mkdir()
    shutil.copy(HERE / "conf.py", source)
    shutil.copy(HERE / "gallery.css", source / "_static")
    start = (source / "README.md").rename(source / "index.md")
    start.write_text(start.read_text(encoding="utf-8") + contents(pages), encoding="utf-8")


def _link(page: Path, source: Path, link: re.Match[str]) -> str:
    """Return a link of a page as it is on the site; a file to which it leads is copied."""
    text, target, anchor = link.groups("")
    path = (page.parent / target).resolve()
    if path == ROOT / "README.md":
        return f"[{text}]({target.replace('README.md', 'index.md')}{anchor})"
    if path.is_dir():
        return text  # a site shows no folders
    if path.is_file() and path.suffix != ".md":
        place = source / path.relative_to(ROOT)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, place)
    return link[0]


def contents(pages: Sequence[Path]) -> str:
    """Return the contents of the site: the tables of docs/README.md by their headings, and pages that none lists."""
    listing = ROOT / "docs" / "README.md"
    text = listing.read_text(encoding="utf-8")
    parts = {"": ["docs/README", "gallery"]}
    for heading, table in re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL):
        if links := re.findall(r"^\| \[.*?\]\((.+?)\)", table, re.MULTILINE):
            parts[heading] = [_document((listing.parent / link).resolve()) for link in links]
    parts["Reference"] = [f"reference/{package}" for package in REFERENCE]
    listed = {"README", *(document for documents in parts.values() for document in documents)}
    parts["Models and changes"] = [document for document in map(_document, pages) if document not in listed]
    return "\n" + "\n".join(_toctree(heading, documents) for heading, documents in parts.items())


def _document(page: Path) -> str:
    """Return the name of a page in Sphinx."""
    return page.relative_to(ROOT).with_suffix("").as_posix()


def _toctree(heading: str, documents: Sequence[str]) -> str:
    caption = f":caption: {heading}\n" if heading else ""
    return f"```{{toctree}}\n:hidden:\n{caption}\n" + "\n".join(documents) + "\n```\n"


def reference(package: str, about: str) -> str:
    """Return the page of a package: its docstring, and the functions and classes that it makes public."""
    heading = f"{package}\n{'=' * len(package)}\n\n{about}\n\n"
    return f"{heading}.. automodule:: {package}\n   :members:\n   :imported-members:\n"


# Gallery ----------------------------------------------------------------------------------------------------


def gallery(scenarios: Sequence[Path], runs: Path, extra: Path) -> str:
    """Return the page with a picture of each run, which leads to its page; write both into a folder of the site."""
    cards = []
    for name in (path.stem for path in scenarios):
        result, place = cosim.load_result(runs / name), extra / "runs" / name
        place.mkdir(parents=True)
        shutil.copy(runs / name / "report.html", place)
        picture(Result.of(result), place / "paths.png")
        title = html.escape(str(result.attrs["title"]))
        cards.append(
            f'<figure><a href="runs/{name}/report.html"><img src="runs/{name}/paths.png" loading="lazy" '
            f'alt="Paths of the robots: {title}"></a><figcaption>{title}<span>{name}.xml</span></figcaption></figure>'
        )
    return _GALLERY.replace("CARDS", "\n".join(cards))


def picture(result: Result, path: Path) -> None:
    """Draw the paths of a run as a small PNG."""
    figure = Figure(figsize=(4.2, 3.0))
    axes = figure.add_axes((0.11, 0.14, 0.87, 0.84))
    draw_paths(axes, "", result, colours_of(len(result.robots)))
    axes.tick_params(labelsize=7)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    Image.open(buffer).convert("RGB").quantize(64).save(path, optimize=True)


if __name__ == "__main__":
    sys.exit(main())

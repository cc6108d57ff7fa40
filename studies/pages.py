"""What the studies here share: folders, and tables and figures for the pages."""

from __future__ import annotations

import io
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "figures"
SCENARIOS = ROOT / "scenarios"


def number(value: float) -> str:
    """Return a number with two digits, large ones without decimals."""
    if abs(value) >= 100:
        return f"{float(f'{value:.2g}'):,.0f}".replace(",", " ").replace("-", "−")
    return f"{value:.2f}".replace("-", "−")


def save(figure: Figure, name: str, dpi: float = 90) -> None:
    """Write a figure to docs/figures as PNG with 256 colours, which suffice for lines and take a third of the space."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    picture = Image.open(buffer).convert("RGB").quantize(256)
    FIGURES.mkdir(exist_ok=True)
    picture.save(FIGURES / f"{name}.png", optimize=True)


def row(*cells: str) -> str:
    """Return a row of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def heading(*cells: str) -> str:
    """Return the first two rows of a Markdown table."""
    return row(*cells) + "\n" + "|" + "---|" * len(cells)

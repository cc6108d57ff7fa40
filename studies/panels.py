"""The panels of the paper's Figures 6, 7, 9 and 10, and the whole figure of a run: python studies/panels.py."""

from pages import SCENARIOS, save

import cosim
from cosim.results.figure import draw

FILES = (
    *("clmr_line_as_printed", "clmr_line", "clmr_circle_as_printed", "clmr_circle", "tractor_trailer_circle"),
    *("compare_neural_pid_wide", "compare_high_gain_wide"),
)

if __name__ == "__main__":
    for file in FILES:
        save(draw(cosim.run(SCENARIOS / f"{file}.xml"), "paper"), file, dpi=75)
    save(draw(cosim.run(SCENARIOS / "convoy.xml")), "figure", dpi=75)

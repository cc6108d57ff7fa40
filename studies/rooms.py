"""The house of `cosim`, drawn from its imports: rooms, and who knows whom.

    python studies/rooms.py

writes ``docs/figures/rooms.svg`` and the table of rooms in ``docs/architecture.md``. The picture leaves out an arrow if
a longer way leads to the same room; the table has all. Imports that ``pyproject.toml`` excuses are left out.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path

import grimp
from lxml import etree

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
PICTURE = ROOT / "docs" / "figures" / "rooms.svg"

CONTENT = {
    "cli": "the command `formation`",
    "pytest_plugin": "scenario files as tests",
    "swap": "a foreign FMU: words, proposals",
    "studies": "many runs, judged together",
    "compare": "two plants, same torques",
    "live": "a run on a page, as it goes on",
    "report": "the page that shows runs",
    "ssp": "systems of FMUs",
    "recordings": "recorded drives, judged",
    "export": "results for other tools",
    "team_fmu": "team FMUs",
    "master": "set-up, step loop, recorder",
    "results": "figures, verdicts, files",
    "fmu": "FMU files: read, bind, test",
    "control": "laws, found and given to teams",
    "signals": "sensors, actuators, places",
    "plant": "the fleet, in compiled code",
    "scenario": "the language, as plain data",
    "vehicle": "kinds of vehicle, each once",
    "translation": "Python of laws, as C",
}
STRANGERS = {"fmpy": "FMPy", "formation_controllers": "controllers", "plants": "plants"}

WIDTH, HEIGHT, GAP, RISE = 210, 62, 24, 40
"""Width and height of a room, distance between rooms in a row and between floors [pixels]."""

STYLE = """
  .room { fill: #8881; stroke: #24292f; stroke-width: 1.2 }
  .back { fill: #fff }
  .arrow { fill: none; stroke: #4c8dd6; stroke-width: 1.4; marker-end: url(#head) }
  .head { fill: #4c8dd6 }
  text { fill: #24292f; font: 12px system-ui, sans-serif; text-anchor: middle }
  .name { font-weight: bold; font-size: 15px }
  .knows { fill: #4c8dd6; font-size: 11px }
  @media (prefers-color-scheme: dark) {
    .back { fill: #0d1117 } .room { stroke: #d0d7de } text { fill: #d0d7de } .knows { fill: #79b8ff }
  }
"""

Arrows = Mapping[str, frozenset[str]]


def main() -> None:
    """Draw the picture and write the table."""
    arrows = known()
    PICTURE.write_bytes(picture(arrows))
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8"), arrows), encoding="utf-8")


def known() -> dict[str, frozenset[str]]:
    """Return for each room of cosim the rooms and the `STRANGERS` that it imports."""
    graph = grimp.build_graph("cosim", include_external_packages=True)
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    excused = {arrow for contract in settings["contracts"] for arrow in contract.get("ignore_imports", ())}
    arrows: dict[str, set[str]] = {}
    for module in graph.modules:
        parts = module.split(".")
        if parts[0] != "cosim" or len(parts) < 2 or parts[1] in ("tests", "__main__"):
            continue
        own = arrows.setdefault(parts[1], set())
        for other in graph.find_modules_directly_imported_by(module):
            if f"{module} -> {other}" not in excused:
                own.update(
                    other.split(".")[1:2] if other.startswith("cosim.") else {other.split(".")[0]} & {*STRANGERS}
                )
    return {room: frozenset(others - {room}) for room, others in sorted(arrows.items())}


def floors(arrows: Arrows) -> dict[str, int]:
    """Return the floor of each room from the top, 0 for one that nobody imports; refuse a circle."""
    found: dict[str, int] = {}

    def floor(room: str, path: tuple[str, ...]) -> int:
        if room in path:
            raise ValueError(f"rooms import each other in a circle: {' <- '.join((*path, room))}")
        if room not in found:
            users = [other for other in arrows if room in arrows[other]]
            found[room] = max((1 + floor(other, (*path, room)) for other in users), default=0)
        return found[room]

    for room in arrows:
        floor(room, ())
    return found


def without_shortcuts(arrows: Arrows) -> dict[str, frozenset[str]]:
    """Return the arrows between rooms, without an arrow whose end a longer way reaches too."""

    def reached(rooms: Iterable[str]) -> set[str]:
        return {further for room in rooms for further in arrows[room] & arrows.keys()} | {
            further for room in rooms for further in reached(arrows[room] & arrows.keys())
        }

    inside = {room: others & arrows.keys() for room, others in arrows.items()}
    return {room: frozenset(others - reached(others)) for room, others in inside.items()}


# The table --------------------------------------------------------------------------------------------------


def with_table(page: str, arrows: Arrows) -> str:
    """Return the page with the table of rooms as it is now."""
    rows = ["| room | content | knows |", "|---|---|---|"]
    level = floors(arrows)
    for room in sorted(CONTENT.keys() & arrows.keys(), key=lambda room: (level[room], room)):
        below = {other for other in CONTENT.keys() & arrows.keys() if level[other] > level[room]}
        rooms = arrows[room] & CONTENT.keys()
        names = [f"`{name}`" for name in sorted(rooms)]
        if rooms and len(others := below - rooms) <= 2:
            but = f" but {' and '.join(f'`{name}`' for name in sorted(others))}" if others else ""
            names = [f"every room below{but}"]
        strangers = [STRANGERS[name] for name in sorted(arrows[room] & STRANGERS.keys())]
        rows.append(f"| `{room}` | {CONTENT[room]} | {', '.join([*names, *strangers]) or 'nobody'} |")
    table = "\n".join(rows)
    return re.sub(r"(?<=<!-- rooms -->\n\n).*?(?=\n\n<!-- end -->)", lambda _: table, page, flags=re.DOTALL)


# The picture ------------------------------------------------------------------------------------------------


def picture(arrows: Arrows) -> bytes:
    """Return the house as an SVG picture: floors from the top, files that all may know as its ground."""
    ground = sorted(arrows.keys() - CONTENT.keys())
    rooms = {room: others - set(ground) for room, others in arrows.items() if room in CONTENT}
    level, drawn = floors(rooms), without_shortcuts(rooms)
    storeys = [sorted(room for room in rooms if level[room] == floor) for floor in range(max(level.values()) + 1)]
    width = max(len(storey) for storey in storeys) * (WIDTH + GAP) + GAP
    place: dict[str, tuple[float, float]] = {}
    for number, storey in enumerate(storeys):
        if number:  # a room stands below those that know it
            storey.sort(key=lambda room: _mean(place[other][0] for other in place if room in drawn[other]))
        left = (width - len(storey) * (WIDTH + GAP) + GAP) / 2
        for column, room in enumerate(storey):
            place[room] = (left + column * (WIDTH + GAP), GAP + number * (HEIGHT + RISE))
    bottom = GAP + len(storeys) * (HEIGHT + RISE)
    svg = etree.Element("svg", xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {width} {bottom + 40 + GAP}")
    etree.SubElement(svg, "title").text = "Rooms of cosim; an arrow leads to a room that another knows"
    etree.SubElement(svg, "style").text = STYLE
    marker = etree.SubElement(svg, "marker", id="head", viewBox="0 0 8 8", refX="7", refY="4", orient="auto")
    marker.set("markerWidth", "7")
    marker.set("markerHeight", "7")
    etree.SubElement(marker, "path", {"class": "head", "d": "M0 0L8 4L0 8z"})
    for room, others in drawn.items():
        for other in sorted(others):
            _arrow(svg, place, room, other, drawn)
    for room, (x, y) in place.items():
        strangers = [STRANGERS[name] for name in sorted(arrows[room] & STRANGERS.keys())]
        lines = [("name", room), ("", CONTENT[room].replace("`", ""))]
        _box(svg, x, y, WIDTH, HEIGHT, [*lines, *([("knows", "knows " + ", ".join(strangers))] if strangers else [])])
    _box(svg, GAP, bottom, width - 2 * GAP, 40, [("", "every room may know: " + ", ".join(ground))])
    return bytes(etree.tostring(svg, pretty_print=True, xml_declaration=True, encoding="UTF-8"))


def _mean(values: Iterable[float]) -> float:
    numbers = list(values)
    return sum(numbers) / len(numbers) if numbers else 0.0


def _arrow(svg: etree._Element, place: Mapping[str, tuple[float, float]], room: str, other: str, drawn: Arrows) -> None:
    """Draw an arrow, which passes the floors between through gaps between their rooms."""
    leaving = sorted(drawn[room], key=lambda name: (place[name][0], name))
    arriving = sorted((name for name in drawn if other in drawn[name]), key=lambda name: (place[name][0], name))
    x = place[room][0] + WIDTH * (leaving.index(other) + 1) / (len(leaving) + 1)
    y = place[room][1] + HEIGHT
    end_x = place[other][0] + WIDTH * (arriving.index(room) + 1) / (len(arriving) + 1)
    end_y = place[other][1] - 2
    course = f"M{x:g} {y:g}"
    between = sorted({top for _, top in place.values() if y < top < end_y - HEIGHT})
    for top in [*between, end_y]:
        edges = [left for left, storey in place.values() if storey == top]
        gaps = [edge - GAP / 2 for edge in edges] + [edge + WIDTH + GAP / 2 for edge in edges]
        to_x = end_x if top == end_y else min(gaps, key=lambda gap: abs(gap - end_x) + abs(gap - x))
        bend = 0.6 * (top - y)
        course += f"C{x:g} {y + bend:g} {to_x:g} {top - bend:g} {to_x:g} {top:g}"
        x, y = to_x, top
        if top != end_y:
            y += HEIGHT
            course += f"V{y:g}"
    etree.SubElement(svg, "path", {"class": "arrow", "d": course})


def _box(svg: etree._Element, x: float, y: float, width: float, height: float, lines: list[tuple[str, str]]) -> None:
    for kind in ("back", "room"):
        shape = {"class": kind, "x": f"{x:g}", "y": f"{y:g}", "width": f"{width:g}", "height": f"{height:g}", "rx": "6"}
        etree.SubElement(svg, "rect", shape)
    for number, (kind, text) in enumerate(lines):
        line = y + height / 2 + 17 * (number - (len(lines) - 1) / 2) + 4.5
        attributes = {"x": f"{x + width / 2:g}", "y": f"{line:g}"} | ({"class": kind} if kind else {})
        etree.SubElement(svg, "text", attributes).text = text


if __name__ == "__main__":
    main()

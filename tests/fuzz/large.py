"""The largest scenarios of each kind: ``python -m tests.fuzz.large`` prints what reading and setting up take.

Each file has almost the 4 MiB or the elements that are read at most, of one kind of content, as it is and with a fault
at its end; a file of 4 MiB that has too many elements is a case of its own.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

from cosim.errors import FormationError
from cosim.master.setup import set_up
from cosim.scenario.document import MAX_BYTES
from cosim.scenario.reader import read_scenario
from cosim.scenario.xml_tree import MAX_ELEMENTS

ROOT = Path(__file__).parents[2]
SECONDS = 60
"""CPU time after which a case is given up."""

SCENARIO = """<scenario xmlns="urn:formation-cosim:scenario:1" name="large">
<title>t</title><description>d {description}</description><simulation horizon="1 s" step="20 ms" seed="1"/>
<plant id="car" model="car_like">{parameters}</plant>{plants}
<controller id="pid" name="neural-adaptive-pid" package="formation-controllers" version="~=0.1.0">{gains}
</controller>{controllers}
<sensor>{sensor}</sensor><actuator>{actuator}</actuator>{inputs}
<input name="tau_d_x"><constant value="1 N"/>{input}</input>
<leader plant="car">{leader}</leader>
<follower id="f" plant="car" controller="pid"><pose x="0 m" y="0 m" psi="0 deg" gamma="0 deg"/>
<desired range="3 m" bearing="45 deg">{changes}</desired></follower>
<follower id="g" plant="car" controller="pid"><pose x="0 m" y="9 m" psi="0 deg" gamma="0 deg"/>
<desired range="3 m" bearing="-45 deg"/></follower>{followers}
{events}<expect><distance above="1 m"/>{expectations}</expect></scenario>"""
POSE = '<pose x="0 m" y="0 m" psi="0 deg" gamma="0 deg"/>'
FOLLOWER = (
    f'<follower id="f{{}}" plant="car" controller="pid">{POSE}<desired range="3 m" bearing="45 deg"/></follower>\n'
)
WAYPOINTS = '<trajectory v="1 m/s">{}</trajectory>'
REPEATED: Mapping[str, tuple[str, str]] = {
    "events": ("events", '<event at="0.5 s" robots="leader"><stop/></event>\n'),
    "events that change a parameter": (
        "events",
        '<event at="0.5 s" robots="f"><parameter name="m_c" value="40 kg"/></event>\n',
    ),
    "expectations": ("expectations", '<peak signal="range_error" below="1 m"/>\n'),
    "expectations of the distance": ("expectations", '<distance above="1 m"/>\n'),
    "followers": ("followers", FOLLOWER),
    "plants": ("plants", '<plant id="p{}" model="car_like"/>\n'),
    "plants from files": ("plants", '<plant id="p{}" fmu="p{}.fmu"/>\n'),
    "controllers": (
        "controllers",
        '<controller id="c{}" name="neural-adaptive-pid" package="formation-controllers" version="~=0.1.0"/>\n',
    ),
    "parameters": ("parameters", '<parameter name="p{}" value="1 m"/>\n'),
    "gains": ("gains", '<gain name="g{}" value="1"/>\n'),
    "effects of the sensor": ("sensor", '<noise x="1 mm"/>\n'),
    "effects of the actuator": ("actuator", '<saturation limit="200 N.m"/>\n'),
    "inputs": ("inputs", '<input name="i{}"><constant value="1 N"/></input>\n'),
    "inputs of one name": ("inputs", '<input name="tau_d_y" value="1 N"/>\n'),
    "waves": ("input", '<sine value="1 N" period="1 s"/>\n'),
    "tables": ("inputs", '<input name="i{}"><table file="t{}.csv" column="c"/></input>\n'),
    "changes of a place": ("changes", '<change from="0.5 s" to="0.6 s" range="4 m"/>\n'),
    "comments": ("events", "<!-- {} -->\n"),
    "elements that nobody knows": ("events", "<a/>"),
    "attributes": ("events", "<event " + " ".join(f'a{i}="1"' for i in range(1000)) + "/>\n"),
    "white space": ("events", " \n\t"),
    "a description": ("description", "word &amp; word "),
}
"""What is repeated, and where."""


def repeated(place: str, piece: str, fault: str = "", most: int = MAX_ELEMENTS) -> str:
    """Return the scenario in which a piece fills a place, with at most so many elements."""
    parts = {"leader": POSE}
    rest = SCENARIO.format_map(_Missing(parts | {"events": fault}))
    count, size, pieces = 0, len(rest.encode()) + 100, []
    each = piece.count("<") - piece.count("</") - piece.count("<!")
    while size < MAX_BYTES and (count + 1) * each < most - 100:
        pieces.append(piece.replace("{}", str(count)))
        size += len(pieces[-1].encode())
        count += 1
    parts[place] = "".join(pieces[:-1])
    parts["events"] = parts.get("events", "") + fault
    return SCENARIO.format_map(_Missing(parts))


class _Missing(dict[str, str]):
    def __missing__(self, key: str) -> str:
        return ""


def _robots(count: int) -> str:
    """Return a scenario whose events name all of its robots."""
    followers = "".join(FOLLOWER.replace("{}", str(i)) for i in range(count))
    names = " ".join(f"f{i}" for i in range(count))
    event = f'<event at="0.5 s" robots="{names}"><input name="i" value="1"/></event>\n'
    room = MAX_BYTES - len(followers) - 2000
    return SCENARIO.format_map(_Missing(leader=POSE, followers=followers, events=event * (room // len(event))))


def _nested() -> str:
    return SCENARIO.format_map(_Missing(leader=POSE, events="<a>" * 500_000 + "</a>" * 500_000))


def _waypoints() -> str:
    point = '<waypoint at="{} s" x="{} m" y="0 m"/>\n'
    room = MAX_BYTES // len(point) - 20_000
    points = "".join(point.replace("{}", str(i)) for i in range(room))
    return SCENARIO.format_map(_Missing(leader=f'<trajectory smoothing="1 cm">{points}</trajectory>'))


def _names() -> str:
    return SCENARIO.format_map(
        _Missing(leader=POSE, events=f'<event at="0.5 s" robots="{"f " * 2_000_000}"><stop/></event>')
    )


def _attribute() -> str:
    return SCENARIO.format_map(
        _Missing(leader=POSE, events=f'<event at="{"1" * 4_000_000} s" robots="f"><stop/></event>')
    )


def _variant(rule: str, times: int = 0) -> Callable[[], str]:
    def text() -> str:
        head = '<variant xmlns="urn:formation-cosim:scenario:1" name="v" of="base.xml">\n<title>v</title>\n'
        return head + rule * (times or (MAX_BYTES - 200) // len(rule)) + "</variant>"

    return text


SINGLE: Mapping[str, Callable[[], str]] = {
    "events for 20 robots": lambda: _robots(20),
    "events for 5000 robots": lambda: _robots(5000),
    "deep nesting": _nested,
    "waypoints": _waypoints,
    "a robot named two million times": _names,
    "a number of four million digits": _attribute,
    "a variant that sets an attribute": _variant('<set select="simulation/@seed" value="2"/>\n'),
    "a variant that sets an attribute by //": _variant('<set select="//simulation/@seed" value="2"/>\n'),
    "a variant that inserts events": _variant(
        '<insert into="/scenario"><event at="0.5 s" robots="f"><stop/></event></insert>\n'
    ),
    "a variant that inserts 20,000 events at once": _variant(
        '<insert into=".">' + '<event at="0.5 s" robots="f"><stop/></event>\n' * 20_000 + "</insert>", 1
    ),
    "a variant with //a[//b]": _variant('<remove select="//expect[//follower]"/>\n'),
}
CASES: dict[str, Callable[[], str]] = {
    **{name: (lambda parts=parts: repeated(*parts)) for name, parts in REPEATED.items()},
    "more elements than are read": lambda: repeated(*REPEATED["changes of a place"], most=MAX_BYTES),
    **{
        f"{name}, wrong at the end": (lambda parts=parts: repeated(*parts, "<event/>"))
        for name, parts in REPEATED.items()
    },
    **SINGLE,
}


def case(name: str, folder: Path) -> None:
    """Read and set up a case, and print what it takes."""
    path = folder / "large.xml"
    text = CASES[name]()
    path.write_text(text, encoding="utf-8")
    (folder / "base.xml").write_text(SCENARIO.format_map(_Missing(leader=POSE)), encoding="utf-8")
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS + 10, SECONDS + 20))
    times = [time.process_time()]
    said = "is read and set up"
    try:
        scenario = read_scenario(path)
        times.append(time.process_time())
        with ExitStack() as cleanup:
            set_up(scenario, cleanup, {})
    except FormationError as error:
        said = f"{type(error).__name__}: {error}".replace(str(folder), "")
    times.append(time.process_time())
    took = " + ".join(f"{after - before:5.2f}" for before, after in pairwise(times))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"{name:50} {len(text.encode()) / 2**20:4.1f} MiB {took:14} s {memory:5} MB  {said[:100]}", flush=True)


def main() -> int:
    """Run all cases, each in a process of its own, or those whose names have a text."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.large", description=__doc__)
    parser.add_argument("only", nargs="?", default="", help="a part of the names of cases")
    options = parser.parse_args()
    for name in CASES:
        if options.only in name:
            with tempfile.TemporaryDirectory(prefix="large-") as folder:
                command = [sys.executable, "-m", "tests.fuzz.large", "--case", name, folder]
                if (done := subprocess.run(command, cwd=ROOT, check=False)).returncode:
                    print(f"{name:50} ends with status {done.returncode}", flush=True)
    return 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--case"]:
        case(sys.argv[2], Path(sys.argv[3]))
    else:
        sys.exit(main())

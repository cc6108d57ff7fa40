"""Environments of controllers that are none, or whose Python answers with garbage."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

from cosim.control import host_process
from cosim.control.hosts import Hosts
from cosim.control.law import find_law
from cosim.plant.protocol import HEADER
from cosim.scenario.reader import read_scenario
from tests.fuzz.mutations import VALUES

LINE = Path(__file__).parents[2] / "scenarios" / "clmr_line.xml"
START_LIMIT = 0.5
"""Time [s] after which a Python that says nothing is given up."""
LAW: dict[str, Any] = {
    "package": "formation-controllers",
    "version": "0.1.0",
    "content": "0c5f",
    "interface": "1.0",
    "vehicles": ["car_like"],
    "needs": [],
    "signals": [{"name": "a", "unit": "m", "description": "b", "components": []}],
    "gain_facts": {"K_p": {"default": 1.0}},
}
ANSWERS: list[Any] = [
    {"python": "3.11.7", "versions": {"numpy": "2.0"}},
    {"fault": "it is tired\u202e"},
    LAW,
    {"known": ["law", 1, None]},
    {"said": "no", "place": 0},
    {"K_p": 1.0, "k_d": [1.0, 2.0]},
]
SCRIPTS = [
    "exit {n}",
    "exec sleep 60",
    "exec 1>&-; exec sleep 60",
    "exec yes",
    "exec cat /dev/urandom",
    "kill -9 $$",
    'printf %s "$7"; exec yes',
    'printf %s "$7"; exec cat',
    'printf %s "$7"; exec 0<&-; exec cat "{reply}"',
    'printf %s "$7"; cat "{reply}"; exec sleep 60',
    'printf %s "$7"; cat "{reply}"; (exec sleep 60) & exit 0',
    'cat "{reply}"; printf %s "$7"; cat "{reply}"; exec sleep 60',
]
"""What stands in place of a Python; its seventh argument is the line after which a host answers."""


def hosts_case(seed: int, folder: Path, _: tuple[bytes, ...]) -> None:
    """Find the law of a scenario in an environment that is none; raise what comes of it."""
    rng = random.Random(seed)
    there = folder / f"environment {seed}"
    rng.choice(PLACES)(there, rng)
    path = folder / "case.xml"
    text = LINE.read_text("utf-8").replace("<controller ", f'<controller environment="{there.name}" time_limit="1 s" ')
    path.write_text(text, "utf-8")
    hosts = Hosts()
    try:
        with patch.object(host_process, "START_LIMIT", START_LIMIT):
            for source in read_scenario(path).controllers.values():
                find_law(source, hosts)
    finally:
        hosts.stop()
        shutil.rmtree(there, ignore_errors=True)
        there.unlink(missing_ok=True) if there.is_symlink() or there.is_file() else None


def _python(there: Path, rng: random.Random) -> Path:
    (there / "bin").mkdir(parents=True)
    return there / "bin" / "python"


def _script(there: Path, rng: random.Random) -> None:
    python, reply = _python(there, rng), there / "reply"
    reply.write_bytes(b"".join(_frame(rng) for _ in range(rng.randint(1, 4))))
    script = rng.choice(SCRIPTS).format(n=rng.randint(0, 255), reply=reply)
    python.write_text(f"#!/bin/sh\n{script}\n", "utf-8")
    python.chmod(rng.choice([0o755] * 9 + [0o644]))


def _frame(rng: random.Random) -> bytes:
    """Return an answer, often one that makes no sense."""
    told = json.loads(json.dumps(rng.choice(ANSWERS)))
    while isinstance(told, dict) and told and rng.random() < 0.5:
        key = rng.choice(list(told))
        told[key] = rng.choice([None, [], {}, -1, 1e308, "nan", rng.choice(VALUES), [[]] * 3, {"name": {}}])
    body = json.dumps(told).encode()
    if rng.random() < 0.2:
        body = rng.choice([body[: len(body) // 2], rng.randbytes(100), b"[" * 5000, b"NaN", b"\xff", b""])
    length = rng.choice([0, 1, len(body) + 1, 2**31, 2**32 - 1]) if rng.random() < 0.1 else len(body)
    return HEADER.pack(rng.choice([0, 0, 0, 0, 1, 2, 255]), length) + body


PLACES: list[Callable[[Path, random.Random], object]] = [
    *[_script] * 8,
    lambda there, rng: None,
    lambda there, rng: there.write_bytes(rng.randbytes(10)),
    lambda there, rng: there.mkdir(),
    lambda there, rng: there.symlink_to(rng.choice([there, there / "bin", "/", "/dev/zero", "/proc/self", "/nowhere"])),
    lambda there, rng: _python(there, rng).symlink_to(rng.choice(["/bin/cat", "/bin/true", "/nowhere", "python", "/"])),
    lambda there, rng: _python(there, rng).mkdir(),
    lambda there, rng: _python(there, rng).write_bytes(rng.randbytes(100)),
]

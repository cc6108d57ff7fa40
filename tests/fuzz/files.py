"""Results, checkpoints, studies, recordings, tables and SSPs that are damaged, and commands that read them."""

from __future__ import annotations

import io
import json
import random
import shutil
import zipfile
import zlib
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from cosim.cli import main
from cosim.master.checkpoint_file import MAGIC
from cosim.tests.driving import scenario
from cosim.tests.studies import write_study
from tests.fuzz.mutations import VALUES, archive, flipped, markup

STATUSES = {0, 1, 2, 3, 71}
"""How a command may end; a bag may claim to be larger than what memory there is."""
NUMBERS = (0.0, -1.0, 1e308, float("nan"), float("inf"), 5e-324, 2**31, 2**63, -(2**63), 10**400)
TEXTS = (*VALUES, "\ud800", "\0", "[", "{}")


def files_case(seed: int, folder: Path, _: tuple[bytes, ...]) -> None:
    """Damage a file, give a command that reads it, and raise what is neither a result nor a refusal."""
    rng = random.Random(seed)
    made = folder / "made"
    warm(folder)
    mutate, name, commands = rng.choice(READ)
    place = folder / "case"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(made, place)
    file = next(place.glob(name))
    file.write_bytes(mutate(file.read_bytes(), rng))
    command = rng.choice(commands)
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        try:
            status = main([argument.replace("@", str(place)) for argument in command])
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else 70
    if status not in STATUSES or "Traceback" in said.getvalue():
        raise AssertionError(f"{name} {' '.join(command)}: status {status}: {said.getvalue()[-1000:]}")


def warm(folder: Path) -> None:
    """Make the files that are damaged, once."""
    made = folder / "made"
    if made.exists():
        return
    part = folder / "making"
    part.mkdir()
    line = scenario(part / "line.xml", '<plant id="car" model="car_like"/>')
    (part / "study").mkdir()
    study = write_study(part / "study")
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        for command in (
            ["run", str(line), "--out", str(part / "runs"), "--no-figure"],
            ["run", str(line), "--out", str(part / "left"), "--no-figure", "--until", "0.5 s"],
            ["export", str(part / "runs" / "line"), "--out", str(part / "drive.csv")],
            ["export", str(part / "runs" / "line"), "--out", str(part / "drive.mcap")],
            ["export", str(line), "--ssp", str(part / "line.ssp")],
            ["study", str(study), "--out", str(part / "studies"), "--no-figure", "--workers", "1"],
        ):
            if main(command):
                raise RuntimeError(f"{command} failed")
    part.rename(made)


# Mutations ------------------------------------------------------------------------------------------------------


def _hdf5(data: bytes, rng: random.Random) -> bytes:
    """Return a result with a variable or a fact that is another one, or with other bytes."""
    if rng.random() < 0.4:
        return flipped(data, rng)
    whole = io.BytesIO(data)
    with h5py.File(whole, "r+") as file, suppress(ValueError, OSError, KeyError, TypeError, OverflowError):
        name = rng.choice(list(file))
        what = rng.randrange(6)
        if what == 0:
            del file[name]
        elif what == 1:
            values = file[name][()]
            del file[name]
            file[name] = values[: len(values) // 2] if np.ndim(values) else [values, values]
        elif what == 2:
            del file[name]
            file[name] = rng.choice(["text", 1, np.zeros((2, 3, 4)), np.zeros(0), np.array([b"a", b"bc"]), 1j])
        elif what == 3:
            values = file[name]
            values[...] = rng.choice([float("nan"), 1e308, -1.0, 0.0])
        else:
            facts = file.attrs if what == 4 else file[name].attrs
            key = rng.choice(list(facts))
            if rng.random() < 0.3:
                del facts[key]
            elif isinstance(facts[key], str) and rng.random() < 0.5:
                facts[key] = _text(facts[key], rng)
            else:
                facts[key] = rng.choice([1, "text", [1.0, 2.0], "", np.zeros(0), "{}", "\udc80"])
    return whole.getvalue()


def _text(text: str, rng: random.Random) -> str:
    """Return a text, JSON or XML or neither, with a change."""
    with suppress(ValueError):
        return json.dumps(_altered(json.loads(text), rng))
    return markup(text, rng)


def _json(data: bytes, rng: random.Random) -> bytes:
    """Return lines of JSON with another value in one of them, or with other bytes."""
    if rng.random() < 0.3:
        return flipped(data, rng)
    lines = data.decode().splitlines() if data.count(b"\n") > 1 and not data.startswith(b"{\n") else [data.decode()]
    at = rng.randrange(len(lines))
    with suppress(ValueError):
        lines[at] = json.dumps(_altered(json.loads(lines[at]), rng))
    return ("\n".join(lines) + "\n").encode()


def _altered(value: Any, rng: random.Random) -> Any:
    """Return a value of JSON in which one part, or itself, is something else."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        if rng.random() < 0.1:
            return {name: part for name, part in value.items() if name != key}
        return value | {key: _altered(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.9:
        at = rng.randrange(len(value))
        part = [] if rng.random() < 0.1 else [_altered(value[at], rng)]
        return [*value[:at], *part * rng.choice((1, 1, 2)), *value[at + 1 :]]
    return rng.choice([None, True, [], {}, [[]], rng.choice(NUMBERS), rng.choice(TEXTS)])


def _checkpoint(data: bytes, rng: random.Random) -> bytes:
    """Return a checkpoint with other facts or numbers whose checksum holds, or with other bytes."""
    if rng.random() < 0.2:
        return flipped(data, rng)
    begin = len(MAGIC) + 8
    end = begin + int.from_bytes(data[len(MAGIC) : begin], "little")
    facts, arrays = json.loads(data[begin:end]), bytearray(data[end:-4])
    if rng.random() < 0.7:
        facts = _altered(facts, rng)
    else:
        for _ in range(rng.choice((1, 8, 1000))):
            arrays[rng.randrange(len(arrays))] = rng.choice((0, 255, rng.randrange(256)))
    about = json.dumps(facts).encode()
    body = MAGIC + len(about).to_bytes(8, "little") + about + bytes(arrays)
    return body + zlib.crc32(body).to_bytes(4, "little")


def _table(data: bytes, rng: random.Random) -> bytes:
    """Return a table with another cell, column or line, or with other bytes."""
    if rng.random() < 0.3:
        return flipped(data, rng)
    lines = [line.split(",") for line in data.decode().splitlines()]
    for _ in range(rng.choice((1, 1, 3))):
        row = rng.choice(lines[:4] if rng.random() < 0.5 else lines)
        if row:  # else a line without cells, which was put in
            row[rng.randrange(len(row))] = rng.choice(TEXTS)
        if rng.random() < 0.2:
            lines.insert(rng.randrange(len(lines)), rng.choice(lines)[: rng.randrange(20)])
    return "\n".join(map(",".join, lines)).encode("utf-8", "surrogatepass")


def _ssp(data: bytes, rng: random.Random) -> bytes:
    """Return an SSP with another description of the system or of its parameters, or a damaged FMU in it."""
    if rng.random() < 0.2:
        return flipped(data, rng)
    with zipfile.ZipFile(io.BytesIO(data)) as whole:
        content = {name: whole.read(name) for name in whole.namelist()}
    name = rng.choice(list(content))
    if name.endswith(".fmu"):
        content[name] = archive(content[name], rng)
    else:
        text = content[name].decode()
        for _ in range(rng.randint(1, 3)):
            text = markup(text, rng)
        content[name] = text.encode("utf-8", "surrogatepass")
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as mutated:
        for name, part in content.items():
            mutated.writestr(zipfile.ZipInfo(name), part)
    return target.getvalue()


_LOOK = [
    ["show", "@/runs/line"],
    ["show", "@/runs/line", "--figure", "@/figure.png"],
    ["report", "@/runs/line"],
    ["export", "@/runs/line", "--out", "@/new.csv"],
    ["export", "@/runs/line", "--out", "@/new.mcap"],
    ["export", "@/runs/line", "--out", "@/new.mat"],
    ["judge", "@/runs/line/result.nc", "--scenario", "@/line.xml", "--out", "@"],
]
_JUDGE = ["--scenario", "@/line.xml", "--out", "@"]
_RESUME = ["resume", "@/left/line", "--no-figure", "--no-report"]
_STUDY = ["study", "@/study/study.xml", "--out", "@/studies", "--no-figure", "--workers", "0"]
READ: list[tuple[Callable[[bytes, random.Random], bytes], str, list[list[str]]]] = [
    *[(_hdf5, "runs/*/result.nc", _LOOK)] * 3,
    (_json, "runs/*/summary.json", _LOOK),
    *[(_checkpoint, "left/*/checkpoints/*25.checkpoint", [_RESUME, [*_RESUME, "--at", "0.5 s", "--horizon", "0.6 s"]])]
    * 2,
    (_json, "studies/*/rows.jsonl", [_STUDY]),
    (_json, "studies/*/summary.json", [["report", "@/studies/small"], _STUDY]),
    (_table, "studies/*/runs.csv", [["report", "@/studies/small"]]),
    (_hdf5, "studies/*/runs.nc", [["report", "@/studies/small"]]),
    (_table, "drive.csv", [["judge", "@/drive.csv", *_JUDGE]]),
    (lambda data, rng: flipped(data, rng), "drive.mcap", [["judge", "@/drive.mcap", *_JUDGE]]),
    *[(_ssp, "line.ssp", [["import", "@/line.ssp", "--out", "@/again.xml"]])] * 2,
]
"""How a file is damaged, its name, and commands that read it."""

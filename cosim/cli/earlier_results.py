"""Takes the results of an earlier run of a scenario out of the way before a new one begins.

So no summary of an earlier run is taken for that of a run that was killed.
"""

from __future__ import annotations

import hashlib
import os
import re
import shlex
import shutil
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from cosim.errors import InputError
from cosim.master.checkpoint_folder import FOLDER, HeldFolder, latest
from cosim.results.netcdf import attributes_of
from cosim.results.provenance import Provenance
from cosim.scenario.edits import split_setting

RESULT, VERDICTS = "result.nc", ("summary.json", "figure.png", "report.html")
FILES = (*VERDICTS, RESULT)
"""The files of a run. The result is moved last, because it identifies the run."""
BEFORE, CHECKPOINTS_BEFORE = "result.before.nc", f"{FOLDER}.before"
"""The result and the checkpoints of an earlier run of the same file and changes, until the new one is complete."""
_LONGEST = 60
_STEP = re.compile(r"""(?:[^/[]|\[(?:'[^']*'|"[^"]*"|[^]'"])*\])+""")
"""A step of an XPath, with what is asked of it in brackets."""
_ID = re.compile(
    r"""(?P<name>\*|@?[\w.:-]*) (?: \[ \s*@(?:id|name)\s*=\s* (?P<quote>['"])(?P<id>.*?)(?P=quote) \s*\] )? .*""", re.X
)
"""Name, and id or name, that a step asks for."""
_UNIT = re.compile(r"^([-+\d.e]+) (\S+)$")
"""A number with its unit."""


def set_aside(
    folder: Path, file: Path, changes: tuple[str, ...], checkpoints: bool = True
) -> tuple[Path, Provenance] | None:
    """Take the files of an earlier run away before a run begins; all but a result can be made anew from it.

    If it was of another file or changed otherwise, they go to a folder beside it that is named after its changes. If
    not, its result and its checkpoints are renamed to `BEFORE` and `CHECKPOINTS_BEFORE`, the other files are removed,
    and `replaced` removes these.

    Parameters
    ----------
    folder
        The folder of the run.
    file, changes
        The scenario's file and its changes.
    checkpoints
        Whether the checkpoints there are those of the earlier run; otherwise they stay.

    Returns
    -------
    tuple or None
        The new place of the files, and their provenance; None if there is nothing to keep.

    Raises
    ------
    OSError
        They cannot be kept.
    InputError
        Another command writes checkpoints there.
    """
    if not folder.is_dir():
        return None
    if checkpoints and (folder / FOLDER).is_dir():
        HeldFolder(folder / FOLDER).close()  # before anything is moved
    if not (folder / RESULT).exists():  # the last run has left none: the one before has not been replaced
        with suppress(FileNotFoundError):
            os.replace(folder / BEFORE, folder / RESULT)
    result = _provenance(folder / RESULT)
    checkpoints = checkpoints and (folder / FOLDER).is_dir()
    earlier = result or (_of_checkpoints(folder / FOLDER) if checkpoints else None)
    if earlier is not None and earlier.variant != Provenance(str(file), changes).variant:
        place = _place(folder, earlier)
        try:
            place.mkdir(exist_ok=True)
            for name in FILES:
                (place / name).unlink(missing_ok=True)
                if (folder / name).exists():
                    os.replace(folder / name, place / name)
            if checkpoints:
                _move(folder / FOLDER, place / FOLDER)
        except OSError:
            _remove(folder, VERDICTS)
            raise
        return place, earlier
    _remove(folder, VERDICTS)
    if result is not None:
        os.replace(folder / RESULT, folder / BEFORE)
    if checkpoints:
        set_checkpoints_aside(folder)
    return None


def _place(folder: Path, earlier: Provenance) -> Path:
    """Return the folder beside that of a run which an earlier run goes to: one without a run of another file."""
    place = folder.with_name(f"{folder.name}+{label(earlier, folder.name)}")
    there = _provenance(place / RESULT) or _of_checkpoints(place / FOLDER)
    if there is None or there.variant == earlier.variant:
        return place
    return folder.with_name(f"{folder.name}+{label(earlier, folder.name, os.path.splitext(earlier.file)[0])}")


def replaced(folder: Path) -> None:
    """Remove the result of an earlier run of the same file and changes, as there is a new one."""
    _remove(folder, (BEFORE,))
    shutil.rmtree(folder / CHECKPOINTS_BEFORE, ignore_errors=True)


def set_checkpoints_aside(folder: Path) -> None:
    """Take the checkpoints of an earlier run away, until `replaced` removes them.

    Raises
    ------
    OSError, InputError
        As `set_aside`.
    """
    if (folder / FOLDER).is_dir():
        _move(folder / FOLDER, folder / CHECKPOINTS_BEFORE)


def _move(folder: Path, place: Path) -> None:
    """Move checkpoints to another place, unless a command writes them."""
    with HeldFolder(folder):
        shutil.rmtree(place, ignore_errors=True)
        if folder.exists():
            os.replace(folder, place)


def _of_checkpoints(folder: Path) -> Provenance | None:
    """Return the provenance of a run that has left checkpoints only, as it was killed."""
    with suppress(InputError):
        if (found := latest(folder)) is not None:
            return Provenance(str(found.scenario.path), found.scenario.changes)
    return None


def _remove(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        with suppress(OSError):
            (folder / name).unlink(missing_ok=True)


def _provenance(path: Path) -> Provenance | None:
    """Return the provenance of a result; None if there is no result, or one without provenance."""
    try:
        attributes = attributes_of(path)
        return Provenance.of(attributes) if "changes" in attributes else None
    except Exception:  # no result that can be kept
        return None


def label(provenance: Provenance, name: str, file: str = "") -> str:
    """Return a short name of a file and changes, another one for others; the file is its stem, unless one is given."""
    stem = file or Path(provenance.file).stem
    parts = [(stem, stem)] if stem != name else []
    parts += [(change, _readable(change)) for change in provenance.changes] or [("unchanged", "unchanged")]
    short = "+".join(re.sub(r"[^\w.=-]+", "_", readable).strip("_") for _, readable in parts)
    exact = "+".join(change.removeprefix("--").replace(" ", "=", 1) for change, _ in parts)
    if short == exact and len(short) <= _LONGEST:
        return short
    return f"{short[:_LONGEST].rstrip('_.=-+')}-{hashlib.sha256(exact.encode()).hexdigest()[:8]}"


def _readable(change: str) -> str:
    """Return a change in few words: of a setting, which elements by their ids and names, and the attribute.

    ``--set "//plant[@id='clmr']/parameter[@name='m_c']/@value=45 kg"`` is ``clmr.m_c=45kg``.
    """
    option, _, words = change.removeprefix("--").partition(" ")
    with suppress(ValueError):
        words = " ".join(shlex.split(words))
    if option == "set":
        with suppress(InputError):
            xpath, words = split_setting(words)
            steps = [_ID.fullmatch(step) for step in _STEP.findall(xpath)]
            named = [step["id"] or step["name"] or step[0] if step else "" for step in steps]
            option = ".".join(name.strip("@") for name in named if name not in ("", "@value"))
    words = _UNIT.sub(r"\1\2", words)
    return f"{option}={words}" if words else option

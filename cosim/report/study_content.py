"""What a page shows of a study, as plain data, from the files of its folder alone; `docs/studies.md` lists them."""

from __future__ import annotations

import base64
import csv
import json
import math
import re
import shlex
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.report.content import Json, content_of
from cosim.report.paths import with_distances
from cosim.results.files import load_result, load_run
from cosim.results.json_numbers import without_nan
from cosim.results.netcdf import attributes_of
from cosim.results.result import Result, Variable

SUMMARY, TABLE, ROWS = "summary.json", "runs.nc", "rows.jsonl"
MOST_ROWS = 50_000
"""Rows of the table; about 60 bytes of the page each."""
MOST_PLAYED = 12
"""Runs with playback."""
MOST_CASES = 400
_LARGEST_PICTURE = 4_000_000
_PICTURES = {
    "figure.png": "The measures of all runs, over what varies",
    "envelope.png": "All runs together: paths, or signals over time",
}
_LARGEST_EXACT = 2**53 - 1
"""The largest whole number up to which JavaScript tells any two apart."""
_NUMBER = re.compile(r"run_([0-9]{1,9})(\.xml)?")


def is_study(folder: Path) -> bool:
    """Return whether a folder is that of a study rather than that of a run."""
    having = any((folder / name).exists() for name in (TABLE, ROWS))
    return folder.is_dir() and having and not (folder / "result.nc").exists()


def study_of(folder: Path) -> tuple[Json, list[Json]]:
    """Return what a page shows of a study, and of its runs whose full results are kept.

    Raises
    ------
    InputError
        The folder is not that of a study, or a file in it cannot be read.
    """
    summary = _summary(folder)
    table = Result.of(load_result(folder / TABLE))
    if "run" not in table or not table.sizes.get("run"):
        raise InputError(f"{folder / TABLE} is not the table of a study, or it holds no run")
    if str(table.attrs.get("mark", "")) != summary.pop("mark"):
        raise InputError(
            f"{folder / SUMMARY} and {TABLE} are not of the same study and runs: `formation study` writes both anew"
        )
    keys = _keys(table)
    kept = {number: path for number, path in _kept(folder).items() if number in keys}
    to_see = {number: path for number, path in _to_see(folder).items() if number in keys}
    others: list[int] = []
    runs = with_distances(_played(dict([*kept.items()][:MOST_PLAYED]), keys, others))
    others += [number for number in [*kept][MOST_PLAYED:] if not _is_of(kept[number], keys[number])]
    left_out = [kept.pop(number).parent.as_posix() for number in others]
    rows = _rows(table, {*kept, *to_see})
    content = {
        **summary,
        "measures": [_with_infinite(measure, table) for measure in summary["measures"]],
        "left_out": left_out,
        "rows": len(rows),
        "table": _packed(_columns(table, rows)),
        "cases": _cases(folder / "cases.csv"),
        "pictures": [*_pictures(folder)],
        "to_see": to_see,
        "kept": {number: path.parent.as_posix() for number, path in kept.items()},
        "keep": _keep(folder, summary),
        "text": str(table.attrs.get("text", "")),
    }
    return without_nan(content), runs


# The summary ------------------------------------------------------------------------------------------------


def _summary(folder: Path) -> Json:
    path = folder / SUMMARY
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"the folder {folder} holds no {SUMMARY}; expected the folder of a study, runs/NAME, as `formation study` "
            "leaves it"
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    try:
        return {
            "name": str(told["study"]),
            "mark": str(told.get("mark", "")),
            "title": str(told["title"]),
            "file": str(told["scenario"]),
            "changes": [str(change) for change in told.get("changes", ())],
            "planned": int(told["planned"]),
            "runs": int(told["runs"]),
            "early": bool(told["ended_early"]),
            "counts": {status: int(told[status]) for status in ("passed", "failed", "broken")},
            "measures": list(map(dict, told["measures"])),
            "bounds": list(map(dict, told.get("bounds", ()))),
            "tuned": list(map(dict, told.get("tuned", ()))),
            "sensitivity": list(map(dict, told.get("sensitivity", ()))),
            "worst": dict(told["worst"]) if told.get("worst") else None,
            "verdicts": list(map(_verdict, told["verdicts"])),
        }
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"{path} is not the summary of a study: {type(error).__name__}: {error}") from None


def _with_infinite(measure: Mapping[str, Any], table: Result) -> Json:
    """Return a measure with infinite quantiles as texts; the summary leaves them out, the runs have their sign."""
    name = str(measure.get("measure"))
    infinite = table[name].values if name in table else np.empty(0)
    sign = _not_finite(-math.inf if np.isneginf(infinite).any() else math.inf)
    return {key: sign if value is None else value for key, value in measure.items()}


def _verdict(data: Mapping[str, Any]) -> Json:
    return {name: value for name, value in dict(data).items() if name not in ("where", "robot", "moment")}


def _keep(folder: Path, summary: Json) -> str:
    """Return the command that keeps the full result of a run, of which the run's number alone is missing."""
    words = ["formation", "study", summary["file"]]
    for change in summary["changes"]:
        words += ["--set", change]
    if summary["runs"] < summary["planned"] and not summary["early"] and not summary["tuned"]:
        words += ["--runs", str(summary["runs"])]
    if folder.parent != Path("runs"):
        words += ["--out", str(folder.parent)]
    return shlex.join([*words, "--keep"])


# The table --------------------------------------------------------------------------------------------------


def _rows(table: Result, remarkable: set[int]) -> NDArray[np.int64]:
    """Return which rows are shown: all, or of very many evenly spaced ones, the extremes, and those to look at."""
    runs = table.sizes["run"]
    if runs <= MOST_ROWS:
        return np.arange(runs)
    chosen = {*range(0, runs, -(-runs // MOST_ROWS))}
    chosen.update(np.flatnonzero(np.isin(table["run"].values, list(remarkable))).tolist())
    for column in table.data_vars.values():
        if column.dims == ("run",) and column.values.dtype.kind == "f" and not np.isnan(column.values).all():
            chosen.update((int(np.nanargmin(column.values)), int(np.nanargmax(column.values))))
    return np.array(sorted(chosen))


def _columns(table: Result, rows: NDArray[np.int64]) -> list[Json]:
    names = ["run", "draw", *(name for name in (*table.coords, *table.data_vars) if name not in ("run", "draw"))]
    return [
        {
            "name": name,
            "kind": str(column.attrs.get("kind", "")),
            "unit": str(column.attrs.get("units", "")),
            "about": str(column.attrs.get("long_name", "")),
            **({"exact": True} if _is_large(column) else {}),
            "values": _values(column, rows),
        }
        for name in names
        if name in table and name not in ("passed", "run_key") and (column := table[name]).dims == ("run",)
    ]


def _is_large(column: Variable) -> bool:
    """Return whether a column of whole numbers, such as seeds, has some that JavaScript would round."""
    values = column.values
    return values.dtype.kind in "iu" and bool(((values > _LARGEST_EXACT) | (values < -_LARGEST_EXACT)).any())


def _values(column: Variable, rows: NDArray[np.int64]) -> list[Any]:
    """Return whole numbers and texts as they are, others with six digits; of what JSON lacks, the infinite as texts.

    Whole numbers are texts if one of them is too large for JavaScript.
    Numbers that are nearer to one another than to zero have as many digits as six of their distances need.
    """
    values = column.values[rows]
    if _is_large(column):
        return [str(value) for value in values.tolist()]
    if values.dtype.kind in "iub":
        return [int(value) for value in values]
    if values.dtype.kind == "f":
        finite = values[np.isfinite(values)].tolist()
        apart = max(finite) - min(finite) if finite else 0.0
        return [_short(value, apart) if math.isfinite(value) else _not_finite(value) for value in values.tolist()]
    return [str(value) for value in values.tolist()]


def _short(value: float, apart: float) -> float:
    if value.is_integer():
        return value
    if 0.0 < apart < abs(value):
        return round(value, 5 - math.floor(math.log10(apart)))
    return float(f"{value:.6g}")


def _not_finite(value: float) -> str | None:
    return None if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"


def _packed(columns: Sequence[Json]) -> str:
    """Return the columns as JSON, deflated, in base 64."""
    text = json.dumps(columns, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(zlib.compress(text.encode("utf-8", "replace"))).decode("ascii")


def _cases(path: Path) -> list[list[str]]:
    """Return the table of cases, headings first; empty if there is none."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return [row for _, row in zip(range(MOST_CASES + 1), csv.reader(file), strict=False)]
    except (OSError, ValueError, csv.Error):
        return []


# Pictures and runs ------------------------------------------------------------------------------------------


def _pictures(folder: Path) -> Iterator[Json]:
    for name, about in _PICTURES.items():
        path = folder / name
        try:
            if path.stat().st_size <= _LARGEST_PICTURE:
                data = base64.b64encode(path.read_bytes()).decode("ascii")
                yield {"name": name, "about": about, "data": f"data:image/png;base64,{data}"}
        except OSError:
            continue


def _kept(folder: Path) -> dict[int, Path]:
    """Return the full results that are kept, by the number of their run."""
    found = (folder / "kept").glob("run_*/result.nc")
    numbered = ((_NUMBER.fullmatch(path.parent.name), path) for path in found)
    return dict(sorted((int(match[1]), path) for match, path in numbered if match))


def _to_see(folder: Path) -> dict[int, str]:
    """Return the runs that are there as scenarios, by their number."""
    numbered = ((_NUMBER.fullmatch(path.name), path) for path in (folder / "runs_to_see").glob("run_*.xml"))
    return dict(sorted((int(match[1]), path.as_posix()) for match, path in numbered if match))


def _keys(table: Result) -> dict[int, str]:
    """Return the key of each run of a table as far as it is told; it is empty in a table of an older version."""
    keys = table["run_key"].values if "run_key" in table else [""] * table.sizes["run"]
    return {int(number): str(key) for number, key in zip(table["run"].values, keys, strict=True)}


def _is_of(path: Path, key: str) -> bool:
    """Tell whether a result is of the run with a key; one that cannot be read is not."""
    with suppress(OSError):
        return str(attributes_of(path).get("study_run", "")).startswith(key)
    return False


def _played(kept: Mapping[int, Path], keys: Mapping[int, str], others: list[int]) -> Iterator[tuple[Result, Json]]:
    """Return each run, and what a page shows of it; one that has no sample, or cannot be read, has no playback.

    ``others`` gets the numbers of results that are of another run than the table's of that number.
    """
    for number, path in kept.items():
        with suppress(InputError, KeyError):
            result = load_run(path)
            if str(result.attrs.get("study_run", "")).startswith(keys[number]):
                yield result, {**content_of(result, share=len(kept)), "number": number}
            else:
                others.append(number)

"""What the FMUs of all kinds of models share: runtime, headers, templates, and the GUID that stands for the content."""

import hashlib
import importlib.metadata
import importlib.util
import math
import string
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from plants.errors import BuildError

TEMPLATE = Path(__file__).parent / "template"
RUNTIME = ("instance.c", "instance.h", "simulation.h", "values.c", "values.h", "variables.h")
"""Of every kind of model, beside the file of the version of FMI."""


@dataclass(frozen=True)
class Version:
    """Differences between the versions of FMI: runtime, headers; by path in the FMU, templates and other files."""

    runtime: str
    headers: tuple[str, ...]
    templates: dict[str, str]
    files: dict[str, str]


VERSIONS = {
    "2.0": Version(
        "fmi2.c",
        ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
        {"modelDescription.xml": "modelDescription2.xml.jinja"},
        {"model.png": "icon.png"},
    ),
    "3.0": Version(
        "fmi3.c",
        ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
        {
            "modelDescription.xml": "modelDescription3.xml.jinja",
            "sources/buildDescription.xml": "buildDescription.xml.jinja",
            "terminalsAndIcons/terminalsAndIcons.xml": "terminalsAndIcons.xml.jinja",
        },
        {"terminalsAndIcons/icon.png": "icon.png", "terminalsAndIcons/icon.svg": "icon.svg"},
    ),
}


def tool() -> str:
    """Return the name and version of this tool, for the FMU's description."""
    try:
        return f"Formation {importlib.metadata.version('formation-cosim')}"
    except importlib.metadata.PackageNotFoundError:  # used from a source tree that is not installed
        return "Formation"


def runtime_of(version: Version, kind: Iterable[str]) -> dict[str, bytes]:
    """Return the hand-written files of an FMU by path: the runtime with those of a kind of model, headers, icons."""
    paths = [TEMPLATE / name for name in (version.runtime, *RUNTIME, *kind)]
    files = {f"sources/{path.name}": path.read_bytes() for path in paths}
    files |= {f"sources/{name}": _fmi_header(name) for name in version.headers}
    return files | {path: (TEMPLATE / name).read_bytes() for path, name in version.files.items()}


def rendered(files: Mapping[str, bytes], templates: Mapping[str, str], context: Mapping[str, Any]) -> dict[str, bytes]:
    """Return all files of an FMU: those given, and templates by path. The GUID is the digest of everything else."""
    sources = sorted(
        name.removeprefix("sources/")
        for name in (*files, *templates)
        if name.startswith("sources/") and name.endswith(".c")
    )
    known = {**context, "source_files": sources, "tool": tool(), "infinity": math.inf}

    def render(guid: str) -> dict[str, bytes]:
        return {**files} | {
            path: _JINJA.get_template(name).render(known, guid=guid).encode() for path, name in templates.items()
        }

    digest = hashlib.sha256()
    for path, content in sorted(render(guid="").items()):
        digest.update(f"{path} {len(content)}\n".encode() + content)
    return render(guid=f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}")


def _fmi_header(name: str) -> bytes:
    fmpy = importlib.util.find_spec("fmpy")
    for folder in (fmpy.submodule_search_locations or ()) if fmpy else ():
        path = Path(folder) / "c-code" / name
        if path.is_file():
            return path.read_bytes()
    raise BuildError(f"the FMI header {name} is not there: it comes with FMPy; install it with 'pip install fmpy'")


def _c_string(text: str) -> str:
    """Return a C string literal in UTF-8; an octal escape always ends after three digits."""
    plain = {ord(c) for c in string.ascii_letters + string.digits + string.punctuation + " "} - set(b'"\\?')
    return '"' + "".join(chr(byte) if byte in plain else f"\\{byte:03o}" for byte in text.encode()) + '"'


def _c_number(value: float) -> str:
    return ("INFINITY" if value > 0 else "-INFINITY") if math.isinf(value) else repr(float(value))


def _c_comment(text: str) -> str:
    return " ".join(text.split()).replace("*/", "* /")


_JINJA = jinja2.Environment(
    loader=jinja2.FileSystemLoader(TEMPLATE),
    autoescape=lambda name: name is not None and name.endswith((".xml.jinja", ".html.jinja")),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_JINJA.filters |= {"c_string": _c_string, "c_number": _c_number, "c_comment": _c_comment}

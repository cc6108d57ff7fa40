"""`build` joins the steps: generate, compile, package. The store gives back an FMU that was built before.

SymPy, Jinja and FMPy's headers are touched only if something has to be generated.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import plants
from plants.errors import BuildError
from plants.factory import store
from plants.factory.compile import Compiler, compile_library, cross_compiler, find_compiler
from plants.factory.package import package
from plants.factory.platforms import Platform, choose, host, universal
from plants.sampled import Sampled

if TYPE_CHECKING:
    from plants.ode import OdeModel

FMI_VERSIONS = {"2": "2.0", "2.0": "2.0", "3": "3.0", "3.0": "3.0"}
"""Spellings of a version that a user may write, and the version."""


def build(
    model: "str | OdeModel | Sampled",
    *,
    fmi: str,
    platforms: str | Iterable[str] | None,
    out: Path | str | None,
    cache: bool,
    starts: Mapping[str, float | str],
) -> Path:
    """Make the FMU of a model; see `plants.build`."""
    if fmi not in FMI_VERSIONS:
        raise BuildError(f"FMI {fmi} is not offered; choose {' or '.join(sorted(set(FMI_VERSIONS.values())))}")
    version = FMI_VERSIONS[fmi]
    if platforms is None:
        compilers = {host(): find_compiler()}
    else:
        compilers = {platform: cross_compiler(platform) for platform in choose(platforms, version)}
    if isinstance(model, Sampled) and model.program:
        compilers = _of_unix(compilers)
    tools = [store.package_digest(), version]
    for platform, compiler in compilers.items():
        tools += [platform.name, *compiler.command, compiler.version]

    # This package determines the FMU of a built-in model; the FMU of any other model is known once it is generated.
    name, files = (model, None) if isinstance(model, str) else (model.name, _generate(model, version, starts))
    contents = [part for item in sorted((files or {}).items()) for part in item]
    begun = [f"{variable}={value!r}" for variable, value in sorted(starts.items())]
    key = store.digest([name, *contents, *begun, *tools])

    def make(path: Path) -> None:
        _make(name, version, files or _generate(plants.load(name), version, starts), compilers, path)

    fmu = store.place(key, name)
    wanted = fmu if out is None else Path(out) / fmu.name
    try:
        if not (cache and store.holds(fmu)):
            store.keep(fmu, make)
    except store.CannotKeep:
        if wanted == fmu:
            raise
        return store.write(wanted, make)  # without a cache, then
    return fmu if out is None else store.copy(fmu, wanted)


def _of_unix(compilers: dict[Platform, Compiler]) -> dict[Platform, Compiler]:
    """Return those that a model with a program beside it can do with."""
    kept = {platform: compiler for platform, compiler in compilers.items() if platform.suffix != ".dll"}
    if not kept:
        raise BuildError("this FMU starts a program beside it, which it can do on Linux and macOS only")
    return kept


def _generate(model: "OdeModel | Sampled", fmi: str, starts: Mapping[str, float | str]) -> dict[str, bytes]:
    if isinstance(model, Sampled):
        from plants.factory.generate_sampled import generate_sampled

        return generate_sampled(model, fmi)
    from plants.factory.generate import generate

    return generate(model, fmi, starts)


def _make(name: str, fmi: str, files: dict[str, bytes], compilers: dict[Platform, Compiler], fmu: Path) -> None:
    """Write the files to a folder beside `fmu`, compile the sources among them for each platform, and zip it all."""
    root = fmu.parent / "content"
    for path, content in files.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(content)
    sources = sorted(path for path in files if path.endswith(".c"))
    libraries: dict[str, list[bytes]] = {}
    for platform, compiler in compilers.items():
        path = f"binaries/{platform.folder(fmi)}/{name}{platform.suffix}"
        libraries.setdefault(path, []).append(compile_library(compiler, platform, root, sources, name))
    for path, parts in libraries.items():
        (root / path).parent.mkdir(parents=True)
        (root / path).write_bytes(parts[0] if len(parts) == 1 else universal(parts))
    package(root, fmu)

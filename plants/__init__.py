"""Vehicle models stated in Python, and the factory that turns a model into a source FMU.

>>> plants.models()                       # the built-in models, one line each
>>> plants.load("car_like")               # the model as a plants.ode.OdeModel
>>> plants.build("car_like")              # the path of its FMU, built now or before

Importing this package, listing the models and building one that has been built before load neither SymPy nor FMPy.
"""

import difflib
import importlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from plants.errors import BuildError, ModelError, NoCompiler, PlantError, UnitError, UnknownModel

if TYPE_CHECKING:
    from plants.ode import OdeModel
    from plants.sampled import Sampled

__all__ = [
    "BuildError",
    "ModelError",
    "NoCompiler",
    "PlantError",
    "UnitError",
    "UnknownModel",
    "build",
    "load",
    "models",
]


def models() -> dict[str, str]:
    """Return the built-in models, name and one-line description: the folders here that hold a ``model.py``."""
    names = sorted(path.parent.name for path in Path(__file__).parent.glob("*/model.py"))
    return {name: str(importlib.import_module(f"plants.{name}").__doc__).splitlines()[0].rstrip(".") for name in names}


def load(name: str) -> "OdeModel":
    """Return a built-in model.

    Raises
    ------
    UnknownModel
        There is none of this name; the error names the known ones.
    """
    _check_known(name)
    model: OdeModel = importlib.import_module(f"plants.{name}.model").model()
    return model


def build(
    model: "str | OdeModel | Sampled",
    *,
    fmi: str = "2.0",
    platforms: str | Iterable[str] | None = None,
    out: Path | str | None = None,
    cache: bool = True,
    starts: Mapping[str, float | str] | None = None,
) -> Path:
    """Make the FMU of a model, unless it has been made before.

    Parameters
    ----------
    model
        Name of a built-in model, or a model: an ordinary differential equation, or a sampled model.
    fmi
        Version of FMI: ``2.0`` or ``3.0`` (``2`` and ``3`` mean the same). Either way the FMU holds both
        Co-Simulation and Model Exchange, that of a sampled model Co-Simulation alone.
    platforms
        Names of the platforms to compile for, or ``all``, by the compiler that the Python package ziglang brings. By
        default this machine's platform alone, by its own C compiler.
    out
        A folder to copy the FMU to, made if need be. By default the FMU stays in the cache.
    cache
        Whether an FMU made before from the same sources by the same compiler will do. It is kept in
        ``$FORMATION_CACHE`` or in the user's cache folder.
    starts
        Start values in place of the model's, of states and parameters by their names; of an enumeration the item. Such
        an FMU has no reference experiment.

    Returns
    -------
    Path
        The FMU, named after the model: ``car_like.fmu``.

    Raises
    ------
    UnknownModel
        There is no built-in model of this name.
    ModelError
        The model uses a function that cannot be written in C, or not differentiated; or a start value does not fit.
    BuildError
        The FMU could not be made: a version of FMI or a platform that is not known, no compiler (NoCompiler), a
        compiler that fails, a folder that cannot be written.
    """
    if isinstance(model, str):
        _check_known(model)
    from plants.factory.build import build as build_fmu

    return build_fmu(model, fmi=fmi, platforms=platforms, out=out, cache=cache, starts=starts or {})


def _check_known(name: str) -> None:
    known = models()
    if name not in known:
        nearest = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {nearest[0]!r}? " if nearest else ""
        raise UnknownModel(f"there is no plant model {name!r}; {hint}known: {', '.join(known)}")

"""Plants, their bindings, and controllers."""

from __future__ import annotations

import os
from pathlib import Path

from cosim.clock import whole
from cosim.errors import InputError, Location
from cosim.scenario.document import read_binding_document
from cosim.scenario.reader.element import Element, settings
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import FIRST_STEP, OPEN, BindingSource, ControllerSource, PlantSource, RoleSource
from cosim.vehicle.kinds import kind_named


def plant(element: Element, times: Times, untrusted: tuple[Path, ...]) -> PlantSource:
    """Read a plant; an FMU in an untrusted folder is isolated."""
    model, fmu = element.attributes.get("model"), element.attributes.get("fmu")
    if (model is None) == (fmu is None):
        raise element.error("a <plant> needs either model=... (a built-in model) or fmu=... (a file)")
    path = None if fmu is None else element.path("fmu")
    distrusted = path is not None and any(Path(os.path.realpath(path)).is_relative_to(folder) for folder in untrusted)
    return PlantSource(
        id=element.get("id"),
        model=model,
        fmu=path,
        binding=_binding_of(element),
        interface=element.get("interface"),
        solver=element.get("solver"),
        solver_steps=_solver_steps(element, times.step),
        tolerance=_tolerance(element),
        late_outputs=element.get("start") == FIRST_STEP,
        isolated=element.get("isolate") in ("process", "robot") or distrusted,
        apart=element.get("isolate") == "robot",
        trusted=element.get("isolate") == "no" and not distrusted,
        time_limit=element.positive("time_limit", "s") if "time_limit" in element else None,
        logging="log" in element,
        parameters=settings(element, "parameter"),
        where=element.where,
    )


def controller(element: Element) -> ControllerSource:
    """Read a controller."""
    return ControllerSource(
        id=element.get("id"),
        name=element.get("name"),
        package=element.get("package"),
        version=element.get("version"),
        gains=settings(element, "gain"),
        where=element.where,
        environment=element.path("environment") if "environment" in element else None,
        time_limit=_time_limit(element),
    )


def _time_limit(element: Element) -> float | None:
    """Read the time limit of a controller, which only one in a process of its own can have."""
    if "time_limit" not in element:
        return None
    if "environment" not in element:
        raise element.error("the time_limit of a <controller> is for one with an environment: give it one, or none")
    return element.positive("time_limit", "s")


def binding(element: Element) -> BindingSource:
    """Read a binding."""
    roles: dict[str, RoleSource] = {}
    for child in element.children("role"):
        name = child.get("name")
        if name in roles:
            raise child.error(f"the role {name!r} is given twice")
        for attribute, value in child.attributes.items():
            if value == OPEN:
                raise child.error(f'the role {name!r} has {attribute}="{OPEN}", which is to be filled in')
        if ("variable" in child) == ("value" in child):
            raise child.error("a <role> needs either a variable or a value")
        if "value" in child and len(child.attributes) > 2:
            raise child.error("a <role> with a value takes no other attribute but its name")
        roles[name] = RoleSource(**child.attributes, where=child.where)
    vehicle = element.get("vehicle")
    try:
        kind_named(vehicle)
    except InputError as error:
        raise element.error(f'vehicle="{vehicle}" of <binding>: {error.message}') from None
    return BindingSource(vehicle, tuple(roles.values()), element.where)


def read_binding(path: str | Path) -> BindingSource:
    """Read a file with a binding.

    Raises
    ------
    InputError
        The file is no binding; with file, line and column.
    """
    document = read_binding_document(Path(path))
    return binding(Element.root(document))


def _binding_of(element: Element) -> BindingSource | None:
    inside = element.find("binding")
    if "binding" not in element:
        return None if inside is None else binding(inside)
    if inside is not None:
        raise inside.error('the <plant> has binding="..." and a <binding>: remove one of them')
    path = element.path("binding")
    try:
        return read_binding(path)
    except InputError as error:
        if error.where == Location(str(path)):  # it cannot even be read
            raise element.error(f'binding="{element.get("binding")}" of <plant>: {error.message}') from None
        raise


def _tolerance(element: Element) -> float | None:
    if "tolerance" not in element:
        return None
    tolerance = float(element.get("tolerance"))
    if not tolerance > 0:
        raise element.error(f'tolerance="{element.get("tolerance")}" of <plant> must be greater than zero')
    return tolerance


def _solver_steps(element: Element, step: float) -> int | None:
    if "solver_step" not in element:
        return None
    if element.get("solver") == "cvode":
        raise element.error("cvode chooses its steps itself: remove solver_step")
    length = element.positive("solver_step", "s")
    steps = whole(step / length)
    if not steps:
        raise element.error(f"the solver_step {length:.12g} s does not divide the communication step of {step:.12g} s")
    return steps

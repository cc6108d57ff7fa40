"""An FMU as a vehicle of a known kind: its interface, its binary, and the variable of each role."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

from cosim.errors import Location
from cosim.fmu.binaries import check_binary, code_of
from cosim.fmu.binding import Binding, bind
from cosim.fmu.interfaces import choose_interface, interfaces
from cosim.fmu.model_description import Interface, Variable
from cosim.fmu.package import Package, open_package
from cosim.scenario.scenario import BindingSource


@dataclass(frozen=True)
class Fmu(Package):
    """An unpacked FMU that is a vehicle of a known kind.

    Attributes
    ----------
    interface : str
        The interface that is used: `CO_SIMULATION` or `MODEL_EXCHANGE`.
    binding : Binding
        The variable of each role.
    brought_code : str
        Code that it brings and that a process can hold only once, in words; see `cosim.fmu.bundled_code`.
    """

    interface: str
    binding: Binding
    brought_code: str

    @cached_property
    def about_interface(self) -> Interface:
        """The FMU's description of the interface that is used."""
        return interfaces(self.description)[self.interface]

    @cached_property
    def inputs(self) -> dict[str, Variable]:
        """Its inputs, by name."""
        return {v.name: v for v in self.description.modelVariables if v.causality == "input"}

    @cached_property
    def settable(self) -> dict[str, Variable]:
        """The variables that a scenario can set by their own names: parameters, and inputs that do not drive it."""
        kind = self.binding.kind
        driving = (*kind.command, *kind.disturbance)
        return {
            v.name: v
            for v in self.description.modelVariables
            if v.causality == "parameter" or (v.causality == "input" and self.binding.role_of(v, driving) is None)
        }


def open_fmu(
    path: Path, where: Location | None = None, declared: BindingSource | None = None, interface: str = ""
) -> Fmu:
    """Check an FMU, find its kind of vehicle and unpack it.

    Parameters
    ----------
    path, where
        The file, and the place in the scenario that asks for it.
    declared
        The binding; without it, variables have the names of the roles that they play.
    interface
        The one to use; if empty, Co-Simulation if the FMU offers it, else Model Exchange.

    Raises
    ------
    InputError
        The FMU cannot be used here; the message names file and reason.
    """
    package = open_package(path, where)
    try:
        return as_vehicle(package, where, declared, interface)
    except BaseException:
        package.close()
        raise


def as_vehicle(
    package: Package, where: Location | None = None, declared: BindingSource | None = None, interface: str = ""
) -> Fmu:
    """Return an opened FMU as a vehicle; it shares the unpacked files. See `open_fmu`."""
    chosen = choose_interface(package, interface, where)
    check_binary(package, interfaces(package.description)[chosen].modelIdentifier, where)
    binding = bind(package.description, str(package.path), declared, where)
    parts = {field.name: getattr(package, field.name) for field in fields(Package)}
    return Fmu(**parts, interface=chosen, binding=binding, brought_code=code_of(package))

"""The errors that a user of `plants` can see. Each message names the fault and the remedy."""


class PlantError(Exception):
    """Base of all errors raised by `plants`."""


class UnknownModel(PlantError):
    """No built-in model has this name."""


class ModelError(PlantError):
    """A model is stated wrongly: an undefined symbol, a name that is taken, a default outside its bounds."""


class UnitError(PlantError):
    """A unit is not known, or two units measure different quantities."""


class BuildError(PlantError):
    """An FMU could not be made."""


class NoCompiler(BuildError):
    """There is no C compiler on this machine."""

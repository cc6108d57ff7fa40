"""FMUs as files: opened, described, bound to the roles of a vehicle, and what scenarios give their variables."""

"""FMUs as files: opened, described, bound to the roles of a vehicle, and given the values of a scenario."""

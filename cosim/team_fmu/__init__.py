"""The team's half of the loop as an FMU for other masters: sensors, law and actuators, poses in, commands out."""

from cosim.team_fmu.build import build_team_fmu, team_fmus
from cosim.team_fmu.model import team_model

__all__ = ["build_team_fmu", "team_fmus", "team_model"]

"""Another name of `formation_controllers.analysis.formation_model`, kept for older imports."""

from formation_controllers.analysis.formation_model import (
    COSINE_MIN,
    FormationModel,
    ReducedDynamics,
    formation_model,
)

__all__ = ["COSINE_MIN", "FormationModel", "ReducedDynamics", "formation_model"]

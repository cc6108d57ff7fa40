"""``python -m kinematic_bicycle [FOLDER]`` makes the FMU, in ./fmus unless a folder is named."""

import sys

import plants
from kinematic_bicycle.model import model

print(plants.build(model(), out=sys.argv[1] if len(sys.argv) > 1 else "fmus"))

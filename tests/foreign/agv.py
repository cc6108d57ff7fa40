"""A transport vehicle as its vendor exports it with CasADi: equations only (Model Exchange), in mm, mrad and N.mm.

    python agv.py HEADERS

writes Agv.fmu to the current folder; HEADERS is a folder with FMI 3.0's C headers.
"""

import sys
from typing import Any

from casadi import MX, DaeBuilder, cos, sin, tan

dae = DaeBuilder("Agv")


def add(name: str, causality: str, variability: str, unit: str, text: str, **more: Any) -> MX:
    """Add a variable with a unit, which the FMU then names but does not define."""
    return dae.add(name, causality, variability, {"unit": unit, "description": text, "start": 0.0} | more)


def output(name: str, unit: str, text: str) -> MX:
    """Add a state, with a start value that can be set."""
    return add(name, "output", "continuous", unit, text, initial="exact")


x = output("px", "mm", "Rear axle along X")
y = output("py", "mm", "Rear axle along Y")
yaw = output("yaw", "mrad", "Yaw angle, counter-clockwise from X")
delta = output("delta", "mrad", "Steering angle, counter-clockwise")
u = output("u", "mm/s", "Forward speed")
r = output("delta_dot", "mrad/s", "Steering rate")
traction = add("M_drive", "input", "continuous", "N.mm", "Drive torque")
steering = add("M_steer", "input", "continuous", "N.mm", "Steering torque")
wheelbase = add("L", "parameter", "tunable", "mm", "Wheelbase", start=1200.0)
mass = add("m", "parameter", "tunable", "kg", "Mass of the body", start=30.0)

# In SI units; mm and mrad come back at the end.
a, v, omega, psi, gamma = wheelbase / 1000, u / 1000, r / 1000, yaw / 1000, delta / 1000
I_body, I_axle, d = 5.0, 10.0, 25.0
t = tan(gamma) / a
t_dot = omega / (a * cos(gamma) ** 2)
f_drive = traction / 1000 * (1 + a * t * sin(psi)) - v * ((I_body + I_axle) * t * t_dot + d * (1 + t**2))
f_steer = steering / 1000 - I_axle * t_dot * v - d * omega
v_dot = (f_drive - t * f_steer) / (mass + I_body * t**2)

dae.eq(dae.der(x), u * cos(psi))
dae.eq(dae.der(y), u * sin(psi))
dae.eq(dae.der(yaw), u * t)
dae.eq(dae.der(delta), r)
dae.eq(dae.der(u), 1000 * v_dot)
dae.eq(dae.der(r), 1000 * (f_steer / I_axle - t * v_dot))

compiler = {"compiler": "cc", "linker": "cc", "linker_flags": ["-lm"]}
files = dae.export_fmu({"no_warning": True})
files = dae.compile_fmu(files, {"include_dirs": [sys.argv[1]], "compiler_options": compiler})
dae.pack_fmu(files, {})

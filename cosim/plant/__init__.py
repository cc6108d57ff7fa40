"""Plants as the master sees them: a fleet of vehicles with poses and torques, for every version and interface of FMI.

`fleet` steps them all; `instance` starts one through FMPy; `stepping` and `model_exchange` call its functions from
compiled code, by `calls`; `cvode` integrates it by FMPy's CVODE; `process` and `worker` keep it in a process of its own
and speak by `protocol`; `log` takes its messages; `arithmetic` keeps the floating-point settings while it starts.
"""

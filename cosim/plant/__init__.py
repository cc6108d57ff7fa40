"""Plants as the master sees them: a fleet of vehicles with poses and torques, for every version and interface of FMI.

`fleet` steps them all; `instance` starts one through FMPy; `stepping` and `model_exchange` call its functions from
compiled code, by `calls`; `cvode` integrates it by FMPy's CVODE; `elsewhere`, `process` and `bells` keep FMUs in
processes of their own, `worker` and `serving` are these, and both sides speak by `protocol`;
`log` takes its messages; `arithmetic` keeps the floating-point settings while it starts.
"""

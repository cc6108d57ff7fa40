"""A ground vehicle as its vendor packages it with PythonFMU3: as charts have it, Runge-Kutta steps, no velocities.

Position is (north, east), the heading clockwise from north, and what is to the right is positive. Position and torque
are arrays. The initial pose is the start value of the outputs. `pythonfmu3 build` copies this file into the FMU.
"""

from math import cos, degrees, pi, radians, sin, tan

from pythonfmu3 import Dimension, Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Variability, Unit

UNITS = [
    Unit("m", m=1),
    Unit("kg", kg=1),
    Unit("deg", rad=1, factor=pi / 180),
    Unit("N.m", kg=1, m=2, s=-2),
]


def along(x, step, slope):
    """Return where a straight line leads."""
    return [a + step * b for a, b in zip(x, slope, strict=True)]


class Ugv(Fmi3Slave):
    """Rear axle without side slip, steered front axle."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.description, self.author = "Unmanned ground vehicle", "Northbound Robotics"
        self.register_units(UNITS)
        self.position, self.heading, self.steering = [0.0, 0.0], 90.0, 0.0  # m, deg, deg
        self.torque = [0.0, 0.0]  # N.m
        self.motion = [0.0, 0.0]  # m/s, rad/s
        self.wheelbase, self.mass, self.time = 1.2, 30.0, 0.0
        pair = [Dimension(start="2")]
        output = {"causality": Fmi3Causality.output, "initial": Fmi3Initial.exact}
        parameter = {"causality": Fmi3Causality.parameter, "variability": Fmi3Variability.fixed}
        self.offer("time", "time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous)
        self.offer("vehicle.position", "position", unit="m", dimensions=pair, **output, description="North, east")
        self.offer("vehicle.heading", "heading", unit="deg", **output, description="Clockwise from north")
        self.offer("vehicle.steering.angle", "steering", unit="deg", **output, description="Positive to the right")
        self.offer(
            "vehicle.torque",
            "torque",
            unit="N.m",
            dimensions=pair,
            causality=Fmi3Causality.input,
            description="Drive, steering to the right",
        )
        self.offer("vehicle.geometry.wheelbase", "wheelbase", unit="m", **parameter, description="Between the axles")
        self.offer("vehicle.mass", "mass", unit="kg", **parameter, description="Mass of the body")

    def offer(self, name, attribute, **what):
        """Register a variable; PythonFMU3's own setter of arrays calls what NumPy 2.4 no longer has."""
        variable = Float64(
            name,
            getter=lambda: getattr(self, attribute),
            setter=lambda value: setattr(self, attribute, value),
            **what,
        )
        self.register_variable(variable)

    def slope(self, x):
        """Return the derivatives of north, east, heading, steering, speed and steering rate, in SI units."""
        _, _, heading, steering, speed, rate = x
        left = -steering
        bend = tan(left) / self.wheelbase
        body, axle, damping = 5.0, 10.0, 25.0
        bend_rate = -rate / (self.wheelbase * cos(left) ** 2)
        push = self.torque[0] * (1.0 + tan(left) * cos(heading))
        push -= speed * ((body + axle) * bend * bend_rate + damping * (1.0 + bend**2))
        turn = -self.torque[1] - axle * bend_rate * speed + damping * rate
        acceleration = (push - bend * turn) / (self.mass + body * bend**2)
        return (
            speed * cos(heading),
            speed * sin(heading),
            -speed * bend,
            rate,
            acceleration,
            bend * acceleration - turn / axle,
        )

    def do_step(self, current_time, step_size):
        """Make one Runge-Kutta step of the whole communication step."""
        x = (*self.position, radians(self.heading), radians(self.steering), *self.motion)
        k1 = self.slope(x)
        k2 = self.slope(along(x, step_size / 2, k1))
        k3 = self.slope(along(x, step_size / 2, k2))
        k4 = self.slope(along(x, step_size, k3))
        mean = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
        north, east, heading, steering, *self.motion = along(x, step_size, mean)
        self.position, self.heading, self.steering = [north, east], degrees(heading), degrees(steering)
        self.time = current_time + step_size
        return True

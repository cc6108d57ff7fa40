"""A rover as its vendor packages it with PythonFMU: explicit Euler, in degrees and km/h, initial pose by parameters.

PythonFMU 0.7 has no means to state a unit, so the descriptions do. `pythonfmu build` copies this file into the FMU.
"""

from math import cos, degrees, radians, sin, tan

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

KMH = 3.6  # km/h in 1 m/s
PARAMETERS = {
    "x0": "Initial pos_x [m]",
    "y0": "Initial pos_y [m]",
    "heading0": "Initial heading [deg]",
    "steer0": "Initial steer [deg]",
    "wheelbase": "Distance between the axles [mm]",
    "mass": "Mass of the body [kg]",
}
INPUTS = {"drive_torque": "Drive torque [N.m]", "steer_torque": "Torque on the steering [N.m]"}
OUTPUTS = {
    "pos_x": "Position of the rear axle, east [m]",
    "pos_y": "Position of the rear axle, north [m]",
    "heading": "Heading, counter-clockwise from east [deg]",
    "steer": "Steering angle, positive to the left [deg]",
    "speed": "Forward speed [km/h]",
    "steer_rate": "Steering rate [deg/s]",
}


class Rover(Fmi2Slave):
    """Rear axle without side slip, steered front axle."""

    description = "Rover with steered front wheels"
    author = "Rovers & Sons"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name in (*PARAMETERS, *INPUTS, *OUTPUTS):
            setattr(self, name, 0.0)
        self.wheelbase, self.mass = 1200.0, 30.0
        for names, causality, variability in (
            (PARAMETERS, Fmi2Causality.parameter, Fmi2Variability.fixed),
            (INPUTS, Fmi2Causality.input, Fmi2Variability.continuous),
            (OUTPUTS, Fmi2Causality.output, Fmi2Variability.continuous),
        ):
            for name, text in names.items():
                self.register_variable(Real(name, causality=causality, variability=variability, description=text))

    def exit_initialization_mode(self):
        """Go to the initial pose: until here the outputs do not show it."""
        self.pos_x, self.pos_y, self.heading, self.steer = self.x0, self.y0, self.heading0, self.steer0

    def do_step(self, current_time, step_size):
        """Make one Euler step of the whole communication step."""
        axles = self.wheelbase / 1000.0
        speed, rate = self.speed / KMH, radians(self.steer_rate)
        heading, steer = radians(self.heading), radians(self.steer)
        bend = tan(steer) / axles  # turn per way
        bend_rate = rate / (axles * cos(steer) ** 2)
        body, axle, damping = 5.0, 10.0, 25.0
        drive = (
            self.drive_torque * (1.0 + axles * bend * sin(heading))
            - (body + axle) * bend * bend_rate * speed
            - damping * (1.0 + bend**2) * speed
        )
        turn = self.steer_torque - axle * bend_rate * speed - damping * rate
        acceleration = (drive - bend * turn) / (self.mass + body * bend**2)
        self.pos_x += step_size * speed * cos(heading)
        self.pos_y += step_size * speed * sin(heading)
        self.heading += step_size * degrees(speed * bend)
        self.steer += step_size * self.steer_rate
        self.speed += step_size * acceleration * KMH
        self.steer_rate += step_size * degrees(turn / axle - bend * acceleration)
        return True

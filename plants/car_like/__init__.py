"""Car-like mobile robot: rear axle without slip, steered front axle, torques as inputs."""

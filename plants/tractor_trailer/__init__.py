"""Tractor with a trailer hitched on its axle: two driven wheels, no wheel slips sideways, wheel torques as inputs."""

"""Differential-drive mobile robot: two driven wheels on one axle that roll without slip, wheel torques as inputs."""

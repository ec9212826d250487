"""The gate between any controller and the robot: modes, limits, and the reason of each shot that is not fired."""

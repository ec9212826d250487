"""The simulator: a world from a robot's records, compiled together with any controller."""

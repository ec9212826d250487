"""Studies: scripts of the public functions, which take a robot from its logs to hit rates, and lay out the paper."""

"""From logs to models: gimbal axes by simulation least squares, the muzzle by maximum likelihood."""

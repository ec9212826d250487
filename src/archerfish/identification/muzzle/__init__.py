"""The muzzle from shots: speed, disturbance angles of eq (6) and their scatter."""

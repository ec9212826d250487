"""Muzzle speed, disturbance angles and their scatter, by likelihood from shots."""

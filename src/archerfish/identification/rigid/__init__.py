"""The grey box: inertia, damping and gravity of a rigid axis."""

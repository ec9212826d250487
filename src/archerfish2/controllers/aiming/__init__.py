"""From where a target will be to a command: one law of aiming a file."""

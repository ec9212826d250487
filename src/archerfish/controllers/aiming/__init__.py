"""Laws of aiming: from where a target will be to a command. One law a file."""

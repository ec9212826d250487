"""Other identification tools, each in an environment of its own and run as a subprocess by a small adapter."""

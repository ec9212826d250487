"""A trained policy: what it observes, its network, and the file that holds both."""

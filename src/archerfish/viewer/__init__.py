"""A browser page that plays engagements of a robot, and a film of them in one file."""

"""The robot's side: policies as files that run without us."""

"""The laboratory: what a team does with its robot before an identification, and the logs that come of it."""

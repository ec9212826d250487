"""Training of policies: PPO and the analytic policy gradient, run folders, and environments for other libraries."""

"""Who is shot at: one file per motion, and one table of the distributions that their parameters are drawn from."""

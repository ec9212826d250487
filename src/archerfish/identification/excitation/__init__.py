"""What to play for an identification, and what it will tell."""

"""The browser page: engagements to play with, and recordings to look at."""

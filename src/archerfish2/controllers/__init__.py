"""Controllers: what is seen in, a command out; one file for each method."""

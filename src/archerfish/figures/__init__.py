"""One style for every plot and page; what is drawn comes as plain arrays and texts."""

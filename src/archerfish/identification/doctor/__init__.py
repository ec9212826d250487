"""What is wrong with logs, said before anything is fitted to them."""

"""The parts of `archerfish sweep`: what is varied, who proposes, who runs, what is kept, how it is ranked."""

"""Proximal policy optimisation, eqs (9) and (10): it trains the parameters of the policy in `controllers`."""

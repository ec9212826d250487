"""Decisions of policies per second in NumPy, as on a robot.

`python benchmarks/decisions.py [--against REVISION]`: a policy of each kind of observation with a network that nobody
trained, as large as those of a training, in 200 situations with a target that moves. How long it takes to load a policy
is in import_time.py. Writes results/decisions.json.
"""

from collections.abc import Callable

import alternating

NAMES, DECISIONS = ("paper", "history", "tracked", "multimodel"), 200


def prepare() -> alternating.Work:
    """Return kind of observation → decisions, which return how many."""
    from archerfish.codegen.decision import example_decisions, seen_of
    from policies import untrained

    def decisions(name: str) -> Callable[[], int]:
        gated = untrained(name)
        policy = gated.controller
        situations = [seen_of(given, given["angle"]) for given, _ in example_decisions(gated, DECISIONS)]

        def run() -> int:
            state = policy.reset(situations[0])
            for seen in situations:
                state, _ = policy.step(state, seen)
            return DECISIONS

        return run

    return {name: decisions(name) for name in NAMES}


if __name__ == "__main__":
    alternating.run(__doc__, __file__, prepare, NAMES, pairs=15)

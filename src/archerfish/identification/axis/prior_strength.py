"""How strong a prior the data bear: the strongest with which they are not explained worse than chance allows."""

from collections.abc import Iterable

from scipy.special import chdtri

from archerfish.identification.axis.modal_form import Sections
from archerfish.identification.axis.out_of_band import scaled_penalty
from archerfish.identification.axis.pole_refinement import Effort, Problem, Refinement, refine_all
from archerfish.identification.axis.simulation_fit import Penalty
from archerfish.identification.axis.spectra import row_count

WEAKER = 0.1
"""Factor between one strength and the next that is tried."""
_WEAKEST = 1e-3
_CHANCE = 0.999


def strongest_accepted(
    free: Refinement,
    starts: Iterable[Sections],
    problem: Problem,
    prior: Penalty,
    effort: Effort,
    strength: float = 1.0,
) -> tuple[float, Refinement]:
    """Find the strongest prior with which the data are not explained worse than chance allows.

    Args:
      free: the fit without prior.
      starts: other poles to start from.
      problem: without penalty.
      prior: at full strength.
      effort: of each refinement.
      strength: to begin with.

    Returns:
      Strength, zero if even the weakest prior is refused, and the fit.
    """
    limit = largest_misfit(free, problem)
    tried = [free.sections, *starts]
    while strength > _WEAKEST:
        refined, *_ = refine_all(tried, problem._replace(penalty=scaled_penalty(prior, strength)), effort)
        if refined.fit.misfit <= limit:
            return strength, refined
        strength, tried = strength * WEAKER, [free.sections, refined.sections]
    return 0.0, free


def largest_misfit(free: Refinement, problem: Problem) -> float:
    """Return the sum of squares up to which a fit is as good as the free one.

    Useless parameters take the difference off by chance, once in a thousand logs.

    Args:
      free: the fit without prior.
      problem: what it was fitted to.
    """
    rows = row_count(problem.experiments) * problem.experiments[0].outputs.shape[1]
    parameters = free.fit.numerators.size + free.fit.feedthrough.size + len(free.fit.numerators)
    return free.fit.misfit * float(1 + chdtri(parameters, 1 - _CHANCE) / rows)

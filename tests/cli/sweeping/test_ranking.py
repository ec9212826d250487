import pytest

pytest.importorskip("jax")

from rich.console import Console

from archerfish.cli.sweeping.axes import parse_vary
from archerfish.cli.sweeping.executor import in_process
from archerfish.cli.sweeping.folder import sweep_folder
from archerfish.cli.sweeping.proposals import proposed_grid
from archerfish.cli.sweeping.ranking import rank, score
from archerfish.cli.sweeping.run import run_rounds
from archerfish.cli.sweeping.tables import draw_sweep, print_standings, summarise

from .made_trials import made_up_hits

BOTH = ({"command-limit": "gate"}, {"command-limit": "box"})


@pytest.fixture
def results(make_plan, tmp_path):
    with sweep_folder(tmp_path, {}, False) as folder:
        proposer = proposed_grid(parse_vary(["ppo.clip=0.1,0.2,0.6"]))
        run_rounds(make_plan((0, 1, 2), BOTH), proposer, folder, in_process, work=made_up_hits)
        return list(folder.results.values())


def test_each_world_has_a_ranking_of_its_own_with_the_failed_last(results):
    standings = rank(results)
    assert [(each.world, each.parameters["ppo.clip"], each.failed) for each in standings] == [
        (f"paper, {limit}", clip, failed)
        for limit in ("gate", "box")
        for clip, failed in ((0.2, 0), (0.1, 0), (0.6, 3))
    ]
    assert all(each.low < each.rate < each.high for each in standings if each.shots)


def test_seeds_are_pooled_and_their_spread_is_shown(results):
    best = rank(results)[0]
    # 40 + seed + 0…3 hits of 50 in each engagement
    assert (best.hits, best.shots) == (sum(40 + seed + k for seed in range(3) for k in range(4)) * 2, 3 * 2 * 4 * 50)
    assert (best.lowest, best.highest) == (41.5 / 50, 43.5 / 50)
    assert best.seeds == (0, 1, 2)


def test_the_order_of_the_results_does_not_matter(results):
    assert rank(results) == rank(results[::-1])


def test_a_sampler_hears_that_a_diverged_training_hits_nothing(results):
    first, diverged = ([each for each in results if each.configuration == k] for k in (0, 2))
    assert score(diverged) == 0.0
    assert score([*first[:1], *diverged[:1]]) == pytest.approx(first[0].rate / 2)


def test_the_summary_names_the_middle_training_of_the_best(results):
    summary = summarise(rank(results), results, "out")
    assert (summary["trials"], summary["failed"], summary["configurations"]) == (18, 6, 3)
    # configuration 1: trials 6, 7, 8 under gate, of which seed 1 is the middle one
    assert summary["best"]["paper, gate"]["policy"] == "trials/0007/policy.json"
    assert list(summary["best"]) == ["paper, gate", "paper, box"]


def test_the_ranking_fits_a_terminal_and_tells_what_failed(results):
    console = Console(width=80, record=True)
    print_standings(rank(results), ["ppo.clip"], console)
    told = console.export_text()
    assert max(map(len, told.splitlines())) <= 80
    assert "0 of 3" in told
    assert "failed" in told


@pytest.mark.parametrize("varied", [["ppo.clip"], []])
def test_the_picture_has_a_panel_per_parameter_or_the_seeds(results, varied):
    figure = draw_sweep(rank(results), results, varied)
    assert [axes.get_xlabel() for axes in figure.axes if axes.get_visible()] == (varied or ["seed"])


def test_there_is_no_picture_without_shots(results):
    failed = [each for each in results if each.problem]
    assert draw_sweep(rank(failed), failed, ["ppo.clip"]) is None

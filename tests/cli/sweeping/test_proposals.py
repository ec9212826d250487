import pytest

pytest.importorskip("jax")
pytest.importorskip("optuna", reason="needs the extra sweep")

from archerfish.cli.sweeping.axes import parse_vary
from archerfish.cli.sweeping.executor import in_process
from archerfish.cli.sweeping.folder import RESULTS, sweep_folder
from archerfish.cli.sweeping.proposals import proposed_samples
from archerfish.cli.sweeping.results import read_results, results_table
from archerfish.cli.sweeping.run import run_rounds

from .made_trials import backwards, ending_after, made_up_hits

AXES = parse_vary(["ppo.clip=0.05..0.45", "ppo.epochs=2..5", "target=both,static"])


def proposed(count, batch=4, sampler="tpe", seed=0, axes=AXES):
    proposer = proposed_samples(axes, count, batch, sampler, seed)
    rounds = [next(proposer)]
    while True:
        try:
            rounds.append(proposer.send([-abs(each["ppo.clip"] - 0.2) for each in rounds[-1]]))
        except StopIteration:
            return rounds


@pytest.mark.parametrize("sampler", ["tpe", "random"])
def test_the_same_seed_and_scores_give_the_same_proposals(sampler):
    rounds = proposed(14, sampler=sampler)
    assert rounds == proposed(14, sampler=sampler)
    assert [len(each) for each in rounds] == [4, 4, 4, 2]
    assert rounds != proposed(14, sampler=sampler, seed=1)
    assert all(0.05 <= each["ppo.clip"] <= 0.45 and each["ppo.epochs"] in range(2, 6) for r in rounds for each in r)


def test_a_longer_sweep_first_proposes_what_the_shorter_one_did():
    short, long = ([each for r in proposed(count) for each in r] for count in (14, 20))
    assert long[:14] == short


def test_the_sampler_learns_from_the_scores():
    # Random search has a median distance of about 0.1 from the best clip.
    last = [each for r in proposed(40) for each in r][-12:]
    assert sorted(abs(each["ppo.clip"] - 0.2) for each in last)[6] < 0.06


def test_a_configuration_that_comes_again_is_not_tried_again():
    rounds = proposed(20, axes=parse_vary(["ppo.clip=0.1,0.2"]))
    assert sorted(each["ppo.clip"] for r in rounds for each in r) == [0.1, 0.2]


def test_a_killed_sweep_proposes_what_it_would_have(make_plan, tmp_path):
    def sweep(out, executor, resume=False):
        with sweep_folder(out, {}, resume) as folder:
            run_rounds(make_plan(), proposed_samples(AXES, 10, 4, "tpe", 3), folder, executor, work=made_up_hits)
            return results_table(folder.results.values())

    whole = sweep(tmp_path / "a", in_process)
    for done in (5, 3, 4):  # in each case some trials of a round are done and others are not
        with pytest.raises(KeyboardInterrupt):
            sweep(tmp_path / "b", ending_after(done), resume=True)
    assert sweep(tmp_path / "b", backwards, resume=True) == whole
    assert len(read_results(tmp_path / "b" / RESULTS)) == 20

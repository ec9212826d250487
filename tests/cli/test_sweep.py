import json

import pytest

from archerfish.records.policy import read_policy

pytest.importorskip("jax")

SMALL = ["--ppo.steps", 200, "--ppo.environments", 8, "--ppo.rollout", 6, "--ppo.hidden", 4, "--observation", "paper"]
SMALL += ["--engagements", 2, "--in-process"]


def test_a_sweep_trains_scores_and_ranks(command, tmp_path):
    words = ["sweep", "--vary", "ppo.clip=0.1,0.2", *SMALL, "--out", "out", "--json", "sweep.json"]
    status, out, _ = command(*words)
    assert status == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        *("results.csv", "results.jsonl", "summary.json", "sweep.json", "sweep.svg", "trials", ".archerfish.json")
    }
    assert read_policy(tmp_path / "out" / "trials" / "0001" / "policy.json").training["ppo"]["clip"] == 0.2
    summary = json.loads((tmp_path / "sweep.json").read_text())
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["trials"], summary["failed"]) == (2, 0)
    best = summary["best"]["paper, gate"]
    assert best["low"] == max(each["low"] for each in summary["standings"])
    assert f"{best['hits']} of 800" in out
    assert max(map(len, out.splitlines())) <= 80

    table = (tmp_path / "out" / "results.csv").read_text()
    status, again, err = command(*words)
    assert (status, again) == (2, "")
    assert "out: holds a sweep with 2 finished trials; add --resume" in err
    assert command(*words, "--resume")[:2] == (0, out)
    assert (tmp_path / "out" / "results.csv").read_text() == table


def test_ways_to_train_are_varied_too(command, tmp_path):
    gradient = ["--gradient.steps", 200, "--gradient.environments", 8, "--gradient.window", 4, "--gradient.hidden", 4]
    status, _, _ = command("sweep", "--vary", "trainer=ppo,gradient", *SMALL, *gradient, "--out", "out")
    assert status == 0
    trained = [read_policy(tmp_path / "out" / "trials" / f"000{index}" / "policy.json").training for index in (0, 1)]
    assert trained[0]["ppo"]["rollout"] == 6
    assert trained[1]["gradient"]["window"] == 4
    configuration = json.loads((tmp_path / "out" / "trials" / "0001" / "config.json").read_text())
    assert configuration["trainer"] == "gradient"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--vary", "ppo.cilp=1"], "no parameter 'ppo.cilp', the parameters are ppo.steps, "),
        (["--vary", "ppo.clip=0.1..0.2"], "a range needs --trials"),
        (["--vary", "ppo.clip=-1,0.2"], "ppo.clip=-1 can't be trained: clip must be finite and > 0"),
        (["--vary", "observation=tracked"], "needs a sensing record"),
        (["--vary", "records=none"], "pitch.json: no such file"),
        (["--seeds", "0", "0"], "--seeds must be at least one, none twice"),
        (["--seeds", "-1"], "--seeds must be within"),
        (["--engagements", "1"], "--engagements must be at least 2"),
        (["--trials", "-1"], "--trials must be at least 0"),
        (["--batch", "0"], "--batch must be at least 1"),
        (["--address", "auto"], "--in-process and --address"),
        (["none.toml"], "none.toml: no such file"),
        (["plant.json", "--seeds", "1"], "--seeds stands beside plant.json"),
        (["--out", "plant.json"], "can't be written"),
        (["--frames", "1"], "frames must be from 2"),
    ],
)
def test_what_cant_be_swept_is_refused_in_one_line(refused, records, words, told):
    assert told in refused("sweep", "--in-process", *words)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--trials", 5], "has nothing to choose from"),
        (["--trials", 5, "--vary", "ppo.clip=0.1..0.2", "--seeds", 0, 1, 2, 3, 4, 5], "takes 6: its seeds and worlds"),
    ],
)
def test_too_few_trials_or_nothing_to_try_is_refused(refused, words, told):
    pytest.importorskip("optuna", reason="needs the extra sweep")
    assert told in refused("sweep", "--in-process", *words)


def test_a_machine_without_ray_is_told_what_to_install(refused, monkeypatch):
    import importlib.util

    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "ray" else found(name))
    assert "needs ray, which is not installed; pip install 'archerfish[sweep]'" in refused("sweep", "--seeds", 1)


def test_a_folder_of_records_is_a_world(command, tmp_path):
    from archerfish.paper.gimbal import printed_plants
    from archerfish.records.plant import write_plant

    for axis, plant in printed_plants().items():
        write_plant(tmp_path / "sentry" / f"{axis}.json", plant)
    status, out, _ = command("sweep", "--vary", "records=sentry", *SMALL, "--out", "out")
    assert status == 0
    assert "identified-sentry, gate" in out
    policy = read_policy(tmp_path / "out" / "trials" / "0000" / "policy.json")
    assert set(policy.provenance["inputs"]) == {"pitch.json", "yaw.json"}

"""Shipped policies, acting in NumPy."""

import dataclasses
import json

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

import etude
from conftest import etude_command, midi
from etude.policy import SHIPPED, SIGHT_READER
from etude.recordings import read_recording


def play(policy, song, **keywords):
    """Scores of the song as the policy plays it."""
    env = etude.PianoEnv(song, config=policy.task, **keywords)
    observation, _ = env.reset(seed=0)
    over = False
    while not over:
        observation, _, _, over, info = env.step(policy.act(observation))
    return info


@pytest.mark.parametrize("song", ["twinkle", "c-major-scale"])
def test_a_shipped_policy_plays_as_well_as_its_file_says(song):
    policy = etude.load_policy(song)
    assert policy.song == etude.SONGS[song]
    # The last bits of an action differ from the trainer's, and a stroke may fall a control step
    # earlier or later.
    assert play(policy, song)["f1"] == pytest.approx(policy.scores["f1"], abs=0.02)


@pytest.fixture(scope="module")
def song(tmp_path_factory):
    """A song of forty notes that no policy has learned, with leaps and black keys."""
    path = tmp_path_factory.mktemp("song") / "unseen.mid"
    path.write_bytes(midi([(60 + (7 * note) % 13, 1) for note in range(40)]))
    return path


def test_the_sight_reader_plays_what_has_no_policy_of_its_own(song, tmp_path):
    policy = etude.load_policy(song)
    assert policy.path == SIGHT_READER and policy.song is None
    folder = etude_command(tmp_path / "played", "play", song) / "latest"
    report = json.loads((folder / "report.json").read_text())
    assert report["player"].endswith(SIGHT_READER.name) and report["f1"] > 0.8
    assert play(policy, song)["f1"] == pytest.approx(report["f1"], abs=0.02)


def test_it_acts_as_the_command_does_on_what_it_sees_of_a_robot(song, tmp_path):
    performed = etude_command(tmp_path / "performed", "perform", song, "--robot", "twin")
    seen = read_recording(performed / "latest" / "run-1.mcap").topics["/policy"]
    observations, actions = seen["observation"], seen["action"]
    assert observations.shape[0] > 300 and np.ptp(actions, axis=0).min() > 0.1
    np.testing.assert_allclose(etude.load_policy(song).act(observations), actions, atol=1e-5)


def test_its_task_is_the_one_that_its_scores_are_of():
    policy = etude.load_policy("twinkle")
    training = policy.header["notes"]["training"]
    trained_in = {**policy.task, "randomisation": {"intensity": 0.6}}

    def in_the_task(task):
        notes = {"training": {**training, "config": {**training["config"], "task": task}}}
        return dataclasses.replace(policy, header={**policy.header, "notes": notes})

    randomised = in_the_task(trained_in)
    assert randomised.task == policy.task
    assert etude.PianoEnv("twinkle", config=randomised.task).task["randomisation"]["intensity"] == 0.0
    with pytest.raises(etude.EtudeError, match="twinkle.safetensors.*another version.*`spin`"):
        in_the_task({**trained_in, "spin": 1}).task


def test_many_observations_at_once():
    policy = etude.load_policy("twinkle")
    observations = np.random.default_rng(0).normal(size=(2, 5, policy.weights[0].shape[0])).astype(np.float32)
    actions = policy.act(observations)
    assert actions.shape == (2, 5, 13) and np.all(np.abs(actions) <= 1)
    np.testing.assert_allclose(actions[1, 3], policy.act(observations[1, 3]), atol=1e-5)
    with pytest.raises(etude.EtudeError, match="409 columns.*config=policy.task"):
        policy.act(np.zeros(356, np.float32))


def test_what_is_not_a_policy_is_refused(tmp_path):
    with pytest.raises(etude.EtudeError, match="twinkle"):
        etude.load_policy("no-such-song")
    with pytest.raises(etude.EtudeError, match="etude train"):
        etude.load_policy(tmp_path)
    (tmp_path / "p.safetensors").write_bytes(b"\x08\0\0\0\0\0\0\0{}      ")
    with pytest.raises(etude.EtudeError, match="not a policy"):
        etude.load_policy(tmp_path / "p.safetensors")
    whole = load_file(SHIPPED / "twinkle.safetensors")
    with safe_open(SHIPPED / "twinkle.safetensors", framework="numpy") as file:
        header = json.loads(file.metadata()["etude"])
    bias = whole["actor.layer0.bias"]
    for changed, other in [
        ({"actor.layer0.bias": bias[:-1]}, header),
        ({"actor.layer0.bias": bias + np.nan}, header),
        ({"actor.layer0.bias": bias.astype(np.float64)}, header),
        ({}, {key: value for key, value in header.items() if key != "layout"}),
        ({}, header | {"hidden": [128, 128]}),
        ({}, header | {"schema": "etude-policy-9"}),
        ({}, []),
    ]:
        save_file(whole | changed, tmp_path / "p.safetensors", {"etude": json.dumps(other)})
        with pytest.raises(etude.EtudeError, match="damaged|not a policy|schema"):
            etude.load_policy(tmp_path / "p.safetensors")
    save_file(whole, tmp_path / "p.safetensors", {"etude": json.dumps(header | {"notes": None})})
    with pytest.raises(etude.EtudeError, match="which task"):
        etude.load_policy(tmp_path / "p.safetensors").task  # noqa: B018

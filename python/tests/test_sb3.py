"""The adapter beside what Stable-Baselines3 makes of single environments (`make test-sb3`)."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

import etude
from etude.sb3 import PianoVecEnv

# Something for each seed to decide.
TASK = {"options": {"randomisation.intensity": 0.5}}


def test_it_does_what_single_environments_do_behind_a_monitor(short_song):
    ours = PianoVecEnv(3, short_song, threads=2, **TASK)
    theirs = DummyVecEnv([lambda: Monitor(etude.PianoEnv(short_song, **TASK)) for _ in range(3)])
    assert ours.observation_space == theirs.observation_space and ours.action_space == theirs.action_space
    for envs in (ours, theirs):
        envs.seed(7)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    random, ended = np.random.default_rng(0), 0
    for _ in range(3 * ours.get_attr("steps")[0]):
        actions = random.uniform(-1, 1, (3, 13)).astype(np.float32)
        steps = [envs.step(actions) for envs in (ours, theirs)]
        for one, other in zip(steps[0][:3], steps[1][:3]):
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
        for one, other in zip(steps[0][3], steps[1][3]):
            assert one["collided"] == other["collided"]
            assert one["reward_terms"] == pytest.approx(other["reward_terms"])
            assert ("terminal_observation" in one) == ("terminal_observation" in other) == ("episode" in one)
            if "episode" in one:
                ended += 1
                np.testing.assert_array_equal(one["terminal_observation"], other["terminal_observation"])
                assert one["TimeLimit.truncated"] and other["TimeLimit.truncated"]
                assert one["episode"]["l"] == other["episode"]["l"]
                assert one["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-5)
                assert one["episode"]["f1"] == pytest.approx(other["f1"])
    assert ended >= 6


def test_a_monitor_logs_the_scores(short_song):
    envs = VecMonitor(PianoVecEnv(2, short_song), info_keywords=("f1", "recall"))
    envs.reset()
    for _ in range(envs.get_attr("steps")[0]):
        _, _, over, infos = envs.step(np.zeros((2, 13), np.float32))
    assert over.all() and all(info["episode"]["f1"] == info["f1"] for info in infos)


def test_the_rest_of_the_idiom(short_song):
    inner = PianoVecEnv(2, short_song)
    # Where SB3's recorder of videos looks for it.
    assert inner.metadata["render_fps"] == 20
    envs = VecMonitor(inner)
    envs.reset()
    assert envs.get_images() == [None, None]
    assert envs.env_is_wrapped(Monitor) == [False, False]
    states = envs.env_method("get_state")
    first = envs.step(np.zeros((2, 13), np.float32))[0]
    for index, state in enumerate(states):
        envs.env_method("set_state", state, indices=index)
    np.testing.assert_array_equal(envs.step(np.zeros((2, 13), np.float32))[0], first)
    with pytest.raises(AttributeError, match="cannot be set"):
        envs.set_attr("title", "another")
    with pytest.raises(TypeError, match="copy"):
        PianoVecEnv(2, short_song, copy=False)

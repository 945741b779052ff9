"""The environments against Gymnasium's own checks, its own vector environment, and Rust."""

import os
import pathlib
import subprocess
import warnings

import gymnasium
import numpy as np
import pytest
from conftest import needed
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from sklearn.metrics import precision_recall_fscore_support

import etude

# In worlds that are drawn at random.
RANDOMISED = {"options": {"randomisation.intensity": 0.5}}


def random_actions(count, num_envs=None, seed=0):
    shape = (count, 13) if num_envs is None else (count, num_envs, 13)
    return np.random.default_rng(seed).uniform(-1, 1, shape).astype(np.float32)


@pytest.mark.parametrize("song", etude.SONGS)
def test_every_song_is_registered(song):
    env = gymnasium.make(etude.env_id(song))
    observation, info = env.reset(seed=1)
    assert env.observation_space.contains(observation) and info == {}
    assert env.get_wrapper_attr("title") == etude.SONGS[song]


@pytest.mark.parametrize(
    "keywords",
    [{}, {"preset": "appendix"}, {"options": {"scale": "si", "stage.fences": False}}, RANDOMISED],
)
def test_gymnasium_finds_nothing_wrong(keywords, short_song):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Joint readings have no bounds.
        warnings.filterwarnings("ignore", message=".*observation space m.*imum value is.*infinity.*")
        check_env(etude.PianoEnv(short_song, **keywords), skip_render_check=True)


def test_the_presets_differ_as_in_the_paper():
    main, appendix = etude.PianoEnv(), etude.PianoEnv(preset="appendix")
    assert main.observation_space.shape == (369,) and appendix.observation_space.shape == (356,)
    assert main.task["stage"]["fences"] and not appendix.task["stage"]["fences"]
    assert main.reward_terms != appendix.reward_terms
    options = {"reward.collision": 4.0, "physics.key.threshold": 0.7, "stage.actuation": "position"}
    heavier = etude.PianoEnv(options=options).task
    assert heavier["reward"]["collision"] == 4.0 and heavier["physics"]["key.threshold"] == 0.7
    assert heavier["stage"]["actuation"] == "position"


def test_the_rails_set_point_is_ahead_of_its_position():
    shown = []
    for rail_set_point in (False, True):
        env = etude.PianoEnv("twinkle", options={"rail_set_point": rail_set_point})
        env.reset(seed=0)
        for _ in range(2):
            observation = env.step(np.ones(13, np.float32))[0]
        shown.append(observation)
    measured, sent = shown
    assert sent[12] > measured[12] + 0.05 and (sent[:12] == measured[:12]).all()


def test_a_fingering_and_a_plan_change_what_is_shown_and_due():
    plain = etude.PianoEnv("twinkle")
    planned = etude.PianoEnv("twinkle", options={"fingering": True, "plan.rule": "articulated"})
    assert planned.observation_space.shape == (369 + 9 + 18,) and planned.task["plan"]["rule"] == "articulated"
    # The rail's action is a distance of up to 40 mm from its planned position.
    assert planned.action_high[12] - planned.action_low[12] == pytest.approx(0.08)
    steady = etude.PianoEnv("twinkle", options={"fingering": True, "rail_range": 0.02})
    assert steady.action_high[12] - steady.action_low[12] == pytest.approx(0.04)
    near = etude.PianoEnv("twinkle", options={"fingering": True, "finger_range": 0.3})
    assert (near.action_high - near.action_low)[:12] == pytest.approx(0.6)
    assert planned.action_low[0] == pytest.approx(-0.47) and near.action_low[0] > -0.4
    with pytest.raises(etude.EtudeError, match="finger_range"):
        etude.PianoEnv("twinkle", options={"finger_range": 0.3})
    rested = []
    for env, keys in (plain, 26 + 49), (planned, 26 + 9 + 49):
        observation, _ = env.reset(seed=0)
        due = []
        for _ in range(env.steps):
            due.append(np.flatnonzero(observation[keys : keys + 49]).tolist())
            observation, *_ = env.step(np.zeros(13, np.float32))
        # Twinkle's first two notes are the same C, ten control steps each, after one second.
        rested.append([step for step in range(20, 40) if due[step] != [24]])
    assert rested == [[30], [28, 29]]
    with pytest.raises(etude.EtudeError, match="restrike_secs"):
        etude.PianoEnv("twinkle", options={"plan.restrike_secs": 5.0})


def test_the_song_is_a_truncation_and_ends_with_its_scores(short_song):
    env = etude.PianoEnv(short_song, options={"randomisation.intensity": 0.0})
    observation, _ = env.reset(seed=0)
    rewards, due, pressed = [], [], []
    for step in range(env.steps):
        due.append(observation[26 + 49 : 26 + 98])
        observation, reward, terminated, truncated, info = env.step(np.zeros(13, np.float32))
        pressed.append(observation[26 : 26 + 49])
        assert not terminated and truncated == (step == env.steps - 1)
        assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-5)
        rewards.append(reward)
    # scikit-learn's scores of each control step, averaged: the paper's.
    steps = [
        precision_recall_fscore_support(*keys, average="binary", zero_division=1)[:3] for keys in zip(due, pressed)
    ]
    assert np.sum(pressed) > 0
    np.testing.assert_allclose([info[name] for name in ("precision", "recall", "f1")], np.mean(steps, axis=0))
    with pytest.raises(etude.EtudeError, match="call reset"):
        env.step(np.zeros(13, np.float32))
    env.reset()
    assert env.step(np.zeros(13, np.float32))[1] == rewards[0]


def test_actions_reach_over_what_the_song_needs(short_song):
    env, scale = etude.PianoEnv(short_song), etude.PianoEnv("c-major-scale")
    assert env.action_low.shape == env.action_high.shape == (13,)
    np.testing.assert_array_equal(env.action_low[:12], scale.action_low[:12])
    # The part of the keyboard that the song needs.
    assert scale.action_high[12] - scale.action_low[12] == pytest.approx(0.297, abs=1e-3)
    assert env.action_high[12] - env.action_low[12] < 0.297
    np.testing.assert_array_equal(etude.PianoVectorEnv(1, short_song).action_low, env.action_low)


def test_a_reward_may_have_no_terms(short_song):
    nothing = {f"reward.{term}": 0.0 for term in etude.PianoEnv(short_song).reward_terms}
    env = etude.PianoEnv(short_song, options=nothing)
    env.reset(seed=0)
    *_, info = env.step(np.zeros(13))
    assert env.reward_terms == [] and info["reward_terms"] == {}
    envs = etude.PianoVectorEnv(2, short_song, options=nothing)
    envs.reset(seed=0)
    assert envs.step(np.zeros((2, 13)))[1].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_together_they_do_what_gymnasium_makes_of_single_ones(short_song, threads):
    """Observations, rewards and infos byte for byte, over the ends of songs."""
    count = 3
    ours = gymnasium.make_vec(
        "etude/Piano-v0",
        num_envs=count,
        vectorization_mode="vector_entry_point",
        song=short_song,
        threads=threads,
        **RANDOMISED,
    )
    theirs = SyncVectorEnv(
        [lambda: etude.PianoEnv(short_song, **RANDOMISED)] * count, autoreset_mode=AutoresetMode.SAME_STEP
    )
    assert ours.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    assert ours.observation_space == theirs.observation_space and ours.action_space == theirs.action_space
    same(ours.reset(seed=7), theirs.reset(seed=7))
    ends = 0
    for actions in random_actions(150, count):
        one, other = ours.step(actions), theirs.step(actions)
        same(one, other)
        ends += int(one[3].sum())
    assert ends > 3
    mask = np.array([True, False, True])
    same(ours.reset(seed=9, options={"reset_mask": mask}), theirs.reset(seed=9, options={"reset_mask": mask}))


def same(one, other):
    """The same arrays, dictionaries and tuples, to the byte."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            same(one[key], other[key])
    elif isinstance(one, tuple) or isinstance(one, np.ndarray) and one.dtype == object:
        assert len(one) == len(other)
        for ours, theirs in zip(one, other):
            same(ours, theirs)
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    else:
        assert one == other


def test_rust_sees_the_same():
    """Byte for byte: crates/task/examples/episode.rs plays the same actions."""
    program = pathlib.Path(os.environ.get("ETUDE_EPISODE", "target/debug/examples/episode"))
    if not program.is_file():
        needed(f"{program} is not built: cargo build -p etude-task --example episode")
    steps, seed = 250, 11  # The song has 231.
    printed = subprocess.run([program, "c-major-scale", str(seed), str(steps)], capture_output=True, check=True)
    rust = np.frombuffer(printed.stdout, "<f4").reshape(steps + 1, 369)
    env = etude.PianoEnv("c-major-scale", **RANDOMISED)
    envs = etude.PianoVectorEnv(2, "c-major-scale", **RANDOMISED)
    seen, together = [env.reset(seed=seed)[0]], [envs.reset(seed=[5, seed])[0][1]]
    for step in range(steps):
        index = np.arange(13)
        action = ((step * 7919 + index * 104729) % 2001).astype(np.float32) / np.float32(1000) - np.float32(1)
        observation, _, _, over, _ = env.step(action)
        seen.append(env.reset()[0] if over else observation)
        together.append(envs.step(np.stack([action, action]))[0][1])
    assert rust.tobytes() == np.stack(seen).tobytes() == np.stack(together).tobytes()


def test_without_a_seed_every_environment_has_another_world():
    # In worlds drawn from the whole range no two hands move alike.
    def moves(**reset):
        envs = etude.PianoVectorEnv(2, "twinkle", options={"randomisation.intensity": 1.0})
        envs.reset(**reset)
        for _ in range(4):
            observations = envs.step(np.full((2, 13), 0.5))[0]
        return [row.tobytes() for row in observations]

    for reset in ({}, {"seed": [None, None]}):
        assert len({*moves(**reset), *moves(**reset)}) == 4
    single = [etude.PianoEnv("twinkle", options={"randomisation.intensity": 1.0}) for _ in range(3)]
    for env in single:
        env.reset()
    assert len({env.step(np.full(13, 0.5))[0].tobytes() for env in single}) == 3
    # What was drawn can be drawn again.
    env = etude.PianoEnv("twinkle", options={"randomisation.intensity": 1.0})
    env.reset()
    again = etude.PianoEnv("twinkle", options={"randomisation.intensity": 1.0})
    again.reset(seed=env.np_random_seed)
    assert env.step(np.full(13, 0.5))[0].tobytes() == again.step(np.full(13, 0.5))[0].tobytes()
    # Seeds go by environment, and a refused reset has not begun anything.
    envs = etude.PianoVectorEnv(2, "twinkle")
    with pytest.raises(etude.EtudeError):
        envs.reset(seed=[1])
    envs.reset(seed=0, options={"reset_mask": np.array([True, False])})
    for env, action in [(envs, np.zeros((2, 13))), (etude.PianoEnv(), np.zeros(13))]:
        with pytest.raises(etude.EtudeError, match="reset"):
            env.step(action)


def test_gymnasiums_wrappers_take_them(short_song):
    """As loops in the manner of CleanRL use them."""
    envs = RecordEpisodeStatistics(etude.PianoVectorEnv(3, short_song))
    envs.reset(seed=0)
    for step in range(envs.unwrapped.steps):
        _, _, _, over, info = envs.step(envs.action_space.sample())
    assert over.all() and info["episode"]["l"].tolist() == [envs.unwrapped.steps] * 3
    assert info["final_obs"][2].shape == (369,) and 0 < info["final_info"]["f1"][0] < 1


def test_arrays_are_the_callers_to_keep_unless_asked_otherwise(short_song):
    kept = etude.PianoVectorEnv(2, short_song)
    first, _ = kept.reset(seed=0)
    copy = first.copy()
    kept.step(random_actions(1, 2)[0])
    np.testing.assert_array_equal(first, copy)
    shared = etude.PianoVectorEnv(2, short_song, copy=False)
    first, _ = shared.reset(seed=0)
    again = shared.step(random_actions(1, 2)[0])[0]
    assert np.shares_memory(first, again)


def test_states_go_on_bit_for_bit(short_song):
    env = etude.PianoEnv(short_song, **RANDOMISED)
    env.reset(seed=3)
    actions = random_actions(24)
    for action in actions[:4]:
        env.step(action)
    state = env.get_state()
    went_on = [env.step(action) for action in actions[4:14]]
    # Another environment, elsewhere in another song's time.
    other = etude.PianoEnv(short_song, **RANDOMISED)
    other.reset(seed=8)
    other.set_state(state)
    for before, action in zip(went_on, actions[4:14]):
        same(before, other.step(action))
    envs = etude.PianoVectorEnv(3, short_song, **RANDOMISED)
    envs.reset(seed=0)
    envs.set_state(1, state)
    np.testing.assert_array_equal(envs.step(np.stack([actions[4]] * 3))[0][1], went_on[0][0])


def test_a_state_that_does_not_fit_leaves_the_episode_alone(short_song):
    env, twin = (etude.PianoEnv(short_song, **RANDOMISED) for _ in range(2))
    for one in (env, twin):
        one.reset(seed=3)
    actions = random_actions(6)
    state = env.get_state()
    no_fences = etude.PianoEnv(short_song, options={"stage.fences": False})
    others = [etude.PianoEnv("twinkle", **RANDOMISED), no_fences, etude.PianoEnv(short_song)]
    foreign = [other.get_state() for other in others]
    damaged = [state[:-9], state.replace(b"over", b"ovrr"), state.replace(b"physics", b"fysics")]
    damaged.append(state.replace(b"asleep", b"aslept"))
    for wrong, action in zip([*foreign, b"", b"{}", b"\xff" * 40, *damaged], np.resize(actions, (10, 13))):
        with pytest.raises(etude.EtudeError, match="cannot continue from this saved state"):
            env.set_state(wrong)
        same(env.step(action), twin.step(action))


def test_pictures():
    env = gymnasium.make("etude/Twinkle-v0", render_mode="rgb_array", width=160, height=120, view="top")
    env.reset(seed=0)
    try:
        first = env.render()
    except etude.EtudeError as error:
        needed(str(error))
    assert first.shape == (120, 160, 3) and first.dtype == np.uint8 and first.std() > 10
    for _ in range(20):
        env.step(np.full(13, 0.9, np.float32))
    assert np.any(env.render() != first)
    envs = etude.PianoVectorEnv(2, render_mode="rgb_array")
    envs.reset(seed=0)
    assert [picture.shape for picture in envs.render()] == [(240, 320, 3)] * 2

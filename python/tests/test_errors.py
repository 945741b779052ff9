"""Whatever is given, the answer is an exception with a message: never a panic or a crash."""

import math
import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import etude

# What a wrong argument may raise. pyo3's PanicException derives from BaseException.
REFUSED = (ValueError, TypeError, OverflowError)


@pytest.mark.parametrize(
    "keywords, message",
    [
        ({"song": "twinckle"}, "did you mean twinkle"),
        ({"song": "nowhere/at-all.mid"}, "nowhere/at-all.mid"),
        ({"song": __file__}, "MIDI"),
        ({"options": {"reward.colision": 1.0}}, "no reward term is called `colision`"),
        ({"options": {"reward.collision": math.nan}}, "finite number"),
        ({"options": {"physics.key.treshold": 0.5}}, "key.treshold"),
        ({"options": {"physics.key.threshold": 77.0}}, "key.threshold"),
        ({"options": {"randomisation.intensity": 3.0}}, "randomisation.intensity"),
        ({"options": {"randomisation.widths.nothing": 1.0}}, "nothing"),
        ({"options": {"stage.side": "middle"}}, "task.stage.side"),
        ({"options": {"lookahead": 1000}}, "lookahead"),
        ({"options": {"lookahead": -1}}, "task.lookahead"),
        ({"options": {"lookahed": 3}}, "did you mean lookahead"),
        ({"options": {"fences": False}}, "did you mean task.stage.fences"),
        ({"options": {"plan.rul": "robopianist"}}, "did you mean rule"),
        ({"preset": "other"}, "fast, expressive, paper, appendix, sight-reader"),
        ({"config": {"lookahed": 3}}, "lookahed"),
        ({"render_mode": "ansi"}, "rgb_array"),
        ({"view": "above"}, "player, side, top, fingers"),
        ({"width": -1}, "-1 × "),
        ({"height": 100_000}, "at most 1920 × 1080"),
        ({"options": {"reward.collision=5 #": 0}}, "collision=5"),
        ({"config": {"lookahead": np.int64(1000)}}, "lookahead"),
    ],
)
def test_messages_say_what_is_wrong(keywords, message):
    with pytest.raises(etude.EtudeError, match=message):
        etude.PianoEnv(**keywords)
    with pytest.raises(etude.EtudeError, match=message):
        etude.PianoVectorEnv(2, **keywords)


def test_wrong_types_are_type_errors():
    for keywords in [
        {"options": {"reward.collision": "much"}},
        {"options": {"reward": 0.0}},
        {"options": [1]},
        {"config": [1]},
        {"no_such_keyword": 1},
        {"options": {"physics.key.threshold": []}},
    ]:
        with pytest.raises((TypeError, etude.EtudeError)):
            etude.PianoEnv(**keywords)
    with pytest.raises(TypeError, match="config"):
        etude.PianoEnv(config={}, options={"stage.fences": False})
    with pytest.raises(TypeError, match="reward.collision must be a number"):
        etude.PianoEnv(options={"reward.collision": None})
    with pytest.raises(TypeError, match="num_envs comes first"):
        etude.PianoVectorEnv("twinkle")


@pytest.mark.parametrize("num_envs, threads", [(0, 1), (-1, 1), (5000, 1), (2, -1), (2, 100_000)])
def test_numbers_of_environments(num_envs, threads):
    with pytest.raises(etude.EtudeError, match="it must be from 1 to"):
        etude.PianoVectorEnv(num_envs, "c-major-scale", threads=threads)
    with pytest.raises(OverflowError):
        etude.PianoVectorEnv(2**70, "c-major-scale")


def test_without_a_screen_there_is_no_window_but_a_message(short_song):
    code = f"import etude; etude.PianoEnv({str(short_song)!r}, render_mode='human').reset(seed=0)"
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    ended = subprocess.run([sys.executable, "-c", code], env=bare, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 1 and "EtudeError: no window" in ended.stderr, ended.stderr


@pytest.mark.parametrize(
    "action", [np.zeros(12), np.zeros((1, 13)), np.full(13, np.nan), np.full(13, np.inf), None, "up", 3.0, [[]]]
)
def test_actions(action, short_song):
    env = etude.PianoEnv(short_song)
    env.reset(seed=0)
    with pytest.raises(REFUSED):
        env.step(action)
    assert env.step(np.zeros(13))[0].shape == (369,)


def test_vectors_of_the_wrong_shape(short_song):
    envs = etude.PianoVectorEnv(2, short_song)
    for seed in ([1], [1, 2, 3], [-1, 2], ["a", "b"], [2**80, 1]):
        with pytest.raises(REFUSED):
            envs.reset(seed=seed)
    for mask in (np.ones(3, bool), np.ones((2, 2), bool), np.ones(2), [True], np.zeros(2, bool)):
        with pytest.raises(REFUSED):
            envs.reset(seed=0, options={"reset_mask": mask})
    envs.reset(seed=0)
    for actions in (np.zeros((3, 13), np.float32), np.zeros(13), "up"):
        with pytest.raises(etude.EtudeError, match="shape"):
            envs.step(actions)
    with pytest.raises(etude.EtudeError, match="no environment 2"):
        envs.get_state(2)
    for seed in (-1, 2**64, 2**64 - 1, [2**80, 1]):
        with pytest.raises(etude.EtudeError, match="a seed must lie in"):
            envs.reset(seed=seed)
    envs.reset(seed=np.int64(3))


def test_an_environment_at_its_end_is_named(short_song):
    env, envs = etude.PianoEnv(short_song), etude.PianoVectorEnv(2, short_song)
    env.reset(seed=0)
    for _ in range(env.steps):
        env.step(np.zeros(13))
    envs.reset(seed=0)
    envs.set_state(1, env.get_state())
    with pytest.raises(etude.EtudeError, match="environment 1 is at the end of its song.*reset_mask"):
        envs.step(np.zeros((2, 13)))
    envs.reset(options={"reset_mask": np.array([False, True])})
    envs.step(np.zeros((2, 13)))


ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=20),
    st.binary(max_size=8),
    st.lists(st.integers(), max_size=3),
)
NAMES = st.one_of(st.text(max_size=20), st.sampled_from(["key.threshold", "joint.rail.damping", "collision", "energy"]))
TABLES = st.dictionaries(NAMES, ANYTHING, max_size=3)
PICTURES = st.fixed_dictionaries(
    {}, optional={"render_mode": ANYTHING, "width": ANYTHING, "height": ANYTHING, "view": ANYTHING}
)
FLAG, COUNT, REAL = st.booleans(), st.integers(-1, 50), st.floats(width=32)
# What each option takes.
OPTIONS = {
    "scale": st.sampled_from(["normalised", "si"]),
    "previous_joints": FLAG,
    "previous_actions": COUNT,
    "fingering": FLAG,
    "change_steps": COUNT,
    "finger_range": REAL,
    "rail_range": REAL,
    "rail_set_point": FLAG,
    "velocities": FLAG,
    "lookahead": COUNT,
    "initial_silence_secs": REAL,
    "plan.rule": st.sampled_from(["robopianist", "articulated"]),
    "plan.restrike_secs": REAL,
    "stage.side": st.sampled_from(["left", "right"]),
    "stage.fences": FLAG,
    "stage.interlock": FLAG,
    "stage.actuation": st.sampled_from(["controlled", "position"]),
    "reward.collision": REAL,
    "reward.energy": REAL,
    "physics.key.threshold": REAL,
    "physics.joint.rail.damping": REAL,
    "randomisation.intensity": REAL,
    "randomisation.widths.key.threshold": REAL,
}
PATHS = st.one_of(st.text(max_size=20), st.sampled_from(sorted(OPTIONS)), NAMES.map(lambda name: f"physics.{name}"))


@st.composite
def some_options(draw):
    """A few, so that most get past the others: mostly with what they take."""
    names = draw(st.lists(st.sampled_from(sorted(OPTIONS)), max_size=3, unique=True))
    return {name: draw(st.one_of(OPTIONS[name], OPTIONS[name], ANYTHING)) for name in names}


KEYWORDS = {
    "song": st.sampled_from(["twinkle", "c-major-scale"]),
    "preset": st.sampled_from(["paper", "appendix", "fast", "expressive"]),
    "options": st.one_of(some_options(), some_options(), st.dictionaries(PATHS, ANYTHING, max_size=3)),
    "config": TABLES,
}


@st.composite
def some_keywords(draw):
    """A few of them, mostly with what they take."""
    names = draw(st.lists(st.sampled_from(sorted(KEYWORDS)), max_size=3, unique=True))
    return {name: draw(st.one_of(KEYWORDS[name], KEYWORDS[name], ANYTHING)) for name in names}


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(some_keywords())
def test_no_keyword_makes_it_panic(keywords):
    try:
        env = etude.PianoEnv(**keywords)
    except REFUSED:
        return
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    reward = env.step(env.action_space.sample())[1]
    # Physics that are unstable have a reward that is no number.
    assert math.isfinite(reward) or keywords.get("options")


@settings(max_examples=100, deadline=None)
@given(PICTURES)
def test_no_picture_makes_it_panic(keywords):
    try:
        etude.PianoEnv("twinkle", **keywords)
    except REFUSED:
        return


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=400))
def test_no_file_makes_it_panic(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("files") / "hostile.mid"
    path.write_bytes(content)
    with pytest.raises(etude.EtudeError):
        etude.PianoEnv(path)
    with pytest.raises(etude.EtudeError):
        etude.load_policy(path.rename(path.with_suffix(".safetensors")))


def test_make_passes_the_message_on():
    with pytest.raises(etude.EtudeError, match="did you mean"):
        gymnasium.make("etude/Piano-v0", song="ode-to-joi")

"""RoboPianist's environment with the options of robopianist-rl's training script; physics steps of 5 ms, control steps of 50 ms,
as ours. The module is not called robopianist.py because that would hide the package."""

import os
import sys
import types

os.environ["MUJOCO_GL"] = "off"
# They make sound, need system libraries, and are imported whether sound is wanted or not.
for name in ["fluidsynth", "pyaudio"]:
    sys.modules[name] = types.ModuleType(name)

import mujoco
import robopianist
from mujoco_utils import composer_utils
from robopianist import music
from robopianist.models.hands import HandSide
from robopianist.suite.tasks.piano_with_one_shadow_hand import PianoWithOneShadowHand
from robopianist.suite.tasks.piano_with_shadow_hands import PianoWithShadowHands

VERSION = robopianist.__version__
# With SBX beside it another MuJoCo is installed too.
assert mujoco.__version__ == "3.3.7", mujoco.__version__


def environment(hands):
    """With "one hand", or "two hands" as usual."""
    options = dict(
        midi=music.load("TwinkleTwinkleRousseau"), trim_silence=True, gravity_compensation=True,
        reduced_action_space=True, n_steps_lookahead=10, primitive_fingertip_collisions=True, physics_timestep=0.005,
        control_timestep=0.05,
        disable_colorization=True,  # Colours cost time, and with one hand they fail ('NoneType' has no 'find_all').
    )
    one = hands == "one hand"
    task = PianoWithOneShadowHand(hand_side=HandSide.RIGHT, **options) if one else PianoWithShadowHands(**options)
    return composer_utils.Environment(
        task=task, random_state=0, strip_singleton_obs_buffer_dim=True, recompile_physics=False, legacy_step=True
    )

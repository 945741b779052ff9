#!/usr/bin/env python3
"""A planner without learning: random shooting through the simulator itself, by getting and setting
its state.

At each control step it tries sequences of actions from the present state, each the best one so far
with noise on it, and plays the first action of the best. No teacher, no gradient; the world is its
own model.

    random_shooting.py [SONG] [--steps N] [--tries N] [--horizon N]
"""

import argparse

import numpy as np

import etude


def best_plan(envs, state, plan, noise, random):
    """The best of the tries: each environment plays one, the first the plan as it is."""
    horizon, tries = len(plan), envs.num_envs
    plans = np.clip(plan + noise * random.normal(size=(tries, horizon, plan.shape[1])), -1, 1).astype(np.float32)
    plans[0] = plan
    for index in range(tries):
        envs.set_state(index, state)
    returns, going = np.zeros(tries), np.ones(tries, bool)
    for actions in plans.transpose(1, 0, 2):
        _, rewards, _, over, _ = envs.step(actions)
        returns += rewards * going
        going &= ~over
    return plans[np.argmax(returns)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("song", nargs="?", default="c-major-scale")
    parser.add_argument("--steps", type=int, help="control steps to play; the whole song if not given")
    parser.add_argument("--tries", type=int, default=64, help="sequences of actions a control step")
    parser.add_argument("--horizon", type=int, default=6, help="control steps a sequence looks ahead")
    parser.add_argument("--noise", type=float, default=0.3)
    arguments = parser.parse_args()

    random = np.random.default_rng(0)
    env = etude.PianoEnv(arguments.song)
    envs = etude.PianoVectorEnv(arguments.tries, arguments.song)
    env.reset(seed=0)
    plan = np.zeros((arguments.horizon, *env.action_space.shape), np.float32)
    for step in range(min(arguments.steps or env.steps, env.steps)):
        plan = best_plan(envs, env.get_state(), plan, arguments.noise, random)
        *_, info = env.step(plan[0])
        # The rest of the plan is where the next one begins.
        plan = np.concatenate([plan[1:], plan[-1:]])
        if (step + 1) % 20 == 0:
            print(f"{(step + 1) / etude.CONTROL_HZ:5.1f} s  F1 so far {info['f1']:.3f}", flush=True)
    print(f"{env.title}: F1 {info['f1']:.3f} after {step + 1} of {env.steps} control steps")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""What a physics step of 5 ms costs MuJoCo alone, without the environment around it, under random actions on one thread.

    benches/peers/bare_steps.sh SECONDS              RoboPianist's world, with one hand and with two
    benches/peers/bare_steps.sh SECONDS MODEL.xml    the file of `etude model export`, with keys and fences and without
"""

import os
import sys
import time

seconds = float(sys.argv[1])
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])

import numpy as np

PHYSICS_STEPS = 10  # In one control step.
random = np.random.default_rng(0)


def measure(name, model, data, control, reset):
    """Prints a row. `control(first)` writes data.ctrl before each physics step, the first of a control step or another; `reset`
    starts an episode of 10 s."""
    import mujoco

    spent, steps, contacts, rows = 0.0, 0, 0, 0
    while spent < seconds:
        reset()
        for _ in range(200):
            for step in range(PHYSICS_STEPS):
                control(step == 0)
                began = time.perf_counter()
                mujoco.mj_step(model, data)
                spent += time.perf_counter() - began
            steps, contacts, rows = steps + 1, contacts + data.ncon, rows + data.nefc
    micro = 1e6 * spent / steps / PHYSICS_STEPS
    print(f"| {name} | {mujoco.__version__} | {model.nv} | {contacts / steps:.1f} | {rows / steps:.0f} | {micro:.1f} | {1e5 / micro:.0f} |")


def ours(path):
    import xml.etree.ElementTree as tree

    import mujoco

    def changed(change):
        root = tree.parse(path).getroot()
        world = root.find("worldbody")
        for body in list(world):
            change(world, body, body.get("name", ""))
        return tree.tostring(root, encoding="unicode")

    def lift(world, body, name):
        if name == "palm":
            x, y, z = body.get("pos").split()
            body.set("pos", f"{x} {y} {float(z) + 0.3}")

    def clear(world, body, name):
        if name.startswith("key"):
            world.remove(body)

    for name, change in [
        ("Étude", lambda *_: None),
        ("Étude, the hand 0.3 m above its keys", lift),
        ("Étude, the hand alone", clear),
    ]:
        model = mujoco.MjModel.from_xml_string(changed(change))
        data = mujoco.MjData(model)
        joints = [model.actuator(i).name for i in range(model.nu)]
        dofs = np.array([model.joint(joint).qposadr[0] for joint in joints])
        low, high = model.jnt_range[dofs].T
        rail = np.array([joint == "rail" for joint in joints])
        low, high = np.where(rail, -0.15, low), np.where(rail, 0.15, high)
        # The joints' own drives without their filters: stiffness, damping and torque limit (docs/physics.md).
        limits = np.where(rail, 110.0, np.tile([0.3125, 0.5625, 0.375, 0.2375], 4)[: model.nu])

        target = np.zeros(model.nu)

        def control(first):
            if first:
                target[:] = random.uniform(low, high)
            position, velocity = data.qpos[dofs], data.qvel[dofs]
            torque = np.where(rail, 2e4, 3.0) * (target - position) - np.where(rail, 700.0, 0.1) * velocity
            data.ctrl[:] = np.clip(torque, -limits, limits)

        measure(name, model, data, control, lambda: mujoco.mj_resetData(model, data))


def robopianist():
    import robopianist_world as world

    for hands in ["one hand", "two hands"]:
        environment = world.environment(hands)
        spec = environment.action_spec()
        environment.reset()
        physics = environment.physics

        def control(first):
            if not first:
                return
            action = random.uniform(spec.minimum, spec.maximum)
            environment.task.before_step(physics, action, environment.random_state)

        measure(f"RoboPianist {world.VERSION}, {hands}", physics.model.ptr, physics.data.ptr, control, environment.reset)


print("| world | MuJoCo | degrees of freedom | contacts | constraint rows | µs a physics step | control steps/s |")
print("|---|---|---|---|---|---|---|")
if len(sys.argv) > 2:
    ours(sys.argv[2])
else:
    robopianist()

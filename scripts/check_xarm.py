#!/usr/bin/env python3
"""UFACTORY's own client against the emulator of the arm: moves, streams, reads back, sees errors.

    check_xarm.py COMMAND-PORT NORMAL-PORT RICH-PORT REAL-PORT

The ports are those of an emulator on this machine, where the client expects 502, 30001, 30002 and
30003. A line "inject CODE" on standard output asks whoever serves the emulator to raise that error.
Exits with 1 if anything differs.
"""

import math
import os
import socket
import sys
import time

# The paper's home position, degrees, and the pose of the flange by our kinematics: mm and degrees.
HOME = [0, 10, 0, 107.3, 180, -10.9, -225]
HOME_POSE = [524.494, 0, 584.883, 95.084, -44.887, 86.407]


def redirect(ports):
    """Redirects connections to the robot's ports to the emulator's, and refuses all others."""
    connect = socket.socket.connect

    def elsewhere(self, address):
        if self.family != socket.AF_INET or address[0] != "127.0.0.1":
            raise OSError(f"a connection to {address} was not meant to be made")
        return connect(self, (address[0], ports[address[1]]))

    socket.socket.connect = elsewhere


wrong = []


def check(what, holds, *details):
    print("ok  " if holds else "FAIL", what, *details, flush=True)
    if not holds:
        wrong.append(what)


def near(ours, theirs, tolerance):
    return len(ours) == len(theirs) and all(abs(a - b) <= tolerance for a, b in zip(ours, theirs))


def wait(condition, secs=10):
    end = time.monotonic() + secs
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    return condition()


def main(ports):
    redirect(dict(zip((502, 30001, 30002, 30003), ports)))
    from xarm.wrapper import XArmAPI

    arm = XArmAPI("127.0.0.1", is_radian=False, forbid_uds=True)
    check("connected", arm.connected and arm.axis == 7, arm.version)
    check("version", arm.version_number == (2, 4, 0), arm.version_number)
    check("reports arrive", wait(lambda: arm.get_state()[1] in (4, 5) and near(arm.angles, HOME, 0.01)), arm.angles)
    check("serial number", arm.get_robot_sn()[0] == 0 and arm.sn == "XS130424A01A08", arm.sn)

    def begin(mode):
        codes = [arm.clean_error(), arm.clean_warn(), arm.motion_enable(True), arm.set_mode(mode), arm.set_state(0)]
        check(f"mode {mode}", codes == [0] * 5 and wait(lambda: arm.state == 2 and arm.mode == mode), codes)

    begin(0)
    check("payload", arm.set_tcp_load(1.091, [-9.72, 18.38, 157.69], wait=True) == 0)
    check("payload reported", wait(lambda: near(arm.tcp_load[1], [-9.72, 18.38, 157.69], 0.01)), arm.tcp_load)

    # Limits of planned moves, in mm and degrees, and how the reports show them.
    codes = [arm.set_tcp_jerk(3000), arm.set_tcp_maxacc(4000), arm.set_joint_jerk(2000), arm.set_joint_maxacc(700)]
    check("limits set", codes == [0] * 4, codes)
    told = lambda: [arm.tcp_jerk, *arm.tcp_acc_limit, arm.joint_jerk, *arm.joint_acc_limit]
    check("limits reported", wait(lambda: near(told(), [3000, 0, 4000, 2000, 0, 700], 0.1)), told())
    arm.set_joint_maxacc(1145)
    arm.set_tcp_maxacc(50000)

    # The safety box: highest and lowest x, y, z in mm.
    box = [700, 200, 450, -460, 800, 100]
    check("box", arm.set_reduced_tcp_boundary(box) == 0)
    code, states = arm.get_reduced_states()
    check("box read", code == 0 and states[1] == box and states[5] == 0, states)
    arm.set_fence_mode(True)
    code, states = arm.get_reduced_states()
    check("box watched", code == 0 and states[5] == 1 and near(states[4][2:4], [-118, 120], 0.01), states)

    # Planned moves; the end of each is seen in the report frames.
    there = [20, 0, 10, 90, 170, 0, -200]
    check("planned move", arm.set_servo_angle(angle=there, speed=60, mvacc=500, wait=True, timeout=30) == 0)
    check("angles read", near(arm.get_servo_angle()[1], there, 0.01), arm.get_servo_angle())
    check("home", arm.set_servo_angle(angle=HOME, speed=60, mvacc=500, wait=True, timeout=30) == 0)
    code, pose = arm.get_position()
    check("position", code == 0 and near(pose, HOME_POSE, 0.002), pose)

    # A move out of the box, which stops the arm; then without a box.
    outside = [80, *HOME[1:]]
    arm.set_servo_angle(angle=outside, speed=60, mvacc=500, wait=False)
    check("box left", wait(lambda: arm.error_code == 35 and arm.state == 4), arm.error_code, arm.state)
    check("stopped at its side", wait(lambda: 450 <= arm.get_position()[1][1] < 480), arm.get_position())
    arm.set_fence_mode(False)
    begin(0)
    check("without a box", wait(lambda: arm.error_code == 0), arm.error_code)
    check("back home", arm.set_servo_angle(angle=HOME, speed=60, mvacc=500, wait=True, timeout=30) == 0)

    # A stream of targets, as in the paper.
    begin(1)
    codes, target = set(), list(HOME)
    for step in range(101):
        target[0] = HOME[0] + 10 * (1 - math.cos(math.pi * step / 100))
        codes.add(arm.set_servo_angle_j(target))
        time.sleep(0.005)
    check("stream", codes == {0}, codes)
    check("stream followed", wait(lambda: near(arm.get_servo_angle()[1], target, 0.01)), arm.get_servo_angle())
    check("real angles", near(arm.get_servo_angle(is_real=True)[1], target, 0.01))
    check("state", wait(lambda: arm.state == 2), arm.state)
    pose = arm.get_position()[1]

    # Errors: one from outside, one from a target that is too far.
    print("inject 31", flush=True)
    check("error seen", wait(lambda: arm.error_code == 31 and arm.state == 4), arm.error_code, arm.state)
    check("error read", arm.get_err_warn_code() == (0, [31, 0]), arm.get_err_warn_code())
    arm.set_servo_angle_j(HOME)
    check("no motion with an error", near(arm.get_position()[1], pose, 0.02))
    begin(1)
    check("error gone", wait(lambda: arm.error_code == 0), arm.error_code)
    arm.set_servo_angle_j([HOME[0] + 90, *HOME[1:]])
    check("far target", wait(lambda: arm.error_code == 24 and arm.state == 4), arm.error_code)
    check("limits", arm.set_servo_angle_j([0, 0, 0, -20, 0, 0, 0]) != 0)

    begin(0)
    check("stops", arm.set_servo_angle(angle=there, speed=30, mvacc=500, wait=False) == 0)
    time.sleep(0.3)
    arm.emergency_stop()
    check("stopped", wait(lambda: arm.state >= 4), arm.state)
    time.sleep(0.3)
    before = arm.get_servo_angle()[1]
    check("on the way", 1 < before[0] < 20 + 1e-3 and near(before, arm.get_servo_angle()[1], 1e-3), before)
    arm.disconnect()

    # The other report ports.
    for report_type in ("normal", "real"):
        arm = XArmAPI("127.0.0.1", is_radian=False, forbid_uds=True, report_type=report_type)
        check(f"{report_type} reports", wait(lambda: near(arm.angles, before, 0.01)), arm.angles)
        arm.disconnect()

    print(f"{len(wrong)} differences" if wrong else "all agree")
    return 1 if wrong else 0


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    code = main([int(port) for port in sys.argv[1:]])
    sys.stdout.flush()
    # The client's threads would keep the process alive for a while.
    os._exit(code)

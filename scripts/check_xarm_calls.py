#!/usr/bin/env python3
"""Every call of UFACTORY's own client that a user makes, against the emulator of the arm.

    check_xarm_calls.py COMMAND-PORT NORMAL-PORT RICH-PORT REAL-PORT

The ports are as for check_xarm.py. One line a call: whether it answers as a real controller does,
its name, its code and its value. Codes that are expected beside 0: 1 for an accessory that is not
there, at which the controller raises error 19 (flange) or 111 (control box); 9 for a move in a mode
that does not take it; 31, the client's own, for a file that is not there. A call that differs, or
for which no source tells the answer of a real controller, names the reason. Exits with 1 if a call
raises, if one differs without a reason, or if fewer than 120 methods agree in all their calls.
"""

import os
import sys
import time

from check_xarm import HOME, HOME_POSE, near, redirect, wait

ENOUGH = 120
BOX = [700, -700, 700, -700, 900, -300]
RANGES = [-350, 350, -110, 110, -350, 350, -10, 220, -350, 350, -90, 170, -350, 350]
NO_DEVICE = "the reply of a real controller, behind which nothing answers, has a length that is not known"
NO_SOLUTION = "the code of a real controller for a pose out of reach is not known"
NO_SENSOR = "no force sensor: the answer of a real controller without one is not known"
NO_TEACHING = "not emulated: what is taught with several points is not calculated"
NO_MODBUS = "standard Modbus TCP is answered with its exception 1"
NO_STUDIO = "xArm Studio's port 18333 is not served"

# Name and verdict of each call of a method, and of each value in the reports.
calls, values = [], []


def short(value):
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)):
        return "[" + " ".join(short(item) for item in list(value)[:8]) + (" ..." if len(value) > 8 else "") + "]"
    return str(value)


def main(ports):
    redirect(dict(zip((502, 30001, 30002, 30003), ports)))
    from xarm.wrapper import XArmAPI

    arm = XArmAPI("127.0.0.1", is_radian=False, forbid_uds=True)
    wait(lambda: near(arm.angles, HOME, 0.01))

    def call(name, *args, want=0, value=None, differs=None, **options):
        """Compares the code and the value of a call with what a real controller gives."""
        try:
            answer = getattr(arm, name)(*args, **options)
        except Exception as error:
            print(f"RAISED {name}: {error!r}", flush=True)
            calls.append((name, "RAISED"))
            return None
        code, got = answer, None
        if isinstance(answer, (list, tuple)):
            code, got = answer[0], (answer[1] if len(answer) == 2 else list(answer[1:]))
        if isinstance(code, bool) or code is None:
            code, got = 0, code
        right = code == want and (value is None or (value(got) if callable(value) else got == value))
        verdict = "ok" if right else "differs" if differs else "WRONG"
        why = "" if right else f" ({differs or 'expected ' + str(want)})"
        print(f"{verdict:7} {name}: {code} {short(got) if got is not None else ''}{why}", flush=True)
        calls.append((name, verdict))
        return got

    def shown(name, value):
        """Holds a value of the reports against what was set."""
        right = wait(lambda: value(getattr(arm, name)), 2)
        verdict = "ok" if right else "WRONG"
        print(f"{verdict:7} {name} in the reports: {short(getattr(arm, name))}", flush=True)
        values.append((name, verdict))

    def close(*values, within=0.01):
        return lambda got: near(got, values, within)

    def clear(mode=0):
        """Not counted: makes the arm ready after an error, or in another mode."""
        arm.clean_error()
        arm.clean_warn()
        arm.motion_enable(True)
        arm.set_mode(mode)
        arm.set_state(0)
        wait(lambda: arm.state == 2 and arm.mode == mode and arm.error_code == 0)

    # Start, state and identity.
    call("get_version", value=lambda text: text.endswith("v2.4.0"))
    call("get_robot_sn", value="XS130424A01A08")
    call("check_verification", value=0)
    call("clean_error")
    call("clean_warn")
    call("motion_enable", True)
    call("set_mode", 0)
    call("set_state", 0)
    call("get_state", value=2)
    call("get_cmdnum", value=0)
    call("get_err_warn_code", value=[0, 0])
    call("get_is_moving", value=False)
    call("get_hd_types")
    call("get_position", value=close(*HOME_POSE))
    call("get_position_aa", value=lambda pose: near(pose[:3], HOME_POSE[:3], 0.01))
    call("get_servo_angle", value=close(*HOME))
    call("get_joint_states", value=lambda sets: len(sets) == 3 and near(sets[0], HOME, 0.01))
    call("get_joints_torque", value=lambda torques: len(torques) == 7)
    call("get_trajectory_rw_status", value=0)
    call("set_feedback_type", 0)

    # Kinematics.
    call("get_forward_kinematics", HOME, value=close(*HOME_POSE))
    call("get_inverse_kinematics", HOME_POSE, value=close(*HOME, within=0.05))
    call("get_inverse_kinematics", [2000, 0, 500, 180, 0, 0], differs=NO_SOLUTION)
    call("clean_warn")
    call("is_joint_limit", HOME, value=False)
    call("is_joint_limit", [0, 0, 0, -30, 0, 0, 0], value=True)
    call("is_tcp_limit", HOME_POSE, value=False)
    call("is_tcp_limit", [2000, 0, 500, 180, 0, 0], value=True)
    call("get_pose_offset", [100, 0, 0, 0, 0, 0], [150, 20, 0, 0, 0, 0], value=close(50, 20, 0, 0, 0, 0))
    call("get_dh_params", value=lambda rows: len(rows) == 28 and rows[1] == 267)
    call("set_dh_params", [0] * 28, 3)

    # Settings, which are read back.
    call("set_tcp_load", 1.0, [1, 2, 3])
    shown("tcp_load", lambda load: load[0] == 1 and near(load[1], [1, 2, 3], 0.01))
    call("set_tcp_offset", [0, 0, 50, 0, 0, 0])
    shown("tcp_offset", close(0, 0, 50, 0, 0, 0))
    call("set_state", 0)
    call("set_tcp_offset", [0] * 6)
    call("set_state", 0)
    call("set_world_offset", [10, 20, 30, 0, 0, 0])
    shown("world_offset", close(10, 20, 30, 0, 0, 0))
    call("get_position", value=lambda pose: near(pose[:3], [HOME_POSE[0] + 10, 20, HOME_POSE[2] + 30], 0.01))
    call("set_state", 0)
    call("set_world_offset", [0] * 6)
    call("set_state", 0)
    call("set_gravity_direction", [0, 1, 0])
    shown("gravity_direction", close(0, 1, 0))
    call("set_mount_direction", 0, 0)
    shown("gravity_direction", close(0, 0, -1))
    call("set_state", 0)
    call("set_collision_sensitivity", 2)
    shown("collision_sensitivity", lambda got: got == 2)
    call("set_teach_sensitivity", 4)
    shown("teach_sensitivity", lambda got: got == 4)
    clear()
    call("set_tcp_jerk", 3000)
    shown("tcp_jerk", lambda got: got == 3000)
    call("set_tcp_maxacc", 40000)
    shown("tcp_acc_limit", lambda got: got[1] == 40000)
    call("set_joint_jerk", 2000)
    shown("joint_jerk", lambda got: abs(got - 2000) < 0.1)
    call("set_joint_maxacc", 1000)
    shown("joint_acc_limit", lambda got: abs(got[1] - 1000) < 0.1)
    call("save_conf")

    # Reduced mode, the box and other guards.
    call("set_reduced_max_tcp_speed", 300)
    call("set_reduced_max_joint_speed", 60)
    call("set_reduced_tcp_boundary", BOX)
    call("set_reduced_joint_range", RANGES)
    call("set_reduced_mode", True)
    call("get_reduced_mode", value=1)
    call("set_fence_mode", True)
    call("set_collision_rebound", True)
    call(
        "get_reduced_states",
        value=lambda got: got[:4] == [1, BOX, 300, 60] and near(got[4], RANGES, 0.1) and got[5:] == [1, 1],
    )
    shown("is_reduced_mode", bool)
    shown("is_fence_mode", bool)
    shown("reduced_max_tcp_speed", lambda got: got == 300)
    for name in ("set_reduced_mode", "set_fence_mode", "set_collision_rebound"):
        call(name, False)
    call("set_self_collision_detection", True)
    call("set_collision_tool_model", 22, 100, 50, 20)
    shown("self_collision_params", lambda got: got[0] and got[1] == 22 and near(got[2][:3], [100, 50, 20], 0.01))
    call("set_self_collision_detection", False)
    call("set_allow_approx_motion", False)
    call("get_allow_approx_motion", value=0)
    call("set_cartesian_velo_continuous", True)
    shown("is_cart_continuous", bool)
    call("set_report_tau_or_i", 1)
    call("get_report_tau_or_i", value=1)
    call("set_report_tau_or_i", 0)
    call("set_linear_spd_limit_factor", 1.1)
    call("get_linear_spd_limit_factor", value=lambda got: abs(got - 1.1) < 1e-6)
    call("set_cmd_mat_history_num", 100)
    call("get_cmd_mat_history_num", value=100)
    call("set_fdb_mat_history_num", 200)
    call("get_fdb_mat_history_num", value=200)
    call("set_xarm7_ik_redundancy", [0.0] * 7, [1.0] * 7)
    call("get_xarm7_ik_redundancy", value=lambda got: got == [[0.0] * 7, [1.0] * 7])
    for name in ("get_poe_status", "get_iden_status", "get_c31_error_info", "get_c37_error_info", "get_c23_error_info"):
        call(name)
    for name in ("get_c24_error_info", "get_c60_error_info", "get_c38_error_info", "get_c54_error_info"):
        call(name)
    call("get_traj_speeding", 1)
    call("set_counter_reset")
    call("set_counter_increase")
    shown("count", lambda got: got == 1)

    # Moves of mode 0.
    there = [5, *HOME[1:]]
    still = lambda: wait(lambda: not arm.get_is_moving() and arm.get_cmdnum()[1] == 0, 20)
    call("set_servo_angle", angle=there, speed=60, mvacc=500, wait=True)
    call("get_servo_angle", value=close(*there))
    call("set_servo_angle", angle=[-5, 0, 0, 0, 0, 0, 0], relative=True, speed=60, mvacc=500, wait=True)
    call("set_servo_angle", angle=there, speed=60, mvacc=500, radius=5, wait=False)
    call("set_pause_time", 0.1)
    still()
    pose = [HOME_POSE[0], 30, *HOME_POSE[2:]]
    call("set_position", *pose, speed=100, mvacc=2000, wait=True)
    call("get_position", value=close(*pose, within=0.1))
    call("set_position", y=-20, relative=True, speed=100, mvacc=2000, wait=True)
    call("get_position", value=lambda got: abs(got[1] - 10) < 0.1)
    call("set_tool_position", z=10, speed=100, mvacc=2000, wait=True)
    aa = arm.get_position_aa()[1]
    call("set_position_aa", [aa[0], aa[1] + 10, *aa[2:]], speed=100, mvacc=2000, wait=True)
    call("get_position_aa", value=lambda got: abs(got[1] - aa[1] - 10) < 0.1)
    higher = [HOME_POSE[0], 0, HOME_POSE[2] + 20, *HOME_POSE[3:]]
    call("move_circle", pose, higher, 50, speed=100, mvacc=2000, wait=False)
    still()
    call("set_servo_angle", angle=HOME, speed=90, mvacc=900, wait=True)
    call("set_only_check_type", 1)
    call("set_position", 3000, 0, 0, 180, 0, 0, want=1)
    call("set_only_check_type", 0)
    call("set_servo_angle_j", HOME, want=9)
    call("set_state", 3)
    call("set_state", 0)

    # Servo mode, manual mode, velocities, online planning.
    clear(1)
    call("set_servo_angle_j", [HOME[0] + 0.5, *HOME[1:]])
    call("set_servo_cartesian", [HOME_POSE[0] + 2, *HOME_POSE[1:]])
    time.sleep(0.3)
    call("set_servo_cartesian_aa", [1, 0, 0, 0, 0, 0], is_tool_coord=False, relative=True)
    time.sleep(0.3)
    call("set_mode", 2)
    call("set_state", 0)
    clear(4)
    before = arm.get_servo_angle()[1]
    call("vc_set_joint_velocity", [20, 0, 0, 0, 0, 0, 0], duration=1)
    time.sleep(0.2)
    call("get_joint_states", value=lambda sets: abs(sets[1][0] - 20) < 1)
    time.sleep(1)
    still()
    call("get_servo_angle", value=lambda got: 19.5 < got[0] - before[0] < 20.5)
    call("get_is_moving", value=False)
    clear(5)
    pose = arm.get_position()[1]
    call("vc_set_cartesian_velocity", [0, 0, 50, 0, 0, 0], duration=0.3)
    time.sleep(0.5)
    still()
    call("get_position", value=lambda got: near(got[:3], [pose[0], pose[1], pose[2] + 15], 1.5))
    clear(6)
    call("set_servo_angle", angle=there, speed=20, mvacc=200, wait=False)
    time.sleep(0.1)
    call("set_servo_angle", angle=HOME, speed=90, mvacc=900, wait=False)
    still()
    call("get_servo_angle", value=close(*HOME, within=0.05))
    clear(7)
    call("set_position", *HOME_POSE[:2], HOME_POSE[2] + 10, *HOME_POSE[3:], speed=100, mvacc=2000, wait=False)
    still()
    call("get_position", value=lambda got: abs(got[2] - HOME_POSE[2] - 10) < 0.1)
    clear()
    call("move_gohome", speed=100, mvacc=900, wait=True)
    call("get_servo_angle", value=close(0, 0, 0, 0, 0, 0, 0))
    call("set_servo_angle", angle=HOME, speed=120, mvacc=900, wait=True)
    call("set_servo_detach", 1)
    call("set_servo_attach", 8)
    clear()

    # Trajectories.
    call("start_record_trajectory")
    call("stop_record_trajectory", "etude")
    call("save_record_trajectory", "etude")
    call("load_trajectory", "etude")
    call("get_trajectory_rw_status", value=2)
    call("playback_trajectory", 1, wait=False)
    call("load_trajectory", "nothing", want=31)
    call("get_trajectories", differs=NO_STUDIO)

    # Inputs and outputs.
    clear()
    call("get_tgpio_version", value=lambda got: got.count(".") == 2)
    call("get_tgpio_digital", value=lambda got: len(got) == 4)
    call("get_tool_digital_input")
    call("get_tgpio_analog", value=lambda got: len(got) == 2)
    call("set_tgpio_digital", 0, 1)
    call("get_tgpio_output_digital", value=[1, 0, 0, 0, 0])
    call("get_cgpio_digital", value=lambda got: len(got) in (8, 16))
    call("get_cgpio_analog", value=lambda got: len(got) == 2)
    call("set_cgpio_digital", 3, 1)
    call("set_cgpio_digital", 9, 1)
    call("set_cgpio_analog", 0, 5)
    call("set_cgpio_analog", 1, 2.5)
    call("set_cgpio_digital_input_function", 2, 1)
    call("set_cgpio_digital_output_function", 2, 1)
    call(
        "get_cgpio_state",
        value=lambda got: got[5] == 1 << 3 | 1 << 9 and near(got[8:10], [5, 2.5], 0.01) and got[10][2] == got[11][2] == 1,
    )
    shown("cgpio_states", lambda got: got[5] == 1 << 3 | 1 << 9)
    call("set_tgpio_digital_with_xyz", 0, 0, [500, 0, 500], 10)
    call("set_cgpio_digital_with_xyz", 3, 0, [500, 0, 500], 10)
    call("set_cgpio_analog_with_xyz", 0, 0, [500, 0, 500], 10)
    call("config_tgpio_reset_when_stop", True)
    call("config_cgpio_reset_when_stop", True)
    shown("gpio_reset_config", lambda got: list(got) == [1, 1])
    call("set_vacuum_gripper", True, wait=False)
    call("get_vacuum_gripper")
    for name in ("open_lite6_gripper", "close_lite6_gripper", "stop_lite6_gripper"):
        call(name)
    call("get_rs485_baudrate", value=2000000)
    call("set_rs485_timeout", 50)
    call("get_rs485_timeout", value=50)
    call("set_modbusrtu_params", 1, 115200)
    call("get_modbusrtu_params", value=[1, 115200, 1, 0])
    call("set_external_device_monitor_params", 1, 20)
    call("get_external_device_monitor_params", value=[1, 20])
    call("set_tgpio_monitor_params", 1, 20)
    call("get_tgpio_monitor_params", value=[1, 20])

    # Servos.
    call("get_servo_debug_msg", value=lambda got: len(got) == 8 and all(servo["code"] == 0 for servo in got))
    call("get_servo_version", 1, value=lambda got: "*" not in got)
    call("get_harmonic_type", 1)
    shown("temperatures", lambda got: len(got) == 7 and all(20 < degrees < 60 for degrees in got))
    shown("currents", lambda got: len(got) == 7 and got[1] > 1)
    shown("voltages", lambda got: near(got, [48] * 7, 1))

    # Accessories that are not there.
    for name, *args in (
        ("set_gripper_enable", True),
        ("set_gripper_mode", 0),
        ("set_gripper_speed", 1000),
        ("get_gripper_position",),
        ("get_gripper_status",),
        ("get_gripper_version",),
        ("get_gripper_err_code",),
        ("clean_gripper_error",),
        ("set_rs485_data", [1, 3, 0, 0, 0, 1]),
    ):
        call(name, *args, want=1)
        clear()
    for name, *args in (
        ("get_bio_gripper_status",),
        ("get_bio_gripper_error",),
        ("get_linear_motor_pos",),
        ("get_linear_motor_status",),
    ):
        call(name, *args, differs=NO_DEVICE)
        clear()
    call("get_base_board_version", differs="no board in the base: the answer of a real controller without one is not known")
    call("get_ft_sensor_error", value=0)
    for name, *args in (("get_ft_sensor_mode",), ("get_ft_sensor_data",), ("get_ft_sensor_config",)):
        call(name, *args, differs=NO_SENSOR)
    for name, *args in (("set_ft_sensor_enable", 1), ("set_ft_sensor_mode", 0), ("set_ft_sensor_zero",)):
        call(name, *args, differs=NO_SENSOR)
    call("iden_tcp_load", differs="not emulated: the payload is not identified")
    call("calibrate_tcp_coordinate_offset", [HOME_POSE] * 4, differs=NO_TEACHING)
    call("calibrate_tcp_orientation_offset", [0, 0, 0], [0, 0, 0], differs=NO_TEACHING)
    call("calibrate_user_orientation_offset", [HOME_POSE] * 3, differs=NO_TEACHING)
    call("calibrate_user_coordinate_offset", [0, 0, 0], [0, 0, 0], differs=NO_TEACHING)
    call("read_holding_registers", 0, 1, differs=NO_MODBUS)
    call("write_single_holding_register", 0, 1, differs=NO_MODBUS)
    call("read_coil_bits", 0, 1, differs=NO_MODBUS)

    # The end.
    call("set_simulation_robot", True)
    shown("is_simulation_robot", bool)
    call("set_simulation_robot", False)
    call("set_tcp_load", 1.0, [1, 2, 3])
    shown("tcp_load", lambda load: load[0] == 1)
    call("clean_conf")
    shown("tcp_load", lambda load: load[0] == 0)
    call("emergency_stop")
    call("get_state", value=4)
    arm.disconnect()

    def count(verdict):
        return sum(verdict == found for _, found in calls + values)

    methods = {name for name, _ in calls}
    agree = methods - {name for name, verdict in calls if verdict != "ok"}
    print(
        f"{len(methods)} methods in {len(calls)} calls, and {len(values)} values in the reports: {len(agree)} methods agree in "
        f"all their calls; {count('differs')} calls differ as listed, {count('WRONG')} are wrong, {count('RAISED')} raise"
    )
    return 0 if count("WRONG") == count("RAISED") == 0 and len(agree) >= ENOUGH else 1


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    code = main([int(port) for port in sys.argv[1:]])
    sys.stdout.flush()
    # The client's threads would keep the process alive for a while.
    os._exit(code)

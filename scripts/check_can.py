#!/usr/bin/env python3
"""Drives an emulated Allegro hand with python-can: an independent reading of the bytes.

    check_can.py /dev/pts/N

The adapter (slcan) at this path must have the hand of crates/robot/tests/drivers/can.rs behind it. The
script asks for the information and the serial number, starts the position stream, drives the middle
finger's proximal joint and sees it move.
"""

import struct
import sys
import time

import can

VERSION = "4.6.1"
ON, OFF, PERIODS, INFORMATION, SERIAL = 0x100, 0x104, 0x204, 0x200, 0x220
POSITION, TORQUE, TEMPERATURE = 0x080, 0x180, 0x0E0
RAD_PER_COUNT = 333.3 / 65536 * 3.141592653589793 / 180
# Slower than the hand's usual 3 ms: python-can reads byte by byte, and must keep up on a busy
# machine.
PERIOD_MS = 10
TIMEOUT_SECS = 20.0
MIDDLE = 1


def send(bus, identifier, data=b""):
    bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))


def receive(bus, identifier):
    end = time.monotonic() + TIMEOUT_SECS
    while time.monotonic() < end:
        message = bus.recv(0.1)
        if message is not None and message.arbitration_id == identifier:
            assert not message.is_remote_frame and not message.is_extended_id, message
            return bytes(message.data)
    raise SystemExit(f"no frame {identifier:03X} within {TIMEOUT_SECS} s")


def ask(bus, identifier):
    bus.send(can.Message(arbitration_id=identifier, is_remote_frame=True, is_extended_id=False))
    return receive(bus, identifier)


def angle(data):
    return struct.unpack("<4h", data)[1] * RAD_PER_COUNT


def drive(bus, pwm, secs):
    """The middle finger's proximal angle after `secs` under this PWM."""
    send(bus, TORQUE + 4 * MIDDLE, struct.pack("<4h", 0, pwm, 0, 0))
    end = time.monotonic() + secs
    while time.monotonic() < end:
        rad = angle(receive(bus, POSITION + 4 * MIDDLE))
    return rad


def main(channel: str) -> int:
    if can.__version__ != VERSION:
        print(f"this is python-can {can.__version__}, not {VERSION}: pip install python-can=={VERSION}")
        return 2
    with can.Bus(interface="slcan", channel=channel, bitrate=1_000_000, sleep_after_open=0.05) as bus:
        hardware, firmware, side, celsius, status = struct.unpack("<HHBBB", ask(bus, INFORMATION))
        told = (hardware >> 8, side, 20 <= celsius <= 60, status)
        assert told == (4, 1, True, 0), (hardware, firmware, side, celsius, status)
        serial = ask(bus, SERIAL).decode("ascii")
        assert len(serial) == 8 and serial.isalnum(), serial
        temperatures = ask(bus, TEMPERATURE)
        assert len(temperatures) == 4 and all(20 <= t <= 60 for t in temperatures), temperatures

        send(bus, PERIODS, struct.pack("<3H", PERIOD_MS, 0, 0))
        order, start = [], time.monotonic()
        while len(order) < 400:
            message = bus.recv(TIMEOUT_SECS)
            if message is None:
                raise SystemExit("the position stream has stopped")
            if POSITION <= message.arbitration_id < POSITION + 16:
                assert message.dlc == 8
                order.append((message.arbitration_id - POSITION) // 4)
        rate = len(order) / 4 / (time.monotonic() - start)
        assert order == [0, 1, 2, 3] * 100, order

        still = drive(bus, 600, 0.2)
        assert abs(still) < 1e-3, f"moved to {still} with the servo off"
        send(bus, ON)
        assert ask(bus, INFORMATION)[6] == 1
        bent = drive(bus, 600, 1.0)
        assert abs(bent - 1.61) < 2e-4, f"{bent} is not the upper stop"
        straight = drive(bus, -600, 1.0)
        assert abs(straight + 0.196) < 2e-4, f"{straight} is not the lower stop"
        # The 8-byte form, and OFF.
        send(bus, PERIODS, struct.pack("<4H", 0, 0, 0, 0))
        send(bus, OFF)
        assert ask(bus, INFORMATION)[6] == 0
        while bus.recv(0.05) is not None:
            pass
        assert bus.recv(0.1) is None, "the stream goes on"
    print(f"python-can {VERSION}: serial {serial}, {rate:.0f} periods/s, {straight:.3f} to {bent:.3f} rad")
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    sys.exit(main(sys.argv[1]))

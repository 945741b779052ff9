#!/usr/bin/env python3
"""Opens recordings that were cut off with the readers of the mcap package, as they are by default.

    check_cut_recordings.py FILE...

Seeking and non-seeking reader must find the same messages in each, the header among them. Prints
the number of messages and the last publish time (s) of each file, as JSON.
"""

import json
import pathlib
import sys

from mcap.reader import NonSeekingReader, SeekingReader, make_reader


def main(paths: list[pathlib.Path]) -> int:
    found = []
    for path in paths:
        readings = []
        for reader in (make_reader, SeekingReader, NonSeekingReader):
            with open(path, "rb") as file:
                messages = [(channel.topic, message.sequence, message.publish_time) for _, channel, message in reader(file).iter_messages()]
            readings.append(sorted(messages, key=lambda message: message[1]))
        if readings[0] != readings[1] or readings[0] != readings[2]:
            raise SystemExit(f"{path}: the readers find {[len(reading) for reading in readings]} messages")
        sequences = [sequence for _, sequence, _ in readings[0]]
        if sequences != list(range(1, len(sequences) + 1)):
            raise SystemExit(f"{path}: messages are missing")
        found.append([len(sequences), max((time for _, _, time in readings[0]), default=0) * 1e-9])
    print(json.dumps(found))
    return 0


if __name__ == "__main__":
    raise SystemExit(main([pathlib.Path(path) for path in sys.argv[1:]]))

"""Checks the sound of a performance with librosa's onset detector: check_sound.py FOLDER…

A folder is one that `etude play` wrote. The onsets that librosa hears in performance.wav must be
those that it hears in reference.wav, and these must be the onsets that were due (mir_eval's
F-measure, 50 ms).
"""

import csv
import pathlib
import sys

import librosa
import mir_eval
import numpy

CONTROL_HZ = 20
NEAR_SECS = 0.05
LEAST = 0.95


def heard(path):
    samples, rate = librosa.load(path, sr=None)
    return librosa.onset.onset_detect(y=samples, sr=rate, units="time")


def due(path):
    """Beginnings of the control steps in which a key becomes due that was not."""
    rows = list(csv.DictReader(path.open()))
    keys = [set(row["due"].split()) for row in rows]
    return numpy.array([step / CONTROL_HZ for step in range(1, len(keys)) if keys[step] - keys[step - 1]])


for folder in map(pathlib.Path, sys.argv[1:]):
    played, reference = heard(folder / "performance.wav"), heard(folder / "reference.wav")
    score = mir_eval.onset.f_measure(reference, played, window=NEAR_SECS)[0]
    detector = mir_eval.onset.f_measure(due(folder / "frames.csv"), reference, window=NEAR_SECS)[0]
    print(f"{folder}: {len(played)} onsets heard, {len(reference)} in the reference: F {score:.3f}; the reference to the score: F {detector:.3f}")
    if min(score, detector) < LEAST:
        sys.exit(f"{folder}: F must be at least {LEAST}; played at {numpy.round(played, 2)}, reference at {numpy.round(reference, 2)}")

"""Draws due and played keys, from the frames.csv of `etude play`: roll.py frames.csv > roll.svg

Right is filled, missed is an outline, wrong is hatched, so that they differ without colours.
"""

import csv
import sys

STEP, KEY, MARGIN = 5, 9, 34
STYLES = {
    "right": 'fill="#0072b2"',
    "missed": 'fill="none" stroke="#0072b2" stroke-width="1"',
    "wrong": 'fill="url(#hatch)" stroke="#d55e00" stroke-width="0.5"',
}
NAMES = ["C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B"]

rows = [
    (set(map(int, row["due"].split())), set(map(int, row["pressed"].split())))
    for row in csv.DictReader(open(sys.argv[1], newline=""))
]
used = set().union(*(due | pressed for due, pressed in rows)) or {60}
low, high = min(used) - 1, max(used) + 1
width, height = MARGIN + STEP * len(rows) + 8, KEY * (high - low + 1) + 44
print(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="8">')
print('<defs><pattern id="hatch" width="3" height="3" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
      '<rect width="1.2" height="3" fill="#d55e00"/></pattern></defs>')
print(f'<rect width="{width}" height="{height}" fill="white"/>')
for pitch in range(low, high + 1):
    y = KEY * (high - pitch)
    if NAMES[pitch % 12].endswith("#"):
        print(f'<rect x="{MARGIN}" y="{y}" width="{STEP * len(rows)}" height="{KEY}" fill="#f0f0f0"/>')
    print(f'<text x="{MARGIN - 4}" y="{y + KEY - 2}" text-anchor="end">{NAMES[pitch % 12]}{pitch // 12 - 1}</text>')


def runs(pitch):
    """Stretches of equal state of one key: (kind, first step, length)."""
    found, kind, start = [], None, 0
    for step, (due, pressed) in enumerate(rows + [(set(), set())]):
        now = {(True, True): "right", (True, False): "missed", (False, True): "wrong"}.get((pitch in due, pitch in pressed))
        if now != kind:
            if kind:
                found.append((kind, start, step - start))
            kind, start = now, step
    return found


for pitch in range(low, high + 1):
    for kind, start, length in runs(pitch):
        print(f'<rect x="{MARGIN + STEP * start}" y="{KEY * (high - pitch) + 1}" width="{STEP * length}" '
              f'height="{KEY - 2}" {STYLES[kind]}/>')
bottom = KEY * (high - low + 1)
for second in range(0, len(rows) // 20 + 1):
    x = MARGIN + STEP * 20 * second
    print(f'<line x1="{x}" y1="0" x2="{x}" y2="{bottom}" stroke="#999" stroke-width="0.3"/>')
    print(f'<text x="{x}" y="{bottom + 10}" text-anchor="middle">{second} s</text>')
for index, (kind, style) in enumerate(STYLES.items()):
    x = MARGIN + 90 * index
    print(f'<rect x="{x}" y="{bottom + 22}" width="18" height="8" {style}/><text x="{x + 23}" y="{bottom + 29}">{kind}</text>')
print("</svg>")

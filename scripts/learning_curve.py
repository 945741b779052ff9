"""Writes a run's evaluations as CSV: learning_curve.py RUN > curve.csv"""

import csv
import json
import pathlib
import sys

rows, elapsed = [], 0.0
for line in pathlib.Path(sys.argv[1], "metrics.jsonl").read_text().splitlines():
    row = json.loads(line)
    elapsed = row.get("perf/elapsed_secs", elapsed)
    scores = {key.removeprefix("eval/"): value for key, value in row.items() if key.startswith("eval/")}
    if scores:
        rows.append({"step": row["step"], "secs": round(elapsed, 1)} | {k: round(v, 4) for k, v in scores.items()})
out = csv.DictWriter(sys.stdout, rows[0].keys(), lineterminator="\n")
out.writeheader()
out.writerows(rows)

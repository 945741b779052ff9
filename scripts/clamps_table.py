"""How often the robot's limiter holds a set-point back while the shipped policies play on the twin, and by which limit: the table of docs/results/robot.md.
A set-point counts if any joint of it is clamped, while the song is played; the columns of the limits count each set-point once a limit. Needs the mcap
package.

    make build && PYTHONPATH=.python python3 scripts/clamps_table.py [--truth standard --truth worn] [--runs 1]
"""

import json
from collections import Counter

from mcap.reader import make_reader

from robot_table import MODES, ROOT, etude, perform, truths_and_runs

RAIL = 12


def counted(recording):
    """The number of set-points that were sent while the song was played, and how many were clamped: in all, and by joint and limit."""
    counts = Counter()
    with open(ROOT / recording, "rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=["/setpoint"]):
            # Everything before the song has time 0.
            if message.log_time > 0:
                clamps = json.loads(message.data)["clamps"]
                counts["all"] += 1
                counts.update({"clamped"} if clamps else ())
                counts.update({("rail" if joint == RAIL else "fingers", limit) for joint, limit in clamps})
    return counts


def main():
    truths, runs_each = truths_and_runs(__doc__)
    songs = [song["id"] for song in etude("songs", "--json")]
    print("| truth | mode | clamped set-points | the song with the most | by limit |")
    print("|---|---|---|---|---|")
    for truth in truths:
        for mode in MODES:
            total, shares = Counter(), {}
            for song in songs:
                runs = perform(song, mode, truth, runs_each)["runs"]
                of_song = sum((counted(run["files"]["recording"]) for run in runs), Counter())
                shares[song] = of_song["clamped"] / of_song["all"]
                total += of_song
            worst = max(shares, key=shares.get)
            limits = sorted(((count, *limit) for limit, count in total.items() if isinstance(limit, tuple)), reverse=True)
            by_limit = "; ".join(f"{joint}, {limit}: {count}" for count, joint, limit in limits) or "–"
            print(
                f"| `{truth}` | {mode} | {total['clamped']} of {total['all']}, {100 * total['clamped'] / total['all']:.2f} % "
                f"| {worst}, {100 * shares[worst]:.2f} % | {by_limit} |",
                flush=True,
            )


if __name__ == "__main__":
    main()

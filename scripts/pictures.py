"""The film and the picture of README and book, from the shipped policies: `make pictures`.

Needs ffmpeg, Chromium and the packages of viewer/ (npm ci). ETUDE names the program, by default
target/release/etude.
"""

import json
import os
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ETUDE = os.environ.get("ETUDE", str(ROOT / "target/release/etude"))
IMAGES = ROOT / "docs/images"
# Time of the picture of Ode to Joy, s.
PICTURE_SECS = 8.2


def run(*command):
    return subprocess.run([str(word) for word in command], cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout


def perform(song, folder):
    """Plays a song; gives its sound and its replay page."""
    report = json.loads(run(ETUDE, "play", song, "-o", folder / song, "--json"))
    print(f"{song}: {report['matched']} notes right, {report['missed']} missed, {report['wrong']} wrong, F1 {report['f1']:.3f}")
    page = folder / f"{song}.html"
    run(ETUDE, "replay", report["files"]["recording"], "-o", page)
    return report["files"]["wav"], page


with tempfile.TemporaryDirectory() as folder:
    wav, page = perform("twinkle", Path(folder))
    run("node", "viewer/film.mjs", page, wav, IMAGES / "twinkle")
    _, page = perform("ode-to-joy", Path(folder))
    run("node", "viewer/picture.mjs", page, PICTURE_SECS, IMAGES / "replay.png")
print(f"Look at twinkle.mp4, twinkle.webp and replay.png in {IMAGES}")

"""Writes MIDI files that do not come with Étude: folk songs of the Essen collection, from the package music21.

They are the first three songs, or COUNT, of the collection's file altdeu10 that last at most 40 crotchets, at 100 crotchets a minute; nobody has
chosen them by how they are played. The files are not kept in the repository.

    pip install --target FOLDER music21==10.5.1
    PYTHONPATH=FOLDER python3 scripts/outside_songs.py OUT [COUNT]
"""

import sys
from pathlib import Path

from music21 import corpus, tempo
from music21.exceptions21 import StreamException

LONGEST = 40


def main(out: Path, songs: int) -> None:
    out.mkdir(parents=True, exist_ok=True)
    short = [score for score in corpus.parse("essenFolksong/altdeu10").scores if score.duration.quarterLength <= LONGEST]
    written = 0
    for score in short:
        if written == songs:
            break
        for mark in list(score.recurse().getElementsByClass(tempo.TempoIndication)):
            mark.activeSite.remove(mark)
        score.parts[0].insert(0, tempo.MetronomeMark(number=100))
        title = score.metadata.title.lower().replace(" ", "-")
        path = out / f"{title}-{score.metadata.number}.mid"
        try:
            score.write("midi", fp=path)
        except StreamException as error:
            print(f"{path.stem} is left out, because music21 cannot write it: {error}", file=sys.stderr)
            continue
        written += 1
        print(path, f"{len(score.flatten().notes)} notes")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 3)

"""A run that is killed again and again (SIGKILL at random moments, while it writes as well) and resumed each time.

Checks that each time it goes on from a checkpoint, that none loses more than a checkpoint period, and that in the end the results
are those of a run that was left alone, bit for bit. Prints the numbers.

    python3 -m benchmarks.kills [--kills 50] [--period 0.3] [--ranks 1]

On several ranks one of them is killed, and mpirun ends the others.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.peers.common import ENVIRONMENT, PLAIN
from bridge.checkpoint import NAME

ROOT = Path(__file__).resolve().parents[1]
SCENE = ("--assembly", "A", "--displacement", "0.02", "--substeps", "10", "--no-figures", "--samples", "200")
SLACK = 2.0  # s: longest time between two looks at the clock and of writing, on a busy machine


@dataclass
class Found:
    """What came of the kills."""

    kills: int
    largest_loss: float  # wall time of the run between a checkpoint and the kill, s
    while_writing: int  # kills that left a file half written
    same: bool  # results and histories are those of the undisturbed run


def start(ranks, *options):
    """A run of the foundation on so many ranks, begun."""
    launcher = [] if ranks == 1 else ["mpirun", "-n", str(ranks)]
    command = [*launcher, sys.executable, "-m", "studies", "foundation", "--quiet", *map(str, options)]
    # mpirun reports a rank that was killed; what it says is not wanted here
    return subprocess.Popen(command, cwd=ROOT, env=PLAIN | ENVIRONMENT, stderr=subprocess.DEVNULL if ranks > 1 else None)


def finish(process):
    """Wait for a run that nobody kills."""
    if process.wait():
        raise subprocess.CalledProcessError(process.returncode, process.args)


def kill(process, ranks, draw):
    """Kill a run, or one of its ranks."""
    if ranks == 1:
        process.kill()
        return
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    if children:
        os.kill(int(draw.choice(children)), signal.SIGKILL)


def results(folder):
    """What must not depend on the kills."""
    summary = json.loads((folder / "summary.json").read_text())
    del summary["results"]["total_time"]
    fields = {file.name: file.read_bytes() for file in sorted((folder / "fields").iterdir())}
    return summary["results"], summary["energy"], (folder / "history.csv").read_bytes(), fields


def first_written(folder, process):
    """Wait until a run writes its first checkpoint; the time (s since the epoch)."""
    partial, path = folder / f".{NAME}.partial", folder / NAME
    partial.unlink(missing_ok=True)
    since = path.stat().st_mtime if path.exists() else 0.0
    while process.poll() is None and not partial.exists() and not (path.exists() and path.stat().st_mtime > since):
        time.sleep(0.002)
    return time.time()


def survive(folder, number, period, seed=0, ranks=1, say=lambda words: None):
    """Kill a run `number` times, up to three periods after it began to write its first checkpoint; see `Found`."""
    draw = random.Random(seed)
    scene = (*SCENE, "--step-ratio", 0.003 / number)  # 34,000 particle steps, a second, for each kill
    alone, killed = folder / "alone", folder / "killed"
    finish(start(ranks, *scene, "--checkpoint-every", 0, "--output", alone))
    options: tuple = (*scene, "--output", killed)
    kills, loss, writing = 0, 0.0, 0
    while kills < number:
        process = start(ranks, *options, "--checkpoint-every", period)
        first = first_written(killed, process)
        time.sleep(draw.uniform(0.0, 3.0 * period) if draw.random() < 0.7 else 0.0)
        if process.poll() is None:
            kill(process, ranks, draw)
            at = time.time()
            kills += 1
        if process.wait() == 0 or (killed / "summary.json").exists():  # done, or killed when all was written
            break
        written = (killed / NAME).stat().st_mtime if (killed / NAME).exists() else 0.0
        loss = max(loss, at - max(written, first - period))  # the first is due a period after the steps began
        if written:
            options = ("--resume", killed)
        writing += (killed / f".{NAME}.partial").exists()
        say(f"kill {kills}: {loss:.2f} s lost at most, {writing} while writing")
    if not (killed / "summary.json").exists():
        finish(start(ranks, *options))
    return Found(kills, loss, writing, results(alone) == results(killed))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--period", type=float, default=0.3, help="seconds between checkpoints")
    parser.add_argument("--ranks", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = survive(Path(folder), options.kills, options.period, ranks=options.ranks, say=lambda words: print(words, flush=True))
    print(found)
    if not (found.same and found.largest_loss < options.period + SLACK):
        sys.exit("the run did not survive")


if __name__ == "__main__":
    main()

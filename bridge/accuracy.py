"""Speed against error: runs at many settings, measured against a reference run."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class Curve(NamedTuple):
    """What is compared: a response over a control (load over displacement), and what it cost."""

    control: np.ndarray
    response: np.ndarray
    seconds: float
    balance_error: float


class Score(NamedTuple):
    """One setting against the reference; errors are shares of the reference's peak, with a sign where it tells something."""

    name: str
    peak: float
    peak_error: float
    curve_error: float  # root mean square over the control
    balance_error: float  # of the energy, share of the external work
    seconds: float
    speed_up: float


def score(name: str, curve: Curve, reference: Curve) -> Score:
    """Measure a curve against the reference, at the curve's own samples (interpolated in the reference).

    Raises:
        ValueError: the curve ends before the reference does.
    """
    if curve.control[-1] < reference.control[-1] * (1.0 - 1e-6):
        raise ValueError(
            f"the run {name} ends at {curve.control[-1]:g}, before its reference at {reference.control[-1]:g}"
        )
    peak = float(reference.response.max())
    difference = curve.response - np.interp(curve.control, reference.control, reference.response)
    return Score(
        name, float(curve.response.max()), float(curve.response.max()) / peak - 1.0,
        float(np.sqrt(np.mean(difference**2))) / peak, curve.balance_error, curve.seconds,
        reference.seconds / curve.seconds if curve.seconds > 0.0 else np.inf,
    )  # fmt: skip


def as_text(scores: Sequence[Score], peak_unit: str = "kN", peak_factor: float = 1e-3) -> str:
    """The scores as a table, the reference first."""
    width = max(len(score.name) for score in scores)
    lines = [
        f"{'setting':{width}s} {'peak/' + peak_unit:>10s} {'peak error':>11s} {'curve rms':>10s} {'balance':>9s} "
        f"{'seconds':>8s} {'speed-up':>9s}"
    ]
    for s in scores:
        lines.append(
            f"{s.name:{width}s} {peak_factor * s.peak:10.1f} {100 * s.peak_error:10.2f}% {100 * s.curve_error:9.2f}% "
            f"{s.balance_error:9.1e} {s.seconds:8.2f} {s.speed_up:9.1f}"
        )
    return "\n".join(lines) + "\n"


def as_csv(scores: Sequence[Score], settings: Sequence[dict[str, Any]]) -> str:
    """The scores as CSV, with the settings that lead to them."""
    names = list(dict.fromkeys(name for setting in settings for name in setting))
    buffer = io.StringIO()
    writer = csv.writer(buffer)
    writer.writerow([*Score._fields, *names])
    for one, setting in zip(scores, settings, strict=True):
        numbers = [format(value, ".6g") for value in one[1:]]
        writer.writerow([one.name, *numbers, *(setting.get(name, "") for name in names)])
    return buffer.getvalue()


MARKERS = "osD^vP*X"
FEW = 20  # settings up to which each has a number and a line in the legend


def plot(scores: Sequence[Score], kinds: Sequence[Sequence[str]], title: str, path: Path) -> None:
    """Errors over speed-up, a point a setting.

    Args:
        scores: Without the reference.
        kinds: Three words for each score, for instance region, variant and moduli: where there are many settings, they
            decide colour, marker and filling of a point.
        title: Of the figure.
        path: Of the PNG.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(12.5, 5.2), layout="constrained")
    FigureCanvasAgg(drawn)
    axes = drawn.subplots(1, 3, width_ratios=(1.0, 1.0, 0.45))
    for ax, label, errors in (
        (axes[0], "error of the peak (%)", [100 * abs(one.peak_error) for one in scores]),
        (axes[1], "rms error of the curve (% of the peak)", [100 * one.curve_error for one in scores]),
    ):
        for one, error, style in zip(scores, errors, _styles(len(scores), kinds)):
            ax.loglog(one.speed_up, max(error, 1e-2), ls="none", ms=7, **style)
        if len(scores) <= FEW:
            for number, (one, error) in enumerate(zip(scores, errors), 1):
                place = (one.speed_up, max(error, 1e-2))
                ax.annotate(str(number), place, xytext=(5, 4), textcoords="offset points", fontsize=8)
        ax.set(xlabel="times faster than the reference", ylabel=label)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("{x:g}")
        ax.tick_params(which="minor", labelsize=6)
        ax.grid(alpha=0.3, which="both")
    axes[2].axis("off")
    if len(scores) <= FEW:
        lines = axes[0].get_lines()
        names = [f"{number} {one.name}" for number, one in enumerate(scores, 1)]
    else:
        lines, names = _legend(axes[2], kinds)
    axes[2].legend(lines, names, loc="center left", fontsize=7)
    drawn.suptitle(title, fontsize=11)
    drawn.savefig(path, dpi=130)


def _styles(count: int, kinds: Sequence[Sequence[str]]) -> list[dict[str, Any]]:
    """Colour, marker and filling of each point."""
    if count <= FEW:
        return [{"color": f"C{k % 10}", "marker": MARKERS[k // 10]} for k in range(count)]
    words = [list(dict.fromkeys(column)) for column in zip(*kinds)]
    return [
        {
            "color": f"C{words[0].index(one) % 10}", "marker": MARKERS[words[1].index(two) % len(MARKERS)],
            "mfc": "none" if words[2].index(three) else None, "alpha": 0.8,
        }
        for one, two, three in kinds
    ]  # fmt: skip


def _legend(ax: Any, kinds: Sequence[Sequence[str]]) -> tuple[list[Any], list[str]]:
    """A line for each word: what its colour, marker or filling means."""
    colours, markers, fillings = (list(dict.fromkeys(column)) for column in zip(*kinds))
    looks: list[tuple[str, dict[str, Any]]]
    looks = [(word, {"color": f"C{k % 10}", "marker": "o"}) for k, word in enumerate(colours)]
    looks += [(word, {"color": "0.3", "marker": MARKERS[k % len(MARKERS)]}) for k, word in enumerate(markers)]
    looks += [(word, {"color": "0.3", "marker": "o", "mfc": "none" if k else None}) for k, word in enumerate(fillings)]
    return [ax.plot([], [], ls="none", ms=7, **look)[0] for _, look in looks], [word for word, _ in looks]

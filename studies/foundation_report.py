"""A run's numbers as text."""

from __future__ import annotations

from pathlib import Path

from studies.foundation_run import Finished

ROWS = {
    "peak_load": ("peak load", 1e-3, "kN", "10.1f"), "peak_displacement": ("  at displacement", 1e3, "mm", "10.2f"),
    "load": ("load at the end", 1e-3, "kN", "10.1f"),
    "min_volumetric_stress": ("min volumetric stress", 1e-6, "MPa", "10.4f"),
    "max_effective_stress": ("max effective stress", 1e-6, "MPa", "10.4f"),
    "min_volumetric_strain": ("min volumetric strain", 1.0, "", "10.5f"),
    "max_effective_strain": ("max effective strain", 1.0, "", "10.4f"), "total_time": ("total time", 1.0, "s", "10.2f"),
    "growth_rate": ("growth of the scheme", 1.0, "1/s", "10.3g"),
}  # fmt: skip


def number(name: str, value: float | None) -> str:
    """A result in the report's unit, right-aligned in ten columns; a dash for None."""
    _, factor, _, form = ROWS[name]
    return f"{'-':>10s}" if value is None else format(factor * value, form)


def report(done: Finished, folder: Path | None) -> str:
    """What the command prints after a run."""
    s = done.summary
    counts = ", ".join(f"{value} {name.replace('_', ' ')}" for name, value in s["counts"].items())
    lines = [f"foundation, {s['method']}: {counts}", f"{'':24s}{'':>4s}{'here':>10s}{'published':>12s}"]
    for name, entry in s["results"].items():
        title, _, unit, _ = ROWS[name]
        lines.append(f"{title:24s}{unit:>4s}{number(name, entry['value'])}{number(name, entry['published']):>12s}")
    lines.append(f"energy balance error {s['energy']['balance_error']:.2e} of the external work")
    seconds = ", ".join(f"{name} {value:.2f}" for name, value in s["seconds"].items())
    lines.append(f"seconds: {seconds}")
    if folder is not None:
        lines.append(f"results in {folder}")
    return "\n".join(lines)

"""Picture of a calibration: the dimensionless relations, each run, and the result."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib
import numpy as np

from studies import drawing
from studies.calibration import Calibrated, Relations

LABELS = ("E / k$_n$", "Poisson's ratio", "σ$_c$ r / R$_n$", "σ$_t$ r / R$_n$")
PUBLISHED = (0.2, (18000e6 / 1.61129e10, 0.20, 1.49))  # k_t / k_n and its values in Rojek & Onate (2007)


def draw(relations: Relations, result: Calibrated, checked: np.ndarray, path: Path) -> None:
    """Relations against k_t / k_n (Rojek & Onate 2007, figs 11 and 12), a colour for each R_t / R_n."""
    panels = relations.values.shape[-1]
    drawn, axes = drawing.figure(1, panels, (3.9, 3.4))
    line = np.geomspace(relations.stiffness_ratios[0], relations.stiffness_ratios[-1], 100)
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, len(relations.strength_ratios)))
    for j, (strength, colour) in enumerate(zip(relations.strength_ratios, colours)):
        curve = _plain(np.array([relations(ratio, strength) for ratio in line]))
        runs = _plain(relations.values[:, j])
        for k, ax in enumerate(axes[0]):
            ax.semilogx(line, curve[:, k], color=colour, lw=1.2, label=f"R$_t$ / R$_n$ = {strength:g}")
            points = np.repeat(np.array(relations.stiffness_ratios)[:, None], runs.shape[1], axis=1)
            ax.semilogx(points, runs[..., k], ".", color=colour, ms=4)
    shift = np.array([math.log(result.micro.normal_stiffness), 0.0] + 2 * [math.log(result.micro.bond_strength / relations.radius)])
    for k, ax in enumerate(axes[0]):
        for y, mark, label in ((result.measured, "D", "result"), (checked, "s", "check, other packings")):
            values = _plain(y - shift[:panels])[:, k]
            spread = values.std(ddof=1) if len(values) > 1 else 0.0
            ax.errorbar(result.micro.stiffness_ratio, values.mean(), spread, fmt=mark, color="#c1272d", mfc="white", capsize=3, label=label)
        if k < len(PUBLISHED[1]):
            ax.semilogx(PUBLISHED[0], PUBLISHED[1][k], "x", color="k", label="Rojek & Onate 2007, calibrated")
        ax.set(xlabel="k$_t$ / k$_n$", ylabel=LABELS[k], xticks=relations.stiffness_ratios)
        ax.set_xticklabels([f"{ratio:g}" for ratio in relations.stiffness_ratios])
        ax.minorticks_off()
        ax.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=7)
    drawing.save(drawn, path)


def _plain(y: np.ndarray) -> np.ndarray:
    """Responses without logarithms."""
    return np.concatenate([np.exp(y[..., :1]), y[..., 1:2], np.exp(y[..., 2:])], axis=-1)

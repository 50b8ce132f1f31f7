"""Couplings of continuum and particles, the run and what it leaves behind."""

from pathlib import Path

import particles
from particles.caches import drop_stale

drop_stale(Path(__file__).parent, Path(particles.__file__).parent)

from bridge.bridging_scale import BridgingScale  # noqa: E402
from bridge.growth import Growth, growth  # noqa: E402
from bridge.layout import Layout, nested_layout  # noqa: E402
from bridge.overlap import Overlap, OverlapZone  # noqa: E402

__all__ = ["BridgingScale", "Growth", "Layout", "Overlap", "OverlapZone", "growth", "nested_layout"]

"""Couplings of continuum and particles, the run and what it leaves behind."""

from bridge.bridging_scale import BridgingScale
from bridge.growth import Growth, growth
from bridge.layout import Layout, nested_layout

__all__ = ["BridgingScale", "Growth", "Layout", "growth", "nested_layout"]
